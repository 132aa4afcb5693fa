"""What the README and the pages of the site promise: every command and every script works as it stands there."""

import csv
import importlib.util
import json
import math
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT
from sample import ALL, NUMBER
from test_run_results import FILES

# Commands that are run elsewhere: this very suite and the crate's documentation by the scripts that run all tests,
# the installation and the comparison with peers, with `--quick`, by tests of their own. Where, and what stands there.
RUN_ELSEWHERE = {
    "tests/run": (".ci/run", "tests/run"),
    "pip install .": ("tests/fmpy/test_pip.py", '"pip", "wheel", "."'),
    "adaptive-fmu run --all": ("tests/fmpy/test_run_all.py", '"run", "--all"'),
    "cargo doc --no-deps": (".ci/run", "cargo doc --release --no-deps"),
    "cmake -S firmware -B build": ("tests/fmpy/test_firmware.py", '"cmake", *command'),
    "cmake --build build": ("tests/fmpy/test_firmware.py", '"--build"'),
    "ctest --test-dir build": ("tests/fmpy/test_firmware.py", '["ctest"]'),
    "benches/peers": ("tests/fmpy/test_peers.py", '"benches" / "peers", "--quick"'),
}
# A script that needs one of these is skipped where it isn't installed.
EXTRAS = {"control", "dask", "ecospy", "gymnasium", "matplotlib"}
# Programs that lie beside the interpreter that runs the tests.
PYTHON_PROGRAMS = {"python", "fmpy"}
# What pages read of the source folder, and of what was built there.
SHOWN = ["examples", "target"]

README = (ROOT / "README.md").read_text()
DOCS = ROOT / "docs"
# As the site orders them.
PAGES = re.findall(r": ([\w/]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M)
BLOCK = re.compile(r"^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.S | re.M)


def text_of(page: str) -> str:
    file = ROOT / page
    # What a page says of plants of other tools is run by test_foreign_plants.py, which makes such plants.
    return re.sub(r"\n## With a plant of another tool\n.*?(?=\n## |\Z)", "", file.read_text(), flags=re.S) if file.is_file() else ""


def blocks(page: str) -> list[tuple[str, str, str | None]]:
    """The language and the text of each block that is run, and what it prints where the page shows that."""
    found = [(block["language"], block["text"]) for block in BLOCK.finditer(text_of(page))]
    after = [text if language == "text" else None for language, text in [*found[1:], ("", "")]]
    return [(*block, shown) for block, shown in zip(found, after, strict=False) if block[0] in {"sh", "python"}]


def commands(text: str) -> list[str]:
    return [line for line in text.replace("\\\n", "").splitlines() if line.strip() and not line.startswith("#")]


# In the order of the pages, and in the order of each page: a block finds what those before it have left. A commit takes the README, and
# every third page of the site.
RUN = [
    pytest.param(page, *block, id=f"{page} {number}")
    for page in ["README.md", *(f"docs/{page}" for page in (PAGES if ALL else PAGES[NUMBER % 3 :: 3]))]
    for number, block in enumerate(blocks(page), 1)
]
COMMANDS = [line for language, text, _ in blocks("README.md") if language == "sh" for line in commands(text)]


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folder in which a reader of a page is: what a user has in the checkout is left alone."""

    class Folders(dict[str, Path]):
        def __missing__(self, page: str) -> Path:
            folder = self[page] = tmp_path_factory.mktemp("reader")
            for name in SHOWN:
                (folder / name).symlink_to(ROOT / name)
            return folder

    return Folders()


def run(words: list[str | Path], folder: Path) -> subprocess.CompletedProcess[str]:
    # Scripts that call the program find the one that was built here.
    environment = {**os.environ, "PATH": f"{PROGRAM.parent}{os.pathsep}{os.environ['PATH']}"}
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@cache
def cargo(command: str) -> subprocess.CompletedProcess[str]:
    """A command that builds: in the checkout, and once, however many pages have it."""
    return run([*shlex.split(command)], ROOT)


def run_command(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    program, *words = shlex.split(command)
    if program == "cargo":
        return cargo(command)
    if program == "adaptive-fmu":
        return run([PROGRAM, *words], folder)
    if program in PYTHON_PROGRAMS:
        return run([Path(sys.executable).parent / program, *words], folder)
    return run([program, *words], folder)


@pytest.mark.parametrize(("page", "language", "text", "shown"), RUN)
def test_a_block_of_a_page_works(
    page: str, language: str, text: str, shown: str | None, reader: dict[str, Path]
) -> None:
    folder = reader[page]
    if language == "sh":
        for command in commands(text):
            if command not in RUN_ELSEWHERE:
                done = run_command(command, folder)
                assert done.returncode == 0, f"{command}\n{done.stderr}"
        return
    modules = set(re.findall(r"^(?:import|from) (\w+)", text, re.M)) | ({"gymnasium"} if ".gym " in text else set())
    if lacking := [name for name in modules & EXTRAS if importlib.util.find_spec(name) is None]:
        pytest.skip(f"{', '.join(lacking)} isn't installed")
    done = run([sys.executable, "-c", text], folder)
    assert done.returncode == 0, done.stderr
    assert shown is None or done.stdout == shown


@pytest.fixture(scope="module")
def motor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the tutorial's reader before the design is changed."""
    folder = tmp_path_factory.mktemp("motor")
    for language, text, _ in blocks("docs/tutorial.md")[:2]:
        for words in [[sys.executable, "-c", text]] if language == "python" else map(shlex.split, commands(text)):
            program = PROGRAM if words[0] == "adaptive-fmu" else words[0]
            assert run([program, *words[1:]], folder).returncode == 0
    return folder


def test_what_the_tutorial_shows_of_a_command_is_what_it_prints(motor: Path) -> None:
    shown = [text for text in (block["text"] for block in BLOCK.finditer(text_of("docs/tutorial.md"))) if text[0] == "$"]
    assert len(shown) == 1
    command, _, printed = shown[0].removeprefix("$ ").partition("\n")
    done = run_command(command, motor)
    assert done.returncode == 0
    for part in printed.split("...\n"):
        assert " ".join(part.split()) in " ".join(done.stdout.split())


def test_what_the_tutorial_states_of_its_loop_is_true(motor: Path) -> None:
    units = [f"motor/{name}.toml" for name in ["Motor", "MotorController", "MotorReference"]]
    check = run([PROGRAM, "check", units[1], "--json"], motor)
    findings = {finding["name"]: finding["value"] for finding in json.loads(check.stdout)["findings"]}
    assert findings["delay margin"] == pytest.approx(19.6e-3, abs=5e-5)
    assert findings["lambda*"] == pytest.approx(0.785, abs=5e-4)
    assert run([PROGRAM, "new", "loop", "--units", *units, "--until", "2", "--out", "motor"], motor).returncode == 0
    assert run([PROGRAM, "run", "motor"], motor).returncode == 0
    rows = list(csv.DictReader((motor / "results" / "motor" / "result.csv").open()))
    speed = {round(float(row["time"]), 6): float(row["plant.speed"]) for row in rows}
    assert speed[1.1] == pytest.approx(197, abs=0.5) and max(speed.values()) < 200.001
    assert max(float(row["controller.voltage"]) for row in rows) == pytest.approx(10.2, abs=0.05)


def test_the_readme_starts_with_the_two_commands_that_do_all_the_set_up() -> None:
    assert COMMANDS[:2] == ["cargo run --release -- export --run 3.2.1-cosine", "tests/run"]


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 80


def test_the_time_in_the_readme_is_that_of_the_page() -> None:
    (time,) = re.findall(r"20 s of the loop 3\.3\.1-case1 as a single FMU takes (\d+ ms)", " ".join(README.split()))
    assert f"| 3.3.1-case1, 20 s as a single FMU | {time} |" in (DOCS / "speed.md").read_text()


def test_no_table_of_the_readme_is_wider_than_a_terminal() -> None:
    assert not [line for line in README.splitlines() if line.startswith("|") and len(line) > 100]


def test_what_is_run_in_place_of_this_test_is_there() -> None:
    every = [block for page in ["README.md", *(f"docs/{page}" for page in PAGES)] for block in blocks(page)]
    written = [line for language, text, _ in every if language == "sh" for line in commands(text)]
    assert set(RUN_ELSEWHERE) <= set(written)
    for file, words in RUN_ELSEWHERE.values():
        assert words in (ROOT / file).read_text(), file


def test_every_file_that_the_readme_links_to_is_there() -> None:
    links = [link for link in re.findall(r"\]\(([^)#]+)", README) if "://" not in link]
    assert len(links) > 15 and all((ROOT / link).is_file() for link in links)


def test_every_page_is_listed_in_the_navigation_of_the_site() -> None:
    # Those that are made when the site is built are looked at by test_site.py.
    made = {"reference/commands.md", "reference/keys.md", "reference/corrections.md"}
    there = {file.relative_to(DOCS).as_posix() for file in DOCS.rglob("*.md")}
    assert there | made == set(PAGES) and len(PAGES) == len(set(PAGES))


def test_every_test_that_a_page_names_is_there() -> None:
    pages = [ROOT / "README.md", ROOT / "SECURITY.md", *DOCS.rglob("*.md")]
    text = "".join(page.read_text() for page in pages)
    files = re.findall(r"`((?:crates/\w+/)?tests/[\w/]+\.\w+)`", text)
    programs = re.findall(r"cargo test[^`]*? --test (\w+)(?: (\w+)::)?", text)
    assert len(files) > 20 and len(programs) > 5
    assert not [file for file in files if not (ROOT / file).is_file()]
    folders = [ROOT / "tests", *ROOT.glob("crates/*/tests")]
    for program, module in programs:
        assert any((folder / program / f"{module or 'main'}.rs").is_file() for folder in folders), (program, module)


def test_pages_count_the_fmus_and_loops_that_list_shows() -> None:
    output = json.loads(run([PROGRAM, "list", "--json"], ROOT).stdout)
    fmus, loops = len(output["fmus"]), len(output["loops"])
    index = (DOCS / "index.md").read_text()
    assert f"- {fmus} [FMUs]" in index and f"- {loops} [loops]" in index
    # Nowhere is another number of FMUs or loops told, but in a study of a user's own (1,000 loops).
    texts = [README, *((ROOT / f"{name}.md").read_text() for name in ["ARCHITECTURE", "CONTRIBUTING"])]
    texts += [file.read_text() for file in DOCS.rglob("*.md")]
    for number, what in [(fmus, "FMUs"), (loops, "loops")]:
        assert {int(output) for text in texts for output in re.findall(rf"(?<![\d.,])(\d+) \[?{what}\b", text)} == {number}, what


def constant(file: str, name: str) -> float:
    """A number in the sources; where a platform chooses, the first."""
    found = re.search(rf"\b{name}(?:: \w+ =|:) (.+?)(?:;|,\n)", (ROOT / file).read_text())
    assert found, f"{file} has no {name}"
    chosen = re.search(r"\{ (\d+) \}", found[1])
    low, _, bits = (chosen[1] if chosen else found[1]).replace("_", "").partition(" << ")
    return float(low) * 2 ** int(bits or 0)


def league(name: str) -> int:
    return int(constant("crates/program/src/league/study.rs", rf"{name}(?=: \d)"))


# What a page says with a number that the sources hold: the numbers in their order.
CONSTANTS = {
    "tuning.md": [
        ("more than {} runs the curves of {} are drawn", lambda: 2 * [constant("crates/program/src/analysis/sweep/mod.rs", "MOST_DRAWN")]),
    ],
    "run.md": [
        ("leaves {} files in", lambda: [len(FILES)]),
        ("for up to {} communication steps", lambda: [constant("crates/program/src/analysis/operating_point.rs", "STEPS")]),
        ("hardly moves within {} steps", lambda: [2 * constant("crates/program/src/analysis/operating_point.rs", "STEPS")]),
        ("more than {} million values", lambda: [constant("crates/program/src/results/recorder.rs", "MOST_STORED") // 1e6]),
        ("for each {} million values", lambda: [constant("crates/program/src/results/recorder.rs", "BLOCK") // 1e6]),
        ("lines of at most {} MiB", lambda: [constant("crates/identification/src/csv.rs", "LONGEST_LINE") / 2**20]),
    ],
    "internals.md": [("is freed, {} FMUs at most", lambda: [constant("crates/framework/src/fmi2/shared.rs", "MOST_CACHED")])],
    "foreign_units.md": [
        ("messages, a {} are shown", lambda: [constant("crates/program/src/simulation/closed_loop.rs", "MOST_MESSAGES")]),
    ],
    "step_size.md": [
        (
            "for at least {} steps, and for at most {}.",
            lambda: [constant("src/controllers/moves.rs", f"{which}_WAIT") for which in ["SHORTEST", "LONGEST"]],
        ),
    ],
    "league.md": [
        (
            "({} particles, {} generations, {} runs",
            lambda: [league("particles"), league("generations"), math.prod(map(league, ["particles", "generations", "noises"]))],
        ),
        ("of {} random plants of each kind", lambda: [league("plants")]),
        ("on {} plants of the thesis", lambda: [(ROOT / "examples/league/league.toml").read_text().count("[[plant]]")]),
    ],
    "../README.md": [("tried on {} random plants", lambda: [league("plants")])],
    "own_controller.md": [
        (
            "It has {} systems",
            lambda: [(ROOT / "examples/my_plant/src/lib.rs").read_text().split("export_fmi2![")[1].split("]")[0].count(",") + 1],
        ),
    ],
}
WORDS = {"three": 3, "four": 4, "eight": 8, "hundred": 100}


@pytest.mark.parametrize(("page", "sentence", "numbers"), [(page, *row) for page, rows in CONSTANTS.items() for row in rows])
def test_numbers_that_pages_take_from_the_sources_are_theirs(
    page: str, sentence: str, numbers: Callable[[], list[float]]
) -> None:
    text = " ".join((DOCS / page).read_text().split())
    found = re.search(re.escape(sentence).replace(r"\{\}", r"(\w+)"), text)
    assert found, f"{page} doesn't say: {sentence}"
    assert [WORDS.get(number) or float(number) for number in found.groups()] == numbers()


def test_no_source_has_more_lines_than_the_project_allows() -> None:
    (most,) = map(int, re.findall(r"no file over (\d+) lines", (ROOT / "CONTRIBUTING.md").read_text()))
    sources = [file for folder in ["crates", "src", "plants", "tests", "benches", "examples"] for file in (ROOT / folder).rglob("*.rs")]
    sources = [file for file in sources if "target" not in file.relative_to(ROOT).parts]
    assert len(sources) > 300
    assert not [file for file in sources if file.read_text().count("\n") > most]
