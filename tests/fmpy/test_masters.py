"""The matrix of masters, its quick part: units alone in other masters have the numbers that plain calls give."""

import json
import os
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import fmpy
import fmusim
import matrix
import numpy as np
import programs
import pytest
import sample
import units
from conftest import ROOT
from drive import by_plain_calls, drive, grid
from loops import pack
from master import Fmu
from masters import TOLERANCE, largest
from package import Package

COUNT = 100
# One of each third kind, so that all get their turn.
KINDS = sample.FMUS if sample.ALL else sample.FMUS[sample.NUMBER % 3 :: 3]


def test_what_a_unit_is_given_shows_in_its_outputs(each_fmu: Fmu) -> None:
    """So a master that handed on no inputs, or late ones, would be found out."""
    given = drive(each_fmu, COUNT)
    late = replace(given, rows=np.roll(given.rows, 1, axis=0))
    outputs = by_plain_calls(given, *grid(given))
    if each_fmu.named(causality="input"):
        assert largest(by_plain_calls(late, *grid(given)), outputs) > 1e3 * TOLERANCE
    else:
        assert max(np.ptp(values) for values in outputs.signals.values()) > 1e3 * TOLERANCE


@pytest.mark.parametrize("master", [units.rust_co_simulation, units.rust_model_exchange])
def test_every_unit_works_in_the_rust_importer(each_fmu: Fmu, master: Callable, tmp_path: Path) -> None:
    difference, limit = master(each_fmu, COUNT, tmp_path)
    assert difference <= limit


@pytest.mark.parametrize("interface", ["CoSimulation", "ModelExchange"])
def test_every_unit_runs_from_its_own_defaults_in_fmpy(each_fmu: Fmu, interface: str) -> None:
    """Nothing is set and nothing connected, as at a tool's first try."""
    # A plant that needs its controller has a shorter experiment.
    stop = min(1.0, float(each_fmu.description.defaultExperiment.stopTime))
    ran = fmpy.simulate_fmu(str(each_fmu.path), fmi_type=interface, stop_time=stop)
    assert ran["time"][-1] == pytest.approx(stop)
    assert all(np.isfinite(ran[name]).all() for name in ran.dtype.names)


@pytest.mark.parametrize("interface", ["co-simulation", "model-exchange"])
def test_every_unit_runs_from_its_own_defaults_in_the_rust_importer(
    each_fmu: Fmu, interface: str, tmp_path: Path
) -> None:
    ran = units.rust_untouched(each_fmu, interface, tmp_path)
    assert all(np.isfinite(values).all() for values in ran.signals.values())


def test_every_unit_follows_inputs_that_change_in_fmpys_own_master(each_fmu: Fmu, tmp_path: Path) -> None:
    difference, limit = units.fmpy_co_simulation(each_fmu, COUNT, tmp_path)
    assert difference <= limit


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("master", [units.ecos, units.libcosim])
def test_a_unit_works_alone_in_ecos_and_libcosim(fmu, name: str, master, tmp_path: Path) -> None:
    difference, limit = master(fmu(name), COUNT, tmp_path)
    assert difference <= limit


@pytest.mark.parametrize("name", KINDS[::3])
def test_the_toolbox_finds_nothing_to_complain_about(fmu, name: str, tmp_path: Path) -> None:
    assert programs.fmutool(fmu(name), COUNT, tmp_path) == "ok"


def test_the_toolbox_complains_about_what_is_wrong(fmu, tmp_path: Path) -> None:
    wrong = Fmu(fmu("Sensor").path, tmp_path / "unpacked")
    wrong.path = tmp_path / "Sensor.fmu"
    description = (tmp_path / "unpacked" / "modelDescription.xml").read_text()
    with zipfile.ZipFile(wrong.path, "w") as archive:
        archive.writestr("modelDescription.xml", description.replace('variability="continuous"', 'variability="fixed"'))
    with pytest.raises(AssertionError, match="cannot be combined|is not allowed"):
        programs.fmutool(wrong, COUNT, tmp_path)


def test_a_container_of_the_toolbox_is_the_loop(tmp_path: Path) -> None:
    (packed,) = pack(tmp_path / "packed", "6.5.2-mrac")
    difference, limit = programs.fmucontainer(Package(packed, tmp_path / "unpacked"), COUNT, tmp_path)
    assert difference <= limit


def test_what_is_no_number_or_beyond_its_limit_has_failed() -> None:
    assert matrix.Cell.compared(1e-10, 1e-9) == matrix.Cell("1e-10", False, 1e-10)
    assert matrix.Cell.compared(1e-8, 1e-9).failed and matrix.Cell.compared(float("nan"), 1e-9).failed


# A master that exits 0 whatever it did, told what to do as fmuCheck, OMSimulator or fmusim is; its values are FMPy's, and
# something more.
PROGRAM = """#!{python}
import sys
import fmpy
import numpy
*options, fmu = sys.argv[1:]
given = dict(zip(options, options[1:])) | dict(word.split("=", 1) for word in options if "=" in word)
step, stop, result = (next(given[name] for name in names if name in given) for names in
                      [("-h", "--stepSize", "--output-interval"), ("-s", "--stopTime", "--stop-time"),
                       ("-o", "--resultFile", "--output-file")])
start = dict(options[k + 1 : k + 3] for k, word in enumerate(options) if word == "--start-value")
times = dict(stop_time=float(stop), output_interval=float(step))
table = fmpy.simulate_fmu(fmu, fmi_type="CoSimulation", start_values=start, **times)
with open(result, "w") as file:
    print(*('"%s"' % (name if name == "time" else "{prefix}" + name) for name in table.dtype.names), sep=",", file=file)
    for row in table:
        time, *values = map(numpy.atleast_1d, row)
        cells = (" ".join(repr(float(one) + {error}) for one in value) for value in values)
        print(float(time[0]), *cells, sep=",", file=file)
"""


@pytest.mark.parametrize("code", [0, 1])
@pytest.mark.parametrize(
    ("master", "program", "prefix", "error", "near"),
    [
        ("fmuCheck", programs.FMUCHECK, "", 1e-8, 1e-15),
        ("OMSimulator", programs.OMSIMULATOR, "model.root.NonlinearSiso.", 1e-8, 1e-15),
        ("fmusim ME", fmusim.FMUSIM, "", 2e-6, 1e-7),
    ],
)
def test_a_master_is_judged_by_its_values(
    master, program, prefix, error, near, code, tmp_path, monkeypatch, capsys
) -> None:
    (tmp_path / program).write_text(PROGRAM.format(python=sys.executable, prefix=prefix, error=code * error))
    (tmp_path / program).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(sys, "argv", ["run", "--quick", "--json", "--master", master, "NonlinearSiso"])
    assert matrix.main() == code
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    cell = row["masters"][master]
    assert row["name"] == "NonlinearSiso" and cell["failed"] == bool(code), cell
    assert cell["difference"] == pytest.approx(code * error, abs=near)


def test_a_program_that_is_not_there_is_no_failure(monkeypatch, capsys) -> None:
    monkeypatch.setattr(programs, "found", lambda _: False)
    monkeypatch.setattr(sys, "argv", ["run", "--quick", "--master", "OMSimulator", "Sensor"])
    assert matrix.main() == 0
    assert "not found" in capsys.readouterr().out


def test_a_master_that_cannot_be_run_has_failed_with_the_reason(monkeypatch, capsys) -> None:
    monkeypatch.setattr(units, "IMPORTER", ROOT / "no importer")
    monkeypatch.setattr(sys, "argv", ["run", "--quick", "--master", "fmi (Rust) CS", "Sensor"])
    assert matrix.main() == 1
    assert "failed: no importer is not built" in capsys.readouterr().out
