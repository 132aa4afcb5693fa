"""The programs that are compared, and a folder for what they leave behind."""

import ctypes
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "target" / "release" / "adaptive-fmu"
MY_PLANT = Path(os.environ["MY_PLANT"])
# Of Linux: from now on, memory that was written doesn't become code. The program evaluates equations as they are then.
PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN = 65, 1
# The master on FMPy, and loops as it takes them.
sys.path.append(str(ROOT / "tests" / "fmpy"))


@dataclass
class Workshop:
    """Where files go, and how long runs are."""

    folder: Path
    quick: bool

    def __post_init__(self) -> None:
        self.fmus = self.folder / "fmus"
        # Nothing that was cached before counts, and nothing stays.
        os.environ["ADAPTIVE_FMU_CACHE"] = str(self.folder / "cache")
        program("export", "--all", "--out", self.fmus)

    @property
    def repeats(self) -> int:
        """How often each figure is measured."""
        return 1 if self.quick else 5

    @property
    def stop(self) -> float:
        """When loops end, s."""
        return 0.5 if self.quick else 20.0

    def long(self, count: int) -> int:
        """So many steps, or fewer in a quick run."""
        return max(1, count // 100) if self.quick else count

    def compile(self, source: str, *options: str, shared: bool = False, others: Sequence[str] = ()) -> Path:
        """A program, or a library, from a file in C beside this folder, and others."""
        words = "".join(word for word in options if word.startswith("-D"))
        target = self.folder / f"{Path(source).stem}{words}{'.so' if shared else ''}"
        kind = ["-shared", "-fPIC"] if shared else []
        files = [ROOT / "benches" / file for file in (source, *others)]
        subprocess.run(["cc", "-O3", *kind, "-o", target, *files, *options], check=True)
        return target

    def export(self, file: Path, *options: str | Path) -> Path:
        """The FMU of a description."""
        program("export", file, *options, "--out", self.fmus)
        return self.fmus / f"{file.stem}.fmu"


def refuse_memory_for_code() -> None:
    """Has this process, and what it becomes, compile nothing while it runs."""
    assert ctypes.CDLL(None).prctl(PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN, 0, 0, 0) == 0


def program(*words: str | Path | float, codes: tuple[int, ...] = (0,), generic: bool = False) -> str:
    """What the program prints, by generic equations perhaps."""
    command = [PROGRAM, *map(str, words)]
    before = refuse_memory_for_code if generic else None
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, preexec_fn=before, check=False)
    assert done.returncode in codes, done
    return done.stdout


def run_json(*words: str | Path | float, generic: bool = False) -> dict:
    """The same as JSON. 3: a metric beyond its limit, with other settings than the loop's own."""
    return json.loads(program(*words, "--json", codes=(0, 3), generic=generic))


def timed(command: list, codes: tuple[int, ...] = (0,)) -> float:
    """How long a program runs."""
    begun = time.perf_counter()
    done = subprocess.run([str(word) for word in command], capture_output=True, cwd=ROOT, check=False)
    took = time.perf_counter() - begun
    assert done.returncode in codes, done
    return took
