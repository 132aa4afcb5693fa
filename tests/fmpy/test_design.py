"""`design`: from a plant to the recommended controller, and the worst plants that `check` finds."""

import csv
import json
import subprocess
import tomllib
from pathlib import Path
from random import Random

import adaptive_fmu
import control
import numpy as np
import pytest
from conftest import PROGRAM, ROOT
from first_designs import design as linear
from random_plants import CLASSES, Plant, plant
from sample import ALL, NUMBER
from verdicts import model, within

MOTOR = ROOT / "examples/zoo/dc_motor.json"
MASS = Plant(np.array([[0.0, 1.0], [-2.0, -1.0]]), np.array([[0.0], [3.0]]), np.array([[1.0, 0.0]]), 2.0)


def run(folder: Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *map(str, words)], cwd=folder, capture_output=True, text=True, timeout=300)


def designed(folder: Path, *words: str, code: tuple[int, ...] = (0,)) -> dict:
    """What `design --json` says."""
    done = run(folder, "design", *words, "--json", "--force")
    assert done.returncode in code, done.stderr
    return json.loads(done.stdout)


def written(folder: Path, of: Plant) -> Path:
    file = folder / "plant.json"
    file.write_text(json.dumps(model(of)))
    return file


def course(folder: Path, *words: str) -> dict[str, np.ndarray]:
    """The signals of a run of design/loop."""
    done = run(folder, "run", "design/loop", "--out", "results", "-q", *words)
    assert done.returncode == 0, done.stderr
    with next((folder / "results").rglob("result.csv")).open() as file:
        rows = list(csv.reader(file))
    return dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))


def key(candidate: dict, time: float, peak: float) -> tuple:
    """What candidates are ranked by."""
    worst = candidate.get("worst") or {}
    settles = worst.get("settling_time")
    in_time = settles is not None and settles <= 1.5 * time
    is_far = worst.get("error_at_end", 1) > 0.05
    verdict = ["sound", "not compared", "not sound"].index(candidate.get("verdict", "not sound"))
    return "refused" in candidate, verdict, is_far, not in_time, max(worst.get("peaks", [np.inf])) / peak


@pytest.mark.parametrize("number", range(8 if ALL else 2))
def test_the_first_is_sound_is_in_time_and_takes_least_control(number: int, tmp_path: Path) -> None:
    random = Random(f"design {NUMBER} {number}")
    single = [of for of in CLASSES if of != "several channels"]
    of = plant(random.choice(single), random)
    time = 8 / of.bandwidth
    output = designed(tmp_path, written(tmp_path, of), "--settling-time", repr(time), code=(0, 3))
    candidates = output["candidates"]
    keys = [key(candidate, time, 1.0) for candidate in candidates]
    assert keys == sorted(keys)
    best = candidates[0]
    assert best["nominal"], best
    # The loop that is left does what was said of it, as separate FMUs that were exported.
    signals = course(tmp_path)
    table = tomllib.loads((tmp_path / "design/loop/Reference.toml").read_text())
    step = 0.0 if best["kind"] == "funnel" else table["start"]["step_time[1,1]"]
    # Figures are about the end of a run: of a loop that drifts on, those of a longer one differ.
    until = np.searchsorted(signals["time"], (step + best["duration"]) * (1 + 1e-9))
    t = signals["time"][:until] - step
    y = signals.get("plant.tracked0_output", signals.get("plant.tracked0"))[:until]
    outside = np.flatnonzero(np.abs(y - y[-1]) > 0.02)
    if best["nominal"]["settling_time"] is not None:
        assert t[outside[-1]] == pytest.approx(best["nominal"]["settling_time"], rel=0.1, abs=3 * best["step"])
    assert max(y.max() - 1, 0) == pytest.approx(best["nominal"]["overshoot"], abs=0.01)


def test_an_output_that_drifts_on_is_told(tmp_path: Path) -> None:
    """A zero at -0.6 rad/s: within its funnel, the output creeps on long after the reference has been reached."""
    creeps = Plant(
        np.array([[-68.0, -3200.0, -36600.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        np.array([[1.0], [0.0], [0.0]]),
        np.array([[-208500.0, -970700.0, -513750.0]]),
        23.0,
    )
    output = designed(tmp_path, written(tmp_path, creeps), "--settling-time", "0.17", "--kinds", "funnel", code=(0, 3))
    [candidate] = output["candidates"]
    [note] = [note for note in candidate["notes"] if "drifts" in note]
    assert f"in the last third of {candidate['duration']:.3g} s" in note
    output = designed(tmp_path, MOTOR, "--output", "speed", "--settling-time", "0.1", "--reference", "100", "--kinds", "pid,l1,funnel")
    assert not [note for candidate in output["candidates"] for note in candidate["notes"] if "drifts" in note]


def test_files_are_written_that_can_be_exported(tmp_path: Path) -> None:
    output = designed(tmp_path, MOTOR, "--output", "speed", "--settling-time", "0.1", "--reference", "100")
    kinds = [candidate["kind"] for candidate in output["candidates"]]
    assert sorted(kinds) == ["funnel", "l1", "l1-limit", "l1-sampled", "ladrc", "observer-l1", "pid"]
    for candidate in output["candidates"]:
        assert candidate["nominal"]["settling_time"] <= 0.1, candidate
        for file in candidate["files"]:
            assert run(tmp_path, "export", file).returncode == 0
            assert run(tmp_path, "check", file).returncode == 0
    page = (tmp_path / "design/index.html").read_text()
    assert all(f"<h2>{kind}</h2>" in page for kind in kinds) and "limit" in page and page.count("<svg") == 2 * len(kinds)
    again = run(tmp_path, "design", MOTOR, "--output", "speed", "--settling-time", "0.1")
    assert again.returncode == 1 and "--force" in again.stderr


def test_only_what_is_measured_is_used(tmp_path: Path) -> None:
    output = designed(tmp_path, MOTOR, "--settling-time", "0.1", "--measured", "speed")
    refused = {candidate["kind"]: candidate["refused"] for candidate in output["candidates"] if "refused" in candidate}
    assert sorted(refused) == ["funnel", "l1", "l1-limit", "l1-sampled"]
    assert "every state of the plant, which isn't measured" in refused["l1"]
    output = designed(tmp_path, MOTOR, "--settling-time", "0.1", "--measured", "speed,current")
    assert not [candidate for candidate in output["candidates"] if "refused" in candidate]


def test_noise_passes_through_a_linear_controller_in_proportion(tmp_path: Path) -> None:
    def noise(*words: str) -> float:
        output = designed(tmp_path, MOTOR, "--bandwidth", "20", "--kinds", "pid", "--reference", "100", *words)
        return output["candidates"][0]["noise"][0]

    one, three = noise("--noise", "0.1"), noise("--noise", "speed=0.3")
    assert three == pytest.approx(3 * one, rel=1e-6) and one > 0
    assert noise("--noise", "current=1") < 1e-9


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--settling-time", "1", "--measured", "sped"], "--measured = sped: is no state or output of the plant; did you mean `speed`?"),
        (["--settling-time", "1", "--noise", "x=1"], "--noise = x: is no state or output of the plant"),
        (["--settling-time", "1", "--kinds", "pdi"], "there is no kind for `design` named `pdi`; did you mean `pid`?"),
        (["--settling-time", "1", "--output", "torque"], "torque"),
        (["--settling-time", "1", "--set", "a=1"], "--at, --set, --free, --want and --hold are for an FMU"),
    ],
)
def test_what_is_wrong_is_reported_and_nothing_is_written(words: list[str], reason: str, tmp_path: Path) -> None:
    done = run(tmp_path, "design", MOTOR, *words)
    assert done.returncode == 1 and reason in done.stderr, done.stderr
    assert not list(tmp_path.iterdir())


def test_where_no_candidate_is_sound_the_exit_code_shows_it(tmp_path: Path) -> None:
    unstable = Plant(np.array([[0.0, 1.0], [4.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), 4.0)
    file = written(tmp_path, unstable)
    output = designed(tmp_path, file, "--bandwidth", "4", "--kinds", "pid,ladrc", "--uncertainty", "90%", code=(3,))
    assert all(not candidate["sound"] and candidate["reason"] for candidate in output["candidates"])
    nothing = Plant(np.array([[1.0]]), np.array([[0.0]]), np.array([[1.0]]), 4.0)
    done = run(tmp_path, "design", written(tmp_path, nothing), "--bandwidth", "4", "--kinds", "pid,ladrc", "--out", "none")
    assert done.returncode == 1 and "no controller was found" in done.stderr and not (tmp_path / "none").exists()


def test_an_fmu_is_a_plant_too(tmp_path: Path) -> None:
    run(tmp_path, "new", "state-space", "--name", "Motor", "--plant", MOTOR)
    assert run(tmp_path, "export", "Motor.toml").returncode == 0
    words = ["--output", "speed_output", "--settling-time", "0.1", "--reference", "100", "--kinds", "pid"]
    output = designed(tmp_path, "fmus/Motor.fmu", *words, "--inputs", "voltage")
    same = designed(tmp_path, MOTOR, *[word.removesuffix("_output") for word in words])
    for which in ["nominal", "worst"]:
        mine, other = output["candidates"][0][which], same["candidates"][0][which]
        assert mine["settling_time"] == pytest.approx(other["settling_time"], rel=1e-3)
        assert mine["peaks"] == pytest.approx(other["peaks"], rel=1e-3)


def test_the_plant_that_check_writes_as_worst_does_what_was_reported(tmp_path: Path) -> None:
    designed(tmp_path, written(tmp_path, MASS), "--bandwidth", "2", "--kinds", "pid")
    done = run(tmp_path, "check", "design/Pid.toml", "--worst", "worst.ssv", "--json")
    found = {item["name"]: item["value"] for item in json.loads(done.stdout)["findings"] if item["section"] == "Uncertain plants"}
    signals = course(tmp_path, "--case", str(tmp_path / "worst.ssv"))
    start = tomllib.loads((tmp_path / "design/loop/Reference.toml").read_text())["start"]["step_time[1,1]"]
    y, t = signals["plant.tracked0"], signals["time"] - start
    settles = t[np.flatnonzero(np.abs(y - y[-1]) > 0.02)[-1]]
    assert settles == pytest.approx(found["settling time"], rel=0.1)


def test_more_plants_and_other_ones_are_tried(tmp_path: Path) -> None:
    designed(tmp_path, written(tmp_path, MASS), "--bandwidth", "2", "--kinds", "pid")

    def tried(*words: str) -> tuple[float, float]:
        output = json.loads(run(tmp_path, "check", "design/Pid.toml", "--json", *words).stdout)
        found = {item["name"]: item["value"] for item in output["findings"] if item["section"] == "Uncertain plants"}
        return found["plants tried"], found["settling time"]

    usual, more, other = tried(), tried("--plants", "2000"), tried("--plants", "2000", "--seed", "7")
    assert more[0] > 2000 > usual[0] > 200 and more[1] >= usual[1]
    assert other[0] == more[0]
    done = run(tmp_path, "check", "LadrcTwoLinkRobot", "--plants", "5")
    assert done.returncode == 1 and "there is no table [nominal]" in done.stderr
    done = run(tmp_path, "check", "LadrcTwoLinkRobot", "--worst", "w.ssv")
    assert done.returncode == 1 and "[nominal]" in done.stderr


@pytest.mark.parametrize("kind", ["pid", "l1"])
def test_no_random_plant_is_worse_than_the_worst_case(kind: str, tmp_path: Path) -> None:
    designed(tmp_path, written(tmp_path, MASS), "--bandwidth", "2", "--kinds", kind)
    output = json.loads(run(tmp_path, "check", f"design/{kind.capitalize()}.toml", "--worst-case", "2", "--json").stdout)["worst_case"]
    assert output["tried"] > 40 and output["failure"] is None

    def squared(of: Plant) -> float:
        names = [(f"plant.{name}[{i + 1},{j + 1}]", value) for name, all in [("A", of.A), ("B", of.B)] for (i, j), value in np.ndenumerate(all)]
        signals = course(tmp_path, *[word for name, value in names for word in ("--set", f"{name}={float(value)!r}")])
        start = tomllib.loads((tmp_path / "design/loop/Reference.toml").read_text())["start"]["step_time[1,1]"]
        after = signals["time"] >= start
        return float(np.sum((signals["plant.tracked0"][after] - 1) ** 2))

    worst = squared(Plant(np.array(output["A"]), np.array(output["B"]), MASS.C, MASS.bandwidth))
    random = Random(NUMBER)
    assert all(squared(within(MASS, random, k % 2 == 0)) <= 1.01 * worst for k in range(8))
    assert worst > squared(MASS)


@pytest.mark.parametrize("kind", ["pid", "ladrc"])
def test_pictures_show_the_loop_that_another_program_computes(kind: str, tmp_path: Path) -> None:
    random = Random(f"pictures {NUMBER} {kind}")
    of = plant(random.choice(["minimum phase", "mode", "integrators"]), random)
    made = run(tmp_path, "new", kind, "--name", "C", "--plant", written(tmp_path, of), "--bandwidth", repr(of.bandwidth))
    assert made.returncode == 0, made.stderr
    pictures = json.loads(run(tmp_path, "check", "C.toml", "--json", "--page", "c.html").stdout)["pictures"]
    assert (tmp_path / "c.html").read_text().count("<svg") == len(pictures) == 5
    law = linear(kind, made, tmp_path)
    step, _, gain, phase, poles = pictures
    size, turned = gain["curves"][0]["points"], phase["curves"][0]["points"]
    for (omega, decibel), (_, degrees) in zip(size[::20], turned[::20], strict=True):
        expected = (law.at(omega) @ of.at(omega))[0, 0]
        assert decibel == pytest.approx(20 * np.log10(abs(expected)), abs=0.02)
        assert np.exp(1j * np.radians(degrees)) == pytest.approx(expected / abs(expected), abs=5e-3)
    joined = control.feedback(control.ss(of.A, of.B, of.C, 0), control.ss(law.A, law.B, law.C, law.D))
    expected = [pole for pole in np.linalg.eigvals(joined.A) if pole.imag >= 0]
    shown = next(curve for curve in poles["curves"] if curve["of"] == "marks")["points"]
    for pole in expected:
        assert min(abs(complex(*point) - pole) for point in shown) <= 1e-3 * abs(pole) + 1e-6
    assert len(shown) == len(expected)
    nominal = next(curve for curve in step["curves"] if curve["of"] == "nominal")["points"]
    assert nominal[-1][1] == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize("row", [[2.0, 0.0], [1.0, 0.1]])
def test_an_output_with_the_name_of_a_state_is_not_mistaken_for_it(row: list[float], tmp_path: Path) -> None:
    number = Random(f"names {row} {NUMBER}")
    A = [[-number.uniform(0.5, 2), 0.5], [0.0, -number.uniform(2, 4)]]
    named = {"A": A, "B": [[0.0], [2.0]], "C": [row], "states": ["speed", "current"], "inputs": ["voltage"], "outputs": ["speed"]}
    other = {**named, "outputs": ["sensor"]}
    of_plant = {}
    for name, plant_ in (("named", named), ("other", other)):
        (tmp_path / f"{name}.json").write_text(json.dumps(plant_))
        found = designed(tmp_path, f"{name}.json", "--bandwidth", "2", "--out", name, code=(0, 3))
        of_plant[name] = {one["kind"]: one["nominal"] for one in found["candidates"] if "refused" not in one}
    assert of_plant["named"].keys() == of_plant["other"].keys() and {"pid", "ladrc", "observer-l1"} <= of_plant["named"].keys()
    for kind, nominal in of_plant["named"].items():
        assert nominal == of_plant["other"][kind], kind
    done = run(tmp_path, "new", "pid", "--plant", "named.json", "--bandwidth", "2", "--name", "Control")
    assert "Output `speed` isn't the state of that name: it is called `speed_output`." in done.stderr, done.stderr


@pytest.mark.parametrize("outputs", [["speed", "speed_output"], ["current", "speed"], ["speed_reference", "current"]])
def test_a_loop_of_any_names_of_outputs_is_that_of_other_names(outputs: list[str], tmp_path: Path) -> None:
    plant_ = {"A": [[-1.0, 0.0], [0.0, -2.0]], "B": [[1.0, 0.0], [0.0, 1.0]], "C": [[2.0, 0.0], [0.0, 1.0]]}
    found = []
    for k, names in enumerate((outputs, ["one", "other"])):
        (tmp_path / f"{k}.json").write_text(json.dumps({**plant_, "states": ["speed", "current"], "inputs": ["a", "b"], "outputs": names}))
        found.append(designed(tmp_path, f"{k}.json", "--bandwidth", "2", "--kinds", "pid,ladrc", "--out", str(k), code=(0, 3)))
    nominal = [{one["kind"]: one["nominal"] for one in answer["candidates"]} for answer in found]
    assert nominal[0] == nominal[1] and None not in nominal[0].values()


def test_runs_that_would_take_long_are_not_compared_on_any_machine(tmp_path: Path) -> None:
    # L1 control adapts a thousand times faster than this plant settles.
    furnace = ROOT / "examples/zoo/induction_furnace.json"
    found = [designed(tmp_path, furnace, "--bandwidth", "0.01", "--kinds", "pid,ladrc,l1", code=(0, 3)) for _ in range(2)]
    assert found[0]["candidates"] == found[1]["candidates"]
    verdicts = {one["kind"]: one["verdict"] for one in found[0]["candidates"]}
    assert verdicts["l1"] == "not compared", verdicts
    late = next(one for one in found[0]["candidates"] if one["kind"] == "l1")
    assert "integration steps" in late["reason"] and "`check`" in late["reason"]


def test_limits_of_an_fmu_of_this_program_are_those_of_its_parameters(tmp_path: Path) -> None:
    limited = {**model(MASS), "u_min": [-4.5], "u_max": [3.5]}
    (tmp_path / "plant.json").write_text(json.dumps(limited))
    for words in (["new", "state-space", "--plant", "plant.json", "--name", "Mass"], ["export", "Mass.toml", "--out", "."]):
        done = run(tmp_path, *words)
        assert done.returncode == 0, done.stderr
    signals = ["--inputs", limited["inputs"][0], "--outputs", limited["outputs"][0]]
    for more, limits in (([], [-4.5, 3.5]), (["--set", "u_max[1]=2.5"], [-4.5, 2.5])):
        done = run(tmp_path, "new", "pid", "--plant", "Mass.fmu", *signals, *more, "--bandwidth", "2", "--name", "Control", "--force")
        assert done.returncode == 0, done.stderr
        start = tomllib.loads((tmp_path / "Control.toml").read_text())["start"]
        assert [start["u_min"], start["u_max"]] == [[limit] for limit in limits]
    refused = run(tmp_path, "new", "pid", "--plant", "Mass.fmu", "--bandwidth", "2", "--name", "Control", "--force")
    assert refused.returncode == 1 and "--inputs" in refused.stderr and "--outputs" in refused.stderr


def test_names_of_a_plant_may_be_those_of_the_models_variables(tmp_path: Path) -> None:
    names = {"states": ["d", "u"], "inputs": ["A"], "outputs": ["K"]}
    plant = {"A": [[-1, 0], [1, -2]], "B": [[1], [0]], "C": [[0, 1]], **names}
    (tmp_path / "plant.json").write_text(json.dumps(plant))
    output = designed(tmp_path, "plant.json", "--settling-time", "2")
    assert not [candidate for candidate in output["candidates"] if "refused" in candidate]
    made = run(tmp_path, "new", "state-space", "--name", "P", "--plant", "plant.json")
    assert "state `d` is called `d_state`, state `u` is called `u_state`, input `A` is called `A_input`" in made.stderr


def test_python_takes_systems_of_python_control(tmp_path: Path) -> None:
    words = {"settling_time": 5.0, "kinds": ["pid", "ladrc"], "noise": 0.01}
    found = adaptive_fmu.design(control.tf([1], [1, 1, 0]), **words, out=tmp_path / "design")
    assert found.sound and found.table.loc[found.table.index[0], "settling_time"] <= 5
    assert (found.table["noise"] > 0).all() and found.page.is_file()
    data = found.loop.run().data
    assert data[[name for name in data.columns if name.startswith("plant.y")][0]].iloc[-1] == pytest.approx(1, abs=0.03)
    with pytest.raises(adaptive_fmu.Error, match="force"):
        adaptive_fmu.design(control.tf([1], [1, 1, 0]), **words, out=tmp_path / "design")
