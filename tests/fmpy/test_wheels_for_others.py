"""Wheels for machines that aren't this one: for Linux with glibc 2.17, and for Windows, tried under Wine.

What they are made of, `tests/platforms/build` leaves in `target`, where it has the tools.
"""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pandas as pd
import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu

OLD_LINUX, WINDOWS = "x86_64-unknown-linux-gnu", "x86_64-pc-windows-gnu"
BUILT = {OLD_LINUX: ROOT / "target" / "old_linux", WINDOWS: ROOT / "target" / "windows"}
OLDEST_GLIBC = (2, 17)
WINE = next((wine for wine in map(shutil.which, ("wine64", "wine", "/usr/lib/wine/wine64")) if wine), None)
UNITS = ["NonlinearSiso", "ReferenceNonlinearSiso", "L1NonlinearSiso"]
pytestmark = pytest.mark.xdist_group("wheels for others")


def ran(*command: str | Path, **options) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What `dist --wheels` makes where cargo left programs for other targets beside this one: wheels by their platforms."""
    built = {target: folder / target / "platforms" for target, folder in BUILT.items()}
    missing = [target for target, folder in built.items() if not list(folder.glob("adaptive-fmu*"))]
    if missing:
        pytest.skip(f"no program was built for {', '.join(missing)} (tests/platforms/build)")
    folder = tmp_path_factory.mktemp("built")
    (folder / "release").mkdir()
    shutil.copy(PROGRAM, folder / "release")
    for target, place in built.items():
        (folder / target).mkdir()
        (folder / target / "release").symlink_to(place)
    out = folder / "wheels"
    answer = ran(folder / "release" / PROGRAM.name, "dist", "--wheels", "--out", out, cwd=ROOT)
    stale = "what was built for other platforms is of other sources: call tests/platforms/build again"
    assert "other sources" not in answer.stderr, stale
    return {wheel.stem.split("-")[-1]: wheel for wheel in out.iterdir()}


def test_a_machine_that_built_for_windows_and_an_old_linux_makes_a_wheel_for_each(wheels: dict[str, Path]) -> None:
    assert set(wheels) == {"manylinux_2_17_x86_64", "win_amd64"}
    for wheel in wheels.values():
        with zipfile.ZipFile(wheel) as archive:
            names = set(archive.namelist())
        shared = next(name for name in names if name.endswith("share/adaptive-fmu/README.md")).removesuffix("README.md")
        libraries = {f"{shared}libraries/linux64/libadaptive_fmu_library.so", f"{shared}libraries/win64/adaptive_fmu_library.dll"}
        assert libraries <= names, "every wheel exports for all platforms"


@pytest.fixture(scope="module")
def on_linux(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """The loop by the program of this machine."""
    return pd.read_csv(looped([PROGRAM], tmp_path_factory.mktemp("linux"), dict(os.environ)))


def looped(program: list[Path | str], folder: Path, environment: dict[str, str]) -> Path:
    """Exports three units and closes their loop for a second."""
    ran(*program, "export", *UNITS, "--out", "units", cwd=folder, env=environment)
    ran(*program, "run", "3.2.1-cosine", "--until", "1", "--fmus", "units", "--out", "results", cwd=folder, env=environment)
    return folder / "results" / "3.2.1-cosine" / "result.csv"


def test_the_wheel_for_an_old_linux_asks_for_glibc_2_17_and_works(
    wheels: dict[str, Path], on_linux: pd.DataFrame, tmp_path: Path
) -> None:
    ran(sys.executable, "-m", "venv", tmp_path / "venv")
    programs = tmp_path / "venv" / "bin"
    # numpy and pandas belong to the Python package, which other tests try.
    ran(programs / "python", "-m", "pip", "install", "--quiet", "--no-deps", wheels["manylinux_2_17_x86_64"])
    program, library = programs / "adaptive-fmu", "share/adaptive-fmu/libraries/linux64/libadaptive_fmu_library.so"
    for file in (program, tmp_path / "venv" / library):
        versions = re.findall(r"GLIBC_([0-9.]+)", ran("readelf", "--version-info", file).stdout)
        assert versions and max(tuple(map(int, version.split("."))) for version in versions) <= OLDEST_GLIBC, file
    result = looped([program], tmp_path, {"PATH": str(programs), "HOME": str(tmp_path)})
    pd.testing.assert_frame_equal(pd.read_csv(result), on_linux, rtol=0, atol=1e-9)


@pytest.fixture(scope="module")
def on_windows(wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A command that runs what pip unpacks for Windows, under Wine."""
    if not WINE or not shutil.which("x86_64-w64-mingw32-gcc"):
        pytest.skip("there is no Wine, or no mingw-w64 (tests/windows/run --install)")
    folder = tmp_path_factory.mktemp("windows")
    asked = ["--platform", "win_amd64", "--only-binary=:all:", "--no-deps", "--target", folder / "packages"]
    ran(sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *asked, wheels["win_amd64"])
    program = folder / "packages" / "bin" / "adaptive-fmu.exe"
    # Rust asks Windows for random numbers by a library that old versions of Wine lack.
    random = [ROOT / "tests" / "windows" / "prng.c", "-ladvapi32", "-o", program.with_name("bcryptprimitives.dll")]
    ran("x86_64-w64-mingw32-gcc", "-shared", *random)
    command = folder / "adaptive-fmu"
    settings = f'export WINEDEBUG=-all WINEPREFIX="{folder / "wine"}"'
    command.write_text(f'#!/bin/sh\n{settings}\nexec "{WINE}" "{program}" "$@"\n')
    command.chmod(0o755)
    return command


def test_the_program_of_the_wheel_for_windows_exports_and_closes_a_loop(
    on_windows: Path, on_linux: pd.DataFrame, tmp_path: Path
) -> None:
    result = looped([on_windows], tmp_path, dict(os.environ))
    pd.testing.assert_frame_equal(pd.read_csv(result), on_linux, rtol=0, atol=1e-9)
    validated = adaptive_fmu("validate", tmp_path / "units" / "L1NonlinearSiso.fmu")
    assert validated.returncode == 0, validated.stdout + validated.stderr
    with zipfile.ZipFile(tmp_path / "units" / "L1NonlinearSiso.fmu") as archive:
        binaries = {name for name in archive.namelist() if name.startswith("binaries/") and not name.endswith("/")}
    assert binaries == {"binaries/linux64/L1NonlinearSiso.so", "binaries/win64/L1NonlinearSiso.dll"}


def test_the_python_package_talks_to_the_program_for_windows(on_windows: Path, on_linux: pd.DataFrame, tmp_path: Path) -> None:
    asked = """
import adaptive_fmu
loop = adaptive_fmu.Loop("3.2.1-cosine")
loop.run(until=1).data.to_csv("result.csv")
try:
    loop.run(until=1, controller={"adaptation_gain": -1})
except adaptive_fmu.Error as error:
    print(error)
"""
    environment = {**os.environ, "ADAPTIVE_FMU_PROGRAM": str(on_windows), "PYTHONPATH": str(ROOT / "python")}
    output = ran(sys.executable, "-c", asked, cwd=tmp_path, env=environment).stdout
    assert "controller.adaptation_gain" in output and "-1" in output and "at least 0" in output
    # Flags are numbers there.
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "result.csv"), on_linux, rtol=0, atol=1e-9, check_dtype=False)
