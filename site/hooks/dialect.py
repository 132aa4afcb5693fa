"""What pages say in the Markdown of FMUs' documentation (CommonMark), in that of the site.

Pages about kinds of systems have no title, since an FMU's page has one already, and their purpose, parameters and limits are in
front matter; a list may follow a line of text immediately.
"""

import re
from pathlib import Path

FENCE = re.compile(r"^(```|~~~)")
ITEM = re.compile(r"^(?:[-*]|\d+\.) ")
KIND = re.compile(r"^\| `[\w-]+` \| \[(?P<title>.+?)\]\((?P<page>[\w/]+\.md)\) \|", re.M)
# The end of a page that an FMU's documentation puts in front of another's.
BEFORE_L1 = "\nThe L1 controller:\n"
# A parameter in front matter, with its text.
GAIN = re.compile(r"^(\w+): ", re.M)
SOURCE = re.compile(r"^Sources?: ", re.M)

titles: dict[str, str] = {}


def on_files(files, config):
    """The titles of kinds stand in the page of keys, which follows from the catalogue."""
    page = (Path(config.docs_dir) / "description.md").read_text(encoding="utf-8")
    titles.update((kind["page"], kind["title"]) for kind in KIND.finditer(page))
    return files


def on_page_markdown(markdown, page, config, files):
    place = page.file.src_uri
    if page.meta.get("followed by") == "controllers/l1":
        markdown = markdown.rstrip("\n") + "\n"
        if not markdown.endswith(BEFORE_L1):
            raise ValueError(f"{place} should end with {BEFORE_L1!r}")
        markdown = markdown.removesuffix(BEFORE_L1) + "\nThe rest of the control law: [L1 adaptive controller](l1.md).\n"
    if "purpose" in page.meta:
        markdown = guided(markdown, page.meta)
    if not markdown.lstrip().startswith("# "):
        markdown = f"# {titles[place]}\n\n{markdown}"
    return lists(markdown)


def guided(markdown: str, meta: dict[str, str]) -> str:
    """A kind's page with its purpose in front, and its parameters and limits before its source."""
    gains = GAIN.sub(r"- `\1`: ", meta["gains"])
    guide = f"**Main parameters.**\n\n{gains}\n\n**What to observe.**\n\n{meta['limits']}\n\n"
    source = SOURCE.search(markdown)
    at = source.start() if source else len(markdown)
    return f"{meta['purpose']}\n\n{markdown[:at]}\n{guide}{markdown[at:]}"


def lists(markdown: str) -> str:
    """An empty line before each list, and none of the comments that mark generated tables."""
    lines: list[str] = []
    fenced = False
    for line in markdown.splitlines():
        if FENCE.match(line.lstrip()):
            fenced = not fenced
        if not fenced and line.startswith("<!--") and line.endswith("-->"):
            continue
        before = lines[-1] if lines else ""
        text = before.strip() and not ITEM.match(before) and not before.startswith(" ")
        if not fenced and ITEM.match(line) and text:
            lines.append("")
        lines.append(line)
    return "\n".join(lines) + "\n"
