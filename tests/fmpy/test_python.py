"""The Python package: loops run, swept, tuned and linearised, units described and exported, errors, interrupts."""

import doctest
import importlib
import json
import os
import pkgutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import adaptive_fmu
import control
import numpy as np
import pandas as pd
import pytest
import scipy.signal
from adaptive_fmu import _pool
from conftest import ROOT, read_csv
from conftest import adaptive_fmu as by_hand

LOOP = "3.2.1-cosine"
MODULES = [module.name for module in pkgutil.iter_modules(adaptive_fmu.__path__, "adaptive_fmu.")]


@pytest.mark.parametrize("name", ["adaptive_fmu", *MODULES])
def test_examples_in_docstrings_are_true(name: str, tmp_path: Path) -> None:
    module = importlib.import_module(name)
    finder = doctest.DocTestFinder(exclude_empty=True)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    for example in finder.find(module, name, extraglobs={"folder": tmp_path, "record": ROOT / "examples/records/motor.csv"}):
        runner.run(example)
    assert runner.summarize(verbose=False).failed == 0


def test_everything_that_is_public_has_an_example() -> None:
    public = [getattr(adaptive_fmu, name) for name in adaptive_fmu.__all__]
    members = [
        member
        for thing in public
        if isinstance(thing, type)
        for name, member in vars(thing).items()
        if not name.startswith("_") and (callable(member) or isinstance(member, property) or hasattr(member, "func"))
    ]
    # What a sweep takes while it runs is not for callers.
    lacking = [thing for thing in [*public, *members] if ">>>" not in (thing.__doc__ or "")]
    assert [thing for thing in lacking if getattr(thing, "__name__", "") != "add" and not isinstance(thing, property)] == []


def test_a_run_gives_what_the_command_gives(tmp_path: Path) -> None:
    words = ["--set", "controller.adaptation_gain=20000.0", "--set", "plant.x0[2]=0.5"]
    output = by_hand("run", LOOP, "--until", "6", *words, "--out", tmp_path, folder=tmp_path)
    assert output.returncode == 3, output.stderr  # Such a start is beyond a limit.
    expected = read_csv(tmp_path / LOOP / "result.csv")
    result = adaptive_fmu.Loop(LOOP).run(until=6, controller={"adaptation_gain": 20_000}, plant={"x0": [0, 0.5]})
    assert list(result.data.columns) == [name for name in expected if name != "time"]
    np.testing.assert_array_equal(result.data.index, expected["time"])
    for name in result.data:
        np.testing.assert_array_equal(result.data[name], expected[name])
    assert result.folder is None and result.units["plant.x[1]"] == "1" and result.settings["step"] == 1e-3
    assert not result.holds and result.metrics["holds"].tolist() == [True, False, True]


@pytest.mark.parametrize("loop", ["3.2.1-cosine", "3.3.3", "7.5.1"])
@pytest.mark.parametrize("composite", [False, True])
def test_a_call_pays_for_what_changes_alone(loop: str, composite: bool) -> None:
    """Units are made ready once: the second call is served by the same process, and costs a small part of a program's start."""
    it = adaptive_fmu.Loop(loop)
    first = it.run(until=0.02, composite=composite)
    ready = list(_pool._idle)
    again = it.run(until=0.02, composite=composite)
    assert ready[-1] in _pool._idle and len(_pool._idle) == len(ready)
    pd.testing.assert_frame_equal(first.data, again.data)


def test_values_of_a_composite_are_those_of_its_units(tmp_path: Path) -> None:
    """Values reach the whole when it is instantiated; an FMU exported with them starts with the same."""
    values = {"controller.adaptation_gain": 5e3, "plant.omega": 2.5}
    result = adaptive_fmu.Loop(LOOP).run(until=3, composite=True, values=values)
    structure = ROOT / "examples" / LOOP
    case = tmp_path / "values.ssv"
    parameters = "".join(
        f'<ssv:Parameter name="{name}"><ssv:Real value="{value!r}"/></ssv:Parameter>' for name, value in values.items()
    )
    case.write_text(
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="v">'
        f"<ssv:Parameters>{parameters}</ssv:Parameters></ssv:ParameterSet>"
    )
    by_case = adaptive_fmu.Loop(structure).run(until=3, composite=True, case=case)
    pd.testing.assert_frame_equal(result.data, by_case.data)
    as_it_is = adaptive_fmu.Loop(LOOP).run(until=3, composite=True)
    assert not np.allclose(result.data["plant.y[1]"], as_it_is.data["plant.y[1]"], atol=1e-3)


def test_a_description_that_changed_is_made_ready_anew(tmp_path: Path) -> None:
    for file in (ROOT / "examples" / LOOP).iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    structure = tmp_path / "SystemStructure.ssd"
    plant = tmp_path / "resources" / "Own.toml"
    plant.parent.mkdir()
    text = (ROOT / "modelDescription" / "NonlinearSiso.toml").read_text().replace('"NonlinearSiso"', '"Own"')
    plant.write_text(text)
    structure.write_text(structure.read_text().replace("/NonlinearSiso.fmu", "/Own.fmu", 1))
    loop = adaptive_fmu.Loop(tmp_path)
    before = loop.run(until=2)
    plant.write_text(text + "\n[start]\nomega = 3.0\n")
    after = loop.run(until=2)
    assert not np.allclose(before.data["plant.x[1]"], after.data["plant.x[1]"], atol=1e-4)


def test_errors_are_exceptions_with_what_to_do(tmp_path: Path) -> None:
    loop = adaptive_fmu.Loop(LOOP)
    with pytest.raises(adaptive_fmu.Error, match="there is no `plant.nix`"):
        loop.run(plant={"nix": 1})
    # In keyword arguments, not in options of a command line.
    with pytest.raises(adaptive_fmu.ArgumentError, match="for 'until': must be a finite number above 0"):
        loop.run(until=-1)
    with pytest.raises(adaptive_fmu.Error) as refused:
        adaptive_fmu.new("l1", tmp_path / "Mine.toml", plant="NonlinearSiso", bandwidth=-1)
    assert "bandwidth" in str(refused.value) and "--" not in str(refused.value)
    with pytest.raises(adaptive_fmu.ArgumentError, match="It must be a dict with the values of its variables"):
        loop.run(plant=3)  # type: ignore[arg-type]
    with pytest.raises(adaptive_fmu.ArgumentError, match="must be a number, a bool, a str"):
        loop.run(plant={"omega": None})  # type: ignore[dict-item]
    with pytest.raises(adaptive_fmu.Error, match="omega"):
        loop.run(plant={"omega": "two"})
    with pytest.raises(adaptive_fmu.Error, match="no FMU named `Nix`"):
        adaptive_fmu.export("Nix", out=tmp_path)
    with pytest.raises(adaptive_fmu.Error, match="there is no component named `nix`; there are: reference"):
        adaptive_fmu.export(composite=LOOP, without=["nix"], out=tmp_path)
    with pytest.raises(adaptive_fmu.Error, match="diverges") as failed:
        adaptive_fmu.Loop("4-case3").run()
    assert failed.value.partial is not None and failed.value.partial.ended == "failed"
    assert len(failed.value.partial.data) > 1000
    beyond = loop.run(until=6, plant={"x0": [0, 0.5]})
    assert not beyond.holds and beyond.metrics["holds"].tolist().count(False) == 1
    with pytest.raises(adaptive_fmu.LimitExceeded, match="is beyond its limit"):
        beyond.check()


def test_names_and_values_reach_the_program_as_they_are(tmp_path: Path) -> None:
    """No shell, no separators: what a name or folder holds is its own business."""
    folder = tmp_path / "it's; $(touch gone) ü ="
    [file] = adaptive_fmu.export("NonlinearSiso", out=folder)
    assert file.parent == folder and file.is_file() and not (tmp_path / "gone").exists()
    with pytest.raises(adaptive_fmu.Error, match="no loop named `--help`"):
        adaptive_fmu.Loop("--help").run()
    rng = np.random.default_rng(5)
    for value in [*rng.standard_normal(5), *rng.standard_normal(5) * 1e-300, 5e-324, -0.0, 0.1, float(2**39 + 1)]:
        result = adaptive_fmu.simulate("Actuator", values={"u[1]": value}, until=1e-3, step=1e-3, record=["u[1]"])
        assert result.data["u[1]"].iloc[0] == value


def test_relative_paths_are_those_of_the_moment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        adaptive_fmu.export("Reference", out="fmus")
        assert (tmp_path / name / "fmus" / "Reference.fmu").is_file()


@pytest.mark.skipif(os.name == "nt", reason="names of files are Unicode there")
def test_a_name_that_is_not_unicode_is_refused_and_nobody_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    odd = tmp_path / os.fsdecode(b"x\xff")
    odd.mkdir()
    with pytest.raises(adaptive_fmu.ArgumentError, match="is not UTF-8"):
        adaptive_fmu.export("Reference", out=odd)
    monkeypatch.chdir(odd)
    with pytest.raises(adaptive_fmu.ArgumentError, match=r"x\\udcff. is not UTF-8"):
        adaptive_fmu.export("Reference", out="fmus")
    monkeypatch.chdir(tmp_path)
    assert adaptive_fmu.export("Reference", out="fmus")[0].is_file()
    # On the command line it is a name as any other, which JSON shows as well as it can.
    done = subprocess.run(
        [adaptive_fmu.program(), "run", LOOP, "--until", "0.1", "--json", "--out", os.fsencode(odd)],
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0 and json.loads(done.stdout)["results"] == str(tmp_path / "x\ufffd" / LOOP), done.stderr
    assert (odd / LOOP / "result.csv").is_file()


def test_whatever_is_asked_has_an_end() -> None:
    """Who asks may wait for it."""
    lines = [
        b'{"request": 1, "arguments": ["list", "\\udcff"], "folder": "."}',
        b'{"request": 2, "arguments": ["list"]}',
        b"nothing",
        b"",
        b"\xff\xfe",
        b'{"request": 5, "arguments": ["list", "\xff"], "folder": "."}',
        b'{"request": 3, "arguments": ["list"], "folder": "/nowhere"}',
        b'{"request": 4, "arguments": ["schema"], "folder": "."}',
    ]
    asked = b"".join(line + b"\n" for line in lines)
    done = subprocess.run([adaptive_fmu.program(), "serve"], input=asked, capture_output=True, timeout=60, check=False)
    messages = [json.loads(line[1:]) for line in done.stdout.splitlines() if line.startswith(b"\x1e")]
    assert [message["end"] for message in messages if "end" in message] == [2, 2, 2, 2, 2, 2, 1, 0]


def test_a_sweep_gives_the_runs_one_by_one() -> None:
    loop = adaptive_fmu.Loop(LOOP)
    gains, omegas = np.array([1e3, 1e4]), [1.0, 2.0]
    swept = loop.sweep({"controller.adaptation_gain": gains, "plant.omega": omegas}, until=6, keep=True)
    assert len(swept) == 4 and len(swept.results) == 4 and (swept.data["ended"] == "complete").all()
    for (_, row), result in zip(swept.data.iterrows(), swept.results, strict=True):
        single = loop.run(until=6, values={name: row[name] for name in ("controller.adaptation_gain", "plant.omega")})
        pd.testing.assert_frame_equal(result.data, single.data)
        assert row["max |u|"] == single.metrics.loc["max |u|", "value"]


def test_a_run_of_a_sweep_that_fails_is_a_row() -> None:
    swept = adaptive_fmu.Loop(LOOP).sweep({"plant.omega": [1.0, -1.0]}, until=6)
    assert swept.data["ended"].tolist() == ["complete", "failed"]
    assert "diverges" in swept.data["message"][1] and swept.data["message"][0] == ""
    with pytest.raises(adaptive_fmu.Error, match="there is no `plant.nix`"):
        adaptive_fmu.Loop(LOOP).sweep({"plant.nix": [1.0]})


def test_tuning_finds_what_the_loop_is_better_with() -> None:
    loop = adaptive_fmu.Loop("4-case1-fuzzy")
    tuned = loop.tune(particles=4, generations=3, until=3)
    assert tuned.objective <= tuned.before and tuned.ended == "complete" and tuned.runs == 12 and tuned.values
    again = loop.tune(particles=4, generations=3, until=3)
    assert again.values == tuned.values and again.objective == tuned.objective


def test_a_search_in_the_same_folder_goes_on_or_is_refused_in_words_of_python(tmp_path: Path) -> None:
    loop, words = adaptive_fmu.Loop("4-case1-fuzzy"), {"particles": 4, "until": 1, "out": tmp_path}
    assert loop.tune(generations=1, **words).runs == 4 and loop.tune(generations=2, **words).runs == 4
    with pytest.raises(adaptive_fmu.Error, match="seed was 1, is 2") as refused:
        loop.tune(generations=2, seed=2, **words)
    assert "force=True" in str(refused.value) and "--" not in str(refused.value)
    tagged = loop.tune(generations=2, seed=2, tag="two", **words)
    assert tagged.runs == 8 and (tmp_path / "4-case1-fuzzy-tuned@two" / "tuned.ssv").is_file()
    assert loop.tune(generations=2, seed=2, force=True, **words).values == tagged.values


def test_a_loop_is_linearised_as_its_name_is() -> None:
    asked = {"at": 0.5, "step": 1e-3}
    of_loop, of_name = adaptive_fmu.Loop(LOOP).linearise(**asked), adaptive_fmu.linearise(LOOP, **asked)
    np.testing.assert_array_equal(of_loop.A, of_name.A)


def test_a_linearisation_is_that_of_the_equations() -> None:
    linear = adaptive_fmu.linearise("StateSpace")
    step = 1e-6
    # The plant's own A by its response, independent of what told it.
    for k, state in enumerate(linear.states):
        base, moved = (
            adaptive_fmu.simulate("StateSpace", values={f"x0[{k + 1}]": x}, until=step, step=step).data for x in (0.0, 1.0)
        )
        slope = [(moved[name].iloc[-1] - base[name].iloc[-1] - (name == state)) / step for name in linear.states]
        np.testing.assert_allclose(linear.A[:, k], slope, rtol=1e-4, atol=1e-4)
    system = linear.ss()
    assert isinstance(system, control.StateSpace)
    np.testing.assert_array_equal(system.A, linear.A)
    np.testing.assert_allclose(sorted(system.poles(), key=abs), sorted(linear.eigenvalues, key=abs))


A, B, C, D = [[0.0, 1.0], [0.0, -10.0]], [[0.0], [50.0]], [[1.0, 0.0]], [[0.0]]
PLANTS = {
    "matrices": (A, B, C, D),
    "control": control.ss(A, B, C, D),
    "scipy": scipy.signal.StateSpace(A, B, C, D),
}


@pytest.mark.parametrize("form", PLANTS)
def test_a_controller_for_a_plant_in_any_form_is_sound(form: str, tmp_path: Path) -> None:
    file = adaptive_fmu.new("l1", tmp_path / "Own.toml", plant=PLANTS[form])
    (tmp_path / "again").mkdir()
    same = adaptive_fmu.new("l1", tmp_path / "again" / "Own.toml", plant=PLANTS["matrices"])
    assert file.read_text() == same.read_text()
    report = adaptive_fmu.check(file)
    assert report.name == "Own" and not report.findings.empty and report.text.startswith("Own: ")
    [fmu] = adaptive_fmu.export(file, out=tmp_path)
    result = adaptive_fmu.simulate(fmu, until=0.1)
    assert np.isfinite(result.data.to_numpy()).all()


def test_a_transfer_function_is_a_plant_and_a_sampled_one_too(tmp_path: Path) -> None:
    transfer = control.tf([50.0], [1.0, 10.0, 0.0])
    assert adaptive_fmu.check(adaptive_fmu.new("l1", tmp_path / "Own.toml", plant=transfer)).name == "Own"
    sampled = control.sample_system(control.ss(transfer), 0.1)
    with open(adaptive_fmu.new("state-space", tmp_path / "Sampled.toml", plant=sampled), "rb") as file:
        structure = tomllib.load(file)["structure"]
    assert structure["delay"] == [0.05]
    np.testing.assert_allclose(structure["A"], control.ss(transfer).A, rtol=0, atol=1e-9)
    with pytest.raises(adaptive_fmu.ArgumentError, match="its sample time is unknown"):
        adaptive_fmu.new("l1", tmp_path / "Other.toml", plant=control.ss(A, B, C, D, True))
    with pytest.raises(adaptive_fmu.ArgumentError, match="must be a linear system"):
        adaptive_fmu.new("l1", tmp_path / "Other.toml", plant=3)
    with pytest.raises(adaptive_fmu.Error, match="Use force=True to overwrite it"):
        adaptive_fmu.new("l1", tmp_path / "Own.toml", plant=transfer)


def test_inputs_over_time_reach_a_unit(tmp_path: Path) -> None:
    """A linear plant under a ramp, by its own exponential."""
    times = np.array([0.0, 1.0])
    ramp = pd.DataFrame({"u[1]": [0.0, 1.0]}, index=times)
    result = adaptive_fmu.simulate("StateSpace", input=ramp, until=1, step=0.01)
    linear = adaptive_fmu.linearise("StateSpace")
    system = scipy.signal.StateSpace(linear.A, linear.B[:, :1], linear.C, linear.D[:, :1])
    grid = result.data.index.to_numpy()
    _, expected, _ = scipy.signal.lsim(system, grid, grid)
    expected = np.asarray(expected).reshape(len(grid), -1)
    # Held over a communication step, a ramp comes half a step late.
    np.testing.assert_allclose(result.data[linear.outputs], expected, atol=0.02 * np.abs(expected).max() + 1e-9)


def test_a_figure_has_the_loops_plots_with_units() -> None:
    figure = adaptive_fmu.Loop("3.3.1-case2").run(until=0.2).plot()
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert "angle (rad)" in labels and "torque (N m)" in labels and figure.axes[-1].get_xlabel() == "time (s)"
    lines = {line.get_label(): line for axis in figure.axes for line in axis.get_lines()}
    own, reference = lines["plant.y[1]"], lines["reference.r[1]"]
    assert (own.get_linestyle(), reference.get_linestyle()) == ("-", "--") and own.get_color() == reference.get_color()
    assert reference.get_zorder() < own.get_zorder()
    assert len({(line.get_color(), line.get_linestyle()) for line in lines.values()}) >= 4


def test_a_figure_of_a_long_run_keeps_every_peak() -> None:
    from adaptive_fmu._result import MOST_POINTS, seen

    values = np.zeros(123_457)
    values[[7, 60_001, 123_456]] = [3.0, -5.0, 1.0]
    places = seen(values)
    assert len(places) <= MOST_POINTS + 200 and np.all(np.diff(places) > 0)
    assert {0, 7, 60_001, 123_456} <= set(places.tolist())
    assert np.array_equal(seen(values[:100]), np.arange(100))


def test_a_figure_shows_errors_in_their_funnel_on_a_logarithmic_axis() -> None:
    result = adaptive_fmu.Loop("6.5.1-neuro").run(until=0.5)
    axis = next(axis for axis in result.plot().axes if "funnel" in axis.get_title(loc="left"))
    lines = {line.get_label(): line.get_ydata() for line in axis.get_lines()}
    assert axis.get_yscale() == "log" and len(lines) == 4
    expected = (result.data["plant.x[2]"] - result.data["x_m2"]).abs()
    np.testing.assert_allclose(lines["|plant.x[2] − x_m2|"], expected)
    np.testing.assert_allclose(lines["funnel ρ"], 1.95 * np.exp(-1.5 * result.data.index) + 0.05)


def test_a_notebook_shows_metrics_and_a_picture() -> None:
    shown = adaptive_fmu.Loop(LOOP).run(until=6)._repr_html_()
    assert "max |u|" in shown and "<svg" in shown and "<script" not in shown


# A shell that starts the tests in the background has interrupts ignored.
HEARD = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
INTERRUPTED = f"""{HEARD}
import adaptive_fmu, os, sys, threading, time
loop = adaptive_fmu.Loop({LOOP!r})
loop.run(until=0.1)
threading.Timer(0.7, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    loop.run(until=5000, step=1e-3, progress=False)
except KeyboardInterrupt as interrupt:
    assert type(interrupt) is adaptive_fmu.Interrupted
    print(interrupt.partial.ended, len(interrupt.partial.data), loop.last is interrupt.partial)
print(loop.run(until=0.1).ended)
"""


def test_an_interrupt_keeps_what_was_computed() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    ended, points, is_last = done.stdout.splitlines()[0].split()
    assert ended == "interrupted" and 100 < int(points) < 5_000_000 and is_last == "True"
    assert done.stdout.splitlines()[1] == "complete"


INTERRUPTED_MANY = f"""{HEARD}
import adaptive_fmu, os, sys, threading
loop = adaptive_fmu.Loop({LOOP!r})
threading.Timer(2.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
if sys.argv[1] == "sweep":
    try:
        loop.sweep({{"plant.x0[1]": [k * 1e-4 for k in range(3000)]}}, until=6, progress=False)
    except adaptive_fmu.Interrupted as interrupt:
        print(len(interrupt.partial), set(interrupt.partial.data["ended"]) - {{"complete"}})
else:
    gain = {{"controller.feedback_gain[1,1]": (5.0, 40.0)}}
    tuned = loop.tune(gain, metric="max |u|", until=6, particles=20, generations=500, progress=False)
    print(tuned.runs, tuned.ended, tuned.values)
"""


@pytest.mark.parametrize(("what", "message"), [("sweep", "set()"), ("tune", "interrupted")])
def test_an_interrupt_keeps_the_runs_that_were_done(what: str, message: str) -> None:
    words = [sys.executable, "-c", INTERRUPTED_MANY, what]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    runs, ended = done.stdout.split()[:2]
    assert 0 < int(runs) < 3000 and ended == message


def test_the_program_ends_with_python_and_leaves_no_files(tmp_path: Path) -> None:
    code = f"""
import adaptive_fmu
from adaptive_fmu import _pool
adaptive_fmu.Loop({LOOP!r}).run(until=0.1)
print(_pool._idle[0].process.pid)
"""
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert not Path(f"/proc/{done.stdout.strip()}").exists() and list(tmp_path.iterdir()) == []


def test_a_program_that_is_gone_is_reported_and_the_next_call_works() -> None:
    loop = adaptive_fmu.Loop(LOOP)
    loop.run(until=0.1)
    busy = threading.Timer(0.5, lambda: [os.kill(one.process.pid, signal.SIGKILL) for one in _pool._busy])
    busy.start()
    with pytest.raises(adaptive_fmu.Error, match="was ended by signal 9"):
        loop.run(until=5000, progress=False)
    assert loop.run(until=0.1).ended == "complete"


def test_many_threads_ask_at_a_time() -> None:
    loop, found = adaptive_fmu.Loop(LOOP), []
    threads = [
        threading.Thread(target=lambda k=k: found.append((k, loop.run(until=0.1, plant={"x0": [k, 0]})))) for k in range(6)
    ]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert len(found) == 6 and all(result.data["plant.x[1]"].iloc[0] == k for k, result in found)


@pytest.fixture
def other_program(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    monkeypatch.setenv("ADAPTIVE_FMU_PROGRAM", str(tmp_path / "nix"))
    monkeypatch.setattr(_pool, "_idle", [])
    yield tmp_path / "nix"


def test_without_the_program_the_error_has_advice(other_program: Path) -> None:
    with pytest.raises(adaptive_fmu.Error, match="can't be started"):
        adaptive_fmu.loops()


def test_types_are_those_that_are_written() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_time_is_reported_while_a_run_goes_on() -> None:
    heard: list[tuple[float, str]] = []
    begun = time.monotonic()
    answer = _pool.ask(["run", LOOP, "--until", "200", "--json"], lambda done, message: heard.append((done, message)))
    assert answer.code in (0, 3) and (time.monotonic() - begun < 0.3 or heard)
    assert all(0 < done <= 1 and "real time" in message for done, message in heard)
    assert [done for done, _ in heard] == sorted(done for done, _ in heard)
