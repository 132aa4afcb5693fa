"""Loops to try in the browser: pages that hold this package's library, compiled to WebAssembly, and need no server."""

import logging
import os
import subprocess
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
log = logging.getLogger("mkdocs.hooks.live")


def library(root: Path) -> Path:
    return Path(os.environ.get(LIBRARY) or root / "target" / "wasm32-unknown-unknown" / "release" / "adaptive_fmu.wasm")


def on_files(files, config):
    root = Path(config.config_file_path).parent
    if not library(root).is_file():
        log.info("no loops to try in the browser: %s isn't there (CONTRIBUTING.md, Documentation)", library(root))
        return files
    program = Path(os.environ.get("ADAPTIVE_FMU_PROGRAM") or root / "target" / "release" / "adaptive-fmu")
    folder = root / "target" / "live"
    for loop in LOOPS:
        command = [program, "explore", loop, "--page", library(root), "--out", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if "other sources" in done.stderr:
            log.info("no loops to try in the browser: %s is of other sources than the program: build it anew", library(root))
            return files
        if done.returncode:
            raise PluginError(f"the page of {loop} can't be made: {done.stderr}")
    written = [folder / f"{loop}.html" for loop in LOOPS] + sorted([*folder.glob("*.js"), *folder.glob("*.css")])
    for file in written:
        files.append(File.generated(config, f"{FOLDER}/{file.name}", abs_src_path=str(file.resolve())))
    return files


def on_page_markdown(markdown, page, config, files):
    """The page about `explore` leads to the loops, where they are there."""
    there = [loop for loop in LOOPS if files.get_file_from_path(f"{FOLDER}/{loop}.html")]
    if page.file.src_uri != "explore.md" or not there:
        return markdown
    links = "\n".join(f"- [{loop}]({FOLDER}/{loop}.html): {LOOPS[loop]}" for loop in there)
    told = "These pages hold the library itself (WebAssembly): they need no program and no server, and run in your browser."
    return f"{markdown}\n## Loops to try here\n\n{told}\n\n{links}\n"
