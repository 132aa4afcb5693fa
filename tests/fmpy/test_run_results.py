"""What a run leaves behind: its page, also when it is interrupted or a unit fails."""

import contextlib
import json
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu, read_csv
from lxml import html

LOOP = "3.2.1-cosine"
BROWSER = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
SSD = (ROOT / "examples" / LOOP / "SystemStructure.ssd").read_text()
PLOTTED = [signals.split() for signals in re.findall(r'<Plot .*signals="([^"]+)"', SSD)]
FILES = ["index.html", "metrics.json", "plot.svg", "result.csv"]


@pytest.fixture(scope="module")
def results(fmu_folder: Path, tmp_path_factory) -> Path:
    """The folder of a run."""
    out = tmp_path_factory.mktemp("results")
    answer = adaptive_fmu("run", LOOP, "--json", "--fmus", fmu_folder, "--out", out)
    assert answer.returncode == 0, answer
    return out / LOOP


def plots(page: Path) -> list[dict]:
    """The plots of a page as its script is given them."""
    given = html.document_fromstring(page.read_text()).xpath("//script[@type='application/json']/text()")
    return [json.loads(plot) for plot in given]


def test_the_page_holds_every_signal_of_every_plot(results: Path) -> None:
    drawn, table = plots(results / "index.html"), read_csv(results / "result.csv")
    assert [[curve["name"] for curve in plot["curves"]] for plot in drawn] == PLOTTED
    for curve in (curve for plot in drawn for curve in plot["curves"]):
        x, y = np.array(curve["x"]), np.array(curve["y"])
        time, recorded = table["time"], table[curve["name"]]
        assert (x[0], x[-1]) == (0.0, 60.0) and len(x) < 8000, curve["name"]
        # Neither the largest nor the smallest value is lost.
        assert (y.min(), y.max()) == pytest.approx((recorded.min(), recorded.max()), rel=1e-5)
        # Lines between points lie on the curve, by a thousandth of what is shown; of one that oscillates faster than points
        # can show, as this control does for a while, at nearly all times.
        away = np.abs(np.interp(time, x, y) - recorded) / np.ptp(recorded)
        assert np.quantile(away, 0.9) < 1e-3 and (away.max() < 1e-3 or curve["name"] == "controller.u[1]"), curve["name"]


def test_axes_are_labelled_with_quantities_and_units(results: Path) -> None:
    output, control = plots(results / "index.html")
    assert (output["x"], output["y"].split(" (")[0]) == ("time (s)", "output")
    assert (control["x"], control["y"].split(" (")[0]) == ("time (s)", "control")


def test_a_reference_is_dashed_beneath_what_follows_it_and_in_its_colour(results: Path) -> None:
    curves = {curve["name"]: curve for curve in plots(results / "index.html")[0]["curves"]}
    own, model, reference = (curves[name] for name in ["plant.y[1]", "y_m", "reference.r[1]"])
    assert not own["beneath"] and own["dashes"] == []
    assert model["beneath"] and reference["beneath"] and own["colour"] == model["colour"] == reference["colour"]
    assert [] != model["dashes"] != reference["dashes"] != []
    # What is drawn first lies beneath: in the picture, too.
    drawn = [path.get("stroke-dasharray") for path in html.parse(results / "plot.svg").xpath("//svg//svg/path")]
    assert drawn[0] and drawn[1] and drawn[2] is None


@pytest.mark.parametrize("loop", ["3.3.3", "3.3.2-case1", "5"])
def test_the_page_of_a_large_run_is_small(loop: str, fmu_folder: Path, tmp_path: Path) -> None:
    answer = adaptive_fmu("run", loop, "--json", "--fmus", fmu_folder, "--out", tmp_path)
    assert answer.returncode in (0, 1, 3), answer
    assert (tmp_path / loop / "index.html").stat().st_size < 500_000
    assert (tmp_path / loop / "plot.svg").stat().st_size < 200_000


def test_the_page_loads_nothing(results: Path) -> None:
    text = (results / "index.html").read_text()
    assert len(text) < 2e5
    page = html.document_fromstring(text)
    loaded = [address for _, _, address, _ in page.iterlinks() if address != "data:,"]
    assert loaded == [] and page.xpath("//script[@src] | //iframe | //img | //object") == []
    (policy,) = page.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    assert policy.startswith("default-src 'none'") and "http" not in policy


def test_the_page_shows_metrics_and_settings(results: Path) -> None:
    page = html.document_fromstring((results / "index.html").read_text())
    recorded = json.loads((results / "metrics.json").read_text())
    assert recorded["ended"] == "complete" and not page.find_class("bad")
    rows = [[cell.text_content().strip() for cell in row] for row in page.get_element_by_id("metrics").iter("tr")]
    expected = [[m["label"], f"{m['limit']:g}", "yes"] for m in recorded["metrics"]]
    assert [[label, *rest] for label, _, *rest in rows[1:]] == expected and len(expected) == 3
    assert [float(row[1]) for row in rows[1:]] == pytest.approx([m["value"] for m in recorded["metrics"]], rel=6e-4)
    settings = page.get_element_by_id("settings").text_content()
    assert all(word in settings for word in ["60 s", "0.001 s", "gauss-seidel", "L1NonlinearSiso"])
    assert "ReferenceNonlinearSiso with cosine_amplitude[1] = 2.0, cosine_frequency[1] = 0.2" in settings


def test_the_same_run_makes_the_same_page(results: Path, fmu_folder: Path, tmp_path: Path) -> None:
    answer = adaptive_fmu("run", LOOP, "--json", "--fmus", fmu_folder, "--out", tmp_path)
    assert answer.returncode == 0
    assert [(tmp_path / LOOP / name).read_bytes() == (results / name).read_bytes() for name in FILES] == [True] * 4


def opened(page: Path, folder: Path) -> html.HtmlElement:
    """A page as a browser shows it, which has nothing to complain of."""
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=10000", "--enable-logging=stderr"]
    command = [BROWSER, *options, "--window-size=1000,900", f"--user-data-dir={folder}", "--dump-dom", f"file://{page}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
    return html.document_fromstring(done.stdout)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: the page was not opened in a browser")
def test_a_browser_draws_every_curve_without_an_error(results: Path, tmp_path: Path) -> None:
    page = opened(results / "index.html", tmp_path)
    lines = [plot.find_class("curve") for plot in page.find_class("diagram")]
    assert [len(plot) for plot in lines] == [len(signals) for signals in PLOTTED]
    # Each is a path of many points.
    assert min(len(line.get("d").split(",")) for plot in lines for line in plot) > 50
    assert [entry.text_content() for entry in page.xpath("//div[@class='legend']/button")] == [
        name for p in PLOTTED for name in p
    ]


# What a reader does with the first plot of a page: a pointer at places of it, in pixels.
READER = """<script>
const at = (kind, x, y) => {
  const plot = document.querySelector('.diagram svg'), box = plot.getBoundingClientRect();
  plot.dispatchEvent(new PointerEvent(kind, {button: 0, clientX: box.left + x, clientY: box.top + y}));
};
const drag = ([a, b], [c, d]) => (at('pointerdown', a, b), at('pointermove', c, d), at('pointerup', c, d));
%s
</script>"""


def times(plot: html.HtmlElement) -> list[float]:
    """What stands at the axis of time."""
    labels = plot.xpath(".//*[name()='text'][@text-anchor='middle' and @x and @y]")
    return [float(label.text_content()) for label in labels if label.text_content() != "time (s)"]


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: the page was not opened in a browser")
def test_a_reader_zooms_hides_curves_and_reads_values(results: Path, tmp_path: Path) -> None:
    def after(actions: str) -> list[html.HtmlElement]:
        """The plots when a reader has done this."""
        file = tmp_path / "read.html"
        file.write_text((results / "index.html").read_text().replace("</body>", READER % actions + "</body>"))
        return opened(file, tmp_path).find_class("diagram")

    whole = [times(plot) for plot in after("")]
    assert all(shown[0] == 0.0 and shown[-1] == 60.0 for shown in whole)
    # Across a plot: that time in all of them.
    across = "drag([200, 100], [300, 102]);"
    zoomed = after(across)
    shown = [times(plot) for plot in zoomed]
    assert shown[0] == shown[1] and 0.0 < shown[0][0] < shown[0][-1] < 30.0
    # Up and down: these values in this plot.
    first = [plot.find_class("curve")[0].get("d") for plot in after("")]
    taller = [plot.find_class("curve")[0].get("d") for plot in after("drag([200, 60], [202, 160]);")]
    assert first[0] != taller[0] and first[1] == taller[1]
    assert [times(plot) for plot in after(across + "at('dblclick', 250, 100);")] == whole
    hidden = after("document.querySelector('.legend button').click();")
    assert [len(plot.find_class("curve")) for plot in hidden] == [len(PLOTTED[0]) - 1, len(PLOTTED[1])]
    # Under the pointer: the time, and the recorded point of each curve that is nearest to it.
    (readout,) = after("at('pointermove', 300, 100);")[0].find_class("readout")
    _, *lines = readout.itertext()
    time = readout.text.removeprefix("time = ").removesuffix(" s")
    table = read_csv(results / "result.csv")
    for name, line in zip(PLOTTED[0], lines, strict=True):
        value, _, own = line.removeprefix(f"{name}: ").partition(" at ")
        row = np.abs(table["time"] - float(own or time)).argmin()
        assert float(value) == pytest.approx(table[name][row], rel=1e-5), line


def test_markup_in_a_loop_stays_text(fmu_folder: Path, tmp_path: Path) -> None:
    hostile = "&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt; &amp; &quot;"
    file = shutil.copytree(ROOT / "examples" / LOOP, tmp_path / "loop") / "SystemStructure.ssd"
    text = SSD.replace('label="max |u|"', f'label="{hostile}"').replace('title="control"', f'title="{hostile}"')
    file.write_text(text)
    answer = adaptive_fmu("run", file, "--json", "--until", "0.1", "--fmus", fmu_folder, "--out", tmp_path)
    assert answer.returncode == 0, answer
    page = html.document_fromstring((tmp_path / LOOP / "index.html").read_text())
    assert page.xpath("//img | //*[@onerror]") == [] and len(page.xpath("//script")) == 1 + len(PLOTTED)


def test_a_plot_may_show_any_variable_and_names_with_commas_stay_one_column(fmu_folder: Path, tmp_path: Path) -> None:
    estimate = "controller.theta_hat[1,1]"
    file = shutil.copytree(ROOT / "examples" / LOOP, tmp_path / "loop") / "SystemStructure.ssd"
    file.write_text(SSD.replace('signals="controller.u[1]"', f'signals="controller.u[1] {estimate}"'))
    answer = adaptive_fmu("run", file, "--json", "--until", "0.1", "--fmus", fmu_folder, "--out", tmp_path)
    assert answer.returncode == 0, answer
    table = read_csv(tmp_path / LOOP / "result.csv")
    assert len(table[estimate]) == 101 and table[estimate][0] == 0.0 != table[estimate][-1]
    assert estimate in {curve["name"] for plot in plots(tmp_path / LOOP / "index.html") for curve in plot["curves"]}


def test_a_failing_unit_leaves_what_was_computed(fmu_folder: Path, tmp_path: Path) -> None:
    # The plant's input gain has the wrong sign: no control can hold that loop.
    unstable = ["--set", "plant.omega=-2", "--json"]
    answer = adaptive_fmu("run", LOOP, *unstable, "--fmus", fmu_folder, "--out", tmp_path)
    assert (answer.returncode, answer.stdout) == (1, "") and str(tmp_path / LOOP) in answer.stderr
    end = read_csv(tmp_path / LOOP / "result.csv")["time"][-1]
    assert 0.01 < end < 60.0
    assert json.loads((tmp_path / LOOP / "metrics.json").read_text())["ended"] == "failed"
    page = html.document_fromstring((tmp_path / LOOP / "index.html").read_text())
    assert f"This run failed at t = {end:.10g} s of 60 s" in page.find_class("bad")[0].text_content()
    ends = {curve["x"][-1] for plot in plots(tmp_path / LOOP / "index.html") for curve in plot["curves"]}
    assert len(ends) == 1 and ends.pop() == pytest.approx(end, abs=1e-9)


class Endless:
    """A run that won't end by itself, in a terminal."""

    def __init__(self, fmus: Path, out: Path, *options: str, stdout: int = subprocess.PIPE) -> None:
        self.terminal, stderr = pty.openpty()
        command = [str(PROGRAM), "run", LOOP, "--until", "9000", *options]
        command += ["--fmus", str(fmus), "--out", str(out)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=stdout, stderr=stderr, text=True)
        os.close(stderr)
        self.seen = ""

    def __enter__(self) -> "Endless":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()
        os.close(self.terminal)

    def read(self, seconds: float) -> None:
        """What the terminal shows until then."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0 and select.select([self.terminal], [], [], left)[0]:
            try:
                self.seen += os.read(self.terminal, 65536).decode(errors="replace")
            except OSError:  # the other end is closed
                return

    def wait_for(self, words: str, seconds: float = 120.0) -> None:
        end = time.monotonic() + seconds
        while words not in self.seen and time.monotonic() < end:
            self.read(0.1)
        assert words in self.seen, self.seen

    def interrupt(self, how: int = signal.SIGINT) -> None:
        self.process.send_signal(how)

    def end(self) -> tuple[int, str]:
        out, _ = self.process.communicate(timeout=60)
        self.read(0.2)
        return self.process.returncode, out


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_run_keeps_what_was_computed(how: int, fmu_folder: Path, tmp_path: Path) -> None:
    with Endless(fmu_folder, tmp_path) as run:
        # Progress shows simulated time, speed and what is left.
        run.wait_for("× real time")
        assert re.search(r"t = \d+\.\d+ of 9000 s, [\d.]+ × real time, .+ left", run.seen)
        run.interrupt(how)
        code, out = run.end()
    assert code == 130
    table = read_csv(tmp_path / LOOP / "result.csv")
    end = table["time"][-1]
    assert 0.0 < end < 9000.0 and len(table["time"]) == round(end / 1e-3) + 1
    assert len(re.findall(rf"the run was interrupted at t = {end:.10g} s of 9000 s", run.seen)) == 1
    assert "max |u|" in out and sorted(file.name for file in (tmp_path / LOOP).iterdir()) == FILES
    assert json.loads((tmp_path / LOOP / "metrics.json").read_text())["ended"] == "interrupted"
    page = html.document_fromstring((tmp_path / LOOP / "index.html").read_text())
    assert f"This run was interrupted at t = {end:.10g} s" in page.find_class("bad")[0].text_content()


def test_progress_is_silent_where_a_program_reads(fmu_folder: Path, tmp_path: Path) -> None:
    with Endless(fmu_folder, tmp_path, "--json") as run:
        run.read(3.0)
        assert run.seen == ""
        run.interrupt()
        code, out = run.end()
    assert (code, json.loads(out)["ended"]) == (130, "interrupted")


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_second_interruption_ends_at_once(how: int, fmu_folder: Path, tmp_path: Path) -> None:
    # Nobody reads this pipe, and it is full: the program can't finish its table.
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(writer, bytes(4096)):
            pass
    os.set_blocking(writer, True)
    with Endless(fmu_folder, tmp_path, stdout=writer) as run:
        run.wait_for("× real time")
        run.interrupt(how)
        with pytest.raises(subprocess.TimeoutExpired):
            run.process.wait(timeout=2.0)
        run.interrupt(how)
        assert run.process.wait(timeout=10.0) == 130
    os.close(reader)
    os.close(writer)
    assert sorted(file.name for file in (tmp_path / LOOP).iterdir()) == FILES
