"""Docstrings of the Python package as Markdown: what is said of parameters as a list, examples as code."""

import re

import griffe

PARAMETER = re.compile(r"^(?P<names>\*{0,2}[a-z_]\w*(?:, \*{0,2}[a-z_]\w*)*): (?P<text>\S.*)$")
PROMPT = ">>> "


class Docstrings(griffe.Extension):
    """Rewrites the docstring of each object that is read."""

    def on_instance(self, *, obj: griffe.Object, **_: object) -> None:
        if obj.docstring is not None:
            obj.docstring.value = markdown(obj.docstring.value)


def markdown(text: str) -> str:
    paragraphs = re.split(r"\n\s*\n", text.strip("\n"))
    return "\n\n".join(paragraph_of(paragraph) for paragraph in paragraphs)


def paragraph_of(text: str) -> str:
    if text.lstrip().startswith(PROMPT):
        return f"```pycon\n{text}\n```"
    lines = text.splitlines()
    if not PARAMETER.match(lines[0]):
        return text
    # A line that doesn't begin with a name goes on with the one before.
    return "\n".join(item(line) for line in lines)


def item(line: str) -> str:
    found = PARAMETER.match(line)
    if found is None:
        return f"    {line.strip()}"
    names = ", ".join(f"`{name}`" for name in found["names"].split(", "))
    return f"- {names}: {found['text']}"
