"""The league: a loop whose margins are known, the same numbers as a run of the loop, work that is resumed, and wrong names."""

import datetime
import json
import math
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu

# An integrator, y' = a u, and a proportional controller: the loop's only frequency is the gain.
PLANT = """
name = "Integrator"
model = "state-space"
description = "y' = a u"
[structure]
A = [[0.0]]
B = [[1.0]]
C = [[1.0]]
"""
CONTROLLER = """
name = "Proportional"
model = "pid"
description = "u = K_p (r - y)"
[structure]
channels = 1
[start]
K_p = [{gain}]
K_i = [0.0]
K_d = [0.0]
"""
REFERENCE = """
name = "Cosine"
model = "reference"
description = "A cosine"
[structure]
channels = 1
[start]
cosine_amplitude = [1.0]
cosine_frequency = [0.5]
"""
STUDY = """
title = "An integrator <alone>"
about = "Margins that are known."
[budget]
particles = 2
generations = 1
noises = 1
tuning_time = 2.0
plants = 8
{budget}
[[advice]]
when = "always"
take = "p"
because = "it bears {{integrator/p.dead_time}} s"
holds = ["integrator/p.dead_time > 0.05", "integrator/p.failed < 0.5"]
[[advice]]
when = "sometimes"
[[advice.within]]
when = "never"
take = "p"
because = "it bears {{integrator/p.dead_time}} s"
holds = ["integrator/p.dead_time > 1"]
[[plant]]
name = "integrator"
title = "An integrator"
unit = "Integrator.toml"
reference = "Cosine.toml"
duration = 20.0
step = 0.002
settled = 5.0
errors = [["plant.y[1]", "reference.r[1]"]]
error_limits = [0.9]
envelope = 1e3
uncertain = ["B"]
payload = {{ "plant.B[1,1]" = {{ times = 0.7 }} }}
pulse = {{ "actuator.bias[1]" = 0.5 }}
[plant.bench]
u_min = [-20.0]
u_max = [20.0]
lag = 0.01
noise = {{ y = 1e-3 }}
[[plant.controller]]
name = "p"
unit = "Proportional.toml"
{tune}
"""


def study(folder: Path, gain: float = 10.0, tune: str = "", budget: str = "") -> Path:
    """A study in a folder, with the descriptions of its units beside it."""
    folder.mkdir(exist_ok=True)
    (folder / "Integrator.toml").write_text(PLANT)
    (folder / "Proportional.toml").write_text(CONTROLLER.format(gain=gain))
    (folder / "Cosine.toml").write_text(REFERENCE)
    file = folder / "study.toml"
    file.write_text(STUDY.format(tune=tune, budget=budget))
    return file


def league(*words: str | Path) -> list[dict]:
    answer = adaptive_fmu("league", *words, "--json")
    assert answer.returncode == 0, answer.stderr
    return json.loads(answer.stdout)["pairs"]


def bears(gain: float, dead_time: float, nominal: bool = False) -> bool | tuple[float, float]:
    """Whether y' = k (r - y) behind a dead time tracks, by Euler's method; nominally its control's variation and peak."""
    span, step = 1e-4, 0.002
    times = np.arange(0.0, 20.0, span)
    delayed, every = round(dead_time / span), round(step / span)
    y, u = np.zeros(len(times)), np.zeros(len(times))
    for k, time in enumerate(times):
        u[k] = gain * (math.cos(0.5 * time) - y[k])
        if k + 1 < len(times):
            # Before the start the control is taken as what it was there.
            y[k + 1] = y[k] + span * u[max(k - delayed, 0)]
        if abs(y[k]) > 1e3:
            return False
    variation, peak = np.abs(np.diff(u[::every])).sum() / 20.0, np.abs(u).max()
    if nominal:
        return variation, peak
    calm, high = bears(gain, 0.0, nominal=True)
    error = np.abs(np.cos(0.5 * times) - y)[times >= 5.0].max()
    return bool(error <= 0.9 and variation <= 3.0 * calm + 0.1 * high)


@pytest.mark.parametrize("gain", [6.0, 10.0, 25.0])
def test_margins_are_those_of_another_simulation_and_of_theory(tmp_path: Path, gain: float) -> None:
    """k/s bears a dead time of pi/2k at most, any gain and any lag; the control counts as lost earlier, where it swings long."""
    (record,) = league("--study", study(tmp_path, gain), "--out", tmp_path / "out")
    margins = record["margins"]
    dead_time = margins["dead_time"]["value"]
    assert margins["dead_time"]["bound"] == "within" and dead_time < math.pi / 2 / gain
    assert bears(gain, dead_time / 1.02) and not bears(gain, 1.07 * dead_time), margins
    assert margins["gain"]["bound"] == "at_least", margins
    # A lag makes the loop swing, the longer the larger gain times lag is: here that counts from 3.5 on, and .3 s is the longest.
    assert margins["lag"]["bound"] == ("at_least" if gain < 12.0 else "within") and margins["lag"]["value"] * gain > 1.5, margins
    # Stepped at once, the next y is y less k H times the y before it: lost from k H = 1 on, and swings long before.
    assert 0.6 < margins["step"]["value"] * gain < 1.0, margins
    # A plant that is .7 of what it should be is one whose gain is .7.
    for condition, factor in [("nominal", 1.0), ("payload", 0.7), ("larger", 1.3), ("smaller", 0.7)]:
        rms = record["conditions"][condition]["outcome"]["rms"][0]
        assert rms == pytest.approx(settled_error(factor * gain), rel=0.01), condition


def settled_error(gain: float) -> float:
    """The root mean square of e = s/(s + k) r, from 5 to 20 s."""
    times, response = np.linspace(5.0, 20.0, 100_001), 0.5j / (0.5j + gain)
    return float(np.sqrt(np.mean((response * np.exp(0.5j * times)).real ** 2)))


def test_a_nominal_run_is_that_of_the_loop(tmp_path: Path) -> None:
    """The linear limit of the robot's controller has the numbers that the loop has, which were found independently."""
    text = (ROOT / "examples" / "league" / "league.toml").read_text()
    start = text.index('[[plant]]\nname = "robot"')
    plant = text[start : text.index("[[plant.controller]]", start)]
    entry = '[[plant.controller]]\nname = "l1-limit"\nunit = "L1LimitTwoLinkRobot"\n'
    budget = "[budget]\nparticles = 1\ngenerations = 1\nnoises = 1\nplants = 2\nmargin = 2.0\nrelative_tolerance = 1e-5\n"
    file = tmp_path / "study.toml"
    file.write_text(f'title = "One"\nabout = ""\n{budget}{plant}{entry}')
    (record,) = league("--study", file, "--out", tmp_path / "out")
    outcome = record["conditions"]["nominal"]["outcome"]
    assert outcome["rms"] == pytest.approx([0.024851, 0.022633], rel=1e-3)
    assert outcome["peak"] == pytest.approx([113.44, 88.86], rel=2e-3)
    assert record["as_one"] and record["gains"]["values"] == {}


def test_what_was_computed_is_not_computed_again(tmp_path: Path) -> None:
    file, out = study(tmp_path, tune='tune = ["K_p"]'), tmp_path / "out"
    first = league("--study", file, "--out", out)
    stored = out / "integrator" / "p.json"
    # Without its last part it is gone on with; the same plants give the same numbers.
    written = stored.stat().st_mtime_ns
    for again in ([], ["--resume"]):
        assert league("--study", file, "--out", out, *again) == first and stored.stat().st_mtime_ns == written
    shutil.copytree(out, tmp_path / "copy")
    assert league("--study", file, "--out", tmp_path / "copy", "--page") == first
    assert league("--study", file, "--out", tmp_path / "again", "--jobs", "1") == first, "on any number of threads"
    # Another study is another question.
    other = study(tmp_path, tune='tune = ["K_p"]', budget="seed = 2")
    answer = adaptive_fmu("league", "--study", other, "--out", out)
    assert answer.returncode == 1 and "belongs to another study: budget.seed was 1, is 2; --force" in answer.stderr, answer.stderr
    answer = adaptive_fmu("league", "--study", other, "--out", out, "--quick")
    assert answer.returncode == 1 and "budget.plants was 8, is" in answer.stderr, answer.stderr
    tagged = league("--study", other, "--out", out, "--quick", "--tag", "seed=2")
    assert tagged != first and (tmp_path / "out@seed=2" / "index.html").is_file() and stored.stat().st_mtime_ns == written
    assert league("--study", other, "--out", tmp_path / "copy", "--quick", "--force") == tagged
    (other.parent / "Proportional.toml").write_text(CONTROLLER.format(gain=11.0))
    study_of_before = tmp_path / "study.toml"
    study_of_before.write_text(STUDY.format(tune='tune = ["K_p"]', budget=""))
    answer = adaptive_fmu("league", "--study", study_of_before, "--out", out)
    assert answer.returncode == 1 and "descriptions of its FMUs differ" in answer.stderr, answer.stderr
    # A file that was changed is no result.
    stored.write_text(stored.read_text().replace('"failure":null', '"failure": null', 1))
    answer = adaptive_fmu("league", "--study", file, "--out", out, "--page")
    assert answer.returncode in (0, 1)


def test_gains_are_better_after_the_search_or_stay(tmp_path: Path) -> None:
    file = study(tmp_path, gain=2.0, tune='tune = ["K_p"]', budget="")
    file.write_text(file.read_text().replace("particles = 2\ngenerations = 1", "particles = 6\ngenerations = 4"))
    (record,) = league("--study", file, "--out", tmp_path / "out")
    gains = record["gains"]
    assert gains["after"] < 0.5 * gains["before"] and gains["runs"] == 24
    (value,) = gains["values"].values()
    assert 2.0 < value <= 10.0 + 1e-9, "within five times what it was"


def test_the_page_loads_nothing_and_judges_its_advice(tmp_path: Path) -> None:
    league("--study", study(tmp_path), "--out", tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    assert "An integrator &lt;alone&gt;" in page and "<script" not in page and "http://" not in page
    assert "default-src 'none'" in page
    always, sometimes, never = re.findall("<li>(?:always|sometimes|never):.*\n(?:<ul.*)?", page)
    assert "Confirmed" in always and "Not confirmed" in never and "{" not in always, always
    assert sometimes == '<li>sometimes:\n<ul class="tree">', sometimes
    for title in ["nominal", "all together", "Tuned gains", "Method"]:
        assert title in page


def test_a_part_of_a_league_has_no_advice_on_what_was_not_run(tmp_path: Path) -> None:
    file = study(tmp_path)
    text, sometimes = file.read_text(), '[[advice]]\nwhen = "sometimes"\n'
    further = [
        '[[advice]]\nwhen = "other"\ntake = "q"\nbecause = "{integrator/q.failed}"\n',
        '[[advice]]\nwhen = "both"\ntake = "q"\nbecause = ""\nholds = ["integrator/q.failed < integrator/p.failed"]\n',
        '[[advice.within]]\nwhen = "within"\ntake = "p"\nbecause = "{integrator/p.failed}"\n',
        '[[advice]]\nwhen = "only q"\n[[advice.within]]\nwhen = "q"\ntake = "q"\nbecause = "{integrator/q.failed}"\n',
    ]
    controller = text[text.index("[[plant.controller]]") :]
    file.write_text(text.replace(sometimes, "".join(further) + sometimes) + controller.replace('"p"', '"q"', 1))
    answer = adaptive_fmu("league", "--study", file, "--out", tmp_path / "out", "--only", "integrator/p", "--quick", "--json")
    lines = json.loads(answer.stdout)["advice"]
    assert [(line["when"], line["take"], len(line["within"])) for line in lines] == [
        ("always", "p", 0),
        ("both", "", 1),
        ("sometimes", "", 1),
    ]
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<li>both:\n" in page and "within" in page and "<li>other" not in page and "Not known" not in page


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"plant.y[1]", "ref', '"plant.z[1]", "ref', "no output `plant.z[1]`"),
        ('uncertain = ["B"]', 'uncertain = ["Q"]', "no parameter `Q`"),
        ("noise = { y = ", "noise = { speed = ", "no output `speed`"),
        ('"actuator.bias[1]"', '"actuator.bias[2]"', "no variable `actuator.bias[2]`"),
        ('name = "p"', 'name = "p/q"', "a name must consist of letters, digits"),
        ("error_limits = [0.9]", "error_limits = [0.9, 1.0]", "1 errors and 2 error_limits"),
        ("u_min = [-20.0]", "u_min = [20.0]", "each u_min below its u_max"),
        ("settled = 5.0", "settled = 25.0", "settled < duration"),
        ('unit = "Integrator.toml"', 'unit = "Integrators.toml"', "Integrators.toml"),
        ("plants = 8", "plants = 0", "must be at least 1"),
        ("plants = 8", "planets = 8", "unknown field `planets`"),
        ("[[plant.controller]]\nname", '[[plant.controller]]\ntune = ["k_p"]\nname', "no parameter `k_p`; did you mean"),
        ("[[plant.controller]]\nname", '[[plant.controller]]\ntune = ["K_i"]\nname', "`K_i` is 0, so scaling does not change it"),
        ("integrator/p.dead_time > 1", "integrator/p.deadtime > 1", "no quantity `deadtime`"),
        ('when = "always"\ntake = "p"', 'when = "always"', "when `always`: `take` is empty"),
        ("step = 0.002", 'step = 0.002\nfault = { "plant.C" = 0.0 }', "no variable `plant.C`"),
    ],
)
def test_what_is_wrong_with_a_study_is_reported_before_anything_runs(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = study(tmp_path)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    answer = adaptive_fmu("league", "--study", file, "--out", tmp_path / "out")
    assert answer.returncode == 1 and message in answer.stderr, answer.stderr
    assert not (tmp_path / "out" / "integrator").exists(), "nothing was computed"


def test_all_pairs_of_the_league_can_be_wired() -> None:
    """Each with gains to search, as one unit but where a part is made of parts itself: those that the documentation names."""
    pairs = league("--list")
    study = tomllib.loads((ROOT / "examples" / "league" / "league.toml").read_text())
    entries = [(plant["name"], entry["name"], entry["tune"]) for plant in study["plant"] for entry in plant["controller"]]
    assert [(pair["plant"], pair["controller"]) for pair in pairs] == [entry[:2] for entry in entries]
    for pair, (plant, law, tune) in zip(pairs, entries, strict=True):
        # A name is that of a parameter, or of all its elements.
        names = {name for names in tune for name in names.split()}
        found = {gain.removeprefix("controller.").split("[")[0] for gain in pair["gains"]}
        assert found == {name.split("[")[0] for name in names}, pair
        is_separate = (plant == "quadrotor" and law != "l1") or (plant, law) == ("twin-rotor", "funnel")
        assert pair["as_one"] is not is_separate, pair
    answer = adaptive_fmu("league", "--list", "--only", "/pid")
    assert answer.returncode == 0 and len(answer.stdout.splitlines()) == len(study["plant"]), answer.stdout


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What is kept of this package's league, as the program reads it."""
    folder = tmp_path_factory.mktemp("league") / "league"
    shutil.copytree(ROOT / "site" / "league", folder)
    study = ROOT / "examples" / "league" / "league.toml"
    answer = adaptive_fmu("league", "--page", "--study", study, "--out", folder, "--json")
    assert answer.returncode == 0 and "is ignored" not in answer.stderr, answer.stderr
    return json.loads(answer.stdout)


def test_results_are_stored_for_all_pairs(results: dict) -> None:
    study = tomllib.loads((ROOT / "examples" / "league" / "league.toml").read_text())
    pairs = [f"{plant['name']}/{entry['name']}" for plant in study["plant"] for entry in plant["controller"]]
    assert f"All {len(pairs)} pairs" in (ROOT / "docs" / "league.md").read_text()
    assert [f"{record['plant']}/{record['controller']}" for record in results["pairs"]] == pairs
    for record in results["pairs"]:
        assert all(record[part] is not None for part in ["gains", "conditions", "margins", "spread"]), record["plant"]
        assert len(record["spread"]["errors"]) == 100


def test_advice_is_confirmed_and_the_same_everywhere(results: dict) -> None:
    """Each branch of the tree holds by the results; the documentation has the tree of the page, with the numbers."""

    def tree(lines: list[dict], indent: str) -> Iterator[str]:
        for line in lines:
            assert line["holds"] is True, line
            yield f"{indent}- {line['when']}: " + (f"**{line['take']}** – {line['because']}." if line["take"] else "")
            yield from tree(line["within"], indent + "    ")

    printed = [line.rstrip() for line in tree(results["advice"], "")]
    assert len(printed) >= 12
    assert "\n".join(printed) in (ROOT / "docs" / "league.md").read_text()


def test_the_readme_quotes_the_results(results: dict) -> None:
    records = {f"{record['plant']}/{record['controller']}": record for record in results["pairs"]}

    def lost(law: str) -> int:
        return sum(error is None for error in records[f"siso/{law}"]["spread"]["errors"])

    def median(law: str) -> float:
        return sorted(records[f"robot/{law}"]["spread"]["errors"])[49]

    sentences = (
        f"active disturbance rejection had a median error {median('l1') / median('ladrc'):.0f} times smaller than L1's on the two-link "
        f"robot, whose actuators have room; it was given the reference's derivatives. On example 3.2.1, whose actuator range is tight, "
        f"it failed on {lost('ladrc')} of the {len(records['siso/ladrc']['spread']['errors'])} plants, PID on {lost('pid')}, and L1 "
        f"on {lost('l1')}."
    )
    assert sentences in " ".join((ROOT / "README.md").read_text().split()), sentences


def test_l1_compared_with_its_linear_limit_is_as_documented(results: dict) -> None:
    """Medians of 100 plants; the order statistics 40 and 61 bound them."""
    records = {f"{record['plant']}/{record['controller']}": record for record in results["pairs"]}

    def median(pair: str) -> tuple[float, float, float]:
        errors = sorted(math.inf if error is None else error for error in records[pair]["spread"]["errors"])
        return errors[39], errors[49], errors[60]

    for plant in ["siso", "unmatched", "robot", "quadrotor", "chapter-4"]:
        (low, _, high), (low_of_limit, _, high_of_limit) = median(f"{plant}/l1"), median(f"{plant}/l1-limit")
        assert low <= high_of_limit and low_of_limit <= high, plant
    for plant, percent in [("vehicle", 3), ("coupled", 8)]:
        own, limit = median(f"{plant}/l1"), median(f"{plant}/l1-limit")
        assert own[0] > limit[2], plant
        assert round(100 * (own[1] / limit[1] - 1)) == percent, plant
    page = " ".join((ROOT / "docs" / "league.md").read_text().split())
    assert "on the vehicle `l1` is 3 % behind, on 6.5.1 8 %." in page


def test_the_quadrotors_rotors_keep_their_limits_whoever_controls(results: dict) -> None:
    """On the bench no control is beyond what four rotors give, which some controllers ask for where nothing limits them."""
    records = {record["controller"]: record["conditions"] for record in results["pairs"] if record["plant"] == "quadrotor"}
    assert len(records) == 6
    thrust = 4 * 3.75
    # Roll by two rotors that differ by all of 3.75 N, at an arm of 0.225 m; yaw by two pairs that do, at 0.038 m.
    most = [thrust, 0.225 * 3.75, 0.225 * 3.75, 0.038 * 2 * 3.75]
    for law, conditions in records.items():
        outcome = conditions["bench"]["outcome"]
        assert outcome["failure"] is None, law
        assert all(peak <= limit * (1 + 1e-9) for peak, limit in zip(outcome["peak"], most, strict=True)), (law, outcome["peak"])
        # At 4.905 N, the weight, two rotors that rest leave less yaw; only with more thrust there is more.
        assert outcome["peak"][3] <= 0.038 * min(outcome["peak"][0], thrust - 4.905) * (1 + 1e-9), law
    assert max(conditions["nominal"]["outcome"]["peak"][3] for conditions in records.values()) > 0.3


def test_plain_mrac_is_as_documented(results: dict) -> None:
    """The gains that the search found, the margins, and the largest torques of the nominal robot."""
    records = {f"{record['plant']}/{record['controller']}": record for record in results["pairs"]}
    assert [name for name in records if name.endswith("/mrac")] == ["siso/mrac", "robot/mrac", "coupled/mrac"]
    page = " ".join((ROOT / "docs" / "league.md").read_text().split())
    factors = {plant: dict(records[f"{plant}/mrac"]["gains"]["factors"]) for plant in ["siso", "robot", "coupled"]}
    assert factors["siso"]["adaptation_gain"] == pytest.approx(0.2)
    for plant in ["robot", "coupled"]:
        assert f"{factors[plant]['adaptation_gain']:.2f} times" in page, factors

    def outcome(pair: str, condition: str) -> dict:
        return records[pair]["conditions"][condition]["outcome"]

    for law, end in [("mrac", "N·m"), ("l1", "with `l1`")]:
        first, second = outcome(f"robot/{law}", "nominal")["peak"]
        assert f"{first:.0f} and {second:.0f} {end}" in page, (law, first, second)
    moved = outcome("siso/mrac", "bench")["variation"][0] / outcome("siso/mrac", "nominal")["variation"][0]
    assert f"moves {moved:.1f} times as much on the bench" in page, moved
    dead_time = {pair: records[pair]["margins"]["dead_time"]["value"] for pair in records}
    assert f"{dead_time['siso/l1'] / dead_time['siso/mrac']:.0f} times longer dead time" in page
    assert round(dead_time["robot/l1"] / dead_time["robot/mrac"], 1) == 2.2 and "on the robot twice as long" in page
    assert round(3 * dead_time["coupled/mrac"] / dead_time["coupled/l1"]) == 4 and "on 6.5.1 `mrac` tolerates a third more" in page

    def median(pair: str) -> float:
        return sorted(math.inf if error is None else error for error in records[pair]["spread"]["errors"])[49]

    for plant, sentence in [("siso", "{} times that of `l1` on 3.2.1"), ("robot", "{} times on the robot"), ("coupled", "{} times on 6.5.1")]:
        assert all(error is not None for error in records[f"{plant}/mrac"]["spread"]["errors"]), plant
        ratio = median(f"{plant}/mrac") / median(f"{plant}/l1")
        assert sentence.format(f"{ratio:.2f}") in page, (plant, ratio)


def test_each_result_has_the_date_of_its_computation(results: dict, tmp_path: Path) -> None:
    dated = {f"{record['plant']}/{record['controller']}": record.get("computed") for record in results["pairs"]}
    new = [pair for pair, day in dated.items() if day is not None]
    assert new == [pair for pair in dated if pair.startswith("quadrotor/") or pair.endswith("/mrac")]
    (record,) = league("--study", study(tmp_path), "--out", tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    day = datetime.date.fromisoformat(record["computed"])
    assert abs(day - datetime.datetime.now(datetime.UTC).date()) <= datetime.timedelta(days=1)
    assert f"computed by version {record['version']} on {day}" in page
    text = " ".join((ROOT / "docs" / "league.md").read_text().split())
    shown = {f"{day.day} {day:%B %Y}" for day in map(datetime.date.fromisoformat, {dated[pair] for pair in new})}
    assert all(day in text for day in shown), shown


def test_a_rotor_that_fails_is_tolerated_as_documented(results: dict) -> None:
    faults = {
        record["controller"]: record["conditions"]["fault"]["outcome"] for record in results["pairs"] if record["plant"] == "quadrotor"
    }
    assert [law for law, outcome in faults.items() if outcome["failure"]] == ["pid"]
    errors = {law: max(outcome["rms"][:2]) for law, outcome in faults.items() if law != "pid"}
    best = sorted(errors, key=errors.get)[:2]
    assert set(best) == {"l1-limit", "l1-sampled"} and all(0.0055 < errors[law] < 0.007 for law in best), errors


@pytest.mark.parametrize("pair", ["siso/ladrc"])
def test_stored_results_are_those_that_are_computed(pair: str, results: dict, tmp_path: Path) -> None:
    """All of a pair that is quick, again: the search, conditions, margins and random plants."""
    (again,) = league("--only", pair, "--out", tmp_path)
    (stored,) = [record for record in results["pairs"] if f"{record['plant']}/{record['controller']}" == pair]
    assert again["gains"]["values"] == pytest.approx(stored["gains"]["values"], rel=1e-3)
    for condition, judged in stored["conditions"].items():
        found, known = again["conditions"][condition]["outcome"], judged["outcome"]
        assert (found["failure"] is None) == (known["failure"] is None), condition
        assert known["failure"] or found["rms"] == pytest.approx(known["rms"], rel=1e-3), condition
    for name, margin in stored["margins"].items():
        assert again["margins"][name]["value"] == pytest.approx(margin["value"], rel=0.05), name
    failed = [sum(error is None for error in record["spread"]["errors"]) for record in (stored, again)]
    assert abs(failed[0] - failed[1]) <= 2, failed


def test_a_tag_ends_the_name_of_a_folder(tmp_path: Path) -> None:
    refused = adaptive_fmu("league", "--list", "--out", ".", "--tag", "x", folder=tmp_path)
    assert refused.returncode == 1 and "but `.` has no name: give a folder with a name" in refused.stderr, refused.stderr


def test_a_pair_that_is_not_there_is_reported_with_near_ones(tmp_path: Path) -> None:
    answer = adaptive_fmu("league", "--only", "robot/pd", "--out", tmp_path / "out")
    assert answer.returncode == 1 and "`robot/pd`" in answer.stderr and "robot/pid" in answer.stderr, answer.stderr


@pytest.mark.slow
def test_dask_computes_what_the_program_computes(tmp_path: Path) -> None:
    """Two workers of its own, and the same results to the last bit; what is there isn't computed again."""
    text = study(tmp_path).read_text()
    second = text[text.index("[[plant.controller]]") :].replace('name = "p"', 'name = "p2"')
    file = tmp_path / "study.toml"
    file.write_text(text + second)
    alone = league("--study", file, "--out", tmp_path / "alone")
    assert [record["controller"] for record in alone] == ["p", "p2"]
    script = [sys.executable, ROOT / "examples" / "robustness_dask" / "league.py", "--workers", "2", "--study", file]
    for _ in range(2):
        command = [*map(str, script), "--out", str(tmp_path / "out")]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "out" / "index.html").read_text() == (tmp_path / "alone" / "index.html").read_text()
        for name in ["p", "p2"]:
            stored = (tmp_path / "out" / "integrator" / f"{name}.json").read_text()
            assert stored == (tmp_path / "alone" / "integrator" / f"{name}.json").read_text()


def test_gains_that_are_better_on_the_nominal_plant_may_lose_more_of_the_others(results: dict, tmp_path: Path) -> None:
    """funnel on 3.2.1 by a search twice as long, as advice says."""
    folder = shutil.copytree(ROOT / "examples" / "league", tmp_path / "league")
    study = folder / "league.toml"
    study.write_text(study.read_text().replace("[budget]", "[budget]\ngenerations = 20", 1))
    (longer,) = league("--study", study, "--only", "siso/funnel", "--out", tmp_path / "out")
    (stored,) = [record for record in results["pairs"] if (record["plant"], record["controller"]) == ("siso", "funnel")]
    assert longer["gains"]["after"] < 0.9 * stored["gains"]["after"]
    lost = [sum(error is None for error in record["spread"]["errors"]) for record in (stored, longer)]
    assert lost[0] <= 5 and 30 <= lost[1] <= 65, lost
