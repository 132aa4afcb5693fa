"""What a reader sees of runs and comparisons: labels, widths of pages and of the terminal, recorded points, the dark."""

import json
from pathlib import Path
from typing import Any

import adaptive_fmu as package
import numpy as np
import pytest
from conftest import adaptive_fmu, read_csv
from lxml import html
from test_explore import browser as browser  # noqa: PLC0414 (a fixture)

LOOP = "3.2.1-cosine"
LONG = f"{LOOP}:controller.adaptation_gain=1e4,plant.omega=1.5,reference.cosine_amplitude[1]=1.25"


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """A page of four runs, two of which have labels, with its JSON and its text."""
    out = tmp_path_factory.mktemp("compared")
    runs = [LOOP, f"strong={LOOP}:plant.omega=2.5", f"slower reference, little gain={LONG}", LONG]
    words = ["compare", *runs, "--until", "2"]
    text, answer = (adaptive_fmu(*words, *json_, "--out", out) for json_ in ([], ["--json"]))
    assert text.returncode == answer.returncode, (text, answer)
    return out / "comparison" / "index.html", json.loads(answer.stdout), text.stdout


def test_labels_name_runs_everywhere_and_their_folders(compared: tuple[Path, dict[str, Any], str]) -> None:
    page, output, text = compared
    values = "controller.adaptation_gain=1e4,plant.omega=1.5,reference.cosine_amplitude_1_=1.25"
    labels = [LOOP, "strong", "slower reference, little gain", f"{LOOP}@{values}"]
    assert [loop["label"] for loop in output["loops"]] == labels
    folders = [Path(loop["results"]).name for loop in output["loops"]]
    assert folders == [LOOP, f"{LOOP}@strong", f"{LOOP}@slower_reference,_little_gain", labels[3]]
    document = html.document_fromstring(page.read_text())
    assert [cell.text.strip() for cell in document.get_element_by_id("metrics").find(".//tr")] == ["metric", *labels]
    drawn = json.loads(document.xpath("//script[@type='application/json']")[0].text)
    assert [curve["name"] for curve in drawn["curves"]][:4] == labels
    assert all(label in text for label in labels)


def test_a_table_fits_a_hundred_columns(compared: tuple[Path, dict[str, Any], str], tmp_path: Path) -> None:
    assert max(len(line) for line in compared[2].splitlines() if not line.startswith("page with")) <= 100
    many = [f"{k}={LOOP}:plant.omega=1.{k}" for k in range(1, 9)]
    text = adaptive_fmu("compare", *many, LONG, "--until", "0.1", "--out", tmp_path).stdout
    lines = [line for line in text.splitlines() if not line.startswith("page with")]
    assert max(map(len, lines)) <= 100 and sum(line.startswith("max |u|") for line in lines) > 1
    assert lines[8].startswith("(9) ") and lines[8].endswith("reference.cosine_amplitude_1_=1.25"), text


def test_labels_are_refused_where_they_are_none(tmp_path: Path) -> None:
    twice = adaptive_fmu("compare", f"a={LOOP}", f"a={LOOP}:plant.omega=2", "--until", "0.1", "--out", tmp_path)
    assert twice.returncode == 1 and "two runs have this label" in twice.stderr and not [*tmp_path.iterdir()]
    assert "label before = must not be empty" in adaptive_fmu("compare", f"={LOOP}", LOOP).stderr
    with pytest.raises(package.ArgumentError, match="label 'a:b'"):
        package.compare(LOOP, **{"a:b": LOOP})


def test_python_names_columns_by_labels() -> None:
    table = package.compare(LOOP, until=1, strong=(LOOP, {"plant.omega": 2.5}))
    assert table.columns.to_list() == ["limit", LOOP, "strong"]
    alone = package.Loop(LOOP).run(until=1, values={"plant.omega": 2.5}).metrics
    np.testing.assert_array_equal(table["strong"].loc[alone.index], alone["value"])


@pytest.mark.parametrize("width", [400, 1300])
def test_a_comparison_is_no_wider_than_its_screen(browser: Any, compared: tuple[Path, dict[str, Any], str], width: int) -> None:
    shown = browser.new_page(viewport={"width": width, "height": 900})
    shown.goto(compared[0].as_uri())
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    # Nor where a pointer shows all values.
    plot = shown.locator(".plot").first.bounding_box()
    for part in (0.3, 0.6, 0.95):
        shown.mouse.move(plot["x"] + part * plot["width"], plot["y"] + 100)
        assert shown.locator(".readout").first.is_visible()
        assert shown.evaluate("document.documentElement.scrollWidth") <= width
    table, legend = shown.locator("#metrics").bounding_box(), shown.locator(".legend").first.bounding_box()
    assert table["x"] + table["width"] <= width and legend["x"] + legend["width"] <= width
    shown.close()


def test_a_pointer_shows_recorded_points(browser: Any, tmp_path: Path) -> None:
    answer = adaptive_fmu("run", LOOP, "--until", "20", "--json", "--out", tmp_path)
    folder = Path(json.loads(answer.stdout)["results"])
    table = read_csv(folder / "result.csv")
    shown = browser.new_page(viewport={"width": 1000, "height": 900})
    shown.goto((folder / "index.html").as_uri())
    plot = shown.locator(".plot svg").first
    box = plot.bounding_box()
    for across in np.linspace(box["x"] + 80, box["x"] + box["width"] - 20, 12):
        shown.mouse.move(across, box["y"] + 100)
        first, *lines = shown.locator(".readout").first.evaluate(
            "shown => [shown.firstChild.textContent, ...[...shown.children].map(it => it.textContent)]"
        )
        time = float(first.removeprefix("time = ").removesuffix(" s"))
        assert len(lines) == 3
        for line in lines:
            name, _, value = line.partition(": ")
            value, _, own = value.partition(" at ")
            row = np.abs(table["time"] - float(own or time)).argmin()
            assert table["time"][row] == pytest.approx(float(own or time), rel=1e-5)
            assert float(value) == pytest.approx(table[name][row], rel=1e-5, abs=1e-9), line
            # Near the pointer wherever that is.
            assert abs(float(own or time) - time) < 0.01 * 20, line
    shown.close()


def luminance(colour: str) -> float:
    parts = [float(part) / 255 for part in colour.split("(")[1].rstrip(")").split(",")[:3]]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a: str, b: str) -> float:
    low, high = sorted([luminance(a), luminance(b)])
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_curves_and_texts_can_be_read_in_the_dark(browser: Any, compared: tuple[Path, dict[str, Any], str], scheme: str) -> None:
    shown = browser.new_page(color_scheme=scheme)
    shown.goto(compared[0].as_uri())
    colours = """(selector, property) => [...document.querySelectorAll(selector)].map(it => getComputedStyle(it)[property])"""
    of = lambda selector, name: shown.evaluate(f"([s, p]) => ({colours})(s, p)", [selector, name])
    (paper,) = of("body", "backgroundColor")
    paper = "rgb(255, 255, 255)" if paper == "rgba(0, 0, 0, 0)" else paper
    assert (luminance(paper) < 0.05) == (scheme == "dark")
    # All colours that a curve may have.
    shown.evaluate(
        """() => ['#0072B2', '#D55E00', '#009E73', '#CC79A7', '#56B4E9', '#E69F00', '#000000'].forEach(stroke =>
            document.querySelector('.plot svg').append(element('path', {class: 'curve', stroke, d: 'M0,0H1'})))"""
    )
    # On white some of the colours have less: they are as they were.
    assert all(contrast(stroke, paper) >= (3 if scheme == "dark" else 2) for stroke in of(".plot path.curve", "stroke"))
    for selector, name, least in [
        ("body", "color", 7),
        (".plot text", "fill", 4.5),
        (".legend button", "color", 4.5),
        ("td", "color", 7),
    ]:
        assert all(contrast(colour, paper) >= least for colour in of(selector, name)), selector
    shown.close()
