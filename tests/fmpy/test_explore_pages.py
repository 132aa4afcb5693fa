"""Pages of `explore` without a server: this package's library runs the loop in the browser, as WebAssembly. They are tried
where it was built: `packaging/browser`, or tests/platforms/build."""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from test_explore import browser as browser  # noqa: PLC0414 (a fixture)
from test_explore import curves, metrics, ran, slider

LOOPS = ["3.2.1-cosine", "6.5.1-mrac"]
AMPLITUDE = "reference.cosine_amplitude[1]"
# The browser's elementary functions and the system's differ by roundings, by which error control chooses other steps. Parts of
# what is compared: a control's peak moves by 5e-5 so, as measured, outputs by 1e-6.
APART = 1e-4
OUTPUT_APART = 1e-5
# The largest control follows adaptation, whose fast turns are elsewhere after any rounding: of 3.2.1-cosine it is 2.782 … 2.836 at
# tolerances from 1e-4 to 1e-10.
CONTROL_APART = 0.02


def apart(label: str) -> float:
    """How far a metric may be from the program's, in parts of it."""
    return CONTROL_APART if label.startswith("max |u") else APART


@pytest.fixture(scope="module")
def library() -> Path:
    target = "wasm32-unknown-unknown"
    folders = [Path(target, "browser"), Path("browser", target, "browser")]
    places = [ROOT / "target" / folder / "adaptive_fmu.wasm" for folder in folders]
    given = os.environ.get("ADAPTIVE_FMU_WASM")
    found = [place for place in ([Path(given)] if given else places) if place.is_file()]
    if not found:
        pytest.skip("the library isn't built for wasm32-unknown-unknown: pages without a server are not tried")
    return max(found, key=lambda place: place.stat().st_mtime)


@pytest.fixture(scope="module")
def folder(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages of some loops."""
    out = tmp_path_factory.mktemp("pages")
    for loop in LOOPS:
        done = adaptive_fmu("explore", loop, "--page", library, "--out", out)
        if "other sources" in done.stderr:
            pytest.skip(f"{library} is of other sources: build it anew")
        assert done.returncode == 0, done.stderr
        assert done.stdout == f"{out / loop}.html\n"
    return out


@pytest.fixture
def page(browser: Any, folder: Path) -> Iterator[Callable[..., Any]]:
    """Opens a page from its file; what a browser finds wrong in it, or what it loads from elsewhere, fails the test."""
    faults: list[str] = []
    contexts = []

    def open_page(loop: str = LOOPS[0], fragment: str = "") -> Any:
        context = browser.new_context(viewport={"width": 1300, "height": 900}, accept_downloads=True)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: message.type in {"error", "warning"} and faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda asked: asked.url.startswith((folder.as_uri(), "blob:")) or faults.append(asked.url))
        page.goto((folder / f"{loop}.html").as_uri() + fragment)
        ran(page)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert faults == []


def run_by_the_program(loop: str, out: Path, *arguments: str) -> dict[str, Any]:
    done = adaptive_fmu("run", loop, "--composite", *arguments, "--json", "--out", out)
    assert done.stdout, done.stderr
    return json.loads(done.stdout)


def run_in_the_page(shown: Any, **wanted: Any) -> dict[str, Any]:
    """What the library within the page answers, with all digits."""
    asked = {"number": 1000, "fine": True, "case": None, "values": {}} | wanted
    return shown.evaluate(
        """async wanted => {
            let last = null;
            await backend.run(wanted, new AbortController().signal, line => { last = line; });
            return last;
        }""",
        asked,
    )


@pytest.mark.parametrize("loop", LOOPS)
def test_metrics_and_curves_are_those_of_the_program(page: Callable[..., Any], loop: str, tmp_path: Path) -> None:
    answer = run_in_the_page(page(loop))
    ran = run_by_the_program(loop, tmp_path)
    assert answer["shortfall"] is None and len(answer["metrics"]) == len(ran["metrics"]) > 0
    for ours, theirs in zip(answer["metrics"], ran["metrics"], strict=True):
        assert ours["label"] == theirs["label"] and ours["value"] == pytest.approx(theirs["value"], rel=apart(ours["label"]))
    table = np.genfromtxt(next(tmp_path.rglob("*.csv")), delimiter=",", names=True, deletechars="", encoding="utf-8")
    time, compared = table[table.dtype.names[0]], 0
    for curve in (curve for diagram in answer["diagrams"] for curve in diagram["curves"]):
        # A control follows adaptation, whose fast turns are elsewhere after any rounding: its metrics are compared alone.
        if curve["name"] in table.dtype.names and not curve["name"].startswith("controller."):
            theirs = table[curve["name"]]
            most = np.abs(np.interp(curve["x"], time, theirs) - curve["y"]).max()
            assert most <= OUTPUT_APART * np.abs(theirs).max(), (curve["name"], most)
            compared += 1
    assert compared >= 2


def test_a_slider_moves_curves_and_metrics_to_those_of_the_program(page: Callable[..., Any], tmp_path: Path) -> None:
    shown = page()
    before, drawn, number = metrics(shown), curves(shown), ran(shown)
    assert len(before) == 3 and len(drawn) == 4
    control = slider(shown, AMPLITUDE)
    # As fast as a hand does.
    for key in ["PageUp", "PageDown", "PageUp", "ArrowLeft"]:
        control.locator("input[type=range]").press(key)
    ran(shown, number)
    value = control.locator("input[type=number]").input_value()
    assert curves(shown) != drawn and float(value) > 2
    theirs = run_by_the_program(LOOPS[0], tmp_path, "--set", f"{AMPLITUDE}={value}")["metrics"]
    assert [float(text) for text in metrics(shown)] == [pytest.approx(it["value"], rel=apart(it["label"])) for it in theirs]
    # The link brings the value to another page, a set to the program.
    shown.wait_for_function("() => location.hash.includes('cosine_amplitude')")
    again = page(LOOPS[0], "#" + shown.url.partition("#")[2])
    assert metrics(again) == metrics(shown)
    with shown.expect_download() as download:
        shown.locator("#download").click()
    file = tmp_path / "downloaded.ssv"
    download.value.save_as(file)
    assert run_by_the_program(LOOPS[0], tmp_path, "--case", str(file))["metrics"] == theirs
    # What needs a server isn't offered.
    assert shown.locator("#save").is_hidden() and shown.locator("#export").is_hidden()


def test_a_refused_value_is_reported_and_the_page_goes_on(page: Callable[..., Any]) -> None:
    shown = page()
    gain = slider(shown, "controller.adaptation_gain")
    number = ran(shown)
    gain.locator("input[type=number]").fill("-1")
    gain.locator("input[type=number]").press("Enter")
    gain.locator(".wrong").wait_for(timeout=60_000)
    assert "must be" in gain.locator(".wrong").text_content()
    gain.locator("button").click()
    ran(shown, number)
    assert not shown.locator("#diagrams.stale").count()


def test_moving_on_while_metrics_are_measured_ends_that(page: Callable[..., Any]) -> None:
    shown = page()
    control = slider(shown, AMPLITUDE).locator("input[type=range]")
    for _ in range(3):
        number = shown.evaluate("document.body.dataset.run")
        control.press("PageUp")
        # A browser that is making the program's code fast meanwhile has taken 41 s on two cores.
        shown.wait_for_function("before => document.body.dataset.run !== before", arg=number, timeout=180_000)
        # Some pauses are as long as the page waits before it measures.
        shown.wait_for_timeout(450)
    shown.wait_for_function("() => document.body.dataset.settled === 'yes'", timeout=60_000)
    assert not any("≈" in text for text in metrics(shown))


def test_a_file_that_is_no_such_library_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.wasm").write_bytes(b"\0asm\1\0\0\0")
    done = adaptive_fmu("explore", LOOPS[0], "--page", tmp_path / "a.wasm", "--out", tmp_path / "pages")
    assert done.returncode == 1 and "a.wasm" in done.stderr and "packaging/browser" in done.stderr
    (tmp_path / "b.wasm").write_text("text")
    done = adaptive_fmu("explore", LOOPS[0], "--page", tmp_path / "b.wasm", "--out", tmp_path / "pages")
    assert done.returncode == 1 and "is not a WebAssembly module" in done.stderr
    done = adaptive_fmu("explore", "3.2.1-cosin", "--page", tmp_path / "a.wasm", "--out", tmp_path / "pages")
    assert done.returncode == 1 and "3.2.1-cosine" in done.stderr
    assert not (tmp_path / "pages").exists()
