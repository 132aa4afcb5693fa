"""The page from a plant to an FMU, as a user works with it, in a browser and from a folder: what is downloaded does in other tools what
the page shows."""

import base64
import functools
import http.server
import json
import subprocess
import threading
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import adaptive_fmu as adaptive_fmu_python
import fmpy
import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from fmpy.validation import validate_fmu
from test_explore import browser as browser  # noqa: PLC0414 (a fixture)
from test_explore_pages import library as library  # noqa: PLC0414 (a fixture)

MOTOR = json.loads((ROOT / "examples/own/dc_motor/model.json").read_text())
# Of the reference step: curves of the page have five digits.
APART = 1e-4


@pytest.fixture(scope="module")
def folder(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page in a folder."""
    out = tmp_path_factory.mktemp("playground")
    done = adaptive_fmu("playground", "--wasm", library, "--out", out)
    if "other sources" in done.stderr:
        pytest.skip(f"{library} is of other sources: build it anew")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{out / 'index.html'}\n"
    return out


@pytest.fixture
def page(browser: Any, folder: Path) -> Iterator[Callable[..., Any]]:
    """Opens the page, from its folder or from a server; what a browser finds wrong in it, or what it asks of others, fails the test."""
    faults: list[str] = []
    contexts = []

    def open_page(address: str = "", fragment: str = "", width: int = 1300) -> Any:
        context = browser.new_context(viewport={"width": width, "height": 900}, accept_downloads=True)
        contexts.append(context)
        shown, start = context.new_page(), address or folder.as_uri()
        shown.on("console", lambda message: message.type in {"error", "warning"} and faults.append(message.text))
        shown.on("pageerror", lambda error: faults.append(str(error)))
        shown.on("request", lambda asked: asked.url.startswith((start, "blob:", "data:")) or faults.append(asked.url))
        shown.goto(f"{start}/index.html{fragment}")
        settled(shown)
        return shown

    yield open_page
    for context in contexts:
        context.close()
    assert faults == []


def settled(shown: Any) -> None:
    """Waits until everything is computed."""
    shown.wait_for_selector("body[data-settled=yes]", timeout=120_000)


def matrices(shown: Any, plant: dict[str, Any]) -> None:
    """Pastes a plant as matrices, as MATLAB prints them."""
    shown.check("[name=form][value=matrices]", force=True)
    for name in "ABC":
        shown.fill(f"#{name}", "[" + "; ".join(" ".join(map(str, row)) for row in plant[name]) + "]")
    # Those of the example before.
    shown.evaluate("document.getElementById('names').open = true")
    for name in ("states", "inputs", "outputs"):
        shown.fill(f"#{name}", "")
    shown.keyboard.press("Tab")
    settled(shown)


def setting(shown: Any, title: str, value: float) -> None:
    """Types a number into the field of a setting or parameter."""
    field = shown.locator(".knob", has_text=title).first.locator("input[type=number]")
    field.fill(str(value))
    field.press("Enter")
    settled(shown)


def downloaded(shown: Any, what: str, out: Path) -> Path:
    with shown.expect_download(timeout=120_000) as download:
        shown.click(f"[data-what={what}]")
    file = out / download.value.suggested_filename
    download.value.save_as(file)
    return file


def curve(shown: Any, picture: int, name: str) -> np.ndarray:
    """A curve of the last answer that had everything."""
    points = shown.evaluate(
        "([at, name]) => settledAnswer.pictures[at].curves.find(it => it.name === name && it.of === 'nominal').points", [picture, name]
    )
    return np.array(points)


def test_a_pasted_motor_becomes_an_fmu_that_moves_as_the_page_shows(page: Callable[..., Any], tmp_path: Path) -> None:
    shown = page()
    matrices(shown, MOTOR)
    shown.check("[name=kind][value=pid]", force=True)
    settled(shown)
    setting(shown, "Bandwidth", 20)
    assert shown.inner_text("#verdict") == "ok"
    assert "settles in" in shown.inner_text("#words")
    fmu = downloaded(shown, "fmu", tmp_path)
    assert validate_fmu(str(fmu)) == [] and fmpy.read_model_description(fmu).modelName == "Controller"
    loop = downloaded(shown, "loop", tmp_path)
    done = adaptive_fmu("run", loop, "--composite", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    table = np.genfromtxt(next(tmp_path.rglob("*.csv")), delimiter=",", names=True, deletechars="")
    time, ours = table[table.dtype.names[0]], curve(shown, 0, "output")
    output = next(name for name in table.dtype.names if name.startswith("plant.y"))
    begin = time[np.flatnonzero(np.diff(table[next(n for n in table.dtype.names if n.startswith("reference.r"))]))[0] + 1]
    inside = ours[:, 0] + begin <= time[-1]
    theirs = np.interp(ours[inside, 0] + begin, time, table[output])
    assert inside.sum() > 100 and np.abs(theirs - ours[inside, 1]).max() <= APART


def test_a_moved_gain_changes_figures_and_undo_and_a_link_restore_them(page: Callable[..., Any]) -> None:
    shown = page()
    before = shown.inner_text("#words")
    setting(shown, "Bandwidth", 12)
    changed = shown.inner_text("#words")
    assert changed != before and shown.locator(".ghost").count() > 0
    shown.click("#link")
    link = shown.url
    shown.click("#undo")
    settled(shown)
    assert shown.inner_text("#words") == before
    again = page(fragment="#" + link.partition("#")[2])
    assert again.inner_text("#words") == changed


def test_files_of_a_transfer_function_work_in_other_tools(page: Callable[..., Any], tmp_path: Path) -> None:
    shown = page()
    shown.check("[name=form][value=transfer]", force=True)
    shown.fill("#num", "2")
    shown.fill("#den", "1 0.5 1")
    shown.fill("#dead", "0.05")
    shown.keyboard.press("Tab")
    settled(shown)
    shown.check("[name=kind][value=ladrc]", force=True)
    settled(shown)
    description = downloaded(shown, "toml", tmp_path)
    checked = adaptive_fmu("check", description, folder=tmp_path)
    assert checked.stdout.splitlines()[0].partition(": ")[2].startswith(("sound", "warning", "not sound"))
    assert checked.stdout.splitlines()[0] == shown.evaluate("settledAnswer.sentence")
    plant = downloaded(shown, "plant", tmp_path)
    command = shown.inner_text("#command").split()
    assert command[0] == "adaptive-fmu" and plant.name in command
    assert adaptive_fmu(*command[1:], "--no-schema", "--out", "again.toml", folder=tmp_path).returncode in {0, 3}
    assert (tmp_path / "again.toml").read_text() == description.read_text()
    zipfile.ZipFile(downloaded(shown, "c", tmp_path)).extractall(tmp_path / "c")
    sources = [file.name for file in (tmp_path / "c").glob("*.c")]
    subprocess.run(["cc", "-std=c99", "-O2", "-ffp-contract=off", "-DController_REPLAY", *sources, "-o", "replay", "-lm"], cwd=tmp_path / "c", check=True)
    assert subprocess.run(["./replay"], cwd=tmp_path / "c", check=False).returncode == 0
    assert "<html" in downloaded(shown, "report", tmp_path).read_text()[:200].lower()


def test_a_plant_without_such_a_controller_shows_the_reason(page: Callable[..., Any]) -> None:
    shown = page()
    shown.select_option("#example", "cart_pendulum")
    settled(shown)
    shown.check("[name=kind][value=pid]", force=True)
    settled(shown)
    assert "M_s of at least" in shown.inner_text("#refused") and shown.is_disabled("[data-what=fmu]")
    shown.check("[name=kind][value=l1]", force=True)
    settled(shown)
    assert shown.is_hidden("#refused") and "settles in" in shown.inner_text("#words")


def test_a_link_with_a_kind_alone_opens_its_design(page: Callable[..., Any]) -> None:
    """As the site has them on the pages of the kinds."""
    fragment = base64.urlsafe_b64encode(b'{"kind":"l1"}').decode().rstrip("=")
    shown = page(fragment=f"#j{fragment}")
    assert shown.is_hidden("#refused") and shown.is_checked("[name=kind][value=l1]") and "settles in" in shown.inner_text("#words")


def test_advice_has_the_names_of_the_page(page: Callable[..., Any]) -> None:
    shown = page()
    setting(shown, "Limit of voltage", 4)
    report = shown.text_content("#report")
    assert "use a smaller Reference" in report and "--reference" not in report


def test_a_server_gives_the_same_page(page: Callable[..., Any], folder: Path) -> None:
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    shown = page(f"http://127.0.0.1:{server.server_port}")
    assert "settles in" in shown.inner_text("#words")
    server.shutdown()


def test_the_page_may_send_nothing(browser: Any, folder: Path) -> None:
    context = browser.new_context()
    shown = context.new_page()
    shown.goto((folder / "index.html").as_uri())
    for sends in ["fetch('https://example.org')", "new WebSocket('wss://example.org')", "navigator.sendBeacon('https://example.org', 'x')"]:
        violation = "new Promise(heard => document.addEventListener('securitypolicyviolation', event => heard(event.violatedDirective)))"
        assert shown.evaluate(f"() => {{ const heard = {violation}; try {{ {sends}; }} catch {{ }} return heard; }}") == "connect-src", sends
    context.close()


def test_a_narrow_screen_shows_everything_without_scrolling_aside(page: Callable[..., Any]) -> None:
    shown = page(width=400)
    assert shown.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_python_writes_the_page_or_reports_what_is_missing(tmp_path: Path) -> None:
    built = (ROOT / "target/wasm32-unknown-unknown/browser/adaptive_fmu.wasm").is_file()
    if built:
        assert adaptive_fmu_python.playground(tmp_path / "page", open=False) == tmp_path / "page" / "index.html"
    else:
        with pytest.raises(adaptive_fmu_python.Error, match="packaging/browser"):
            adaptive_fmu_python.playground(tmp_path / "page", open=False)
