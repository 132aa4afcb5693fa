"""Loops of components in Python, inputs in any form, FMPy's names of arguments, and errors for what isn't there."""

import gc
import json
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from recorded import program
from sample import NUMBER
from test_foreign_plants import in_c

PARTS = ["ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso"]


def connections(folder: Path) -> set[tuple[str, str]]:
    tree = ET.parse(folder / "SystemStructure.ssd")
    found = [element.attrib for element in tree.iter() if element.tag.endswith("}Connection")]
    return {(f"{a['startElement']}.{a['startConnector']}", f"{a['endElement']}.{a['endConnector']}") for a in found}


def quiet(*components: object, **arguments: object) -> adaptive_fmu.Loop:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return adaptive_fmu.Loop.connect(*components, **arguments)


def test_components_are_connected_by_their_names_as_the_loop_of_the_package_is(tmp_path: Path) -> None:
    loop = quiet(*PARTS, name="Mine", step=0.001, until=3)
    expected = adaptive_fmu.Loop("3.2.1-cosine").run(until=3, values={})
    result = loop.run()
    assert result.name == "Mine" and result.settings["step"] == 0.001
    for name in result.data.columns.intersection(expected.data.columns):
        np.testing.assert_array_equal(result.data[name], expected.data[name], err_msg=name)
    assert loop.sweep({"plant.omega": [1, 2]}, until=0.1).name == "Mine"
    # Saved, it is the same; the folder of an unsaved one goes with it.
    folder = loop.save(tmp_path / "saved")
    again = adaptive_fmu.Loop(folder).run()
    np.testing.assert_array_equal(again.data, result.data)
    with pytest.raises(adaptive_fmu.Error, match="force=True"):
        loop.save(folder)
    assert loop.save(folder, force=True) == folder
    own = Path(loop.name)
    assert own.is_dir()
    del loop
    gc.collect()
    assert not own.exists()
    with pytest.raises(adaptive_fmu.Error, match="is stored already"):
        adaptive_fmu.Loop(folder).save(tmp_path / "other")


def test_connections_are_made_where_names_differ(tmp_path: Path) -> None:
    """Between an FMU of another tool, a description and an FMU of this package, with pairs that name components."""
    motor = in_c(tmp_path)
    plant = {"A": [[-2.0]], "B": [[3.0]], "C": [[1.0]], "D": [[0.0]], "inputs": ["volts"], "outputs": ["omega"]}
    (tmp_path / "plant.json").write_text(json.dumps(plant))
    pid = adaptive_fmu.new("pid", tmp_path / "Drive.toml", plant=tmp_path / "plant.json")
    links = {"drive.omega": "motor.speed", "motor.voltage": "drive.volts", "drive.omega_reference": "wanted.r[1]"}
    parts = [("motor", motor), ("drive", pid), ("wanted", "ReferenceNonlinearSiso")]
    # The motor declares no dependencies.
    with pytest.warns(UserWarning, match="may be an algebraic loop"):
        loop = adaptive_fmu.Loop.connect(*parts, connect=links, step=0.001, until=0.1)
    folder = loop.save(tmp_path / "saved")
    assert {(source, to) for to, source in links.items()} <= connections(folder)
    result = loop.run()
    # One source each, and their order: the reference, the motor, then the controller, which shows at once what it is given.
    assert result.ended == "complete" and {"motor.speed", "drive.volts", "wanted.r[1]"} <= set(result.data.columns)
    # Arrays are connected element by element.
    robot = adaptive_fmu.Loop.connect(
        "ReferenceTwoLinkRobot", "TwoLinkRobot", ("first", "L1TwoLinkRobot"), ("second", "L1TwoLinkRobot"), step=0.001, until=0.1,
        connect={"plant.u": "second.u"},
    )
    pairs = connections(robot.save(tmp_path / "robot"))
    assert {("second.u[1]", "plant.u[1]"), ("second.u[2]", "plant.u[2]")} <= pairs
    assert not any(source.startswith("first.u") for source, to in pairs if to.startswith("plant."))


def test_inputs_without_a_source_are_listed_in_a_warning() -> None:
    with pytest.warns(UserWarning, match=r"not connected keep their start values: .*controller\.r\[1\]"):
        adaptive_fmu.Loop.connect("NonlinearSiso", "L1NonlinearSiso")


@pytest.mark.parametrize(
    ("connect", "reason"),
    [
        ({"plant.u": "controller.nix"}, "connect = controller.nix: is no output of controller; there are: u[1]"),
        ({"plant.nix": "controller.u"}, "connect = plant.nix: is no input of plant; there are: u[1]"),
        ({"pant.u": "controller.u"}, "there is no component named `pant`; did you mean `plant`?"),
        ({"plant.u": "controller.u", "plant.u[1]": "reference.r[1]"}, "plant.u[1]: has two sources: connect it once"),
        ({"plant.u": "reference.r[1]", "controller.x": "plant.y"}, "controller.x: has 2 elements, `plant.y` has 1"),
        ({"plantu": "controller.u"}, "plantu: must be COMPONENT.INPUT"),
        ({"controller.r": "controller.step_too_long"}, "controller.r[1]: can't come from controller.step_too_long, which has type Boolean"),
    ],
)
def test_connections_that_do_not_fit_are_refused(connect: dict[str, str], reason: str) -> None:
    with pytest.raises(adaptive_fmu.ArgumentError) as error:
        adaptive_fmu.Loop.connect(*PARTS, connect=connect)
    assert reason in str(error.value) and "--" not in str(error.value), error.value


def test_what_is_no_loop_is_refused_at_once(tmp_path: Path) -> None:
    description = adaptive_fmu.new("pid", tmp_path / "C.toml", inputs=1, outputs=1, states=1)
    for name, reason in {
        "3.2.1-cosin": "did you mean `3.2.1-cosine`",
        "StateSpace": "StateSpace is an FMU of this package, not a loop",
        tmp_path / "C.fmu": "is an FMU, not a loop",
        description: "is the description of an FMU, not a loop",
    }.items():
        with pytest.raises(adaptive_fmu.ArgumentError) as error:
            adaptive_fmu.Loop(name)
        assert reason in str(error.value) and "--" not in str(error.value), error.value
    loop = adaptive_fmu.Loop("3.2.1-cosine")
    for call in (
        lambda: loop.run(plant={"omgea": 1}),
        lambda: loop.run(values={"plnt.omega": 1}),
        lambda: loop.linearise(free=["nix"]),
        lambda: adaptive_fmu.simulate("StateSpace", values={"nix": 1}),
        lambda: adaptive_fmu.new("pdi", tmp_path / "X.toml"),
        lambda: loop.run(until=1, stop_time=2),
        lambda: loop.run(values={}, start_values={}),
        lambda: adaptive_fmu.simulate("StateSpace", step=1, output_interval=1),
        lambda: adaptive_fmu.simulate("StateSpace", record=[], output=[]),
        lambda: adaptive_fmu.Loop.connect(3),
    ):
        with pytest.raises(adaptive_fmu.ArgumentError):
            call()


def test_inputs_in_any_form_give_the_same_bits(tmp_path: Path) -> None:
    rng = np.random.default_rng([NUMBER, 80])
    times = np.arange(0, 1.0001, 0.01)
    values = np.round(rng.uniform(-1, 1, len(times)), 6)
    frame = pd.DataFrame({"u[1]": values}, index=times)
    frame.rename_axis("time").to_csv(tmp_path / "input.csv")
    structured = np.array(list(zip(times, values, strict=True)), dtype=[("time", float), ("u[1]", float)])
    forms = {
        "frame": frame,
        "column": frame.rename_axis("time").reset_index(),
        "milliseconds": frame.set_index(np.round(1e3 * times)).rename_axis("time [ms]"),
        "Timedelta": frame.set_index(pd.to_timedelta(times, unit="s")),
        "dict": {"time": times, "u[1]": values},
        "structured": structured,
        "path": tmp_path / "input.csv",
        "function": lambda t: {"u[1]": values[round(t / 0.01)]},
    }
    results = {name: adaptive_fmu.simulate("StateSpace", input=form, until=1, step=0.01).data for name, form in forms.items()}
    assert results["frame"]["y[1]"].abs().max() > 0
    for name, result in results.items():
        np.testing.assert_allclose(result, results["frame"], rtol=1e-9, atol=1e-12, err_msg=name)
    step = times > 0.5
    switched = [{"time": times, "u[1]": step}, pd.DataFrame({"u[1]": step.astype(float)}, index=times)]
    one, other = (adaptive_fmu.simulate("StateSpace", input=form, stop_time=1, output_interval=0.01).data for form in switched)
    np.testing.assert_array_equal(one, other)
    # A column that is no number isn't dropped.
    with pytest.raises(adaptive_fmu.Error, match="input"):
        adaptive_fmu.simulate("StateSpace", input=frame.assign(**{"u[1]": "high"}), until=1, step=0.01)
    for form, reason in ((lambda t: 1.0, "must return a dict"), (lambda t: {}, "must return a dict"), ({"time": [0, 1], "nix": [1, 2]}, "nix")):
        with pytest.raises(adaptive_fmu.Error, match=reason):
            adaptive_fmu.simulate("StateSpace", input=form, until=1, step=0.5)


def test_names_of_fmpy_are_names_of_arguments(tmp_path: Path) -> None:
    own = adaptive_fmu.simulate("NonlinearSiso", values={"u[1]": 0.3}, until=1, step=0.02, record=["omega"], interface="me")
    theirs = adaptive_fmu.simulate(
        "NonlinearSiso", start_values={"u[1]": 0.3}, stop_time=1, output_interval=0.02, output=["omega"], interface="me"
    )
    np.testing.assert_array_equal(own.data, theirs.data)
    coarse = adaptive_fmu.simulate("NonlinearSiso", values={"u[1]": 0.3}, until=1, step=0.5, interface="me", relative_tolerance=1e-2)
    fine = adaptive_fmu.simulate("NonlinearSiso", values={"u[1]": 0.3}, until=1, step=0.5, interface="me", relative_tolerance=1e-10)
    assert not np.array_equal(coarse.data, fine.data)
    np.testing.assert_allclose(coarse.data, fine.data, rtol=0.05, atol=1e-3)
    loop = adaptive_fmu.Loop("3.2.1-cosine")
    one = loop.run(until=1, step=0.002, values={"plant.omega": 2.0})
    other = loop.run(stop_time=1, output_interval=0.002, start_values={"plant.omega": 2.0})
    np.testing.assert_array_equal(one.data, other.data)


def test_the_command_prints_what_a_loop_consists_of(tmp_path: Path) -> None:
    output = json.loads(program(tmp_path, "info", "3.2.1-cosine", "--json").stdout)
    assert [component["name"] for component in output["components"]] == ["reference", "plant", "controller"]
    of_file = {(each["from"], each["to"]) for each in output["connections"]}
    assert of_file == connections(ROOT / "examples/3.2.1-cosine") and (output["step"], output["stop_time"]) == (0.001, 60.0)
    text = program(tmp_path, "info", "3.2.1-cosine").stdout
    assert "plant.x[2]" in text and "communication step 0.001 s, gauss-seidel" in text
    made = program(tmp_path, "new", "loop", "--units", *PARTS, "--connect", "plant.u=reference.r", "--out", "own", "--json")
    answer = json.loads(made.stdout)
    assert answer["connected"] == 4 and answer["open"] == [] and Path(answer["structure"]).name == "SystemStructure.ssd"
    assert ("reference.r[1]", "plant.u[1]") in connections(tmp_path / "own")
    refused = program(tmp_path, "run", "StateSpace")
    assert refused.returncode == 1 and "`adaptive-fmu simulate StateSpace` simulates it" in refused.stderr


def test_a_diagram_shows_each_component_and_signal() -> None:
    for name in ("3.3.1-case2-bench", "7.5.1"):
        loop = adaptive_fmu.Loop(name)
        root = ET.fromstring(str(loop.diagram()))
        texts = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
        pairs = connections(ROOT / "examples" / name)
        components = {end.split(".")[0] for pair in pairs for end in pair}
        assert components <= set(texts)
        width, height = map(float, root.attrib["viewBox"].split()[2:])
        for rect in root.iter("{http://www.w3.org/2000/svg}rect"):
            assert 0 <= float(rect.attrib["x"]) < width and float(rect.attrib["y"]) + float(rect.attrib["height"]) <= height
        bundles = {(source.split(".")[0], to.split(".")[0]) for source, to in pairs}
        assert sum("marker-end" in element.attrib for element in root.iter()) == len(bundles)
