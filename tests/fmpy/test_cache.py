"""The cache: whose it must be, and what is damaged in it."""

import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from conftest import PROGRAM, adaptive_fmu

NAME = "StateSpace"
# A user of this system that no test is.
SOMEBODY = 54321


def exported(cache: Path | str, out: Path) -> tuple[bytes, list[str]]:
    """An FMU that is exported with a cache, and the warnings that are about the cache."""
    answer = adaptive_fmu("export", NAME, "--out", out, ADAPTIVE_FMU_CACHE=str(cache))
    assert answer.returncode == 0, answer.stderr
    with zipfile.ZipFile(out / f"{NAME}.fmu") as archive:
        assert archive.testzip() is None
    return (out / f"{NAME}.fmu").read_bytes(), [line for line in answer.stderr.splitlines() if "cache" in line]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The FMU as it is without a cache."""
    return exported("", tmp_path_factory.mktemp("expected"))[0]


@pytest.fixture(scope="module")
def filled(expected: bytes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with what an export leaves."""
    cache = tmp_path_factory.mktemp("filled") / "cache"
    assert exported(cache, cache.parent) == (expected, [])
    assert sorted(file.suffix for file in cache.iterdir()) == [".described", ".zip"]
    return cache


@pytest.mark.parametrize("kind", ["zip", "described"])
@pytest.mark.parametrize("damage", ["zeros", "a bit", "cut", "empty", "another value", "a link", "open to others"])
def test_a_damaged_file_is_made_anew_with_one_warning(
    kind: str, damage: str, filled: Path, expected: bytes, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    shutil.copytree(filled, cache)
    [file] = cache.glob(f"*.{kind}")
    whole = file.read_bytes()
    middle = len(whole) // 2
    if damage == "a link":
        (tmp_path / "elsewhere").write_bytes(whole)
        file.unlink()
        file.symlink_to(tmp_path / "elsewhere")
    elif damage == "open to others":
        file.chmod(0o666)
    else:
        file.write_bytes(
            {
                "zeros": whole[:middle] + bytes(4096) + whole[middle + 4096 :],
                "a bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
                "cut": whole[:middle],
                "empty": b"",
                "another value": whole.replace(b"0", b"1"),
            }[damage]
        )
    fmu, [warning] = exported(cache, tmp_path)
    assert fmu == expected
    assert warning == f"warning: damaged files in the cache were generated again: {file}"
    assert file.read_bytes() == whole and not file.is_symlink() and file.stat().st_mode & 0o077 == 0
    assert exported(cache, tmp_path) == (expected, [])


def test_several_damaged_files_are_reported_in_one_line(filled: Path, expected: bytes, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    shutil.copytree(filled, cache)
    for file in cache.iterdir():
        file.write_bytes(bytes(100))
    fmu, [warning] = exported(cache, tmp_path)
    assert fmu == expected and all(file.name in warning for file in cache.iterdir())


def refused(cache: Path, expected: bytes, out: Path) -> str:
    """Why a cache isn't used. Nothing in it is touched, and what comes out is the same."""
    before = sorted(cache.iterdir()) if cache.is_dir() else []
    fmu, [warning] = exported(cache, out)
    assert fmu == expected and (sorted(cache.iterdir()) if cache.is_dir() else []) == before
    assert warning.startswith("warning: the cache is not used: ") and "ADAPTIVE_FMU_CACHE" in warning
    return warning


def test_a_link_is_no_cache_wherever_it_is_on_the_way(expected: bytes, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "real")
    assert f"{tmp_path}/link is a link" in refused(tmp_path / "link", expected, tmp_path)
    assert f"{tmp_path}/link is a link" in refused(tmp_path / "link" / "cache", expected, tmp_path)
    assert list((tmp_path / "real").iterdir()) == []


def test_a_folder_that_others_may_replace_is_no_cache(expected: bytes, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    for mode in (0o777, 0o775):
        shared.chmod(mode)
        error = refused(shared / "cache", expected, tmp_path)
        assert f"others may write to {shared} (mode {mode:o})" in error and not (shared / "cache").exists()
    # Where nobody renames what is another's, the folder within is safe.
    shared.chmod(0o1777)
    assert exported(shared / "cache", tmp_path) == (expected, [])
    assert (shared / "cache").stat().st_mode & 0o777 == 0o700 and len(list((shared / "cache").iterdir())) == 2


@pytest.mark.parametrize("mode", [0o775, 0o777])
def test_a_folder_of_the_users_own_is_closed_to_others(mode: int, filled: Path, expected: bytes, tmp_path: Path) -> None:
    """As a mask of 002 leaves one, where each user has a group."""
    cache = tmp_path / "cache"
    shutil.copytree(filled, cache)
    cache.chmod(mode)
    assert exported(cache, tmp_path) == (expected, [])
    assert cache.stat().st_mode & 0o7777 == 0o700 and len(list(cache.iterdir())) == 2


@pytest.mark.parametrize("mode", [0o775, 0o1777])
def test_a_folder_for_other_things_keeps_its_rights(mode: int, expected: bytes, tmp_path: Path) -> None:
    """As where the variable names a project, or the folder for temporary files."""
    folder = tmp_path / "project"
    folder.mkdir()
    if mode == 0o775:
        (folder / "notes.txt").touch()
    folder.chmod(mode)
    assert f"others may write to {folder} (mode {mode:o})" in refused(folder, expected, tmp_path)
    assert folder.stat().st_mode & 0o7777 == mode


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives folders and files to another user")
@pytest.mark.parametrize("what", ["the folder", "its parent", "a file"])
def test_nothing_of_another_user_is_read(what: str, filled: Path, expected: bytes, tmp_path: Path) -> None:
    cache = tmp_path / "above" / "cache"
    shutil.copytree(filled, cache)
    if what == "a file":
        [file] = cache.glob("*.zip")
        os.chown(file, SOMEBODY, SOMEBODY)
        fmu, [warning] = exported(cache, tmp_path)
        assert fmu == expected and "generated again" in warning and file.name in warning and file.stat().st_uid == 0
        return
    foreign = cache if what == "the folder" else cache.parent
    os.chown(foreign, SOMEBODY, SOMEBODY)
    assert f"{foreign} belongs to another user ({SOMEBODY})" in refused(cache, expected, tmp_path)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root becomes another user")
def test_another_user_does_not_take_what_is_roots(expected: bytes, filled: Path, tmp_path: Path) -> None:
    """The folders of tests are root's alone: this one lies elsewhere."""
    place = Path("/tmp") / f"cache-of-root-{os.getpid()}"
    place.mkdir(mode=0o755)
    try:
        place.chmod(0o755)
        shutil.copytree(filled, place / "cache")
        (place / "cache").chmod(0o755)
        (place / "out").mkdir()
        os.chown(place / "out", SOMEBODY, SOMEBODY)
        if not os.access(PROGRAM, os.X_OK) or any(not above.stat().st_mode & 0o001 for above in PROGRAM.parents):
            pytest.skip("another user can't start the program where it lies")
        environment = {**os.environ, "ADAPTIVE_FMU_CACHE": str(place / "cache"), "HOME": str(place / "out")}
        words = [PROGRAM, "export", NAME, "--out", place / "out"]
        done = subprocess.run(
            words, env=environment, capture_output=True, text=True, check=False, cwd=place, user=SOMEBODY, group=SOMEBODY
        )
        assert done.returncode == 0 and f"{place}/cache belongs to another user (0)" in done.stderr, done
        assert (place / "out" / f"{NAME}.fmu").read_bytes() == expected
    finally:
        shutil.rmtree(place)
