"""The wheel that pip installs: what it holds, and what a person without Rust, a C compiler or the repository does with it."""

import base64
import csv
import hashlib
import os
import subprocess
import sys
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest
from conftest import FMU_NAMES, LOOP_NAMES, ROOT, adaptive_fmu


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = adaptive_fmu("dist", "--wheels", "--out", tmp_path_factory.mktemp("wheels"))
    assert made.returncode == 0, made.stderr
    return Path(made.stdout.splitlines()[0])


def contents(wheel: Path) -> dict[str, bytes]:
    """The files of a wheel, which are those of its record."""
    name, version, *_ = wheel.stem.split("-")
    with zipfile.ZipFile(wheel) as archive:
        held = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    own = f"{name}-{version}.dist-info/RECORD"
    record = list(csv.reader(held[own].decode().splitlines()))
    assert {path for path, *_ in record} == set(held) and [own, "", ""] in record
    for path, checksum, size in record:
        if path != own:
            digest = base64.urlsafe_b64encode(hashlib.sha256(held[path]).digest()).rstrip(b"=").decode()
            assert checksum == f"sha256={digest}" and int(size) == len(held[path])
    return held


def test_a_wheel_holds_what_a_program_needs(wheel: Path) -> None:
    files = contents(wheel)
    name, version, *_ = wheel.stem.split("-")
    data = f"{name}-{version}.data"
    with zipfile.ZipFile(wheel) as archive:
        modes = {entry.filename: entry.external_attr >> 16 for entry in archive.infolist()}
    assert modes[f"{data}/scripts/adaptive-fmu"] & 0o111
    shared = f"{data}/data/share/adaptive-fmu"
    assert {f"{shared}/modelDescription/{fmu}.toml" for fmu in FMU_NAMES} <= set(files)
    assert {f"{shared}/examples/{loop}/SystemStructure.ssd" for loop in LOOP_NAMES} <= set(files)
    assert f"{shared}/README.md" in files and f"{shared}/libraries/linux64/libadaptive_fmu_library.so" in files
    # Where shells look for them in an environment.
    pages = {"man/man1/adaptive-fmu.1", "man/man1/adaptive-fmu-run.1", "bash-completion/completions/adaptive-fmu"}
    pages |= {"zsh/site-functions/_adaptive-fmu", "fish/vendor_completions.d/adaptive-fmu.fish"}
    assert {f"{data}/data/share/{page}" for page in pages} <= set(files)
    modules = {f"adaptive_fmu/{file.name}" for file in (ROOT / "python" / "adaptive_fmu").glob("*.py")}
    assert modules | {"adaptive_fmu/py.typed"} <= set(files)


def test_the_metadata_of_a_wheel_is_that_of_pyproject(wheel: Path) -> None:
    """As pip reads it; what it is built from by `pip install .` is the same file."""
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    with zipfile.ZipFile(wheel) as archive:
        text = next(archive.read(entry) for entry in archive.namelist() if entry.endswith("/METADATA"))
    metadata = Parser().parsestr(text.decode())
    assert metadata["Name"] == project["name"] and metadata["Version"] == version
    assert metadata["Requires-Python"] == project["requires-python"] and metadata["Summary"] == project["description"]
    assert metadata.get_all("Provides-Extra") is not None
    assert set(metadata.get_all("Provides-Extra")) == set(project["optional-dependencies"])
    needed = metadata.get_all("Requires-Dist")
    assert set(project["dependencies"]) <= set(needed)
    for extra, packages in project["optional-dependencies"].items():
        assert {f"{package} ; extra == '{extra}'" for package in packages} <= set(needed)
    assert metadata.get_payload() == (ROOT / "README.md").read_text()


@pytest.fixture(scope="module")
def fresh(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A fresh virtual environment with the wheel, and an empty PATH but for it."""
    folder = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
    python = folder / "venv" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"{wheel}[plot,notebook,compile]"]
    done = subprocess.run(install, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    # What zig makes once for each platform takes minutes.
    variables = {"ZIG_GLOBAL_CACHE_DIR": os.environ.get("ZIG_GLOBAL_CACHE_DIR", str(Path.home() / ".cache" / "zig"))}
    return {**variables, "PATH": str(python.parent), "HOME": str(folder), "TMPDIR": str(tmp_path_factory.mktemp("tmp"))}


@pytest.mark.slow
def test_from_a_fresh_environment_to_a_loop_a_plot_a_gain_and_an_fmu_for_six_platforms(
    fresh: dict[str, str], tmp_path: Path
) -> None:
    python = Path(fresh["PATH"]) / "python"
    script = ROOT / "tests" / "fmpy" / "from_nothing.py"
    done = subprocess.run([python, script, tmp_path], env=fresh, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "all metrics within their limits" in done.stdout and "tuned: controller.feedback_gain[1,1]" in done.stdout
    assert (tmp_path / "loop.png").read_bytes().startswith(b"\x89PNG")
    with zipfile.ZipFile(tmp_path / "L1NonlinearSiso.fmu") as archive:
        names = set(archive.namelist())
    platforms = {name.split("/")[1] for name in names if name.startswith("binaries/")}
    assert {"linux64", "linux32", "aarch64-linux", "win64", "darwin64", "aarch64-darwin"} <= platforms
    assert list(Path(fresh["TMPDIR"]).iterdir()) == []


@pytest.mark.slow
def test_the_extra_for_notebooks_brings_what_bars_are_drawn_by(fresh: dict[str, str], tmp_path: Path) -> None:
    """Without ipywidgets tqdm refuses, and `tqdm.auto` warns in each notebook."""
    script = "from tqdm.notebook import tqdm; tqdm(total=1).update(1)"
    words = [Path(fresh["PATH"]) / "python", "-c", script]
    done = subprocess.run(words, env=fresh, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_program_of_a_wheel_exports_every_fmu_and_closes_a_loop(fresh: dict[str, str], tmp_path: Path) -> None:
    words = ["adaptive-fmu", "export", "--run", "3.2.1-cosine"]
    program = Path(fresh["PATH"]) / words[0]
    done = subprocess.run([program, *words[1:]], env=fresh, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {file.stem for file in (tmp_path / "fmus").glob("*.fmu")} == set(FMU_NAMES)
    assert (tmp_path / "results" / "3.2.1-cosine" / "result.csv").is_file()


def test_a_program_alone_exports(tmp_path: Path, fresh: dict[str, str]) -> None:
    """As `cargo install` leaves it: one file, in a folder of its own. Without a cache, too."""
    program = tmp_path / "bin" / "adaptive-fmu"
    program.parent.mkdir()
    program.write_bytes((Path(fresh["PATH"]) / "adaptive-fmu").read_bytes())
    program.chmod(0o755)
    for cache in ("", str(tmp_path / "cache")):
        out = tmp_path / f"fmus{len(cache)}"
        environment = {**fresh, "ADAPTIVE_FMU_CACHE": cache}
        for words in (["export", "NonlinearSiso", "--out", out], ["run", "3.2.1-cosine", "--until", "1", "--out", out]):
            done = subprocess.run([program, *words], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
        assert (out / "NonlinearSiso.fmu").is_file()
    assert list((tmp_path / "cache").glob("*.library")) and list(Path(fresh["TMPDIR"]).iterdir()) == []
