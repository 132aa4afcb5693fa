"""Values that variables get during a run: loops, single FMUs by both interfaces, files of loops, pages, Python, and what is refused."""

import json
import re
import shutil
from pathlib import Path

import adaptive_fmu
import fmpy
import numpy as np
import pytest
from conftest import ROOT, read_csv
from fmpy.fmi2 import FMU2Slave
from recorded import program
from sample import NUMBER
from scipy.linalg import expm

LOOP = "3.2.1-cosine"


def simulated(tmp_path: Path, *words: str) -> dict[str, np.ndarray]:
    ran = program(tmp_path, "simulate", "StateSpace", "--until", "4", "--step", "0.01", "--out", "r", "--json", *words)
    assert ran.returncode == 0, ran.stderr
    return read_csv(tmp_path / json.loads(ran.stdout)["results"] / "result.csv")


@pytest.mark.parametrize("interface", ["cs", "me"])
def test_a_single_fmu_goes_on_with_the_new_equations(tmp_path: Path, interface: str) -> None:
    """Against the exact solution of a linear system, whose entries change at two times, one of them between communication points."""
    rng = np.random.default_rng([NUMBER, 90])
    a = np.array([[0.0, 1.0], [-rng.uniform(1, 4), -rng.uniform(0.2, 1)]])
    values = [f"A[2,1]={a[1, 0]}", f"A[2,2]={a[1, 1]}", "x0[1]=1", f"u[1]={rng.uniform(-1, 1)}"]
    u = float(values[-1].split("=")[1])
    changed, later = rng.uniform(-6, -1), rng.uniform(-1, 1)
    first, second = round(rng.uniform(0.5, 1.5), 2), round(rng.uniform(2, 3), 2) + 0.004
    events = [f"{second}: u[1]={later}", f"{first}: A[2,1]={changed}"]
    words = [word for value in values for word in ("--set", value)] + [word for event in events for word in ("--event", event)]
    result = simulated(tmp_path, "--interface", interface, *words)
    x, expected = np.array([1.0, 0.0]), []
    for time in result["time"]:
        expected.append(x[0])
        now_a, now_u = a.copy(), u
        if time >= first - 1e-9:
            now_a[1, 0] = changed
        if time >= second - 1e-9:
            now_u = later
        both = np.zeros((3, 3))
        both[:2, :2], both[1, 2] = now_a, now_u
        x = (expm(0.01 * both) @ [*x, 1.0])[:2]
    np.testing.assert_allclose(result["y[1]"], expected, atol=2e-5, err_msg=f"{NUMBER}")
    # What an FMU of another tool sees: the same by Python.
    of_python = adaptive_fmu.simulate(
        "StateSpace",
        values={"A": [[0, 1], a[1].tolist()], "x0": [1, 0], "u": [u]},
        events=[(second, "u[1]", later), (first, "A[2,1]", changed)],
        until=4,
        step=0.01,
        interface=interface,
    )
    np.testing.assert_array_equal(of_python.data["y[1]"], result["y[1]"])


def by_hand(folder: Path, steps: int, step: float, events: list[tuple[float, str, float]]) -> np.ndarray:
    """The plant's output in a loop of the three FMUs, each stepped in turn by FMPy."""
    units = {}
    for component, name in (("reference", "ReferenceNonlinearSiso"), ("plant", "NonlinearSiso"), ("controller", "L1NonlinearSiso")):
        [file] = adaptive_fmu.export(name, out=folder)
        description = fmpy.read_model_description(str(file))
        unit = FMU2Slave(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(file), unzipdir=str(folder / component)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=component,
        )
        unit.instantiate()
        unit.setupExperiment(startTime=0.0)
        units[component] = (unit, {variable.name: variable.valueReference for variable in description.modelVariables})

    def get(component: str, name: str) -> float:
        unit, references = units[component]
        return unit.getReal([references[name]])[0]

    def put(component: str, name: str, value: float) -> None:
        unit, references = units[component]
        unit.setReal([references[name]], [value])

    links = [("plant", "u[1]", "controller", "u[1]"), ("controller", "r[1]", "reference", "r[1]")]
    links += [("controller", f"x[{k}]", "plant", f"x[{k}]") for k in (1, 2)]

    def take(component: str) -> None:
        for to, name, source, output in links:
            if to == component:
                put(to, name, get(source, output))

    for unit, _ in units.values():
        unit.enterInitializationMode()
    for _ in range(3):
        [take(component) for component in units]
    for unit, _ in units.values():
        unit.exitInitializationMode()
    outputs, left = [get("plant", "x[1]")], sorted(events)
    for k in range(steps):
        while left and left[0][0] <= k * step + 1e-9:
            _, name, value = left.pop(0)
            put(*name.split(".", 1), value)
        for component, (unit, _) in units.items():
            take(component)
            unit.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
        outputs.append(get("plant", "x[1]"))
    for unit, _ in units.values():
        unit.terminate()
        unit.freeInstance()
    return np.array(outputs)


def test_a_loop_gives_what_a_master_gives_that_sets_the_values(tmp_path: Path) -> None:
    rng = np.random.default_rng([NUMBER, 91])
    # Away from the 2 rad/s that it has: nearer, the controller leaves nothing to be seen.
    events = [(round(rng.uniform(0.3, 1), 3), "plant.omega", rng.uniform(1, 1.7)), (1.2, "plant.a1", rng.uniform(0, 2))]
    events += [(1.2, "controller.u_max[1]", rng.uniform(1.2, 1.6)), (1.7, "controller.u_max[1]", 1e15)]
    expected = by_hand(tmp_path, 2500, 1e-3, events)
    loop = adaptive_fmu.Loop(LOOP)
    result = loop.run(until=2.5, events=events)
    np.testing.assert_allclose(result.data["plant.x[1]"], expected, rtol=1e-9, atol=1e-12)
    without = loop.run(until=2.5)
    first = events[0][0]
    before = without.data.index <= first
    np.testing.assert_array_equal(result.data[before], without.data[before])
    assert np.abs(result.data["plant.x[1]"] - without.data["plant.x[1]"]).max() > 1e-4
    # One continuous system has the same events, but for what sampling changes.
    whole = loop.run(until=2.5, events=events, composite=True)
    assert np.abs(whole.data["plant.x[1]"] - result.data["plant.x[1]"]).max() < 0.05 * np.abs(result.data["plant.x[1]"]).max()
    assert np.abs(whole.data["plant.x[1]"] - loop.run(until=2.5, composite=True).data["plant.x[1]"]).max() > 1e-4


def test_a_file_of_a_loop_has_events_and_sweeps_and_tunes_take_them(tmp_path: Path) -> None:
    own = tmp_path / "own"
    shutil.copytree(ROOT / "examples" / LOOP, own)
    structure = own / "SystemStructure.ssd"
    event = '<Event time="0.5" name="plant.omega" value="3.5"/>'
    structure.write_text(re.sub(r"(<ClosedLoop[^>]*>)", rf"\1{event}", structure.read_text(), count=1))
    loop, plain = adaptive_fmu.Loop(own), adaptive_fmu.Loop(LOOP)
    events = [(0.5, "plant.omega", 3.5)]
    np.testing.assert_array_equal(loop.run(until=1.5).data, plain.run(until=1.5, events=events).data)
    # It may come after the end of a shorter run.
    np.testing.assert_array_equal(loop.run(until=0.4).data, plain.run(until=0.4).data)
    gains = [5e4, 1e5]
    swept = plain.sweep({"controller.adaptation_gain": gains}, until=6, events=events)
    for gain, peak in zip(gains, swept.data["max |u|"], strict=True):
        run = plain.run(until=6, events=events, controller={"adaptation_gain": gain})
        assert run.metrics.loc["max |u|", "value"] == peak
    asked = {"parameters": {"controller.feedback_gain[1,1]": (10.0, 30.0)}, "metric": "max |u|", "until": 6, "particles": 2}
    tuned = plain.tune(**asked, generations=1, events=events, separate=True)
    assert tuned.before == plain.run(until=6, events=events).metrics.loc["max |u|", "value"]
    assert tuned.before != plain.tune(**asked, generations=1, separate=True).before


def test_a_page_marks_events_and_a_run_is_repeated_with_them(tmp_path: Path) -> None:
    words = ["--until", "2", "--event", "1.25: plant.omega=3", "--event", "0.5: controller.adaptation_gain=50000"]
    ran = program(tmp_path, "run", LOOP, *words, "--out", "r", "--json")
    assert ran.returncode in (0, 3), ran.stderr
    folder = tmp_path / "r" / LOOP
    page = (folder / "index.html").read_text()
    assert "<th>event<td>1.25: plant.omega=3" in page and "<th>event<td>0.5: controller.adaptation_gain=50000" in page
    diagrams = [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page, flags=re.S)]
    marks = {"0.5": "controller.adaptation_gain = 50000", "1.25": "plant.omega = 3"}
    assert diagrams
    assert all({f"{mark['time']:g}": mark["text"] for mark in diagram["marks"]} == marks for diagram in diagrams)
    assert (folder / "plot.svg").read_text().count("<title>plant.omega = 3</title>") == len(diagrams)
    again = program(tmp_path, "run", "--again", folder, "--json")
    output = json.loads(again.stdout)
    assert output["again"]["same_numbers"] and output["again"]["differences"] == [], output["again"]
    axis = adaptive_fmu.Loop(LOOP).run(until=2, events=[(1.25, "plant.omega", 3)]).plot().axes[-1]
    assert any(np.allclose(line.get_xdata(), 1.25) for line in axis.get_lines())


@pytest.mark.parametrize(
    ("event", "reason"),
    [
        ((3.0, "plant.omega", 2), "time = 3 s: must be within the run, from 0 s to before 2 s"),
        ((-1.0, "plant.omega", 2), "time = -1 s: must be within the run"),
        ((1.0, "plant.u[1]", 2), "`plant.u[1]` can't change during a run: it is connected"),
        ((1.0, "plant.x0[1]", 2), "it is a fixed parameter"),
        ((1.0, "plant.x[1]", 2), "it is a continuous output"),
        ((1.0, "plant.omga", 2), "there is no `plant.omga` that may change during a run; did you mean `plant.omega`"),
        ((1.0, "plant.omega", "fast"), "`plant.omega` = fast: must be a finite number"),
        ((float("nan"), "plant.omega", 2), "must be TIME: NAME=VALUE"),
        ((1.0, "plant.omega"), "It must be a list of (time in s, name, value)"),
    ],
)
def test_events_that_can_not_be_are_refused_before_the_run(event: tuple, reason: str) -> None:
    with pytest.raises(adaptive_fmu.ArgumentError) as error:
        adaptive_fmu.Loop(LOOP).run(until=2, events=[event])
    assert reason in str(error.value), error.value


@pytest.mark.parametrize("words", [["--all"], ["--again", "results"]])
def test_events_are_of_one_loop_and_are_repeated_as_they_were(tmp_path: Path, words: list[str]) -> None:
    refused = program(tmp_path, "run", *words, "--event", "1: plant.omega=2")
    assert refused.returncode == 2 and re.search(f"'{words[0]}.*' cannot be used with '--event", refused.stderr), refused.stderr


def test_a_value_that_an_fmu_refuses_ends_the_run_with_the_time(tmp_path: Path) -> None:
    with pytest.raises(adaptive_fmu.Error, match=r"omega_m(in|ax)") as error:
        adaptive_fmu.Loop(LOOP).run(until=2, events=[(1.0, "controller.omega_min[1,1]", 5)])
    partial = getattr(error.value, "partial", None)
    assert partial is None or partial.data.index[-1] == pytest.approx(1.0)
    refused = program(tmp_path, "simulate", "StateSpace", "--event", "1: u[1]=2", "--input", written(tmp_path), "--until", "2")
    assert refused.returncode == 1 and "`u[1]` can't change during a run: --input has values for it" in refused.stderr


def written(folder: Path) -> Path:
    (folder / "in.csv").write_text('time,"u[1]"\n0,1\n2,1\n')
    return folder / "in.csv"
