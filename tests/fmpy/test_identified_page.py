"""The page of `identify`: its curves are those of an independent simulation, its bounds contain plants of the region, and it loads nothing."""

import json
import re
from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pytest
from recorded import program
from sample import NUMBER
from scipy.linalg import expm
from test_pages import BROWSER

NAMES = ["u <1>", "position", "speed"]


def machine(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    a = np.array([[0.0, 1.0], [-rng.uniform(4, 9), -rng.uniform(0.4, 1.5)]])
    return a, np.array([[0.0], [rng.uniform(2, 5)]])


def sampled(a: np.ndarray, b: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    both = expm(h * np.block([[a, b], [np.zeros((b.shape[1], a.shape[0] + b.shape[1]))]]))
    return both[: len(a), : len(a)], both[: len(a), len(a) :]


def recorded(folder: Path, rng: np.random.Generator, rows: int = 700, h: float = 0.05, noise: float = 0.02) -> pd.DataFrame:
    a, b = machine(rng)
    f, g = sampled(a, b, h)
    u = np.repeat(rng.uniform(-1, 1, rows), rng.integers(3, 25, rows))[:rows]
    x = np.zeros((rows, 2))
    for k in range(rows - 1):
        x[k + 1] = f @ x[k] + g[:, 0] * u[k]
    table = pd.DataFrame(np.column_stack([u, x + noise * rng.standard_normal(x.shape)]), index=h * np.arange(rows), columns=NAMES)
    table.rename_axis("time").to_csv(folder / "record.csv")
    return table


def diagrams(page: str) -> dict[str, dict]:
    found = re.findall(r'<script type="application/json">(.*?)</script>', page, flags=re.S)
    return {diagram["title"]: diagram for diagram in map(json.loads, found)}


def test_simulated_curves_are_those_of_the_model(tmp_path: Path) -> None:
    rng = np.random.default_rng([NUMBER, 70])
    table = recorded(tmp_path, rng)
    words = ["--inputs", "u <1>", "--states", "position,speed", "--page", "shown"]
    ran = program(tmp_path, "identify", "record.csv", *words)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    page = (tmp_path / "shown/identify.html").read_text()
    assert "u &lt;1&gt;" in page and "u <1>" not in page.replace("u \\u003c1>", "")
    model = json.loads((tmp_path / "model.json").read_text())
    f, g = sampled(np.array(model["A"]), np.array(model["B"]), 0.05)
    _, q = sampled(np.array(model["A"]), np.eye(2), 0.05)
    training_rows = len(table) - round(0.3 * len(table))
    found = diagrams(page)
    for i, name in enumerate(["position", "speed"]):
        curves = {curve["name"]: curve for curve in found[f"{name}, record.csv"]["curves"]}
        assert list(curves) == ["simulated", "simulated, held out", "measured"]
        for curve, rows in (("simulated", slice(0, training_rows)), ("simulated, held out", slice(training_rows, None))):
            part = table.iloc[rows]
            # Initial state and constant of each part by least squares, weighted by the noise of each signal.
            forced, sensitivities = np.zeros(2), np.hstack([np.eye(2), np.zeros((2, 2))])
            responses, forced_all = [], []
            for u in part[NAMES[0]]:
                responses.append(sensitivities.copy())
                forced_all.append(forced.copy())
                forced = f @ forced + g[:, 0] * u
                sensitivities = f @ sensitivities + np.hstack([np.zeros((2, 2)), q])
            weights = 1 / np.tile(np.array(model["noise"]), len(part))
            matrix, measured = np.vstack(responses), part[["position", "speed"]].to_numpy().ravel()
            rest = measured - np.concatenate(forced_all)
            best = np.linalg.lstsq(matrix * weights[:, None], rest * weights, rcond=None)[0]
            expected = (np.concatenate(forced_all) + matrix @ best).reshape(-1, 2)[:, i]
            shown = curves[curve]
            at = np.round(np.array(shown["x"]) / 0.05).astype(int) - (rows.start or 0)
            # The simulation weighs signals by output error's noise, which is not that of the model where the innovation form counts.
            tolerance = 0.05 * np.std(measured.reshape(-1, 2)[:, i] - expected) + 1e-5
            np.testing.assert_allclose(shown["y"], expected[at], atol=tolerance, err_msg=f"{NUMBER} {name} {curve}")
    measured = next(curve for curve in found["speed, record.csv"]["curves"] if curve["name"] == "measured")
    values = [value for value in measured["y"] if value is not None]
    assert min(values) == pytest.approx(table["speed"].min(), rel=1e-5) and max(values) == pytest.approx(table["speed"].max(), rel=1e-5)


def charts(page: str) -> dict[str, list[tuple[str, np.ndarray]]]:
    """Lines of the charts by their titles, in pixels."""
    found = {}
    for title, drawing in re.findall(r"<figure><figcaption>(.*?)</figcaption>(.*?)</figure>", page, flags=re.S):
        lines = re.findall(r"<title>([^<]*)</title><path class=\"curve\"[^>]*? d=\"([^\"]*)\"", drawing)
        found[title] = [(name, np.array(re.findall(r"(-?[\d.]+),(-?[\d.]+)", path), dtype=float)) for name, path in lines]
    return found


def test_bounds_of_frequency_responses_contain_plants_that_the_records_allow(tmp_path: Path) -> None:
    rng = np.random.default_rng([NUMBER, 71])
    table = recorded(tmp_path, rng, noise=0.05)
    found = adaptive_fmu.identify(table, [NAMES[0]], ["position", "speed"], page=tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    lines = charts(page)["u &lt;1&gt; to speed: magnitude"]
    assert [name for name, _ in lines] == ["bound", "bound", "magnitude"]
    (_, low), (_, high), (_, middle) = lines
    # From pixels to frequencies and dB, by the curve of the model itself.
    frequencies = np.geomspace(0.1 * np.abs(found.poles["pole"]).min(), np.pi / 0.05, len(middle))

    def magnitude(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        shifted = 1j * frequencies[:, None, None] * np.eye(2) - a
        return 20 * np.log10(np.abs(np.linalg.solve(shifted, np.broadcast_to(b, (len(frequencies), 2, 1))))[:, 1, 0])

    own = magnitude(found.A, found.B)
    slope, offset = np.polyfit(middle[:, 1], own, 1)
    np.testing.assert_allclose(slope * middle[:, 1] + offset, own, atol=0.02 * np.ptp(own) / 2)
    places = [place for place, (matrix, *_) in enumerate(found.free) if matrix != "d"]
    root = np.linalg.cholesky(found.covariance[np.ix_(places, places)] + 1e-300 * np.eye(len(places)))
    drawn = []
    for _ in range(2000):
        a, b = found.A.copy(), found.B.copy()
        for place, change in zip(places, root @ rng.standard_normal(len(places)), strict=True):
            matrix, row, column = found.free[place]
            (a if matrix == "A" else b)[row - 1, column - 1] += change
        drawn.append(magnitude(a, b))
    outside = np.mean([(one < slope * low[:, 1] + offset) | (one > slope * high[:, 1] + offset) for one in drawn], axis=0)
    print("outside of the bounds", outside.min(), outside.max())
    # 1 % are outside; pixels are rounded, and the bounds are those of the first order.
    assert 0.002 < np.median(outside) < 0.03 and outside.max() < 0.08, (NUMBER, outside.max())


def test_a_page_of_parameters_shows_the_fmu_and_its_linear_model(tmp_path: Path) -> None:
    rng = np.random.default_rng([NUMBER, 72])
    table = recorded(tmp_path, rng)
    motor = adaptive_fmu.identify(table, [NAMES[0]], ["position", "speed"])
    plant = adaptive_fmu.new("state-space", tmp_path / "Plant.toml", plant=(motor.A, motor.B, np.eye(2), np.zeros((2, 1))))
    table.columns = ["u[1]", "y[1]", "y[2]"]
    table.rename_axis("time").to_csv(tmp_path / "named.csv")
    words = ["--fmu", plant, "--inputs", "u[1]", "--outputs", "y[1],y[2]", "--free", "A[2,1],B[2,1]", "--page", "it.html"]
    ran = program(tmp_path, "identify", "named.csv", *words)
    assert ran.returncode == 0 and "the page is it.html" in ran.stdout + ran.stderr, ran.stdout + ran.stderr
    page = (tmp_path / "it.html").read_text()
    found = diagrams(page)
    assert list(found) == ["y[1], named.csv", "y[2], named.csv"]
    names = [curve["name"] for curve in found["y[1], named.csv"]["curves"]]
    assert names == ["simulated", "simulated, held out", "measured"]
    assert {"Poles", "u[1] to y[1]: magnitude", "u[1] to y[2]: phase"} <= set(charts(page))
    assert "<td>A[2,1]<" in page and "Parameters" in page
    again = program(tmp_path, "identify", "named.csv", *words, "--out", "other.json")
    assert again.returncode == 1 and "it.html: the file exists" in again.stderr, again.stderr
    # In Python the same numbers.
    estimated = adaptive_fmu.estimate(plant, tmp_path / "named.csv", "u[1]", ["y[1]", "y[2]"], free=["A[2,1]", "B[2,1]"])
    model = json.loads((tmp_path / "model.json").read_text())
    assert estimated.model == model and estimated.text == (tmp_path / "model.json").read_text()
    assert estimated.parameter_set == (tmp_path / "model.ssv").read_text()
    assert estimated.values == {name: value for name, value in zip(["A[2,1]", "B[2,1]"], [model["A"][1][0], model["B"][1][0]], strict=True)}


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: the page was not opened in a browser")
def test_a_browser_draws_the_page_at_any_width_and_finds_nothing_wrong(tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright isn't installed")
    table = recorded(tmp_path, np.random.default_rng([NUMBER, 73]), rows=300)
    adaptive_fmu.identify(table, [NAMES[0]], ["position", "speed"], page=tmp_path)
    faults: list[str] = []
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=BROWSER, headless=True, args=["--no-sandbox", "--disable-gpu"])
        for width in (1300, 400):
            page = browser.new_page(viewport={"width": width, "height": 900})
            page.on("console", lambda message: faults.append(message.text))
            page.on("pageerror", lambda error: faults.append(str(error)))
            page.goto(f"file://{tmp_path / 'identify.html'}")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            # Two signals and the disturbance; poles, two responses in two charts each, and two residuals with itself and the input.
            assert page.locator(".plot:has(path)").count() == 3 and page.locator("figure svg").count() == 1 + 4 + 4
        browser.close()
    assert faults == []
