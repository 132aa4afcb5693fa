"""Results in notebooks, executed in a kernel: nothing in red on the first run, each figure once, and tables of all that is returned."""

import sys

import nbformat
import pytest
from conftest import ROOT
from nbclient import NotebookClient

CELLS = {
    "run": "import adaptive_fmu\nloop = adaptive_fmu.Loop('3.2.1-cosine')\nresult = loop.run(until=1)\nresult",
    "loop": "loop",
    "figure": "result.plot()",
    "figure in the middle": "figure = result.plot()\nlen(figure.axes)",
    "closed figure": "from matplotlib import pyplot\npyplot.close(figure)\nfigure",
    "check": "adaptive_fmu.check('L1NonlinearSiso')",
    "linearise": "adaptive_fmu.linearise('NonlinearSiso', at=0.5)",
    "tuned": "loop.tune({'controller.feedback_gain[1,1]': (5.0, 40.0)}, metric='max |u|', until=6, particles=2, generations=1)",
    "diagram": "loop.diagram()",
    "connected": "adaptive_fmu.Loop.connect('ReferenceNonlinearSiso', 'NonlinearSiso', 'L1NonlinearSiso')",
}


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[nbformat.NotebookNode]]:
    notebook = nbformat.v4.new_notebook()
    path = f"import sys\nsys.path.insert(0, {str(ROOT / 'python')!r})"
    notebook.cells = [nbformat.v4.new_code_cell(path), *map(nbformat.v4.new_code_cell, CELLS.values())]
    notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python", "language": "python"}
    folder = tmp_path_factory.mktemp("notebook")
    done = NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    return {name: cell.outputs for name, cell in zip(CELLS, done.cells[1:], strict=True)}


def shown(outputs: list[nbformat.NotebookNode], kind: str) -> list[str]:
    return [output.data[kind] for output in outputs if "data" in output and kind in output.data]


def test_nothing_is_written_in_red(outputs: dict[str, list[nbformat.NotebookNode]]) -> None:
    errors = {name: output.text for name, several in outputs.items() for output in several if output.get("name") == "stderr"}
    assert errors == {} and sys.stderr is not None


def test_a_figure_is_displayed_once(outputs: dict[str, list[nbformat.NotebookNode]]) -> None:
    for name in ("figure", "figure in the middle", "closed figure"):
        assert len(shown(outputs[name], "image/png")) == 1, name
    assert any(text.isdigit() for text in shown(outputs["figure in the middle"], "text/plain"))


def test_what_is_returned_has_tables_and_pictures(outputs: dict[str, list[nbformat.NotebookNode]]) -> None:
    for name, parts in {
        "run": ["max |u|", "<svg"],
        "loop": ["example 3.2.1", "<svg", "L1NonlinearSiso"],
        "check": ["Desired dynamics", "sound"],
        "linearise": ["eigenvalues", "u[1]", "x[2]"],
        "tuned": ["feedback_gain", "objective"],
        "connected": ["<svg", "controller"],
    }.items():
        [html] = shown(outputs[name], "text/html")
        assert all(part in html for part in parts), (name, html)
    [svg] = shown(outputs["diagram"], "image/svg+xml")
    assert svg.count("<rect") == 3 and "r[1]" in svg
