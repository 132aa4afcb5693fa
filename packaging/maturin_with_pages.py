"""Builds the Python package as maturin does, and adds what shells read: the manual pages and completions of the program in it."""

import base64
import hashlib
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import maturin
from maturin import (  # noqa: F401  the other steps of a build are maturin's
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

# Where shells look for completions below `share`, as in the wheels of `dist`.
COMPLETIONS = {
    "bash": "bash-completion/completions/adaptive-fmu",
    "zsh": "zsh/site-functions/_adaptive-fmu",
    "fish": "fish/vendor_completions.d/adaptive-fmu.fish",
}


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    name = maturin.build_wheel(wheel_directory, config_settings, metadata_directory)
    add_pages(Path(wheel_directory) / name)
    return name


def add_pages(wheel):
    with zipfile.ZipFile(wheel) as archive:
        entries = {entry: archive.read(entry) for entry in archive.infolist()}
    with tempfile.TemporaryDirectory(dir=wheel.parent) as folder:
        (script,) = (entry for entry in entries if ".data/scripts/" in entry.filename)
        program = Path(folder) / Path(script.filename).name
        program.write_bytes(entries[script])
        program.chmod(0o755)
        share = f"{script.filename.split('/')[0]}/data/share"
        try:
            pages = {f"{share}/{place}": text for place, text in shell_files(program)}
        except (OSError, subprocess.SubprocessError) as error:
            # A program for another platform.
            print(f"warning: no manual pages and completions, which the program writes ({error})", file=sys.stderr)
            return
        record = next(entry for entry in entries if entry.filename.endswith(".dist-info/RECORD"))
        entries[record] += "".join(map(recorded, pages, pages.values())).encode()
        with zipfile.ZipFile(program.with_name(wheel.name), "w", zipfile.ZIP_DEFLATED) as written:
            # The record last, as maturin has it.
            for entry, content in [*((file(place), text) for place, text in pages.items()), *entries.items()]:
                written.writestr(entry, content)
        program.with_name(wheel.name).replace(wheel)


def file(place):
    """An entry that everybody may read."""
    entry = zipfile.ZipInfo(place)
    entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o100644 << 16
    return entry


def shell_files(program):
    """Manual pages and completions: places below `share`, and texts."""
    pages = program.parent / "man1"
    subprocess.run([program, "manual", "--out", pages], stdout=subprocess.DEVNULL, check=True)
    yield from ((f"man/man1/{page.name}", page.read_bytes()) for page in sorted(pages.iterdir()))
    for shell, place in COMPLETIONS.items():
        yield place, subprocess.run([program, "completions", shell], stdout=subprocess.PIPE, check=True).stdout


def recorded(place, content):
    digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
    return f"{place},sha256={digest},{len(content)}\n"
