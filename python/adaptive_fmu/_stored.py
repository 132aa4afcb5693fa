"""Runs of a sweep in a folder, where the same call continues."""

from __future__ import annotations

import hashlib
import json
import math
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import Error
from ._program import Answer
from ._sweep import Run
from ._values import PathLike, texts


class Stored:
    """The file sweep.json with the arguments, runs.jsonl with one line per run, and recorded signals in files of their own."""

    def __init__(self, folder: PathLike, arguments: Mapping[str, Any], force: bool) -> None:
        self._folder = Path(folder)
        self._runs = self._folder / "runs.jsonl"
        self._folder.mkdir(parents=True, exist_ok=True)
        if force:
            self._remove()
        self._same_arguments(self._folder / "sweep.json", json.loads(json.dumps(arguments)))
        self._lines = {json.dumps(line["words"]): line for line in self._whole_lines()}

    def get(self, point: dict[str, Any], keep: bool) -> Run | None:
        """Return the run with some values; None if it is not stored."""
        line = self._lines.get(json.dumps(_words(point)))
        if line is None:
            return None
        answer = self._signals(point) if keep else None
        if keep and answer is None:
            return None
        metrics = {label: float("nan") if value is None else value for label, value in line["metrics"].items()}
        return Run(point, line["ended"], metrics, line["message"], answer)

    def add(self, run: Run) -> None:
        """Store a run. It is on the disk when this returns."""
        if run.answer is not None:
            self._write_signals(run.point, run.answer)
        metrics = {label: None if math.isnan(value) else value for label, value in run.metrics.items()}
        line = {"words": _words(run.point), "ended": run.ended, "metrics": metrics, "message": run.message}
        with self._runs.open("ab", buffering=0) as file:
            # Written in one piece; a line that a crash cuts off is dropped when the sweep continues.
            file.write(json.dumps(line).encode() + b"\n")
            os.fsync(file.fileno())

    def _remove(self) -> None:
        for file in [self._folder / "sweep.json", self._runs, *self._folder.glob("run-*.npz")]:
            file.unlink(missing_ok=True)

    def _same_arguments(self, file: Path, arguments: dict[str, Any]) -> None:
        if not file.is_file():
            if self._runs.exists():
                raise Error(
                    f"{self._runs}: {file.name} is missing, so these runs may be of another sweep; force=True replaces them"
                )
            _replace(file, json.dumps(arguments, indent=1).encode() + b"\n")
            return
        try:
            before: dict[str, Any] = dict(json.loads(file.read_text()))
        except (ValueError, TypeError):
            raise Error(f"{file}: is not a file of a sweep; force=True replaces it") from None
        names = [*before, *(name for name in arguments if name not in before)]
        differing = [name for name in names if before.get(name) != arguments.get(name)]
        changes = [f"{name} was {json.dumps(before.get(name))}, is {json.dumps(arguments.get(name))}" for name in differing]
        if changes:
            raise Error(f"{file}: belongs to another sweep: {'; '.join(changes)}; force=True replaces it")

    def _whole_lines(self) -> list[dict[str, Any]]:
        if not self._runs.is_file():
            return []
        text = self._runs.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        if whole != text:
            _replace(self._runs, whole)
        try:
            return [json.loads(line) for line in whole.splitlines()]
        except ValueError as error:
            raise Error(f"{self._runs}: is not a file of a sweep: {error}; force=True replaces it") from None

    def _file(self, point: dict[str, Any]) -> Path:
        return self._folder / f"run-{hashlib.sha256(json.dumps(_words(point)).encode()).hexdigest()[:20]}.npz"

    def _signals(self, point: dict[str, Any]) -> Answer | None:
        try:
            with np.load(self._file(point), allow_pickle=False) as file:
                rest = json.loads(str(file["rest"]))
                return Answer(rest["code"], "", rest["notes"], file["table"], rest["about"])
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None

    def _write_signals(self, point: dict[str, Any], answer: Answer) -> None:
        assert answer.table is not None
        file = self._file(point)
        new = file.with_suffix(".new")
        with new.open("wb") as opened:
            rest = json.dumps({"code": answer.code, "notes": answer.notes, "about": answer.about})
            np.savez(opened, table=answer.table, rest=np.array(rest))
        new.replace(file)


def _words(point: dict[str, Any]) -> list[str]:
    """Return the values as the program reads them, which is what a run depends on."""
    return [f"{name}={text}" for name, text in texts(point).items()]


def _replace(file: Path, content: bytes) -> None:
    """Replace a file so that after a crash either the old or the new content is there."""
    new = file.with_suffix(".new")
    with new.open("wb") as opened:
        opened.write(content)
        opened.flush()
        os.fsync(opened.fileno())
    new.replace(file)
