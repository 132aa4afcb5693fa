"""Texts in the words of the field: none of the others in the README and in the help, and ever fewer elsewhere. Pages are few and short.

tests/words.toml has the words, what is excepted, and the ceilings. `pytest -s` prints the counts, and the files that have most.
"""

import io
import re
import subprocess
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT

WORDS = tomllib.loads((ROOT / "tests" / "words.toml").read_text())
NUMBER = re.compile(r"(?<![\w.\\/{}\])*:%-])\.\d")
# The first line of a doc comment, of an item or a file.
BEGINS = re.compile(r"^(?! *//[/!]).*\n *//[/!] (?:What|Whether|Of)\b|\A//! (?:What|Whether|Of)\b", re.M)
FENCE = re.compile(r"^```.*?^```$|\$\$.*?\$\$|`[^`\n]*`", re.S | re.M)


def expression(*tables: str) -> re.Pattern[str]:
    words = [word for table in tables for word in WORDS[table]]
    return re.compile(rf"\b(?:{'|'.join(words)})\b", re.I)


def without_exceptions(text: str) -> str:
    for phrase in WORDS["exceptions"]:
        text = text.replace(phrase, "")
    return text


def helps() -> Iterator[tuple[str, str]]:
    """The help of each command."""
    asked = [[]]
    while asked:
        words = asked.pop()
        text = subprocess.run([PROGRAM, *words, "--help"], capture_output=True, text=True, check=True).stdout
        yield " ".join(words), text
        # Commands are listed by groups; options begin with a dash, arguments with a bracket.
        names = re.findall(r"^  ([a-z][\w-]*) {2,}[A-Z]", text, re.M)
        asked += [[*words, name] for name in names if name != "help"]


def files(*patterns: str) -> dict[str, str]:
    found = sorted({file for pattern in patterns for file in ROOT.glob(pattern) if "target" not in file.relative_to(ROOT).parts})
    return {file.relative_to(ROOT).as_posix(): file.read_text() for file in found}


SOURCES = files("crates/*/src/**/*.rs", "src/**/*.rs", "plants/**/*.rs")


def comments(text: str) -> str:
    """The comments and the texts of a source, without the code that stands between the braces of a text."""
    found = re.findall(r"//.*$|#.*$|\"(?:[^\"\\]|\\[\s\S])*\"", text, re.M)
    return "\n".join(part if part[0] in "/#" else re.sub(r"\{[\w:.#?$<>^+*,-]*\}", "", part) for part in found)


def python_texts(text: str) -> str:
    """The comments and the texts of a module in Python."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return "\n".join(token.string for token in tokens if token.type in {tokenize.COMMENT, tokenize.STRING})


def places() -> dict[str, dict[str, str]]:
    """What is counted where."""
    pages = {name: FENCE.sub("", text) for name, text in files("docs/**/*.md", "*.md").items() if name != "CHANGELOG.md"}
    rust = {name: comments(text) for name, text in SOURCES.items()}
    python = {name: python_texts(text) for name, text in files("python/**/*.py").items()}
    return {"pages": pages, "Rust": rust, "Python": python}


def test_readme_and_help_have_the_words_of_the_field() -> None:
    wrong = expression("words", "front_words")
    texts = {"README.md": FENCE.sub("", (ROOT / "README.md").read_text()), **dict(helps())}
    assert len(texts) > 20
    met = {}
    for name, text in texts.items():
        for line in without_exceptions(text).splitlines():
            if words := [found[0] for found in (*wrong.finditer(line), *NUMBER.finditer(line))]:
                met[f"{name}: {line.strip()}"] = words
    assert not met, "\n".join(f"{line} {words}" for line, words in met.items())


@cache
def counted() -> dict[str, Counter[str]]:
    wrong = expression("words")
    counts: dict[str, Counter[str]] = {}
    for place, texts in places().items():
        counts[f"words in {place}"] = Counter({name: len(wrong.findall(without_exceptions(text))) for name, text in texts.items()})
        counts[f"numbers in {place}"] = Counter({name: len(NUMBER.findall(text)) for name, text in texts.items()})
    counts["doc comments"] = Counter({name: len(BEGINS.findall(text)) for name, text in SOURCES.items()})
    return counts


@pytest.mark.parametrize("what", WORDS["ceilings"])
def test_elsewhere_they_get_fewer(what: str) -> None:
    assert set(counted()) == set(WORDS["ceilings"])
    counts, most = counted()[what], WORDS["ceilings"][what]
    message = f"{what}: {sum(counts.values())}, at most {most}; most of them in {counts.most_common(5)}"
    print(message)
    assert sum(counts.values()) <= most, message


def test_exceptions_are_few_and_have_reasons() -> None:
    assert len(WORDS["exceptions"]) <= 30 and all(WORDS["exceptions"].values())


# Pages of the site: how many there may be, their words together and in one of them. Those of kinds are counted apart.
MOST_PAGES, MOST_WORDS, LONGEST_PAGE, LONGEST_KIND = 40, 35_000, 1500, 700
KIND = re.compile(r"(controllers|plants)/|composite\.md$")
CODE = re.compile(r"^```.*?^```$|\$\$.*?\$\$", re.S | re.M)


def test_pages_are_few_and_short() -> None:
    """Words of tables count, those of code and displayed equations don't. The navigation has generated pages, too."""
    listed = re.findall(r": ([\w/]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M)
    words = {name.removeprefix("docs/"): len(CODE.sub("", text).split()) for name, text in files("docs/**/*.md").items()}
    assert len(words) > 60
    kinds = {name: count for name, count in words.items() if KIND.match(name)}
    others = {name: count for name, count in words.items() if name not in kinds}
    pages = {*others, *(name for name in listed if not KIND.match(name))}
    print(f"{len(pages)} pages of {sum(others.values())} words, {len(kinds)} pages of kinds")
    assert len(pages) <= MOST_PAGES, sorted(pages)
    assert sum(others.values()) <= MOST_WORDS, Counter(others).most_common(10)
    assert not {name: count for name, count in others.items() if count > LONGEST_PAGE}
    assert not {name: count for name, count in kinds.items() if count > LONGEST_KIND}
