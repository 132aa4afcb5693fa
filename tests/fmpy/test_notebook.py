"""The notebooks: they run as they stand; the one that closes a loop gives what the program gives."""

import json
from pathlib import Path

import nbformat
import numpy as np
import pytest
from conftest import ROOT
from nbclient import NotebookClient
from test_foreign_plants import needs_python

FILE = ROOT / "examples" / "close_the_loop.ipynb"
OWN_PLANT = ROOT / "examples" / "own_plant.ipynb"
NOTEBOOK = nbformat.read(FILE, as_version=4)
CODE = [cell for cell in NOTEBOOK.cells if cell.cell_type == "code"]


@pytest.fixture(scope="module")
def executed() -> nbformat.NotebookNode:
    """The notebook after all its cells, and one that tells the points of the loop."""
    notebook = nbformat.read(FILE, as_version=4)
    notebook.cells.append(nbformat.v4.new_code_cell("import json\nprint(json.dumps(points))"))
    return NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(FILE.parent)}}).execute()


def test_the_notebook_gives_the_loop_that_the_program_gives(executed: nbformat.NotebookNode, ran) -> None:
    _, recorded = ran("3.2.1-cosine", "--until", 15)
    time, r, y, u = np.array(json.loads(executed.cells[-1].outputs[0].text)).T
    # From 15 s on the phase of the fast adaptation grows out of rounding errors.
    until = round(15 / 1e-3)
    assert time[-1] == pytest.approx(20)
    for shown, name in ((r, "reference.r[1]"), (y, "plant.y[1]"), (u, "controller.u[1]")):
        np.testing.assert_allclose(shown[:until], recorded[name][1 : until + 1], atol=1e-5)


def test_the_notebook_shows_the_loop(executed: nbformat.NotebookNode) -> None:
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs)


def test_the_loop_takes_ten_lines() -> None:
    loop = next(cell.source for cell in CODE if "doStep" in cell.source)
    assert len(loop.splitlines()) <= 10


@needs_python
def test_a_recording_of_an_fmu_leads_to_a_controller(tmp_path: Path) -> None:
    """Its last cell asserts overshoot and settling time."""
    notebook = nbformat.read(OWN_PLANT, as_version=4)
    assert len(notebook.cells) <= 20 and notebook.cells[-1].source.count("assert") >= 2
    path = f"import sys\nsys.path.insert(0, {str(ROOT / 'python')!r})"
    notebook.cells.insert(0, nbformat.v4.new_code_cell(path))
    done = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in done.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    assert {output.name for output in outputs if output.output_type == "stream"} == {"stdout"}
    assert (tmp_path / "oven/Ladrc.fmu").is_file() and "settled to 5 %" in done.cells[-1].outputs[0].text


@pytest.mark.parametrize("file", [FILE, OWN_PLANT])
def test_a_notebook_has_no_outputs_and_no_traces_of_a_machine(file: Path) -> None:
    notebook = nbformat.read(file, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert notebook.metadata.kernelspec.name == "python3"
