"""Every command of the README, and of the page about controllers of one's own, works as it stands there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

# Commands that are run elsewhere: this very suite and the crate's documentation by .ci/run, the comparison with peers by
# a test of its own, with `--quick`. Where, and what stands there.
RUN_ELSEWHERE = {
    "tests/run": (".ci/run", "tests/run"),
    "cargo doc --no-deps": (".ci/run", "cargo doc --no-deps"),
    "benches/peers": ("tests/fmpy/test_peers.py", '"benches" / "peers", "--quick"'),
}

README = (ROOT / "README.md").read_text()
# What it says of plants of other tools is run by test_foreign_plants.py, which makes such plants.
OWN_CONTROLLER = (ROOT / "docs" / "own_controller.md").read_text().split("\n## With a plant of another tool")[0]


def commands(page: str) -> list[str]:
    return [line for block in re.findall(r"```sh\n(.*?)```", page, re.S) for line in block.splitlines()]


COMMANDS = commands(README)


def test_the_readme_starts_with_the_two_commands_that_do_all_the_set_up() -> None:
    assert COMMANDS[:2] == ["cargo run --release -- export --run 3.2.1-cosine", "tests/run"]


@pytest.mark.parametrize("command", [command for command in COMMANDS if command not in RUN_ELSEWHERE])
def test_a_command_of_the_readme_works(command: str) -> None:
    # The tests may run in another environment than the one that tests/run prepares.
    words = shlex.split(command.replace("target/venv/bin/", f"{Path(sys.executable).parent}/"))
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that a reader of the page calls `mine`: what a user has there under this name is left alone."""
    return tmp_path_factory.mktemp("reader") / "mine"


# In the order of the page: each finds what those before it have left.
@pytest.mark.parametrize("command", commands(OWN_CONTROLLER))
def test_a_command_of_the_page_about_controllers_of_ones_own_works(command: str, mine: Path) -> None:
    words = [re.sub(r"^mine(?=/|$)", str(mine), word) for word in shlex.split(command)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_what_is_run_in_place_of_this_test_stands_there() -> None:
    assert set(RUN_ELSEWHERE) <= set(COMMANDS)
    for file, words in RUN_ELSEWHERE.values():
        assert words in (ROOT / file).read_text(), file


def test_every_file_that_the_readme_links_to_is_there() -> None:
    links = [link for link in re.findall(r"\]\(([^)#]+)", README) if "://" not in link]
    assert links and all((ROOT / link).is_file() for link in links)


def test_every_test_that_a_page_names_is_there() -> None:
    pages = [ROOT / "README.md", ROOT / "SECURITY.md", *(ROOT / "docs").glob("*.md")]
    text = "".join(page.read_text() for page in pages)
    files = re.findall(r"`(tests/[\w/]+\.\w+)`", text)
    programs = re.findall(r"cargo test[^`]*? --test (\w+)(?: (\w+)::)?", text)
    assert len(files) > 20 and len(programs) > 5
    named = [f"tests/{program}/{module or 'main'}.rs" for program, module in programs]
    assert not [file for file in [*files, *named] if not (ROOT / file).is_file()]


def test_the_fmus_and_loops_of_the_readme_are_those_that_exist() -> None:
    for name in [file.stem for file in (ROOT / "modelDescription").glob("*.toml")]:
        assert f"| `{name}` |" in README
    for folder in (ROOT / "examples").glob("*/SystemStructure.ssd"):
        assert f"| `{folder.parent.name}` |" in README
