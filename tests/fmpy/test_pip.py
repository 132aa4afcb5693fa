"""What pip builds of the source folder, as README says: by the newest maturin that pyproject.toml allows, and by the newest
of all."""

import os
import re
import subprocess
import tarfile
import venv
import warnings
import zipfile
from pathlib import Path

import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu
from test_wheel import contents

# Where maturin has cargo build, which the tests did before.
BUILT = ROOT / "target" / "release" / "adaptive-fmu"
pytestmark = pytest.mark.skipif(
    not BUILT.is_file() or PROGRAM not in (BUILT, BUILT.resolve()), reason="another build than the release is tested"
)


def ran(python: Path, *words: str | Path, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """A module of a fresh Python, without what the tests tell theirs."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "ADAPTIVE_FMU_PROGRAM")}
    environment["PATH"] = f"{python.parent}{os.pathsep}{environment['PATH']}"
    return subprocess.run([python, "-m", *words], cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pip")
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    if ran(python, "pip", "install", "--quiet", "--upgrade", "maturin").returncode != 0:
        pytest.skip("no registry of packages answers")
    return python


@pytest.fixture(scope="module")
def wheel(python: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    built = ran(python, "pip", "wheel", ".", "--no-deps", "--wheel-dir", folder)
    assert built.returncode == 0, built.stdout
    (wheel,) = folder.iterdir()
    return wheel


def test_pip_builds_the_source_folder_and_the_package_works(wheel: Path, python: Path) -> None:
    installed = ran(python, "pip", "install", "--no-deps", "--quiet", wheel)
    assert installed.returncode == 0, installed.stderr
    program = python.with_name("adaptive-fmu")
    words = [program, "run", "3.2.1-cosine", "--until", "1"]
    done = subprocess.run(words, cwd=wheel.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    # Where `man` and shells look in an environment.
    share = python.parents[1] / "share"
    assert ".TH adaptive-fmu" in (share / "man" / "man1" / "adaptive-fmu.1").read_text()
    assert (share / "bash-completion" / "completions" / "adaptive-fmu").is_file()


def test_a_wheel_of_pip_holds_the_modules_and_what_shells_read_as_one_of_dist(wheel: Path, tmp_path: Path) -> None:
    made = adaptive_fmu("dist", "--wheels", "--out", tmp_path)
    assert made.returncode == 0, made.stderr
    of_pip, of_dist = contents(wheel), contents(Path(made.stdout.splitlines()[0]))
    version = wheel.name.split("-")[1]
    kinds = ("adaptive_fmu/", f"adaptive_fmu-{version}.data/data/share/")
    common = lambda files: {
        place: text for place, text in files.items() if place.startswith(kinds) and "/share/adaptive-fmu/" not in place
    }
    assert common(of_pip) == common(of_dist)
    assert sum("/man/man1/" in place for place in common(of_pip)) > 20
    with zipfile.ZipFile(wheel) as archive:
        modes = {entry.filename.split("/")[-1]: entry.external_attr >> 16 for entry in archive.infolist()}
    assert modes["adaptive-fmu"] & 0o111 and modes["adaptive-fmu.1"] & 0o777 == 0o644


def test_an_archive_of_sources_holds_what_builds_it(python: Path, tmp_path: Path) -> None:
    made = ran(python, "maturin", "sdist", "--out", tmp_path)
    assert made.returncode == 0, made.stderr
    (archive,) = tmp_path.iterdir()
    with tarfile.open(archive) as sources:
        names = {name.partition("/")[2] for name in sources.getnames()}
    assert {"pyproject.toml", "packaging/maturin_with_pages.py", "python/adaptive_fmu/__init__.py"} <= names


def test_the_newest_maturin_of_all_builds_it_too(python: Path, tmp_path: Path) -> None:
    """One that is newer than the bound may fail: then the bound is right, and somebody is to look at it."""
    output = ran(python, "maturin", "--version").stdout.strip()
    (bound,) = re.findall(r'"maturin>=[\d.]+,<([\d.]+)"', (ROOT / "pyproject.toml").read_text())
    number = lambda text: [int(part) for part in re.findall(r"\d+", text)]
    built = ran(python, "pip", "wheel", ".", "--no-deps", "--no-build-isolation", "--wheel-dir", tmp_path)
    if number(output) < number(bound):
        assert built.returncode == 0, built.stdout
    elif built.returncode != 0:
        warnings.warn(f"{output} doesn't build the package: {built.stdout[-1000:]}", stacklevel=1)
