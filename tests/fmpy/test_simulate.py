"""One unit alone: `simulate` against FMPy, in both interfaces, with inputs from a file."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import sample
from conftest import adaptive_fmu, read_csv
from fmpy import simulate_fmu
from master import PLANT, Fmu, at_ease

STOP, STEP = 0.5, 1e-2


def simulate(fmu: Path, out: Path, *options: str | Path) -> dict[str, np.ndarray]:
    answer = adaptive_fmu("simulate", fmu, "--json", "--out", out, *options)
    assert (answer.returncode, answer.stderr) == (0, ""), answer
    output = json.loads(answer.stdout)
    table = read_csv(Path(output["results"]) / "result.csv")
    assert output["ended"] == "complete" and all(output["last"][name] == table[name][-1] for name in output["last"])
    assert {file.name for file in Path(output["results"]).iterdir()} == {"index.html", "metrics.json", "plot.svg", "result.csv"}
    return table


def refused(*arguments: str | Path) -> str:
    answer = adaptive_fmu("simulate", *arguments)
    assert (answer.returncode, answer.stdout) == (1, "") and answer.stderr.startswith("error: "), answer
    return answer.stderr


def inputs_of(fmu: Fmu, folder: Path) -> tuple[Path, np.ndarray]:
    """Waves for the continuous inputs of a unit, around the values that it is at ease with."""
    ease = at_ease(fmu)
    names = [v.name for v in fmu.variables.values() if v.causality == "input" and v.variability == "continuous"]
    times = np.linspace(0, STOP, 21)
    columns = [ease.get(name, 0.0) + 0.05 * np.sin(3 * times + k) for k, name in enumerate(names)]
    table = np.array(list(zip(times, *columns, strict=True)), dtype=[("time", float), *((name, float) for name in names)])
    file = folder / "input.csv"
    quoted = ",".join(["time", *(f'"{name}"' for name in names)])
    file.write_text("\n".join([quoted, *(",".join(map(repr, map(float, row))) for row in table)]) + "\n")
    return file, table


def settings(fmu: Fmu) -> list[str]:
    return [part for name, value in at_ease(fmu).items() for part in ("--set", f"{name}={value!r}")]


@pytest.mark.parametrize("name", sample.FMUS)
def test_co_simulation_gives_what_fmpy_gives(name: str, fmu, tmp_path: Path) -> None:
    unit = fmu(name)
    file, table = inputs_of(unit, tmp_path)
    options = ["--input", file, "--until", str(STOP), "--step", str(STEP), *settings(unit)]
    ours = simulate(unit.path, tmp_path, *options)
    outputs = [v.name for v in unit.variables.values() if v.causality == "output"]
    theirs = simulate_fmu(
        str(unit.path),
        fmi_type="CoSimulation",
        start_values=at_ease(unit),
        input=table if len(table.dtype) > 1 else None,
        output=outputs,
        stop_time=STOP,
        step_size=STEP,
        output_interval=STEP,
    )
    assert len(ours["time"]) == len(theirs["time"]) == round(STOP / STEP) + 1
    for output in outputs:
        wanted = theirs[output].astype(float)
        # Inputs are the same but for rounding; fast adaptation makes of that what the units' tolerance, 1e-6, allows.
        size = max(1.0, np.abs(wanted).max())
        np.testing.assert_allclose(ours[output], wanted, rtol=0, atol=1e-6 * size, err_msg=output)


@pytest.mark.parametrize("name", ["NonlinearSiso", "TwoLinkRobot", "MaresAuv", "TwinRotor", "Reference", "ReferenceQuadrotor"])
def test_model_exchange_gives_what_co_simulation_gives(name: str, fmu, tmp_path: Path) -> None:
    unit = fmu(name)
    options = ["--until", "1", "--step", "0.01", *settings(unit)]
    within = simulate(unit.path, tmp_path / "cs", *options)
    integrated = simulate(unit.path, tmp_path / "me", *options, "--interface", "me", "--tolerance", "1e-8")
    for output in within:
        size = max(1.0, np.abs(within[output]).max())
        np.testing.assert_allclose(integrated[output], within[output], atol=2e-5 * size, err_msg=output)


def test_inputs_are_linear_between_their_times_in_model_exchange(fmu, tmp_path: Path) -> None:
    # x1' = x2 + …: what a ramp does is compared with many short steps of co-simulation.
    (tmp_path / "ramp.csv").write_text('time,"u[1]"\n0,0\n0.5,1\n0.5,-1\n1,0\n')
    options = ["--input", tmp_path / "ramp.csv", "--until", "1", "--record", "x[1],x[2]"]
    exact = simulate(fmu(PLANT).path, tmp_path / "me", *options, "--step", "0.1", "--interface", "me", "--tolerance", "1e-10")
    # Held over a step, an input lags by half of it.
    near = simulate(fmu(PLANT).path, tmp_path / "cs", *options, "--step", "1e-5")
    for name in ("x[1]", "x[2]"):
        np.testing.assert_allclose(exact[name], near[name][::10000], atol=5e-5)


def test_wrong_inputs_are_refused_by_line_and_name(fmu, tmp_path: Path) -> None:
    file = tmp_path / "input.csv"
    for text, parts in [
        ("", ["line 1", "names"]),
        ("hours,u[1]\n0,1\n", ["line 1", "`time`"]),
        ("time [days],u[1]\n0,1\n", ["line 1", "in days", "in s, ms, us, min or h"]),
        ("time,u[1] [V]\n0,1\n", ["line 1", "u[1] is in V: must be in"]),
        ("time,speed\n0,1\n", ["line 1", "`speed`", "u[1]"]),
        ("time,u[1]\n", ["line 2", "at least one line of values"]),
        ("time,u[1]\n0,1\n1\n", ["line 3", "has 1 values, but there are 2 columns"]),
        ("time,u[1]\n0,one\n", ["line 2", "u[1] = one"]),
        ("time,u[1]\n0,nan\n", ["line 2", "u[1] = NaN"]),
        ("time,u[1]\n1,0\n0,0\n", ["line 3", "time = 0", "before"]),
    ]:
        file.write_text(text)
        error = refused(fmu(PLANT).path, "--input", file, "--out", tmp_path)
        assert all(part in error for part in ["input.csv", *parts]), error
    assert "`speed`" in refused(fmu(PLANT).path, "--record", "speed", "--out", tmp_path)
    assert "`speed`" in refused(fmu(PLANT).path, "--set", "speed=1", "--out", tmp_path)


def test_a_recording_longer_than_any_text_is_an_input(fmu, tmp_path: Path) -> None:
    """Six megabytes, with the marks and the ends of lines of a spreadsheet."""
    times = np.linspace(0, 1, 250_001)
    rows = [f"{t!r},{0.1 * t!r}" for t in times.tolist()]
    tables = []
    for name, lines in [("long", rows), ("short", [rows[0], rows[-1]])]:
        file = tmp_path / f"{name}.csv"
        file.write_bytes("\ufefftime,u[1]\r\n".encode() + "\r\n".join([*lines, ""]).encode())
        answer = adaptive_fmu("simulate", fmu(PLANT).path, "--input", file, "--until", "1", "--step", "0.01", "--out", tmp_path / name)
        assert answer.returncode == 0, answer
        tables.append(read_csv(tmp_path / name / PLANT / "result.csv"))
    assert (tmp_path / "long.csv").stat().st_size > 6_000_000
    for name in tables[0]:
        assert tables[0][name] == pytest.approx(tables[1][name], abs=1e-9), name
    with file.open("ab") as more:
        more.write(b"2,\xff\r\n")
    assert "line 4: is not UTF-8" in refused(fmu(PLANT).path, "--input", file)
    file.write_text("time,u[1]\n0," + "0" * 5_000_000 + "\n")
    assert "line 2: is longer than" in refused(fmu(PLANT).path, "--input", file)


def test_a_failing_unit_keeps_what_was_computed(fmu, tmp_path: Path) -> None:
    for interface in ("cs", "me"):
        options = ["--set", "x0[1]=1", "--interface", interface, "--out", tmp_path / interface]
        answer = adaptive_fmu("simulate", fmu(PLANT).path, *options)
        note, error = answer.stderr.splitlines()
        assert answer.returncode == 1 and note.startswith("results until then are in"), answer
        assert error.startswith("error: ") and "diverges" in error
        assert 1.2 < read_csv(tmp_path / interface / PLANT / "result.csv")["time"][-1] < 1.26


def test_a_unit_for_model_exchange_alone_is_simulated(fmu, tmp_path: Path) -> None:
    file = tmp_path / "Alone.fmu"
    with zipfile.ZipFile(fmu("TwinRotor").path) as archive, zipfile.ZipFile(file, "w") as other:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "modelDescription.xml":
                content = re.sub(rb"<CoSimulation.*?(/>|</CoSimulation>)", b"", content, flags=re.DOTALL)
            other.writestr(name, content)
    alone = simulate(file, tmp_path, "--until", "0.2")
    both = simulate(fmu("TwinRotor").path, tmp_path, "--until", "0.2", "--interface", "me")
    assert all(np.array_equal(alone[name], both[name]) for name in both)
    assert "does not support co-simulation" in refused(file, "--interface", "cs", "--out", tmp_path)
