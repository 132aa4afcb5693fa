"""Pages to try in the browser, of loops and from a plant to an FMU: they hold this package's library, compiled to WebAssembly, and need
no server."""

import base64
import json
import logging
import os
import subprocess
import tomllib
from pathlib import Path

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

LOOPS = {
    "3.2.1-cosine": "an L1 controller of a nonlinear plant whose gain and disturbance are unknown",
    "3.3.1-case2": "an L1 controller of a two-link robot",
    "4-case1-fuzzy": "an L1 controller whose gain a fuzzy system chooses",
    "6.5.1-l1": "an L1 controller of a coupled plant",
    "6.5.1-mrac": "robust MRAC that keeps the same plant's errors in a funnel",
}
# What the program compiles to for browsers (CONTRIBUTING.md has the command), or another of the same sources.
LIBRARY = "ADAPTIVE_FMU_WASM"
FOLDER = "live"
# The page from a plant to an FMU, and the pages of the kinds that it designs.
PLAYGROUND = "try"
KINDS = {"controllers/pid.md": "pid", "controllers/ladrc.md": "ladrc", "controllers/l1.md": "l1", "controllers/l1_sampled.md": "l1-sampled"}
log = logging.getLogger("mkdocs.hooks.live")


def library(root: Path) -> Path:
    return Path(os.environ.get(LIBRARY) or root / "target" / "wasm32-unknown-unknown" / "browser" / "adaptive_fmu.wasm")


def page_of(design: dict) -> str:
    """The address of the design page with a design, of which it reads what differs from its start."""
    text = base64.urlsafe_b64encode(json.dumps(design, separators=(",", ":")).encode()).decode().rstrip("=")
    return f"{PLAYGROUND}/index.html#j{text}"


def written(program: Path, *arguments: str | Path) -> bool:
    """Writes pages; false where the library is of other sources than the program."""
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    if done.returncode and "other sources" not in done.stderr:
        raise PluginError(f"a page for browsers can't be made: {done.stderr}")
    return done.returncode == 0


def on_files(files, config):
    root = Path(config.config_file_path).parent
    if not library(root).is_file():
        log.info("no loops to try in the browser: %s isn't there (CONTRIBUTING.md, Documentation)", library(root))
        return files
    program = Path(os.environ.get("ADAPTIVE_FMU_PROGRAM") or root / "target" / "release" / "adaptive-fmu")
    folders = {FOLDER: root / "target" / "live", PLAYGROUND: root / "target" / "try"}
    commands = [("explore", loop, "--page", library(root), "--out", folders[FOLDER]) for loop in LOOPS]
    commands += [("playground", "--wasm", library(root), "--out", folders[PLAYGROUND])]
    if not all(written(program, *command) for command in commands):
        log.info("no loops to try in the browser: %s is of other sources than the program: build it anew", library(root))
        return files
    for name, folder in folders.items():
        for file in sorted(file for file in folder.iterdir() if file.suffix in {".html", ".js", ".css"}):
            files.append(File.generated(config, f"{name}/{file.name}", abs_src_path=str(file.resolve())))
    return files


def on_page_markdown(markdown, page, config, files):
    """The page about `explore` leads to the loops, that about `playground` and those of its controllers to it, where they are there."""
    name = page.file.src_uri
    there = [loop for loop in LOOPS if files.get_file_from_path(f"{FOLDER}/{loop}.html")]
    if name == "explore.md" and there:
        links = "\n".join(f"- [{loop}]({FOLDER}/{loop}.html): {LOOPS[loop]}" for loop in there)
        note = "These pages hold the library itself (WebAssembly): they need no program and no server, and run in your browser."
        return f"{markdown}\n## Loops to try here\n\n{note}\n\n{links}\n"
    if not files.get_file_from_path(f"{PLAYGROUND}/index.html"):
        return markdown
    if name == "playground.md":
        plants = tomllib.loads((Path(config.config_file_path).parent / "examples" / "zoo" / "plants.toml").read_text())
        links = ", ".join(f"[{plant}]({page_of({'form': 'example', 'source': {'example': plant}})})" for plant in plants)
        return f"{markdown}\n## Try it here\n\n[The page]({PLAYGROUND}/index.html), also with one of the example plants: {links}.\n"
    kind = KINDS.get(name)
    return markdown if kind is None else f"{markdown}\n[Design one in the browser](../{page_of({'kind': kind})})\n"
