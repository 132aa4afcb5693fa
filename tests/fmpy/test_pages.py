"""What an FMU tells a reader who has nothing else: its page, its icon, and its pins in groups."""

import html as escapes
import io
import json
import os
import re
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import adaptive_fmu as adaptive_fmu_package
import fmpy
import numpy as np
import pytest
import responses
import sample
from conftest import FMU_NAMES, ROOT, Ran, adaptive_fmu
from lxml import etree, html
from master import Fmu

BROWSER = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
ORDER = ["wiring", "pins", "gains", "response", "warnings", "limits", "law", "variables", "report"]
ALWAYS = {"wiring", "pins", "gains", "response", "warnings", "limits", "law", "variables"}
TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"


def entry(fmu: Path, name: str) -> bytes:
    with zipfile.ZipFile(fmu) as archive:
        return archive.read(name)


def page_of(fmu: Path) -> html.HtmlElement:
    return html.document_fromstring(entry(fmu, "documentation/index.html").decode())


def sections(page: html.HtmlElement) -> list[str]:
    return [heading.get("id") for heading in page.iter("h2")]


def section(page: html.HtmlElement, name: str) -> str:
    """The text of a section."""
    (heading,) = page.xpath(f"//h2[@id='{name}']")
    text = []
    for element in heading.itersiblings():
        if element.tag == "h2":
            break
        text.append(element.text_content())
    return "\n".join(text)


def named(texts: list[str]) -> set[str]:
    """The names in some texts, with ranges written out."""
    names = set()
    for name in re.split(r",\s*|\s+", " ".join(texts)):
        found = re.fullmatch(r"(.+)\[(\d+)…(\d+)\]", name)
        names |= {f"{found[1]}[{k}]" for k in range(int(found[2]), int(found[3]) + 1)} if found else {name}
    return names


def in_diagram(page: html.HtmlElement) -> set[str]:
    return named([text.text_content() for text in page.xpath("//svg[@id='diagram']//*[local-name() = 'text']")])


def pins_of(fmu: Fmu) -> list[str]:
    return fmu.named(causality="input") + fmu.named(causality="output")


def exported(tmp_path: Path, text: str, *options: str) -> Path:
    """The FMU of a description."""
    file = tmp_path / "own.toml"
    file.write_text(text)
    answer = adaptive_fmu("export", file, *options, "--out", tmp_path)
    assert answer.returncode == 0, answer.stderr
    return Path(answer.stdout.split()[-1])


def test_a_page_shows_what_is_asked_for_first_first(each_fmu: Fmu) -> None:
    page = page_of(each_fmu.path)
    found = sections(page)
    assert found == [name for name in ORDER if name in found] and set(found) >= ALWAYS
    assert page.get_element_by_id("purpose").text_content().strip(), "what it is for"


def test_a_page_names_every_pin_in_its_diagram(each_fmu: Fmu) -> None:
    assert set(pins_of(each_fmu)) - in_diagram(page_of(each_fmu.path)) == set()


def test_the_pages_of_a_loop_show_partners_and_what_to_connect(fmu: Callable[[str], Fmu]) -> None:
    page = page_of(fmu("L1TwoLinkRobot").path)
    assert {"reference", "plant", "controller", "TwoLinkRobot"} <= in_diagram(page)
    rows = [[cell.text_content().strip() for cell in row] for row in page.xpath("//th[.='connect']/ancestor::table//tr")]
    assert ["reference.r[1…2]", "r[1…2]"] in rows
    assert ["plant.x[1…4]", "x[1…4]"] in rows and ["u[1…2]", "plant.u[1…2]"] in rows
    assert "enabled" in section(page, "wiring") and "may stay open" in section(page, "wiring")


def curves_of(page: html.HtmlElement) -> dict[str, np.ndarray]:
    """The curves in the pictures of how a unit answers, in pixels, by their names in the legend."""
    curves = {}
    for figure in page.iter("figure"):
        names = [key.text_content().strip() for key in figure.find_class("key")]
        lines = sorted(figure.xpath(".//*[local-name() = 'polyline']"), key=lambda line: line.get("stroke"))
        points = [np.array([point.split(",") for point in line.get("points").split()], dtype=float) for line in lines]
        curves |= dict(zip(names, points, strict=True))
    return curves


ALONE = {"Excitation": ["u[1]"], "Sensor": ["u[1]", "y[1]"], "Unwrap": ["u[1]", "y[1]"], "Actuator": ["u[1]", "y[1]"], "StateSpace": ["y[1]"], "PidNonlinearSiso": ["u[1]"]}


@pytest.mark.parametrize("name", ALONE)
def test_a_unit_in_no_loop_shows_what_it_does_alone(name: str, fmu: Callable[[str], Fmu]) -> None:
    page = page_of(fmu(name).path)
    curves = curves_of(page)
    assert list(curves) == ALONE[name] and all(len(points) > 100 for points in curves.values())
    # More than a flat line: what is shown uses the height of the picture. An unwrapped angle leaves the wrapped one far below.
    least = 50 if name == "Unwrap" else 100
    assert all(np.ptp(points[:, 1]) > least for points in curves.values())
    assert "computed at export" in section(page, "response") and "new loop" in section(page, "response")


# It shows itself too, by five curves of one unit of measurement, some of which move little.
ALONE_TOO = {*ALONE, "QuadrotorMixer"}
# No loop of the package holds them: their pages tell how to make one.
WITHOUT_LOOP = ("Funnel", "FuzzyL1CoupledMimo", "FuzzyL1TwoLinkRobot", "L1Limit", "L1Ppf", "L1Sampled", "Ladrc", "MracPpfUnmatched")


def test_every_other_unit_shows_how_its_loop_answers(each_fmu: Fmu) -> None:
    text = section(page_of(each_fmu.path), "response")
    if each_fmu.name.startswith(WITHOUT_LOOP):
        assert f"adaptive-fmu new loop --units {each_fmu.name}.fmu" in text
        return
    assert ("The loop" in text) == (each_fmu.name not in ALONE_TOO) and curves_of(page_of(each_fmu.path))


def test_a_plant_of_ones_own_shows_its_own_step_response_under_its_own_names(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "own" / "dc_motor" / "DcMotor.toml").read_text()
    page = page_of(exported(tmp_path, text))
    curves = curves_of(page)
    assert list(curves) == ["speed_output"]
    speed = curves["speed_output"][:, 1]
    # In pixels, from above: it rises to a speed that it keeps.
    assert speed[0] - speed[-1] > 100 and np.abs(np.diff(speed[-20:])).max() <= 0.11


WITHOUT = {
    "L1NonlinearSiso": ["Baseline", "baseline", "K_m", "nmatched", "infinity_norm", "Funnel", "inertia", 'input_gain = "full"'],
    "L1TwoLinkRobot": ["nmatched", "Funnel", "outside", "diagonal", 'regressor = "state"'],
    "L1UnmatchedMimo": ["Baseline", "baseline", "K_m", "Funnel", "diagonal"],
    "FuzzyL1ActuatedSiso": ["nmatched", "Funnel to watch", "known term"],
    "NeuroPpfCoupledMimo": ["square_roots", "g_network_initial"],
    "NeuroPpfTwoLinkRobot": ["quasi_random", "A_m"],
    "PidNonlinearSiso": ["Funnel"],
}
WITH = {
    "L1NonlinearSiso": ['regressor = "state"', 'input_gain = "diagonal"'],
    "L1TwoLinkRobot": ["Baseline", "known term", 'input_gain = "full"'],
    "L1UnmatchedMimo": ["Unmatched uncertainty", "factors"],
    "L1MaresAuv": ["accelerations", "nominal_inertia"],
}


@pytest.mark.parametrize("name", WITHOUT)
def test_a_page_has_no_law_of_what_its_unit_does_not_have(name: str, fmu: Callable[[str], Fmu]) -> None:
    law = section(page_of(fmu(name).path), "law")
    assert [word for word in WITHOUT[name] if word in law] == []
    assert "only:" not in law and "end -->" not in law


@pytest.mark.parametrize("name", WITH)
def test_a_page_has_the_law_of_what_its_unit_has(name: str, fmu: Callable[[str], Fmu]) -> None:
    law = section(page_of(fmu(name).path), "law")
    assert [word for word in WITH[name] if word.lower() not in law.lower()] == [] and "Source:" in law


def test_a_page_has_what_a_description_of_ones_own_asks_for(tmp_path: Path) -> None:
    text = (ROOT / "modelDescription" / "L1NonlinearSiso.toml").read_text()
    text = text.replace('"L1NonlinearSiso"', '"Own"').replace("[structure]", "[structure]\nfunnel = true", 1)
    text += '\n[names]\nx = ["angle", "speed"]\nr = "wanted"\n'
    page = page_of(made := exported(tmp_path, text, "--terminals"))
    assert "Funnel to watch" in section(page, "law")
    assert {"angle", "speed", "wanted", "u[1]", "funnel_left"} <= in_diagram(page)
    assert curves_of(page) == {} and "new loop --units Own.fmu" in section(page, "response"), "no loop of this unit was run"
    terminals = etree.fromstring(entry(made, TERMINALS))
    members = {member.get("variableName"): member.get("memberName") for member in terminals.iter("TerminalMemberVariable")}
    assert members == {"wanted": "r[1]", "angle": "x[1]", "speed": "x[2]", "u[1]": "u[1]"}


def test_a_composite_shows_its_parts(tmp_path: Path) -> None:
    answer = adaptive_fmu("export", "--composite", "3.2.1-cosine", "--out", tmp_path)
    assert answer.returncode == 0, answer.stderr
    page = page_of(tmp_path / "Loop_3_2_1_cosine.fmu")
    assert {"reference", "plant", "controller", "x[1]", "u[1]", "dr[1]", "enabled"} <= in_diagram(page)
    assert "plant.x[1…2]" in section(page, "wiring"), "outputs that are connected inside can be read, too"
    assert "response" in sections(page) and "unmatched" not in section(page, "law").lower()


def test_no_limit_is_reported_as_such(fmu: Callable[[str], Fmu]) -> None:
    page = page_of(fmu("L1NonlinearSiso").path)
    assert "no limit" in section(page, "gains") and "1000000000000000" not in page.text_content()


def test_every_fmu_has_its_kinds_icon(each_fmu: Fmu) -> None:
    model = re.search(r'^model = "(.+)"', (ROOT / "modelDescription" / f"{each_fmu.name}.toml").read_text(), re.M)[1]
    icons = ROOT / "modelDescription" / "icons"
    assert entry(each_fmu.path, "model.png") == (icons / f"{model}.png").read_bytes()
    with zipfile.ZipFile(each_fmu.path) as archive:
        assert not [name for name in archive.namelist() if "terminals" in name.lower()], "FMI Library 3 refuses them"


@pytest.fixture(scope="module")
def with_terminals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terminals")
    answer = adaptive_fmu("export", "--all", "--terminals", "--out", folder)
    assert answer.returncode == 0, answer.stderr
    return folder


def test_terminals_keep_to_the_standards_schema_and_name_variables(each_fmu: Fmu, with_terminals: Path) -> None:
    file = with_terminals / each_fmu.path.name
    terminals = etree.fromstring(entry(file, TERMINALS))
    model = re.search(r'^model = "(.+)"', (ROOT / "modelDescription" / f"{each_fmu.name}.toml").read_text(), re.M)[1]
    for kind in ("png", "svg"):
        icon = ROOT / "modelDescription" / "icons" / f"{model}.{kind}"
        assert entry(file, f"terminalsAndIcons/icon.{kind}") == icon.read_bytes()
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    assert schema.validate(terminals), schema.error_log
    pins = pins_of(each_fmu)
    for terminal in terminals.iter("Terminal"):
        names = [member.get("memberName") for member in terminal]
        assert len(set(names)) == len(names)
        assert [member.get("variableName") for member in terminal if member.get("variableName") not in pins] == []


@pytest.mark.parametrize("form", [["--source"], ["--source-only"], ["--composite", "3.2.1-cosine"], ["--ssp", "3.2.1-cosine"]])
def test_terminals_are_in_an_fmu_of_each_form_that_is_asked_for_them(form: list[str], tmp_path: Path) -> None:
    for options, expected in ([], False), (["--terminals"], True):
        answer = adaptive_fmu("export", "L1NonlinearSiso", *form, *options, "--out", tmp_path)
        assert answer.returncode == 0, answer.stderr
        for file in map(Path, answer.stdout.split()):
            with zipfile.ZipFile(file) as archive:
                inner = [io.BytesIO(archive.read(name)) for name in archive.namelist() if name.endswith(".fmu")]
            for fmu in inner or [file]:
                with zipfile.ZipFile(fmu) as archive:
                    assert (TERMINALS in archive.namelist()) == expected, file


def test_python_adds_terminals_where_they_are_asked_for(tmp_path: Path) -> None:
    # A run stores no FMUs; the option is no fault.
    answer = adaptive_fmu("run", "3.2.1-cosine", "--until", "0.1", "--terminals", folder=tmp_path)
    assert answer.returncode == 0 and [path.name for path in tmp_path.iterdir()] == ["results"], answer.stderr
    (file,) = adaptive_fmu_package.export("L1NonlinearSiso", out=tmp_path / "python", terminals=True)
    assert entry(file, TERMINALS)
    (plain,) = adaptive_fmu_package.export("L1NonlinearSiso", out=tmp_path / "python")
    with pytest.raises(KeyError):
        entry(plain, TERMINALS)


@pytest.mark.parametrize("loop", ["3.2.1-cosine", "3.3.1-case2-bench", "3.3.2-case1", "5-wide", "6.5.1-mrac", "7.5.1", "7.5.2"])
def test_terminals_connect_what_the_loops_connect(loop: str, with_terminals: Path) -> None:
    units = {c.get("name"): with_terminals / Path(c.get("source")).name for c in responses.elements(loop, "Component")}
    of = {
        (part, variable): (terminal.get("name"), member.get("memberName"))
        for part, unit in units.items()
        for terminal in etree.fromstring(entry(unit, TERMINALS)).iter("Terminal")
        for member in terminal
        for variable in [member.get("variableName")]
    }
    for link in responses.elements(loop, "Connection"):
        (_, one), (_, other) = (
            of[link.get(f"{end}Element"), link.get(f"{end}Connector")] for end in ("start", "end")
        )
        assert one == other, etree.tostring(link)


def test_icons_differ(fmu_folder: Path) -> None:
    pictures = {entry(fmu_folder / f"{name}.fmu", "model.png") for name in FMU_NAMES}
    assert len(pictures) == len(list((ROOT / "modelDescription" / "icons").glob("*.png"))) - 2, "all but a loop's and the spare one"


def leaves(curve: np.ndarray, other: np.ndarray, off: np.ndarray) -> list[int]:
    """The hundredths of a picture in which a curve goes lower or higher than another one does there, and a little beside."""
    ends = np.linspace(0, len(curve), 101).astype(int)
    near = len(curve) // 200 + 1
    beyond = []
    for k, (a, b) in enumerate(zip(ends, ends[1:])):
        here, there = curve[a:b], other[max(a - near, 0) : b + near]
        if here.min() < there.min() - off[k] or here.max() > there.max() + off[k]:
            beyond.append(k)
    return beyond


@pytest.mark.parametrize("loop", [loop for loop in sample.LOOPS if not responses.is_to_fail(loop)])
def test_the_picture_of_a_loop_is_what_it_records(loop: str, ran: Callable[..., Ran]) -> None:
    """UPDATE_RESPONSES=1 writes examples/LOOP/response.txt anew."""
    _, table = ran(loop)
    file = ROOT / "examples" / loop / "response.txt"
    if "UPDATE_RESPONSES" in os.environ:
        file.write_text(responses.text(loop, table))
    curves = responses.read(loop)
    for _, signals in responses.plots(loop):
        plotted = responses.ranges([table[signal] for signal in signals])
        for signal in signals:
            drawn = np.interp(table["time"], *curves[signal])
            # Numbers have four digits, which is little for a peak at the start.
            off = 0.02 * plotted + 5e-4 * np.abs(table[signal]).max() * (np.arange(100) == 0)
            assert leaves(drawn, table[signal], off) == leaves(table[signal], drawn, off) == [], signal
    assert file.stat().st_size < 30_000


PURPOSE = """
<script>
addEventListener("load", () => {
  const lines = [...document.querySelectorAll("iframe")].map(frame => {
    const purpose = frame.contentDocument.querySelector("#purpose p"), range = document.createRange();
    range.selectNodeContents(purpose);
    return [frame.name, new Set([...range.getClientRects()].map(line => Math.round(line.bottom / 12))).size];
  });
  document.body.textContent = JSON.stringify(lines);
});
</script>
"""
MEASURE = """
<script>
addEventListener("load", () => {
  const frames = [...document.querySelectorAll("iframe")].map(frame => {
    const page = frame.contentDocument, input = page.querySelector("#pins ~ .scroll code");
    return [frame.name, frame.width, page.documentElement.scrollWidth, input ? input.getBoundingClientRect().top : -1];
  });
  document.body.textContent = JSON.stringify(frames);
});
</script>
"""


def measured(fmu_folder: Path, folder: Path, widths: list[int], script: str) -> list:
    """What a script tells of the pages of all FMUs, each in a frame of some widths, in Chromium."""
    frame = '<iframe name="{}" width="{}" height="900" srcdoc="{}"></iframe>'
    pages = {name: entry(fmu_folder / f"{name}.fmu", "documentation/index.html").decode() for name in FMU_NAMES}
    frames = [frame.format(name, width, escapes.escape(page)) for name, page in pages.items() for width in widths]
    (folder / "all.html").write_text(f"<!DOCTYPE html><meta charset=utf-8><body>{''.join(frames)}{script}")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", folder / "all.html"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    output = json.loads(html.document_fromstring(answer.stdout).xpath("//body")[0].text_content())
    assert len(output) == len(widths) * len(FMU_NAMES)
    return output


@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_what_a_unit_is_for_takes_at_most_two_lines(fmu_folder: Path, tmp_path: Path) -> None:
    shown = measured(fmu_folder, tmp_path, [1300], PURPOSE)
    assert [(name, lines) for name, lines in shown if not 1 <= lines <= 2] == []


@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_pages_fit_their_screens_and_inputs_are_seen_early(fmu_folder: Path, tmp_path: Path) -> None:
    shown = measured(fmu_folder, tmp_path, [1300, 400], MEASURE)
    assert [(name, width, seen) for name, width, seen, _ in shown if seen > int(width)] == [], "wider than the screen"
    assert [(name, top) for name, width, _, top in shown if width == "1300" and not 0 < top < 1200] == []
