"""Equations between dollars as MathML, which browsers show without a script. One that can't be converted ends the build."""

import re

from latex2mathml.converter import convert

# Code first, so that no dollar in it counts.
TOKENS = re.compile(
    r"^(?P<fence>```|~~~).*?^(?P=fence)|(?P<ticks>`+).+?(?P=ticks)|\$\$(?P<block>.+?)\$\$|(?<![\\\w$])\$(?=\S)(?P<inline>[^$]+?)(?<=\S)\$",
    re.S | re.M,
)
PLACE = re.compile(r"xEQUATION(\d+)x")

# By page: the equations that its text has places for.
equations: dict[str, list[str]] = {}


def on_page_markdown(markdown, page, config, files):
    found: list[str] = []

    def place(token: re.Match[str]) -> str:
        tex = token["block"] or token["inline"]
        if tex is None:
            return token[0]
        found.append(mathml(tex, "block" if token["block"] else "inline", page.file.src_uri))
        return f"xEQUATION{len(found) - 1}x"

    markdown = TOKENS.sub(place, markdown)
    equations[page.file.src_uri] = found
    return markdown


def on_page_content(html, page, config, files):
    found = equations[page.file.src_uri]
    html, count = PLACE.subn(lambda place: found[int(place[1])], html)
    if count != len(found):
        raise ValueError(f"{page.file.src_uri}: {len(found)} equations, of which {count} have a place")
    return html


def mathml(tex: str, display: str, place: str) -> str:
    try:
        result = convert(tex.strip(), display=display)
    except Exception as error:
        raise ValueError(f"{place}: no equation: {tex}: {error!r}") from error
    # What the converter doesn't know it hands on as it is.
    if "\\" in result:
        raise ValueError(f"{place}: the converter doesn't know a command in {tex}")
    return result
