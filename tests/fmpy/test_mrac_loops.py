"""Robust MRAC with prescribed performance: the continuous loops, and the sampled law through separate units."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu, read_csv
from lxml import html
from master import Fmu, Unit
from test_command_line import fails

BOTH = ["gauss-seidel", "jacobi"]
CHANNELS = (1, 2, 3)


def run(loop: str, out: Path, *options: str | float | Path) -> tuple[dict, dict[str, np.ndarray]]:
    answer = adaptive_fmu("run", loop, *options, "--json", "--out", out)
    assert answer.returncode in (0, 3) and answer.stderr == "", answer
    output = json.loads(answer.stdout)
    return output, read_csv(Path(output["results"]) / "result.csv")


def values(output: dict, label: str) -> list[float]:
    return [metric["value"] for metric in output["metrics"] if label in metric["label"]]


def peaks(table: dict[str, np.ndarray]) -> list[float]:
    return [np.abs(table[f"controller.u[{i}]"]).max() for i in CHANNELS]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Loop 6.5.1 as one unit, with signals that are no outputs."""
    folder = tmp_path_factory.mktemp("whole")
    assert adaptive_fmu("export", "--composite", "6.5.1-mrac", "--out", folder).returncode == 0
    fmu = Fmu(folder / "Loop_6_5_1_mrac.fmu", folder / "unpacked")
    names = [
        f"{name}[{i}]" for name in ("controller.e", "controller.rho", "plant.x", "controller.x_m") for i in CHANNELS
    ]
    with Unit(fmu) as unit:
        unit.start()
        rows = [[unit[name] for name in names]]
        for k in range(1000):
            unit.step(0.01 * k, 0.01)
            rows.append([unit[name] for name in names])
    return dict(zip(names, np.array(rows).T, strict=True))


def test_as_a_composite_the_error_is_a_hundred_millionth_of_the_state(whole) -> None:
    for i, start in zip(CHANNELS, (0.3, 0.4, 0.2), strict=True):
        parts = np.abs(whole[f"controller.e[{i}]"] / whole[f"controller.rho[{i}]"])
        assert parts.argmax() == 0 and parts[0] == pytest.approx(start, abs=1e-12)
        late = whole[f"controller.e[{i}]"][500:]
        assert 1e-9 < np.sqrt(np.mean(late**2)) < 1.5e-8
        difference = whole[f"plant.x[{i}]"] - whole[f"controller.x_m[{i}]"]
        assert np.abs(difference - whole[f"controller.e[{i}]"]).max() < 1e-14


def test_as_a_composite_the_control_has_the_peaks_of_the_continuous_loop(tmp_path: Path) -> None:
    _, table = run("6.5.1-mrac", tmp_path, "--composite", "--until", 0.1, "--step", 1e-5)
    assert peaks(table) == pytest.approx([178.7, 326.6, 194.0], rel=2e-3)
    _, table = run("6.5.2-mrac", tmp_path, "--composite", "--until", 0.01, "--step", 1e-6)
    assert peaks(table) == pytest.approx([78, 888, 39], rel=0.01)
    e = table["plant.x[2]"] + 0.8
    # Against a model that has hardly moved by then.
    assert table["time"][np.abs(e).argmax()] == pytest.approx(3.5e-3, abs=1e-3)


def test_with_the_sign_of_the_adaptation_that_is_printed_here_the_nonlinear_loop_stays_inside(tmp_path: Path) -> None:
    output, _ = run("6.5.2-mrac", tmp_path, "--composite", "--step", 1e-4)
    largest = values(output, "/rho")
    assert output["ended"] == "complete" and largest[1] == pytest.approx(0.903, abs=2e-3) and max(largest) < 1


def test_a_model_that_starts_from_rest_loses_the_nonlinear_loop_immediately_with_an_error(tmp_path: Path) -> None:
    at_rest = [word for i in CHANNELS for word in ("--set", f"controller.x_m0[{i}]=0")]
    answer = adaptive_fmu("run", "6.5.2-mrac", "--composite", *at_rest, "--out", tmp_path)
    assert answer.returncode == 1 and "controller.e[2] = " in answer.stderr and "left its funnel" in answer.stderr
    assert 1.0e-4 < float(re.search(r"at t = ([\d.e-]+) s", answer.stderr.split("goes on")[1])[1]) < 1.2e-4


@pytest.mark.parametrize("order", BOTH)
@pytest.mark.parametrize("step", [0.01, 0.005, 0.001])
def test_the_sampled_law_holds_the_loop_at_the_steps_of_a_real_tool(fmu_folder, tmp_path, order, step) -> None:
    output, table = run("6.5.1-mrac", tmp_path, "--order", order, "--step", step, "--fmus", fmu_folder)
    assert output["ended"] == "complete" and max(values(output, "/rho")) < 1
    late = table["time"] >= 2.0 - 1e-9
    for i in CHANNELS:
        # The ideal model's output, by the exact solution for a reference that is linear between the points.
        e = table[f"plant.x[{i}]"] - model_of(table)[i - 1]
        assert np.sqrt(np.mean(e[late] ** 2)) <= step * {"gauss-seidel": 0.5, "jacobi": 0.7}[order]


def model_of(table: dict[str, np.ndarray]) -> np.ndarray:
    """x_m' = A_m (x_m - r) from rest."""
    from scipy import signal

    a_m = np.array([[-70.0, 0, 0], [0, -60, 1], [0, -1, -60]])
    r = np.array([table[f"reference.r[{i}]"] for i in CHANNELS]).T
    return signal.lsim((a_m, -a_m, np.eye(3), np.zeros((3, 3))), r, table["time"])[1].T


def test_the_printed_gains_lose_the_nonlinear_loop_at_long_steps_and_hold_it_at_its_own(fmu_folder, tmp_path) -> None:
    output, _ = run("6.5.2-mrac", tmp_path, "--until", 1, "--fmus", fmu_folder)
    assert max(values(output, "/rho")) == pytest.approx(0.925, abs=5e-3)
    refusal = adaptive_fmu("run", "6.5.2-mrac", "--step", 5e-4, "--fmus", fmu_folder, "--out", tmp_path).stderr
    assert "controller: " in refusal and "e[2] = " in refusal and "smaller communication step" in refusal


@pytest.mark.parametrize("order", BOTH)
def test_the_gains_for_co_simulation_hold_it_at_five_milliseconds(fmu_folder, tmp_path, order: str) -> None:
    options = ["--case", "cosimulation.ssv", "--step", 0.005, "--order", order, "--fmus", fmu_folder]
    output, _ = run("6.5.2-mrac", tmp_path, *options)
    assert output["ended"] == "complete" and max(values(output, "/rho")) < 1


def test_three_laws_are_compared_on_one_page(fmu_folder: Path, tmp_path: Path) -> None:
    loops = ["6.5.1-l1", "6.5.1-neuro", "6.5.1-mrac"]
    answer = adaptive_fmu("compare", *loops, "--until", 1, "--json", "--fmus", fmu_folder, "--out", tmp_path)
    assert answer.returncode == 0, answer
    output = json.loads(answer.stdout)
    assert [one["loop"] for one in output["loops"]] == loops
    page = html.document_fromstring(Path(output["page"]).read_text())
    rows = [[cell.text_content().strip() for cell in row] for row in page.get_element_by_id("metrics").iter("tr")]
    assert rows[0] == ["metric", *loops]
    measured = {row[0]: row[1:] for row in rows[1:]}
    for one, column in zip(output["loops"], range(3), strict=True):
        for metric in one["metrics"]:
            shown = measured[metric["label"]][column]
            assert shown == "–" if metric["value"] is None else float(shown) == float(f"{metric['value']:.4g}")
    titles = [heading.text_content() for heading in page.iter("h2")]
    assert {"plant.x[1]", "|plant.x[2] − x_m2| in its funnel", "controller.u[3]"} <= set(titles)
    assert "there is no loop named" in fails("compare", "6.5.1-l1", "nothing", "--out", tmp_path)


def test_the_page_of_a_comparison_loads_nothing(tmp_path: Path) -> None:
    assert adaptive_fmu("compare", "3.2.1-cosine", "3.2.1-square", "--until", 0.1, "--out", tmp_path).returncode == 0
    page = (tmp_path / "comparison" / "index.html").read_text()
    assert "default-src 'none'" in page and ROOT.as_posix() not in page
    document = html.document_fromstring(page)
    assert not document.xpath("//*[@src]")
    assert all(link.get("href").startswith("data:") for link in document.iter("link"))
