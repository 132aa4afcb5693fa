"""Which FMU and which loop works in which master, judged by values and never by exit codes.

    tests/masters/run [--quick] [--json] [--master NAME]... [NAME]...

Rows are FMUs, then loops; all of them unless some are named. A cell is the largest difference at any communication
point (see LEGEND), "failed" with a reason, or "not found". The exit code is 1 if any cell failed.
"""

import argparse
import contextlib
import io
import json
import math
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).resolve().parents[1] / "fmpy")]

import fmusim  # noqa: E402
import loops  # noqa: E402
import programs  # noqa: E402
import units  # noqa: E402
from conftest import FMU_NAMES, LOOP_NAMES, adaptive_fmu  # noqa: E402
from master import Fmu  # noqa: E402
from masters import COUNT, TOLERANCE  # noqa: E402
from package import Package  # noqa: E402
from units import SOLVERS  # noqa: E402

QUICK = 100
LEGEND = f"""
The largest difference of any output, relative to its largest magnitude where that is above 1; 0: none at all. FMUs:
from plain calls at the same times, within {TOLERANCE:.0e}; ME of FMPy and fmusim: from co-simulation, within {SOLVERS:.0e}.
Loops: from the same loop in FMPy, and FMPy from the program's own run, within {TOLERANCE:.0e}. –: not for this."""


@dataclass(frozen=True)
class Master:
    """How a unit, and how a loop, is run there: each gives a difference and its limit, or a word."""

    name: str
    unit: Callable[[Fmu, int, Path], tuple[float, float] | str] | None = None
    loop: Callable[[Package, int, Path], tuple[float, float] | str] | None = None
    # A program that need not be there.
    program: str | None = None


MASTERS = [
    Master("FMPy CS", units.fmpy_co_simulation, loops.in_fmpy_and_by_the_program),
    Master("FMPy ME", units.fmpy_model_exchange),
    Master("ecos", units.ecos, loops.ecos),
    Master("libcosim", units.libcosim, loops.libcosim),
    Master("fmi (Rust) CS", units.rust_co_simulation),
    Master("fmi (Rust) ME", units.rust_model_exchange),
    Master("fmutool", programs.fmutool),
    Master("fmucontainer", None, programs.fmucontainer),
    Master("OMSimulator", programs.omsimulator_unit, programs.omsimulator_loop, programs.OMSIMULATOR),
    Master("fmuCheck", programs.fmucheck, None, programs.FMUCHECK),
    Master("fmusim CS", fmusim.co_simulation, None, fmusim.FMUSIM),
    Master("fmusim ME", fmusim.model_exchange, None, fmusim.FMUSIM),
]


@dataclass(frozen=True)
class Cell:
    """What came of a unit or a loop in a master."""

    text: str
    failed: bool = False
    difference: float | None = None

    @classmethod
    def of(cls, master: Master, subject: Fmu | Package, count: int, folder: Path) -> "Cell":
        """Runs it there."""
        call = master.loop if isinstance(subject, Package) else master.unit
        if call is None:
            return cls("–")
        if master.program and not programs.found(master.program):
            return cls("not found")
        folder.mkdir(parents=True)
        try:
            # Units and masters say much that is no result.
            with contextlib.redirect_stdout(io.StringIO()):
                answer = call(subject, count, folder)
        except Exception as error:  # noqa: BLE001
            reason = " ".join(str(error).split()) or type(error).__name__
            return cls(f"failed: {reason[-200:]}", True)
        return cls(answer) if isinstance(answer, str) else cls.compared(*answer)

    @classmethod
    def compared(cls, difference: float, limit: float) -> "Cell":
        """Of a difference; one that is no number is a failure, too."""
        if difference <= limit:
            return cls("0" if difference == 0.0 else f"{difference:.0e}", False, difference)
        # What is no number is null for scripts.
        return cls(f"failed: {difference:.1e} > {limit:.0e}", True, difference if math.isfinite(difference) else None)


# Name of an FMU or a loop, its cells, and how many seconds they took.
Row = tuple[str, dict[str, Cell], float]


def rows(names: list[str], masters: list[Master], count: int, folder: Path) -> Iterator[Row]:
    """Each FMU, then each loop, in all these masters."""
    chosen = [[name for name in known if name in names] for known in (FMU_NAMES, LOOP_NAMES)]
    if chosen[0]:
        exported = adaptive_fmu("export", *chosen[0], "--out", folder / "fmus")
        assert exported.returncode == 0, exported.stderr
    packed = {file.stem: file for file in loops.pack(folder / "packed", *chosen[1])} if chosen[1] else {}
    for name in chosen[0] + chosen[1]:
        begun, here = time.monotonic(), folder / name
        subject = Package(packed[name], here) if name in packed else Fmu(folder / "fmus" / f"{name}.fmu", here)
        cells = {master.name: Cell.of(master, subject, count, here / master.name) for master in masters}
        shutil.rmtree(here)
        yield name, cells, time.monotonic() - begun


def main() -> int:
    """The table of what is asked for."""
    parser = argparse.ArgumentParser("tests/masters/run", description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="FMUs and loops; all unless some are named")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} steps instead of {COUNT}")
    parser.add_argument("--json", action="store_true", help="for scripts")
    parser.add_argument("--master", action="append", choices=[m.name for m in MASTERS], help="only this one")
    given = parser.parse_args()
    if unknown := set(given.names) - {*FMU_NAMES, *LOOP_NAMES}:
        parser.error(f"no FMU or loop named {', '.join(sorted(unknown))}")
    masters = [m for m in MASTERS if not given.master or m.name in given.master]
    count = QUICK if given.quick else COUNT
    with tempfile.TemporaryDirectory() as folder:
        found = rows(given.names or [*FMU_NAMES, *LOOP_NAMES], masters, count, Path(folder))
        table = list(found) if given.json else list(printed(found, masters))
    if given.json:
        reported = [
            {"name": name, "seconds": round(seconds, 1), "masters": {m: vars(cell) for m, cell in cells.items()}}
            for name, cells, seconds in table
        ]
        print(json.dumps({"steps": count, "rows": reported}, indent=2))
    return int(any(cell.failed for _, cells, _ in table for cell in cells.values()))


def printed(table: Iterator[Row], masters: list[Master]) -> Iterator[Row]:
    """The same, each row printed as soon as it is known."""
    widths = [max(len(name) for name in [*FMU_NAMES, *LOOP_NAMES])] + [max(len(m.name), 9) for m in masters]

    def line(words: list[str]) -> None:
        print("|", " | ".join(word.ljust(width) for word, width in zip(words, widths, strict=True)), "|", flush=True)

    line(["", *(m.name for m in masters)])
    line(["-" * width for width in widths])
    for row in table:
        line([row[0], *(cell.text for cell in row[1].values())])
        yield row
    print(LEGEND)


if __name__ == "__main__":
    sys.exit(main())
