"""A unit within the process moves it: where files come from and go to was settled when the command began."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from conftest import adaptive_fmu
from master import PLANT

MOVES = """
#include <sys/stat.h>
#include <unistd.h>
#define fmi2Instantiate own_fmi2Instantiate
#define fmi2DoStep own_fmi2DoStep
#include "all.c"
#undef fmi2Instantiate
#undef fmi2DoStep

__attribute__((constructor)) static void moves(void) {
    if (chdir("/") == 0) { umask(0777); }
}

FMI2_Export fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                          const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    moves();
    return own_fmi2Instantiate(name, type, guid, resources, functions, visible, logging);
}

FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real step, fmi2Boolean no_set_prior) {
    moves();
    return own_fmi2DoStep(c, point, step, no_set_prior);
}
"""


@pytest.mark.skipif(shutil.which("gcc") is None or not sys.platform.startswith("linux"), reason="a library is made for this system")
@pytest.mark.parametrize("command", ["simulate", "run"])
def test_files_go_where_the_user_named_though_a_unit_moves_the_process(command: str, tmp_path: Path) -> None:
    """A unit within the process changes the working folder, and the mask by which files are made: when it is loaded, made,
    and at every step."""
    exported = adaptive_fmu("export", "--source-only", PLANT, "--out", tmp_path / "sources")
    assert exported.returncode == 0, exported
    unpacked = tmp_path / "unpacked"
    zipfile.ZipFile(tmp_path / "sources" / f"{PLANT}.fmu").extractall(unpacked)
    (unpacked / "sources" / "moves.c").write_text(MOVES)
    library = unpacked / "binaries" / "linux64" / f"{PLANT}.so"
    library.parent.mkdir(parents=True, exist_ok=True)
    source = unpacked / "sources" / "moves.c"
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", source, "-lm", "-o", library], check=True)
    shutil.make_archive(str(tmp_path / "moving"), "zip", unpacked)
    (tmp_path / "fmus").mkdir()
    (tmp_path / "moving.zip").rename(tmp_path / "fmus" / f"{PLANT}.fmu")
    others = adaptive_fmu("export", "L1NonlinearSiso", "ReferenceNonlinearSiso", "--out", tmp_path / "fmus")
    assert others.returncode == 0, others
    words = {
        "simulate": ["simulate", f"fmus/{PLANT}.fmu", "--in-process"],
        "run": ["run", "3.2.1-cosine", "--fmus", "fmus", "--in-process", "--parquet"],
    }[command]
    answer = adaptive_fmu(*words, "--until", "0.1", "--out", "a/b", folder=tmp_path)
    assert answer.returncode in (0, 3), answer
    (folder,) = (tmp_path / "a" / "b").iterdir()
    mask = os.umask(0)
    os.umask(mask)
    assert folder.stat().st_mode & 0o777 == 0o777 & ~mask
    assert {"index.html", "metrics.json", "plot.svg", "result.csv"} <= {file.name for file in folder.iterdir()}
    assert {file.stat().st_mode & 0o777 for file in folder.iterdir()} == {0o666 & ~mask}
