"""The documentation site: it is built without a warning, its links and anchors lead somewhere, it needs no network, and it
shows equations without a script."""

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from conftest import FMU_NAMES, PROGRAM, ROOT

lacking = [name for name in ["mkdocs", "material", "mkdocstrings", "latex2mathml"] if not importlib.util.find_spec(name)]
pytestmark = pytest.mark.skipif(
    bool(lacking), reason=f"{', '.join(lacking)} isn't installed: docs/requirements.txt names what builds the site"
)


class Page(HTMLParser):
    """What a page links to, what it loads, and where it can be linked to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = {"", "__skip"}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "link" and values.get("rel") not in {"canonical", "next", "prev"}:
            self.loads.append(values["href"])
        if tag in {"script", "img"} and "src" in values:
            self.loads.append(values["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    environment = {**os.environ, "ADAPTIVE_FMU_PROGRAM": str(PROGRAM), "NO_MKDOCS_2_WARNING": "1"}
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(build, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not [line for line in done.stderr.splitlines() if "WARNING" in line], done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {file: Page(file.read_text()) for file in site.rglob("*.html") if file.name != "404.html"}


def test_every_link_leads_to_a_page_and_an_anchor(pages: dict[Path, Page]) -> None:
    assert len(pages) > 80
    broken = []
    for file, page in pages.items():
        for link in page.links + page.loads:
            parts = urlsplit(link)
            if parts.scheme in {"http", "https", "mailto", "data"}:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file() or (target in pages and unquote(parts.fragment) not in pages[target].anchors):
                broken.append(f"{file.name}: {link}")
    assert not broken


def test_it_needs_no_network(site: Path, pages: dict[Path, Page]) -> None:
    assert not [(file.name, link) for file, page in pages.items() for link in page.loads if "//" in link]
    styles = [file.read_text() for file in site.rglob("*.css")]
    assert styles and not [found for text in styles for found in re.findall(r"url\(\"?(?:https?:)?//[^)]*", text)]


def test_equations_are_mathml(pages: dict[Path, Page]) -> None:
    law = next(file for file in pages if file.parts[-2:] == ("controllers", "l1.html")).read_text()
    assert law.count("<math") > 50
    for file in pages:
        text = re.sub(r"<(pre|code|script|style)\b.*?</\1>", "", file.read_text(), flags=re.S)
        assert "xEQUATION" not in text and "$" not in re.sub(r"<[^>]*>", "", text), file.name


def test_what_is_generated_is_there(site: Path) -> None:
    commands = (site / "reference" / "commands.html").read_text()
    for command in ["list", "new", "new-loop", "export", "run", "tune", "linearise", "check", "validate"]:
        assert f'<h2 id="{command}">' in commands
    keys = (site / "reference" / "keys.html").read_text()
    assert "structure.baseline" in keys and '<h2 id="state-space">' in keys
    assert "<h2" in (site / "reference" / "corrections.html").read_text()
    for name in FMU_NAMES:
        assert '<h2 id="outputs">' in (site / "reference" / "fmus" / f"{name}.html").read_text(), name
    assert "adaptive_fmu.Loop" in (site / "reference" / "python.html").read_text()


def test_the_search_knows_the_pages(site: Path) -> None:
    index = (site / "search" / "search_index.json").read_text()
    assert all(words in index for words in ["step_too_long", "A controller of your own", "prescribed performance"])
