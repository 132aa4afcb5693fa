"""Verification of loops by random samples: verdicts, intervals, samples, failing runs, and what is refused."""

import csv
import json
import re
import shlex
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import NormalDist

import adaptive_fmu as package
import numpy as np
import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu
from sample import ALL, NUMBER
from test_command_line import fails

# One source whose largest output is the magnitude of its offset: the share of failures follows from the limit.
SOURCE = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="known" version="1.0">
  <ssd:System name="loop" description="A source">
    <ssd:Elements>
      <ssd:Component name="source" type="application/x-fmu-sharedlibrary" source="resources/Reference.fmu">
        <ssd:Connectors><ssd:Connector name="r[1]" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors>
      </ssd:Component>
    </ssd:Elements>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0.0" stopTime="0.1"><ssd:Annotations>
    <ssc:Annotation type="adaptive-fmu.closed-loop"><ClosedLoop name="known">
      <Master step="0.1" order="jacobi"/>
      <Metric label="max |r|, t >= 0 s" statistic="max" of="source.r[1]" from="0" limit="0.9"/>
      <Plot title="reference" signals="source.r[1]"/>
    </ClosedLoop></ssc:Annotation>
  </ssd:Annotations></ssd:DefaultExperiment>
</ssd:SystemStructureDescription>
"""
OFFSET = ["--vary", "source.offset[1]=-1..1"]
LOOP = "3.2.1-cosine"
VARY = ["--vary", "plant.omega=±30%", "--vary", "adaptation_gain=1e4..1e5/log", "--until", "2"]


@pytest.fixture
def known(tmp_path: Path) -> Path:
    (folder := tmp_path / "known").mkdir()
    (folder / "SystemStructure.ssd").write_text(SOURCE)
    return folder


def verify(out: Path, *options: str | Path | float, code: int = 0) -> dict:
    answer = adaptive_fmu("verify", *options, "--json", "--out", out)
    assert answer.returncode == code, answer
    return json.loads(answer.stdout)


def rows(result: dict) -> list[dict[str, str]]:
    with open(Path(result["results"]) / "samples.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_intervals_hold_a_known_rate_and_verdicts_are_right(known: Path, tmp_path: Path) -> None:
    """Failures are a tenth of the box. All seeds from 1 to 100 are a matter of tests/all."""
    seeds = range(1, 101) if ALL else range(1 + NUMBER % 10, 101, 10)
    plain, early = 0, 0
    for seed in seeds:
        for_seed = ["--seed", seed, "--tag", f"s{seed}"]
        result = verify(tmp_path, known, *OFFSET, "--runs", 400, *for_seed)
        assert (result["verdict"], result["runs"]) == (None, 400)
        failing = [row for row in rows(result) if abs(float(row["source.offset[1]"])) > 0.9]
        assert result["failures"] == len(failing)
        low, high = result["interval"]
        plain += low <= 0.1 <= high
        decided = adaptive_fmu("verify", known, *OFFSET, "--at-most", 0.2, *for_seed, "--json", "--out", tmp_path / "early")
        result = json.loads(decided.stdout)
        assert result["verdict"] == ("passed" if decided.returncode == 0 else "undecided")
        low, high = result["interval"]
        early += low <= 0.1 <= high
    least = 90 if ALL else 7
    assert plain >= least and early >= least, (plain, early)


def test_the_verdict_is_first_and_is_the_exit_code(known: Path, tmp_path: Path) -> None:
    def study(*options: str) -> tuple[int, str]:
        answer = adaptive_fmu("verify", known, *OFFSET, *options, "--out", tmp_path, "--force")
        return answer.returncode, answer.stdout.splitlines()[0]

    code, sentence = study("--require", "max |r|, t >= 0 s <= 1", "--at-most", "0.01")
    assert (code, sentence) == (0, "Passed: 0 of 500 runs fail; with 95 % confidence fewer than 1 in 100 do.")
    code, sentence = study("--at-most", "0.01")
    assert code == 3 and sentence.startswith("Failed: ") and sentence.endswith("with 95 % confidence more than 1 in 100 do.")
    code, sentence = study("--at-most", "0.1", "--runs", "60")
    assert code == 3 and sentence.startswith("Undecided: ") and sentence.endswith("while 1 in 10 may.")
    code, sentence = study("--runs", "1000")
    assert code == 0 and " of 1,000 runs fail, " in sentence and " … " in sentence


@pytest.mark.parametrize("options", [[], ["--separate"]])
def test_samples_are_the_same_on_any_number_of_threads(tmp_path: Path, options: list[str]) -> None:
    tables = []
    for jobs in (1, 3):
        result = verify(tmp_path / str(jobs), LOOP, *VARY, "--runs", 40, "--require", "max |u| <= 1.3", *options, "--jobs", jobs)
        assert result["one_system"] is (not options)
        tables.append((Path(result["results"]) / "samples.csv").read_bytes())
    assert tables[0] == tables[1]


def test_a_further_parameter_leaves_the_values_of_the_others(tmp_path: Path) -> None:
    few = rows(verify(tmp_path / "few", LOOP, *VARY, "--runs", 5, "--require", "max |u| <= 1.3"))
    more = rows(verify(tmp_path / "more", LOOP, *VARY, "--vary", "plant.a1=±5%", "--runs", 5, "--require", "max |u| <= 1.3"))
    for name in ("plant.omega", "controller.adaptation_gain"):
        assert [row[name] for row in few] == [row[name] for row in more]


def test_the_line_of_each_failing_sample_shows_its_failure(tmp_path: Path) -> None:
    limit = 1.28
    listed = adaptive_fmu("verify", LOOP, *VARY, "--runs", "60", "--require", f"max |u| <= {limit}", "--out", tmp_path, "--json")
    result = json.loads(listed.stdout)
    folder = Path(result["results"])
    failing = [row for row in rows(result) if row["result"] != "passed"]
    assert 0 < len(failing) == result["failures"] < 60, result
    lines = sorted((folder / "failed").glob("*.txt"))
    assert (
        len(lines) == len(failing) == len(list((folder / "failed").glob("*.ssv")))
        and len(list((folder / "worst").glob("*.ssv"))) == 60
    )
    for row, file in list(zip(failing, lines, strict=True))[:3]:
        remark, line = file.read_text().strip().splitlines()
        assert f"Sample {row['sample']}:" in remark
        words = shlex.split(line)
        assert words[:2] == ["adaptive-fmu", "run"]
        answer = subprocess.run([PROGRAM, *words[1:], "--out", tmp_path, "--json"], capture_output=True, text=True, check=False)
        metrics = {metric["label"]: metric["value"] for metric in json.loads(answer.stdout)["metrics"]}
        assert metrics["max |u|"] > limit and metrics["max |u|"] == float(row["max |u|"])
    page = (folder / "index.html").read_text()
    assert result["sentence"].split(";")[0] in page and "First-order index" in page and page.count("<svg") == 6


@pytest.mark.parametrize(
    "options",
    [
        # By the name of its FMU, and a seed of noise.
        [LOOP, "--vary", "plant.omega=±30%", "--set", "NonlinearSiso.omega=2", "--until", "0.5"],
        ["3.3.1-case2-bench", "--vary", "plant.m1=±30%", "--set", "sensor.seed=5", "--until", "0.1"],
    ],
)
def test_the_line_of_a_sample_shows_it_whatever_is_set(options: list[str], tmp_path: Path) -> None:
    ran = json.loads(adaptive_fmu("run", options[0], *options[3:], "--json", "--out", tmp_path).stdout)
    label = next(metric["label"] for metric in ran["metrics"] if metric["label"].startswith("max") and metric["value"])
    result = verify(tmp_path, *options, "--require", f"{label} <= 0", "--runs", 3)
    for row, file in zip(rows(result), sorted((Path(result["results"]) / "failed").glob("*.txt")), strict=True):
        _, line = file.read_text().strip().splitlines()
        answer = adaptive_fmu(*shlex.split(line)[1:], "--out", tmp_path, "--json")
        metrics = {metric["label"]: metric["value"] for metric in json.loads(answer.stdout)["metrics"]}
        assert metrics[label] == float(row[label])


def test_limits_in_percent_are_those_of_metrics_in_percent(own: Path, tmp_path: Path) -> None:
    options = [own, "--vary", "motor.A[1,2]=±20%", "--runs", 2, "--until", 1.2]
    forms = ["overshoot speed <= 10%", "overshoot speed <= 0.1", "overshoot of motor.speed, % <= 10%", "overshoot of motor.speed, % <= 10"]
    results = [verify(tmp_path / str(k), *options, "--require", form) for k, form in enumerate(forms)]
    asked = {"label": "overshoot of motor.speed, %", "side": "<=", "value": 10.0}
    assert all({**result["requirements"][0], "violated": 0} == {**asked, "violated": 0} for result in results)
    assert "isn't in %" in fails("verify", *map(str, options), "--require", "settling speed <= 50%", "--out", str(tmp_path))


def test_metrics_of_the_same_name_are_refused(known: Path, tmp_path: Path) -> None:
    (file := known / "SystemStructure.ssd").write_text(
        SOURCE.replace("<Plot", '<Metric label="max |r|, t &gt;= 0 s" statistic="rms" of="source.r[1]" from="0"/><Plot')
    )
    assert file.exists() and "two metrics" in fails("verify", str(known), *OFFSET, "--runs", "3", "--out", str(tmp_path))


def test_a_study_goes_on_where_it_ended(tmp_path: Path) -> None:
    options = [LOOP, *VARY, "--require", "max |u| <= 1.28"]
    whole = verify(tmp_path / "whole", *options, "--runs", 24)
    verify(tmp_path / "parts", *options, "--runs", 10)
    parts = verify(tmp_path / "parts", *options, "--runs", 24)
    assert rows(parts) == rows(whole) and parts["failures"] == whole["failures"]
    # A shorter one takes no run away.
    assert verify(tmp_path / "parts", *options, "--runs", 5)["runs"] == 5
    error = fails("verify", *options, "--runs", "24", "--seed", "2", "--out", str(tmp_path / "parts"))
    assert "seed was 1, is 2" in error and "--force" in error
    (file := tmp_path / "parts" / f"{LOOP}-verified" / "runs.bin").write_bytes(b"adaptive-fmu verify 1\n{}" + 64 * b"0")
    assert "checksum" in fails("verify", *options, "--runs", "24", "--out", str(tmp_path / "parts")) and file.exists()


def test_refused_samples_are_no_runs_and_more_than_one_in_a_hundred_end_the_study(tmp_path: Path) -> None:
    # rho_inf must be below rho_0.
    loop, vary = "5", "controller.rho_inf[1]="
    error = fails(
        "verify",
        loop,
        "--vary",
        f"{vary}0.001..1000",
        "--runs",
        "20",
        "--until",
        "0.01",
        "--require",
        "funnel",
        "--out",
        str(tmp_path),
    )
    assert "components refused 1 of 1 samples; at most 1 % may be" in error and "must be below controller.rho_0[1]" in error


def test_noise_has_a_seed_of_its_own_in_each_run(tmp_path: Path) -> None:
    loop, options = "3.3.1-case2-bench", ["--vary", "plant.m1=±10%", "--until", "0.05", "--runs", "4"]
    labels = [
        metric["label"]
        for metric in json.loads(adaptive_fmu("run", loop, "--until", "0.05", "--json", "--out", tmp_path).stdout)["metrics"]
    ]
    peak = next(label for label in labels if label.startswith("max"))
    result = verify(tmp_path, loop, *options, "--require", f"{peak} <= 1e9")
    seeds = [[value for name, value in row.items() if name.endswith(".seed")] for row in rows(result)]
    assert seeds[0] and len({seed for row in seeds for seed in row}) == sum(map(len, seeds))
    same = verify(tmp_path, loop, *options, "--require", f"{peak} <= 1e9", "--same-noise", "--force")
    assert not any(name.endswith(".seed") for name in rows(same)[0])


def test_the_time_of_an_event_is_varied(tmp_path: Path) -> None:
    options = ["--event", "0.5: reference.offset[1]=0.5", "--vary", "event[1].time=0.2..0.8", "--until", "1", "--runs", "5"]
    result = verify(tmp_path, LOOP, *options, "--require", "max |u| <= 0.001")
    times = [float(row["event[1].time"]) for row in rows(result)]
    assert all(0.2 <= time <= 0.8 for time in times) and len(set(times)) == 5 and result["failures"] == 5
    line = (Path(result["results"]) / "failed" / "001.txt").read_text()
    assert f"'{times[0]!r}: reference.offset[1]=0.5'" in line
    refused = fails("verify", LOOP, "--vary", "event[1].time=0.2..0.8", "--require", "max |u| <= 1", "--out", str(tmp_path))
    assert "counts the options --event" in refused


def test_plants_are_drawn_from_the_uncertainty_of_a_description(own: Path, tmp_path: Path) -> None:
    description = own / "DcMotorController.toml"
    options = ["--vary-from", f"motor={description}", "--require", "settling speed <= 10"]
    table = rows(verify(tmp_path, own, *options, "--runs", 200))
    names = [name for name in table[0] if name.startswith("motor.")]
    assert names == ["motor.A[1,1]", "motor.A[2,1]", "motor.A[1,2]", "motor.A[2,2]", "motor.B[2,1]"]
    for name, nominal in zip(names, (-0.5, -25, 250, -500, 500), strict=True):
        values = np.array([float(row[name]) for row in table]) / nominal
        assert 0.8 <= values.min() < 0.83 and 1.17 < values.max() <= 1.2
    error = fails("verify", LOOP, "--vary-from", f"plant={description}", "--until", "1", "--out", str(tmp_path))
    assert "A[i,j]" in error


def test_plants_are_drawn_by_the_covariance_that_records_leave(own: Path, tmp_path: Path) -> None:
    model = json.loads((ROOT / "examples" / "own" / "dc_motor" / "model.json").read_text())
    deviations, correlation = (0.02, 10.0), 0.8
    covariance = [[deviations[0] ** 2, correlation * 0.2], [correlation * 0.2, deviations[1] ** 2]]
    model |= {"free": [["A", 1, 1], ["A", 1, 2]], "covariance": covariance}
    (file := tmp_path / "model.json").write_text(json.dumps(model))
    result = verify(tmp_path, own, "--vary-from", f"motor={file}", "--require", "settling speed <= 10", "--runs", 300)
    values = np.array([[float(row["motor.A[1,1]"]), float(row["motor.A[1,2]"])] for row in rows(result)])
    assert np.std(values, axis=0) == pytest.approx(deviations, rel=0.15)
    assert np.mean(values, axis=0) == pytest.approx((-0.5, 250.0), rel=0.02)
    assert np.corrcoef(values.T)[0, 1] == pytest.approx(correlation, abs=0.08)


def test_the_page_shows_what_the_commands_print(own: Path, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "verify.md").read_text()
    for line in re.findall(r"^adaptive-fmu (verify mine .*)$", page, re.MULTILINE):
        words = [word.replace("mine/", f"{own}/") if "=mine/" in word else word for word in shlex.split(line)]
        words[1] = str(own)
        answer = adaptive_fmu(*words, "--out", tmp_path)
        blocks = re.findall(r"^```(\w*)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
        shown = next(text for language, text in blocks if not language and text.splitlines()[0] in answer.stdout)
        assert answer.returncode == 0 and answer.stdout.startswith(shown), answer


REFUSED = [
    (["--vary", "plant.omeg=±30%"], "plant.omega"),
    (["--vary", "plant.omega=±30%", "--vary", "omega=1..2"], "varied twice"),
    (["--vary", "plant.omega=±30%", "--require", "max |v| <= 1"], "max |u|"),
    (["--vary", "plant.omega=±30%", "--require", "overshoot y[1] <= 0.1"], "reference steps"),
    (["--vary", "plant.omega=±30%", "--require", "funnel"], "no component of the loop has a funnel"),
    (["--vary", "plant.omega=±30%", "--at-most", "2"], "--at-most 2"),
    ([], "--vary"),
]


@pytest.mark.parametrize(("options", "hint"), REFUSED)
def test_what_does_not_fit_the_loop_is_refused_before_anything_runs(options: list[str], hint: str, tmp_path: Path) -> None:
    assert hint in fails("verify", LOOP, *options, "--until", "1", "--out", str(tmp_path))


def test_an_error_that_leaves_its_funnel_is_a_failure(tmp_path: Path) -> None:
    options = ["5", "--vary", "controller.rho_inf[1]=±10%", "--require", "funnel", "--until", "0.1", "--runs", "3"]
    options += ["--set", "controller.on_funnel_exit=reopen"]
    inside = verify(tmp_path / "inside", *options)
    assert inside["requirements"] == [{"label": "max controller.funnel_reopened", "side": "<=", "value": 0.0, "violated": 0}]
    # The reference jumps by more than the funnel is wide.
    outside = verify(tmp_path / "outside", *options, "--event", "0.05: reference.offset[1]=2")
    assert (inside["failures"], outside["failures"], outside["requirements"][0]["violated"]) == (0, 3, 3), outside


def test_python_has_the_same_verdict_samples_and_failures(tmp_path: Path) -> None:
    vary, require = {"plant.omega": "±30%", "controller.adaptation_gain": "1e4..1e5/log"}, ["max |u| <= 1.28"]
    verified = package.verify(LOOP, vary, require, runs=60, until=2)
    result = verify(tmp_path, LOOP, *VARY, "--runs", 60, "--require", require[0])
    assert (verified.failures, verified.runs) == (result["failures"], 60) and verified.interval == tuple(result["interval"])
    assert list(verified.samples["max |u|"]) == [float(row["max |u|"]) for row in rows(result)]
    assert len(verified.plot().axes) == 2 and "max |u|" in verified.samples
    assert verified.sentence in repr(verified) and "<svg" in verified._repr_html_()
    with ThreadPoolExecutor(2) as pool:
        there = package.verify(LOOP, vary, require, runs=60, until=2, executor=pool)
    assert there.samples.equals(verified.samples)
    with pytest.raises(package.Error, match="max \\|u\\|"):
        package.verify(LOOP, vary, "max |v| <= 1", runs=5)


# A mass without friction: its position after 1 s is its position at the start plus its speed.
MASS = SOURCE
for found, replaced in {
    'name="source"': 'name="plant"',
    "source.r[1]": "plant.y[1]",
    "r[1]": "y[1]",
    "Reference.fmu": "StateSpace.fmu",
    '"0.1"': '"1.0"',
    "max |r|, t >= 0 s": "max |y|, t >= 1 s",
    'from="0" limit="0.9"': 'from="1" limit="1.815"',
}.items():
    MASS = MASS.replace(found, replaced)
RARE = ["--vary", "plant.x0[1]=-1..1", "--vary", "plant.x0[2]=normal(0,0.2)", "--rare"]


def rate_of_mass(limit: float = 1.815) -> float:
    """Part of the starts from which the position exceeds the limit, by integration over the first one."""
    places = np.linspace(-1, 1, 20_001)
    beyond = [NormalDist().cdf(-(limit - place) / 0.2) + NormalDist().cdf(-(limit + place) / 0.2) for place in places]
    return float(np.trapezoid(beyond, places)) / 2


@pytest.fixture
def mass(tmp_path: Path) -> Path:
    (folder := tmp_path / "mass").mkdir()
    (folder / "SystemStructure.ssd").write_text(MASS)
    return folder


def repeated(mass: Path, out: Path, seeds: range) -> None:
    """Checks number of runs, estimates and intervals of rare failures with these seeds."""
    rate, near, covered = rate_of_mass(), 0, 0
    assert 0.9e-6 < rate < 1.1e-6
    for seed in seeds:
        result = verify(out, mass, *RARE, "--seed", seed, "--tag", f"s{seed}")
        assert result["runs"] <= 20_000 and result["verdict"] is None
        near += 0.5 <= result["share"] / rate <= 2
        covered += result["interval"][0] <= rate <= result["interval"][1]
    least = len(seeds) - len(seeds) // 9
    assert near >= min(45, least) and covered >= min(44, least), (near, covered)


def test_a_rate_of_one_in_a_million_is_found(mass: Path, tmp_path: Path) -> None:
    repeated(mass, tmp_path, range(1 + NUMBER % 50, 2 + NUMBER % 50))


@pytest.mark.slow
def test_rates_of_one_in_a_million_are_found_in_fifty_repetitions(mass: Path, tmp_path: Path) -> None:
    repeated(mass, tmp_path, range(1, 51))


def test_rare_failures_have_levels_failing_samples_and_a_page(mass: Path, tmp_path: Path) -> None:
    options = [mass, *RARE, "--runs", 2000, "--at-most", 1e-4]
    result = verify(tmp_path, *options)
    levels = result["rare"]["levels"]
    assert result["verdict"] == "passed" and re.match(r"Passed: about 1 in [\d,]+ runs fails; with 95 % ", result["sentence"]), (
        result
    )
    assert [level["samples"] for level in levels] == 5 * [400] and levels[0]["within"] == 40 and result["runs"] == 1840
    margins = [level["margin"] for level in levels]
    assert margins == sorted(set(margins), reverse=True)
    # The worst samples are far from what is usual, and their lines show it.
    folder = Path(result["results"])
    _, line = (folder / "worst" / "001.txt").read_text().strip().splitlines()
    answer = subprocess.run(
        [PROGRAM, *shlex.split(line)[1:], "--out", tmp_path, "--json"], capture_output=True, text=True, check=False
    )
    [metric] = json.loads(answer.stdout)["metrics"]
    table = rows(result)
    values = [float(row["max |y|, t >= 1 s"]) for row in table]
    assert metric["value"] == max(values) > 1.6
    for row, value in zip(table, values, strict=True):
        assert abs(float(row["plant.x0[1]"]) + float(row["plant.x0[2]"])) == pytest.approx(value, abs=1e-9)
    page = (folder / "index.html").read_text()
    assert "Values in failing samples" in page and "Levels" in page and "First-order index" not in page
    # The first level has the samples of a plain study, and the same command continues.
    plain = verify(tmp_path / "plain", *options[:5], "--runs", 40)
    assert [row["plant.x0[2]"] for row in rows(plain)] == [row["plant.x0[2]"] for row in table[:40]]
    assert rows(verify(tmp_path, *options, "--jobs", 1)) == table
    assert "belongs to another study" in fails("verify", *map(str, options[:-4]), "--out", str(tmp_path))


def test_rare_failures_are_the_same_on_workers(mass: Path) -> None:
    vary = {"plant.x0[1]": (-1, 1), "plant.x0[2]": "normal(0,0.2)"}
    here = package.verify(mass, vary, rare=True, runs=2000)
    with ThreadPoolExecutor(2) as pool:
        there = package.verify(mass, vary, rare=True, runs=2000, executor=pool)
    assert there.samples.equals(here.samples) and there.rate == here.rate and here.interval[0] < here.rate < here.interval[1]
    assert list(here.levels["margin"])[-1] == 0 and len(here.plot().axes) == 2


def test_rare_failures_need_runs_and_a_margin_that_varies(mass: Path, tmp_path: Path) -> None:
    assert "--rare needs at least 640 runs" in fails("verify", str(mass), *RARE, "--runs", "500", "--out", str(tmp_path))
    options = ["5", "--vary", "controller.rho_inf[1]=±10%", "--require", "funnel", "--until", "0.01", "--rare", "--runs", "640"]
    error = fails("verify", *options, "--set", "controller.on_funnel_exit=reopen", "--out", str(tmp_path))
    assert "100 % of the samples are equally far from their limits" in error and "leave --rare out" in error


@pytest.mark.slow
def test_a_rate_of_one_in_a_thousand_is_that_of_plain_runs(tmp_path: Path) -> None:
    options = [LOOP, "--vary", "plant.omega=±30%", "--vary", "plant.x0[1]=normal(0,0.1)", "--until", 1, "--step", 0.01]
    options += ["--require", "max |u| <= 1.45"]
    plain = verify(tmp_path / "plain", *options, "--runs", 40_000)
    rare = verify(tmp_path / "rare", *options, "--rare", "--runs", 10_000)
    assert 20 <= plain["failures"] <= 80 and len(rare["rare"]["levels"]) == 3, (plain["failures"], rare["rare"])
    (low, high), (least, most) = plain["interval"], rare["interval"]
    assert least <= high and low <= most and 0.5 < rare["share"] / plain["share"] < 2, (plain["interval"], rare["interval"])
