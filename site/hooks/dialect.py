"""What pages say in the Markdown of FMUs' documentation (CommonMark), in that of the site.

Pages about kinds of systems have no title, since an FMU's page has one already; a list may follow a line of text at once.
"""

import re
from pathlib import Path

FENCE = re.compile(r"^(```|~~~)")
ITEM = re.compile(r"^(?:[-*]|\d+\.) ")
KIND = re.compile(r"^\| `[\w-]+` \| \[(?P<title>.+?)\]\((?P<page>[\w/]+\.md)\) \|", re.M)
# A law's page that an FMU's documentation puts in front of another's.
BEFORE_L1 = "\nThe L1 law:\n"

titles: dict[str, str] = {}


def on_files(files, config):
    """The titles of kinds stand in the page of keys, which follows from the catalogue."""
    page = (Path(config.docs_dir) / "description.md").read_text(encoding="utf-8")
    titles.update((kind["page"], kind["title"]) for kind in KIND.finditer(page))
    return files


def on_page_markdown(markdown, page, config, files):
    place = page.file.src_uri
    if place == "controllers/fuzzy_l1.md":
        markdown = markdown.rstrip("\n") + "\n"
        if not markdown.endswith(BEFORE_L1):
            raise ValueError(f"{place} should end with {BEFORE_L1!r}")
        markdown = markdown.removesuffix(BEFORE_L1) + "\nThe rest of the law: [L1 adaptive controller](l1.md).\n"
    if not markdown.lstrip().startswith("# "):
        markdown = f"# {titles[place]}\n\n{markdown}"
    return lists(markdown)


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
