"""The results of a study on disk: one line for each loop that ended, safe once it is written."""

import csv
import hashlib
import json
import os
from pathlib import Path

import loop

COLUMNS = ["loop", "outcome", "rms_e1", "rms_e2", "max_u1", "max_u2", "message"]
COLUMNS += [*(quantity.name for quantity in loop.QUANTITIES), "noise_seed"]


class Refused(Exception):
    """What the user is told in one line."""


class Results:
    """`results.csv` in a folder, and `study.json`: what these results depend on."""

    def __init__(self, folder: Path, seed: int, fmus: dict[str, bytes], again: bool = False) -> None:
        self.file, self.seed = folder / "results.csv", seed
        folder.mkdir(parents=True, exist_ok=True)
        self._same_set_up(folder / "study.json", fmus)
        self._only_whole_lines(again)
        with self.file.open(newline="") as file:
            self.rows = {int(row["loop"]): row for row in csv.DictReader(file)}

    def _same_set_up(self, file: Path, fmus: dict[str, bytes]) -> None:
        digest = {name: hashlib.sha256(content).hexdigest() for name, content in fmus.items()}
        set_up = {"seed": self.seed, "loop.py": hashlib.sha256(Path(loop.__file__).read_bytes()).hexdigest(), **digest}
        if not self.file.exists():
            replace(file, json.dumps(set_up, indent=1) + "\n")
        before = json.loads(file.read_text()) if file.exists() else {}
        if differ := [name for name in set_up if before.get(name) != set_up[name]]:
            raise Refused(f"{file.parent} holds results of another set-up ({', '.join(differ)}): give another --out")

    def _only_whole_lines(self, again: bool) -> None:
        """Drops a line that was cut off; with `again`, those of loops that ended with an exception."""
        head = ",".join(COLUMNS) + "\n"
        lines = self.file.read_text().splitlines(keepends=True) if self.file.exists() else []
        whole = [line for line in lines[1:] if line.endswith("\n")]
        kept = [line for line in whole if not (again and line.split(",")[1] == loop.EXCEPTION)]
        if [head, *kept] != lines:
            replace(self.file, "".join([head, *kept]))

    def add(self, k: int, outcome: dict[str, float | str]) -> None:
        """Writes what became of loop `k`; it is on the disk when this returns."""
        row = {"loop": k, **outcome, **loop.sample(self.seed, k)}
        row["message"] = " ".join(outcome.get("message", "").split())
        with self.file.open("a", newline="") as file:
            csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n").writerow(row)
            file.flush()
            os.fsync(file.fileno())
        self.rows[k] = {name: str(row.get(name, "")) for name in COLUMNS}


def replace(file: Path, text: str) -> None:
    """Writes a file so that either what it held or all of this is there."""
    new = file.with_suffix(".new")
    with new.open("w") as opened:
        opened.write(text)
        opened.flush()
        os.fsync(opened.fileno())
    new.replace(file)
