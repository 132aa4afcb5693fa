"""A loop in the browser (`explore`): its page as a user has it, in Chromium, and its server as anybody may call it."""

import contextlib
import http.client
import json
import re
import shutil
import signal
import subprocess
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu
from fmpy import read_model_description

LOOP = "3.2.1-cosine"
GAIN, AMPLITUDE = "controller.adaptation_gain", "reference.cosine_amplitude[1]"
BROWSER = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
OPTIONS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()


class Explored:
    """A program that serves a loop's page."""

    def __init__(self, out: Path, *arguments: str | Path) -> None:
        words = [PROGRAM, "explore", *arguments, "--no-open", "--json", "--out", out]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(list(map(str, words)), stdout=pipe, stderr=pipe, text=True, cwd=out)
        assert self.process.stdout is not None and self.process.stderr is not None
        line = self.process.stdout.readline()
        assert line, self.process.stderr.read()
        self.url, self.out = json.loads(line)["url"], out
        parts = urlsplit(self.url)
        self.host, self.port = parts.hostname, parts.port
        (self.token,) = parse_qs(parts.query)["token"]

    def ask(self, method: str, path: str, body: Any = None, **headers: str | None) -> tuple[int, str]:
        """Status and text of an answer; a header that is None is left out."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=60)
        given = {"X-Token": self.token, "Content-Type": "application/json"}
        given |= {name.replace("_", "-"): value for name, value in headers.items()}
        bytes_ = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        connection.putrequest(method, path, skip_host="Host" in given, skip_accept_encoding=True)
        for name, value in given.items():
            if value is not None:
                connection.putheader(name, value)
        if bytes_ is not None and "Transfer-Encoding" not in given:
            connection.putheader("Content-Length", str(len(bytes_)))
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            connection.endheaders(bytes_)
        answer = connection.getresponse()
        text = answer.read().decode()
        self.headers = dict(answer.getheaders())
        connection.close()
        return answer.status, text

    def wanted(self, path: str, **body: Any) -> tuple[int, Any]:
        status, text = self.ask("POST", path, {"case": None, "values": {}} | body)
        return status, json.loads(text.splitlines()[-1])

    def end(self, how: int = signal.SIGINT) -> tuple[int, float]:
        """The exit code after a signal, and how long it took."""
        begun = time.monotonic()
        self.process.send_signal(how)
        return self.process.wait(timeout=20), time.monotonic() - begun


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Explored]:
    served = Explored(tmp_path_factory.mktemp("explored"), LOOP, "--until", "10")
    yield served
    served.process.kill()


# ---- the server


def test_the_server_listens_on_the_loopback_address_alone(explored: Explored) -> None:
    assert explored.host == "127.0.0.1"
    listening = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    own = [fields[1] for fields in listening if fields[1].endswith(f":{explored.port:04X}") and fields[3] == "0A"]
    assert own == [f"0100007F:{explored.port:04X}"]


@pytest.mark.parametrize("path", ["/", "/explore.js", "/controls.js", "/steps.js", "/diagrams.js", "/explore.css", "/loop"])
def test_nothing_is_answered_without_the_token(explored: Explored, path: str) -> None:
    for token in [None, "", explored.token[:-1], "0" * len(explored.token)]:
        status, text = explored.ask("GET", path, X_Token=token)
        assert status == 403 and "token" in text, token
    assert explored.ask("GET", f"{path}?token={explored.token}", X_Token=None)[0] == 200


def test_another_name_of_this_machine_or_another_page_is_refused(explored: Explored) -> None:
    for host in ["evil.example", f"evil.example:{explored.port}", "127.0.0.1", "127.0.0.1:1", ""]:
        assert explored.ask("GET", "/loop", Host=host)[0] == 403, host
    assert explored.ask("GET", "/loop", Host=f"localhost:{explored.port}")[0] == 200
    for origin in ["http://evil.example", "null", f"https://127.0.0.1:{explored.port}"]:
        assert explored.ask("POST", "/run", {"case": None, "values": {}}, Origin=origin)[0] == 403, origin
    assert not [name for name in explored.headers if name.lower().startswith("access-control")]


def test_a_browser_loads_nothing_from_elsewhere(explored: Explored) -> None:
    status, text = explored.ask("GET", "/")
    assert status == 200 and explored.headers["Content-Security-Policy"].startswith("default-src 'none'")
    assert "http:" not in text and "https:" not in text and "//" not in re.sub(r"<!--.*?-->", "", text)


def test_what_is_no_request_is_refused_and_the_server_goes_on(explored: Explored) -> None:
    plain = {"case": None, "values": {}}
    assert explored.ask("POST", "/run", plain, Content_Type="text/plain")[0] == 415
    assert explored.ask("POST", "/run", b"{")[0] == 400
    assert explored.ask("POST", "/run", b"[1]")[0] == 400
    assert explored.ask("POST", "/run", {"case": None})[0] == 400
    assert explored.ask("POST", "/run", plain | {"further": 1})[0] == 400
    assert explored.ask("POST", "/run", b'{"case": null, "values": {"controller.adaptation_gain": NaN}}')[0] == 400
    assert explored.ask("POST", "/run", b"[" * 200_000)[0] == 400
    assert explored.ask("POST", "/run", b" " * 300_000)[0] == 413
    assert explored.ask("POST", "/run", b"0\r\n\r\n", Transfer_Encoding="chunked")[0] == 411
    assert explored.ask("GET", "/" + "a" * 20_000)[0] == 431
    assert explored.ask("GET", "/run")[0] == 405
    for path in ["/../Cargo.toml", "/explore.html", "/%2e%2e/x", "//"]:
        assert explored.ask("GET", path)[0] == 404, path
    assert explored.ask("GET", "/loop")[0] == 200


def test_a_run_answers_with_curves_metrics_and_its_time(explored: Explored) -> None:
    status, answer = explored.wanted("/run")
    assert status == 200 and answer["shortfall"] is None and answer["end"] == 10
    assert [len(diagram["curves"]) for diagram in answer["diagrams"]] == [3, 1]
    for curve in (curve for diagram in answer["diagrams"] for curve in diagram["curves"]):
        assert 10 < len(curve["x"]) == len(curve["y"]) <= 1000 and curve["x"][-1] == 10, curve["name"]
    assert len(answer["metrics"]) == 3 and answer["fine"] is False
    assert 0 < answer["seconds"] < 60


def test_a_run_with_a_value_is_that_of_the_program(explored: Explored, tmp_path: Path) -> None:
    _, answer = explored.wanted("/run", values={AMPLITUDE: 1.5}, fine=True)
    assert answer["fine"] is True
    ran = adaptive_fmu("run", LOOP, "--composite", "--until", "10", "--set", f"{AMPLITUDE}=1.5", "--json", "--out", tmp_path)
    metrics = json.loads(ran.stdout)["metrics"]
    assert [metric["value"] for metric in answer["metrics"]] == [metric["value"] for metric in metrics]


def test_a_name_that_is_none_and_a_value_that_a_unit_refuses_are_reported(explored: Explored) -> None:
    _, answer = explored.wanted("/run", values={"controller.nothing": 1})
    assert "there is no adjustable parameter `controller.nothing`" in answer["error"]
    _, answer = explored.wanted("/run", values={GAIN: "fast"})
    assert f'`{GAIN}` = "fast": must be a finite number' in answer["error"]
    _, answer = explored.wanted("/run", case="other.ssv")
    assert "there is no case `other.ssv`" in answer["error"]
    _, answer = explored.wanted("/run", values={GAIN: -1, AMPLITUDE: 1})
    assert answer["at"] == [GAIN] and "adaptation_gain" in answer["refused"] and "-1" in answer["refused"]
    # Each is allowed, both together aren't.
    _, answer = explored.wanted("/run", values={"controller.omega_min[1,1]": 5, "controller.omega_max[1,1]": 4})
    assert "must not be above controller.omega_max[1,1] = 4" in answer["refused"]
    assert answer["at"] == ["controller.omega_max[1,1]", "controller.omega_min[1,1]"]
    _, answer = explored.wanted("/run", values={"controller.A_m[2,2]": 1.4, AMPLITUDE: 1})
    assert "must be Hurwitz" in answer["refused"] and answer["at"] == ["controller.A_m[2,2]"]


def test_a_loop_that_is_lost_shows_where_its_curves_end(explored: Explored) -> None:
    _, answer = explored.wanted("/run", values={"plant.omega": -2})
    assert 0 < answer["end"] < 10 and f"failed at t = {answer['end']:g} s of 10 s" in answer["shortfall"]
    assert answer["diagrams"][0]["curves"][0]["x"][-1] == pytest.approx(answer["end"])


@pytest.mark.parametrize("name", ["", "..", "../up", "a/b", "a\\b", "/tmp/a", ".hidden", "a" * 61])
def test_a_file_of_such_a_name_is_not_written(explored: Explored, name: str) -> None:
    for path in ["/set", "/save", "/export"]:
        status, answer = explored.wanted(path, name=name)
        assert status == 422 and "must be" in answer["error"], path
    assert not [*explored.out.rglob("*up*"), *explored.out.rglob("*.hidden*")]


def test_a_set_runs_the_loop_as_the_page_did(explored: Explored, tmp_path: Path) -> None:
    values = {AMPLITUDE: 1.25, "controller.feedback_gain[1,1]": 12.5}
    status, saved = explored.wanted("/save", name="mine", values=values)
    file = explored.out / f"{LOOP}-explored" / "mine.ssv"
    assert status == 200 and explored.out / saved["file"] == file
    parameters = ElementTree.parse(file).getroot().findall(".//{*}Parameter")
    assert {it.get("name"): float(it[0].get("value", "")) for it in parameters} == values
    assert explored.wanted("/set", name="mine", values=values)[1]["set"] == file.read_text()
    _, answer = explored.wanted("/run", values=values)
    ran = adaptive_fmu("run", LOOP, "--composite", "--until", "10", "--step", "0.01", "--case", file, "--json", "--out", tmp_path)
    assert json.loads(ran.stdout)["metrics"][0]["value"] == answer["metrics"][0]["value"]


def test_cases_are_those_next_to_the_loop_with_all_that_they_choose(tmp_path: Path) -> None:
    served = Explored(tmp_path, "4-case1-fuzzy", "--until", "1")
    try:
        answer = json.loads(served.ask("GET", "/loop")[1])
        assert [case["name"] for case in answer["cases"]] == [None, "midpoint.ssv", "tuned.ssv", "two-level.ssv"]
        assert answer["cases"][3]["values"]["controller.constant_gain"] == 0.6
        own, two_level = (served.wanted("/run", case=case)[1]["metrics"] for case in [None, "two-level.ssv"])
        assert own != two_level
        # What isn't a number goes into a set, too.
        text = served.wanted("/set", name="a", case="two-level.ssv", values={"controller.constant_gain": 0.5})[1]["set"]
        parameters = ElementTree.fromstring(text).findall(".//{*}Parameter")
        assert {it.get("name"): (it[0].tag.split("}")[1], it[0].get("value")) for it in parameters} == {
            "controller.fuzzy_output": ("Enumeration", "constant"),
            "controller.constant_gain": ("Real", "0.5"),
        }
    finally:
        served.process.kill()


def test_a_newer_request_of_a_page_ends_the_older_and_that_of_another_page_does_not(tmp_path: Path) -> None:
    served = Explored(tmp_path, LOOP, "--separate", "--step", "1e-4")
    try:
        connection = http.client.HTTPConnection(served.host, served.port, timeout=60)
        older = json.dumps({"page": "a", "number": 1, "case": None, "values": {}})
        headers = {"X-Token": served.token, "Content-Type": "application/json"}
        connection.request("POST", "/run", older, headers)
        answer = connection.getresponse()
        assert 0 < json.loads(answer.readline())["done"] < 1
        # Units of other tools may bear one run at a time: that of another page waits.
        other = http.client.HTTPConnection(served.host, served.port, timeout=60)
        other.request("POST", "/run", older.replace('"a"', '"b"'), headers)
        waiting = json.loads(other.getresponse().readline())
        assert waiting == {"done": 0, "waits": True}
        assert "done" in json.loads(answer.readline())
        other.close()
        newer = http.client.HTTPConnection(served.host, served.port, timeout=60)
        newer.request("POST", "/run", older.replace("1", "2", 1), headers)
        assert json.loads(answer.read().splitlines()[-1]) == {"superseded": True}
        assert "done" in json.loads(newer.getresponse().readline())
        # A page that was closed has its run ended; Ctrl-C ends all at once.
        newer.close()
        code, took = served.end()
        assert code == 0 and took < 10
    finally:
        served.process.kill()


def test_it_ends_after_a_time_that_is_named(tmp_path: Path) -> None:
    done = adaptive_fmu("explore", LOOP, "--no-open", "--for", "0.2", folder=tmp_path)
    assert done.returncode == 0 and re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[0-9a-f]{32}\n", done.stdout)
    assert [*tmp_path.iterdir()] == []


# ---- the page


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if BROWSER is None:
        pytest.skip("no Chromium is installed: the page is not tried in a browser")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright isn't installed")
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=BROWSER, headless=True, args=OPTIONS)
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Any, explored: Explored) -> Iterator[Callable[..., Any]]:
    """Opens the page; what a browser finds wrong in it, or what it would load from elsewhere, fails the test."""
    faults: list[str] = []
    contexts = []

    def open_page(fragment: str = "", served: Explored = explored, width: int = 1300) -> Any:
        context = browser.new_context(viewport={"width": width, "height": 900}, accept_downloads=True)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: message.type in {"error", "warning"} and faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda asked: asked.url.startswith(("http://127", "blob:")) or faults.append(asked.url))
        page.goto(served.url + fragment)
        ran(page)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert faults == []


def ran(page: Any, after: str | None = None) -> str:
    """Waits until a run later than that one is shown; its number."""
    page.wait_for_function("after => document.body.dataset.run && document.body.dataset.run !== after", arg=after, timeout=60_000)
    page.wait_for_function("() => flying === null && !isWanted && (isFine || !diagrams.length)", timeout=60_000)
    return page.evaluate("document.body.dataset.run")


def slider(page: Any, name: str) -> Any:
    return page.locator(f".slider[data-name='{name}']")


def metrics(page: Any) -> list[str]:
    return page.locator("#metrics tbody tr td:nth-child(3)").all_text_contents()


def curves(page: Any) -> list[str]:
    return [path.get_attribute("d") for path in page.locator(".plot path.curve").all()]


def test_a_slider_moves_curves_and_metrics_and_its_values_are_exported(page: Callable[..., Any], explored: Explored) -> None:
    shown = page()
    assert shown.locator("#blocks .block").count() == 3 and shown.locator("#blocks .arrow").count() == 3
    before, drawn, number = metrics(shown), curves(shown), ran(shown)
    assert len(before) == 3 and len(drawn) == 4 and not any("≈" in value for value in before)
    amplitude = slider(shown, AMPLITUDE)
    amplitude.locator("input[type=range]").focus()
    for _ in range(5):
        shown.keyboard.press("PageUp")
    ran(shown, number)
    assert metrics(shown) != before and curves(shown) != drawn and "moved" in amplitude.get_attribute("class")
    value = float(amplitude.locator("input[type=number]").input_value())
    assert value > 2
    shown.locator("#name").fill("from the page")
    shown.locator("#export").click()
    shown.get_by_text("FMUs that start with these values").wait_for(timeout=120_000)
    folder = explored.out / f"{LOOP}-explored" / "from the page"
    described = read_model_description(folder / "ReferenceNonlinearSiso.fmu")
    start = {variable.name: variable.start for variable in described.modelVariables}
    # The loop's own values stand in the FMU as well.
    assert float(start["cosine_amplitude[1]"]) == value and float(start["cosine_frequency[1]"]) == 0.2
    assert {file.stem for file in folder.iterdir()} == {"ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso"}
    with shown.expect_download() as download:
        shown.locator("#download").click()
    text = download.value.path().read_text()
    assert download.value.suggested_filename == "from the page.ssv" and f'name="{AMPLITUDE}"' in text
    # Back to what the loop has.
    number = ran(shown)
    shown.locator("#reset").click()
    ran(shown, number)
    assert metrics(shown) == before and not shown.locator(".slider.moved").count()


def test_a_refused_value_is_reported_at_its_slider_and_the_last_curves_stay_greyed(page: Callable[..., Any]) -> None:
    shown = page()
    drawn, number = curves(shown), ran(shown)
    gain = slider(shown, GAIN)
    gain.locator("input[type=number]").fill("-1")
    gain.locator("input[type=number]").press("Enter")
    gain.locator(".wrong").wait_for(timeout=60_000)
    assert "adaptation_gain" in gain.locator(".wrong").text_content()
    assert curves(shown) == drawn and shown.locator("#diagrams.stale").count() == 1
    gain.locator("button").click()
    ran(shown, number)
    assert not shown.locator("#diagrams.stale").count() and gain.locator(".wrong").is_hidden()


def test_a_lost_loop_reports_when_and_its_metrics_are_until_then(page: Callable[..., Any]) -> None:
    shown = page("#plant.omega=-2")
    assert "failed at t = " in shown.locator("#shortfall").text_content()
    assert "until then" in shown.locator("#metrics thead").text_content()


def test_a_link_holds_the_values_and_every_tab_has_its_own(page: Callable[..., Any]) -> None:
    first = page()
    second = page(f"#{AMPLITUDE}=1.5")
    assert slider(second, AMPLITUDE).locator("input[type=number]").input_value() == "1.5"
    assert metrics(first) != metrics(second)
    number = ran(second)
    slider(second, AMPLITUDE).locator("input[type=number]").fill("1.75")
    slider(second, AMPLITUDE).locator("input[type=number]").press("Enter")
    ran(second, number)
    second.wait_for_function("() => location.hash.includes('1.75')")
    again = page(urlsplit(second.url).fragment.join(["#", ""]))
    assert metrics(again) == metrics(second)
    # The other tab is as it was, and goes on when this one is closed.
    second.close()
    number = ran(first)
    slider(first, GAIN).locator("input[type=range]").press("PageDown")
    ran(first, number)


def test_every_parameter_is_found_by_words_and_with_its_keyboard(page: Callable[..., Any]) -> None:
    shown = page()
    visible = shown.locator(".slider:visible")
    few = visible.count()
    shown.locator("#find").fill("initial x1")
    assert visible.count() == 1 and slider(shown, "plant.x0[1]").is_visible()
    shown.locator("#find").fill("")
    shown.locator("#all").check()
    assert 3 < few < 20 and visible.count() > 2 * few
    # A limit that is none has no slider.
    assert slider(shown, "controller.u_max[1]").locator("input[type=range]").count() == 0
    labelled = "[...document.querySelectorAll('input, select, button')].filter(it => it.offsetParent && !it.labels?.length && !it.ariaLabel && !it.textContent)"
    assert shown.evaluate(f"{labelled}.length") == 0


def test_the_page_is_no_wider_than_a_phone(page: Callable[..., Any]) -> None:
    shown = page(width=400)
    assert shown.evaluate("document.documentElement.scrollWidth") <= 400


def test_a_program_that_has_ended_is_reported(browser: Any, tmp_path: Path) -> None:
    served = Explored(tmp_path, LOOP, "--until", "1")
    shown = browser.new_page()
    shown.goto(served.url)
    ran(shown)
    assert served.end()[0] == 0
    slider(shown, GAIN).locator("input[type=range]").press("PageDown")
    shown.get_by_text("The program doesn't answer").wait_for()
    shown.close()


def test_a_loop_with_units_of_another_tool_is_explored_through_them(page: Callable[..., Any], tmp_path: Path, fmu_folder: Path) -> None:
    """Units that the loop names by their files are taken as any other tool's are."""
    for name in ["SystemStructure.ssd", "reference.ssv"]:
        text = (ROOT / "examples" / LOOP / name).read_text()
        text = text.replace('stopTime="60.0"', 'stopTime="2.0"').replace('"resources/', '"elsewhere/')
        (tmp_path / name).write_text(text)
    (tmp_path / "elsewhere").mkdir()
    for name in ["NonlinearSiso", "ReferenceNonlinearSiso", "L1NonlinearSiso"]:
        shutil.copy(fmu_folder / f"{name}.fmu", tmp_path / "elsewhere")
    served = Explored(tmp_path, tmp_path)
    try:
        shown = page(served=served)
        assert "separate FMUs" in shown.locator("#form").text_content()
        number = ran(shown)
        slider(shown, AMPLITUDE).locator("input[type=range]").press("PageUp")
        ran(shown, number)
        assert served.wanted("/export", name="a")[1]["left_out"] == ["reference", "plant", "controller"]
    finally:
        served.process.kill()
