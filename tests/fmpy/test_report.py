"""The page on which the thesis is reproduced: every example is there, its numbers are those of its runs, and its figures
show something."""

import csv
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from conftest import LOOP_NAMES, ROOT, adaptive_fmu
from lxml import html
from PIL import Image
from test_run_results import BROWSER

STUDY = tomllib.loads((ROOT / "examples" / "thesis.toml").read_text())
# One that is lost without adaptation, one with paths in space, one that is worse without.
SHOWN = ["3.2.1", "3.3.2", "3.4.1"]


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> tuple[Path, list[dict]]:
    """The folder of a report on three examples, and what it told."""
    out = tmp_path_factory.mktemp("report")
    only = [word for name in SHOWN for word in ("--only", name)]
    answer = adaptive_fmu("report", *only, "--json", "--out", out)
    assert answer.returncode == 0, answer
    return out, json.loads(answer.stdout)["examples"]


@pytest.fixture(scope="module")
def page(report) -> html.HtmlElement:
    return html.document_fromstring((report[0] / "index.html").read_text())


def test_every_loop_of_the_package_is_in_the_study_but_for_those_of_others() -> None:
    shown = {run["loop"] for example in STUDY["example"] for run in example["run"]}
    # They are not of the thesis.
    own = {"3.2.1-mrac", "3.3.1-case2-bench", "3.3.1-mrac", "3.3.2-case1-rotors", "3.3.2-case2-rotors"}
    assert shown == set(LOOP_NAMES) - own


def test_every_run_has_one_with_adaptation_frozen(report, page) -> None:
    for example in report[1]:
        assert [run["run"] for run in example["runs"]] == [run["run"] for run in example["frozen"]]
        assert len(example["runs"]) == len(next(e for e in STUDY["example"] if e["name"] == example["example"])["run"])
    tables = page.find_class("adaptation")
    rows = [[row[0].text_content() for row in table] for table in tables]
    assert len(rows) == 5 and all("as it is" == own and "frozen" in frozen for _, own, frozen, *_ in rows)
    # The quadrotor's controllers have no linear limit.
    limit = ["linear limit", "adaptation adds"]
    assert [row[3:] for row in rows] == [limit, limit, [], [], limit]


def test_a_linear_limit_is_the_loop_with_the_unit_of_that_controller(report, page, tmp_path) -> None:
    for run, of_limit in [("3.2.1-cosine", report[1][0]["linear"][0]), ("3.2.1-square", report[1][0]["linear"][1])]:
        folder = shutil.copytree(ROOT / "examples" / run, tmp_path / run)
        file = folder / "SystemStructure.ssd"
        file.write_text(file.read_text().replace("/L1NonlinearSiso.fmu", "/L1LimitNonlinearSiso.fmu"))
        done = adaptive_fmu("run", folder, "--json", "--out", tmp_path / "results")
        assert done.returncode in (0, 1), done.stderr
        expected = json.loads(done.stdout)["metrics"]
        assert sum(metric["limit"] is not None for metric in expected) == 3
        for ours, theirs in zip(of_limit["metrics"], expected, strict=True):
            assert ours["label"] == theirs["label"]
            assert ours["value"] == pytest.approx(theirs["value"], rel=1e-9), ours["label"]
    assert report[1][1]["linear"] == [None, None]
    # What adaptation adds is the difference.
    for example in report[1]:
        for own, limit in zip(example["runs"], example["linear"], strict=True):
            if limit is not None:
                added = own["metrics"][0]["value"] - limit["metrics"][0]["value"]
                row = next(row for row in page.get_element_by_id("glance")[1:] if row[0].text_content() == own["run"])
                shown = float(row[5].text_content().strip().replace("−", "-"))
                assert shown == pytest.approx(added, rel=1e-3), own["run"]


@pytest.mark.slow
def test_the_page_about_choosing_is_right_on_adaptation_compared_with_its_limit(tmp_path) -> None:
    only = [word for name in ["3", "4", "6.5.2", "7.5.2"] for word in ("--only", name)]
    answer = adaptive_fmu("report", *only, "--json", "--out", tmp_path)
    assert answer.returncode == 0, answer
    of = {run["run"]: (run, limit) for it in json.loads(answer.stdout)["examples"] for run, limit in zip(it["runs"], it["linear"])}
    text = " ".join((ROOT / "docs" / "choosing.md").read_text().split())

    def values(run: str, label: str) -> list[float]:
        return [next(it["value"] for it in form["metrics"] if it["label"] == label) for form in of[run]]

    assert "every error of a loop that has a limit is within 2 % of the limit's" in text
    compared, lost = 0, []
    for run, (own, limit) in of.items():
        if run[0] in "34" and limit is not None:
            lost += [run for form in (own, limit) if form["ended"] == "failed"]
            # Controls and what a square wave shows of steps aside.
            others = r"max (\|u|force|yaw)|(rise time|settling time|overshoot|steady|IAE|total variation|peak|time at)"
            for label in [it["label"] for it in own["metrics"] if not re.match(others, it["label"])]:
                if run not in lost:
                    of_own, of_limit = values(run, label)
                    assert of_own == pytest.approx(of_limit, rel=0.02), (run, label)
                    compared += 1
    assert compared > 20 and lost == ["4-case3"] * 2
    own, limit = values("6.5.2-l1", "max |e_2|/rho")
    assert f"is {own:.2f} with adaptation and {limit:.2f} without" in text
    smaller = [1.0 - own / limit for own, limit in (values("7.5.2", f"rms (r_{k} - q_{k}), t >= 5 s") for k in (1, 2))]
    assert f"errors {100 * smaller[0]:.0f} and {100 * smaller[1]:.0f} % smaller" in text


def test_without_adaptation_loops_that_need_it_are_lost_or_worse(report, page) -> None:
    unknown, _, unmatched = report[1]
    assert [run["ended"] for run in unknown["frozen"]] == ["failed", "failed"]
    for own, frozen in zip(unmatched["runs"][0]["metrics"][:4], unmatched["frozen"][0]["metrics"], strict=False):
        assert frozen["value"] > 5.0 * own["value"] > 0.0, own["label"]
    rows = {row[0].text_content(): row[3].text_content().strip() for row in page.get_element_by_id("glance")[1:]}
    assert rows["3.2.1-cosine"].startswith("lost at t = ") and float(rows["3.4.1"]) > 1.0


def test_a_claim_is_shown_with_what_was_measured(report, page) -> None:
    shown = [[cell.text_content() for cell in row] for table in page.find_class("claims") for row in table[1:]]
    claims = [claim for example in report[1] for claim in example["claims"]]
    assert len(shown) == len(claims) >= 6
    for (claim, measured, holds), expected in zip(shown, claims, strict=True):
        assert claim.startswith(expected["claim"]) and measured.strip() == expected["measured"]
        assert holds.strip() == ("yes" if expected["holds"] else "no")
    (run,) = [run for run in report[1][0]["runs"] if run["run"] == "3.2.1-cosine"]
    largest = run["metrics"][0]["value"]
    assert f"{largest:.4g}"[:5] in shown[0][1]


def test_the_page_loads_nothing_and_runs_nothing(report, page) -> None:
    assert (report[0] / "index.html").stat().st_size < 4e5
    outside = [address for _, _, address, _ in page.iterlinks() if address != "data:,"]
    assert all(address.startswith("#") for address in outside)
    assert page.xpath("//script | //iframe | //img | //object | //link[@rel='stylesheet']") == []
    (policy,) = page.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    assert policy.startswith("default-src 'none'") and "http" not in policy


def test_every_figure_has_its_picture_and_its_curves_as_files(report, page) -> None:
    out, examples = report
    names = [figure.get("id") for figure in page.iter("figure")]
    assert len(names) == sum(example["figures"] for example in examples) >= 15
    assert sorted(f"{name}.svg" for name in names) == sorted(file.name for file in (out / "figures").iterdir())
    for name in names:
        with (out / "data" / f"{name}.csv").open() as file:
            rows = list(csv.DictReader(file))
        curves = {row["curve"] for row in rows}
        for curve in curves:
            t, value = np.array([(float(r["t"]), float(r["value"])) for r in rows if r["curve"] == curve]).T
            assert len(t) > 500 and np.all(np.diff(t) > 0) and np.all(np.isfinite(value)), (name, curve)


def test_examples_and_figures_are_named_as_in_the_thesis(page) -> None:
    paragraphs = [paragraph.text_content() for paragraph in page.find_class("thesis")]
    assert len(paragraphs) == len(SHOWN) and all("chapter 3" in text and "figure" in text for text in paragraphs)
    captions = {caption.text_content() for caption in page.iter("figcaption")}
    assert "3.2.1-cosine: control (thesis: figure 3.3)" in captions
    assert "case 1: trajectory in space (thesis: figure 3.13)" in captions


def test_paths_in_space_have_named_axes(report) -> None:
    text = (report[0] / "figures" / "3.3.2-9.svg").read_text()
    assert all(f">{name} (m)</text>" in text for name in "xyz") and "stroke-dasharray" in text


def test_the_recorded_search_is_what_its_seed_gives(tmp_path: Path) -> None:
    chapter = next(example for example in STUDY["example"] if example["name"] == "4")
    (figure,) = [figure for figure in chapter["figure"] if "seed 4" in figure["title"]]
    best, median = (line["y"] for line in figure["lines"])
    swarm = ["--particles", "40", "--generations", "2", "--seed", "4"]
    answer = adaptive_fmu("tune", "4-case1-fuzzy", *swarm, "--json", "--out", tmp_path)
    assert answer.returncode == 0, answer
    history = json.loads((tmp_path / "4-case1-fuzzy-tuned" / "search.json").read_text())["swarm"]["history"]
    for generation, expected in zip(history, zip(best, median), strict=False):
        # Compilers differ in their last digits, and the file holds five.
        assert (generation["best"], generation["median"]) == pytest.approx(expected, rel=1e-3)
    assert best == sorted(best, reverse=True) and len(best) == 60


def test_an_example_that_is_not_there_is_refused_by_name(tmp_path: Path) -> None:
    answer = adaptive_fmu("report", "--only", "9.9", "--out", tmp_path)
    assert (answer.returncode, answer.stdout) == (1, "")
    assert "no example `9.9`" in answer.stderr and "3.2.1" in answer.stderr


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("measured = ['3.2.1-cosine: max |e|']", "max |e|"),
        ("measured = ['3.2.1: max |u|']", "no run `3.2.1`"),
        ("measured = ['3.2.1-cosine: max |u|']\nlimits = 3", "limits"),
        ("smaller = ['3.2.1-cosine: max |u|']", "as many"),
    ],
)
def test_a_study_with_a_mistake_is_refused_before_anything_is_run(line: str, named: str, tmp_path: Path) -> None:
    run = "run = [{ loop = '3.2.1-cosine', frozen = {} }]"
    study = f"title = 'T'\nabout = ''\n[[example]]\nname = '1'\ntitle = ''\nabout = ''\n{run}\n[[example.claim]]\n"
    (tmp_path / "study.toml").write_text(f"{study}text = 'it holds'\n{line}\n")
    answer = adaptive_fmu("report", "--study", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert answer.returncode == 1 and named in answer.stderr and "study.toml" in answer.stderr, answer
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: the page was not opened in a browser")
def test_a_browser_shows_every_figure_with_its_curves(report, page, tmp_path: Path) -> None:
    out, _ = report
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr"]

    def picture(address: Path, size: str) -> np.ndarray:
        """What is seen of a page, without an error in its console."""
        file = tmp_path / "seen.png"
        command = [BROWSER, *options, f"--user-data-dir={tmp_path / 'user'}", f"--window-size={size}"]
        command += [f"--screenshot={file}", address.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
        assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
        return np.asarray(Image.open(file).convert("RGB"))

    def coloured(seen: np.ndarray, colour: tuple[int, int, int]) -> int:
        return int((np.abs(seen.astype(int) - colour).max(axis=2) < 30).sum())

    # Curves are blue, vermilion, green; of axes and text nothing is.
    for name in ["3.2.1-1", "3.2.1-5", "3.3.2-1", "3.3.2-9"]:
        figure = out / "figures" / f"{name}.svg"
        curves = len(set(re.findall(r"<path[^>]*stroke=\"(#[0-9A-F]{6})\"", figure.read_text())))
        seen = picture(figure, "1280,800")
        found = [coloured(seen, colour) > 300 for colour in [(0, 114, 178), (213, 94, 0)][: min(curves, 2)]]
        assert found and all(found), name
    # On a phone, the page isn't wider than the screen: what a reader sees has a margin at its right.
    phone = picture(out / "index.html", "500,3000")
    assert (phone[:, -3:] == 255).all() and coloured(phone, (27, 27, 27)) > 300
