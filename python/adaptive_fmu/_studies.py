"""Checks and comparisons: FMUs against the standard, loops with each other, controllers in the league, the thesis."""

from __future__ import annotations

import html
import json
import os
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, Union

import pandas as pd

from ._errors import ArgumentError, Error
from ._executor import ask
from ._loop import Loop
from ._pool import done
from ._program import in_keywords, program
from ._values import PathLike, Value, elements, number

#: A loop, its name or path, or a pair of one of these and values by the names of variables, or a folder of earlier results.
Run = Union[Loop, PathLike, "tuple[Loop | PathLike, Mapping[str, Value]]"]


def validate(fmu: PathLike, *, run: bool = True) -> pd.DataFrame:
    """Check an FMU of any tool against the FMI 2.0 standard and return the findings, one row each; no rows if there are none.

    Columns: severity ("error" or "warning"), what, advice, variable, section (of the standard) and line (of modelDescription.xml).

    fmu: FMU archive (NAME.fmu).
    run: True to simulate it for a few steps too, in a process of its own. Default: True.

    >>> import adaptive_fmu
    >>> [file] = adaptive_fmu.export("NonlinearSiso", out=folder)
    >>> len(adaptive_fmu.validate(file))
    0
    """
    answer = done(["validate", "--json", *([] if run else ["--no-run"]), "--", os.fspath(fmu)]).json()
    found = pd.DataFrame(answer["findings"], columns=["severity", "what", "advice", "variable", "section", "line"]).astype(object)
    return found.where(found.notna(), None)


def compare(
    *runs: Run,
    until: float | None = None,
    step: float | None = None,
    composite: bool = False,
    out: PathLike | None = None,
    **labelled: Run,
) -> pd.DataFrame:
    """Run loops and return their metrics side by side: one row per metric, one column per run, and `limit`.

    runs: two or more loops: `Loop`, names or paths; pairs of a loop and values, ("3.2.1-cosine", {"plant.omega": 2.5}); or folders
        of earlier results.
    until: stop time, s. Default: each loop's own.
    step: communication step, s. Default: each loop's own.
    composite: True to simulate each loop as one continuous system. Default: False.
    out: folder for the results and a page with common diagrams, comparison/index.html. Default: None, nothing is written.
    labelled: further runs by the labels that their columns and curves have.

    Raises `Error` if an FMU fails. Metrics that a run has no value for are NaN.

    >>> import adaptive_fmu
    >>> table = adaptive_fmu.compare("3.2.1-cosine", ("3.2.1-cosine", {"plant.omega": 2.5}), until=6)
    >>> table.columns.to_list()
    ['limit', '3.2.1-cosine', '3.2.1-cosine@plant.omega=2.5']
    >>> table = adaptive_fmu.compare(usual="3.2.1-cosine", strong=("3.2.1-cosine", {"plant.omega": 2.5}), until=6)
    >>> table.columns.to_list()
    ['limit', 'usual', 'strong']
    """
    for label in labelled:
        if label == "limit" or any(sign in label for sign in "=:@/\\"):
            raise ArgumentError(f"label {label!r}: must not be limit, and have none of = : @ / \\")
    named = [f"{label}={_run_text(run)}" for label, run in labelled.items()]
    with _folder(out) as folder:
        request = ["compare", "--json", f"--out={folder}", *(["--composite"] if composite else [])]
        for option, value in (("--until", until), ("--step", step)):
            request += [f"{option}={number(value)}"] if value is not None else []
        results = done([*request, "--", *map(_run_text, runs), *named]).json()["loops"]
    columns: dict[str, dict[str, float | None]] = {"limit": {}}
    for loop in results:
        columns[loop["label"]] = {metric["label"]: metric["value"] for metric in loop["metrics"]}
        columns["limit"] |= {metric["label"]: metric["limit"] for metric in loop["metrics"]}
    return pd.DataFrame(columns, dtype=float).rename_axis("metric")


def _run_text(run: Run) -> str:
    loop, values = run if isinstance(run, tuple) else (run, {})
    text = loop.name if isinstance(loop, Loop) else os.fspath(loop)
    given = [f"{place}={value}" for name, each in values.items() for place, value in elements(name, each)]
    return f"{text}:{','.join(given)}" if given else text


def league(
    only: str | Sequence[str] = (),
    *,
    quick: bool = False,
    out: PathLike | None = None,
    resume: bool = False,
    force: bool = False,
    executor: Any = None,
) -> pd.DataFrame:
    """Compare controllers on equal terms, on plants with sensors and actuators, and return the measurements, one row per pair.

    All pairs take hours, with `quick` minutes.

    only: pairs PLANT/CONTROLLER, or their beginnings, such as "siso/pid" or "robot". Default: all.
    quick: True for a few plants and short searches, to see that all works; its numbers mean little. Default: False.
    out: folder for the page and the results, from which `resume` continues. Default: None, nothing is written.
    resume: True to continue an earlier call in that folder. Default: False.
    force: True to replace its results. Default: False.
    executor: where the pairs are computed, as for `Loop.sweep`; a job is one stage of a pair. Default: None, this process.

    >>> import adaptive_fmu
    >>> adaptive_fmu.league("siso/pid", quick=True)[["plant", "controller"]].to_dict("records")
    [{'plant': 'siso', 'controller': 'pid'}]
    """
    if resume and out is None:
        raise ArgumentError("resume continues in the folder `out`: give both")
    with _folder(out) as folder:
        request = [
            "league",
            "--json",
            f"--out={folder}",
            *(f"--only={pair}" for pair in ([only] if isinstance(only, str) else only)),
        ]
        request += [f"--{name}" for name, wanted in (("quick", quick), ("resume", resume), ("force", force)) if wanted]
        answer = ask(request, executor, advice="With `out`, resume=True continues it")
        if failure := answer.failure():
            raise failure
        pairs = answer.json()["pairs"]
    rows = [
        {"plant": pair["asked"]["plant"]["name"], "controller": pair["asked"]["controller"]["name"], **_numbers(pair)}
        for pair in pairs
    ]
    return pd.DataFrame(rows)


def _numbers(pair: Mapping[str, Any], before: str = "") -> dict[str, float]:
    """Return the numbers of a result by their paths."""
    found: dict[str, float] = {}
    for name, value in pair.items():
        if isinstance(value, Mapping) and name != "asked":
            found |= _numbers(value, f"{before}{name}.")
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            found[f"{before}{name}"] = value
    return found


def report(only: str | Sequence[str] = (), *, out: PathLike | None = None) -> pd.DataFrame:
    """Run the examples of the thesis and return what each claims and whether it holds here, one row per claim.

    Columns: example, claim, holds (None if it was not measured), measured and remark.

    only: examples to run, whose numbers begin with this, such as "3.3" or "6.5.1". Default: all.
    out: folder for the page with its figures. Default: None, nothing is written.

    >>> import adaptive_fmu
    >>> bool(adaptive_fmu.report("3.2.1")["holds"].all())
    True
    """
    with _folder(out) as folder:
        request = ["report", "--json", f"--out={folder}"]
        request += [f"--only={example}" for example in ([only] if isinstance(only, str) else only)]
        examples = done(request).json()["examples"]
    rows = [{"example": example["example"], **claim} for example in examples for claim in example["claims"]]
    return pd.DataFrame(rows, columns=["example", "claim", "holds", "measured", "remark"])


def playground(out: PathLike = "playground", *, open: bool = True) -> Path:
    """Write the page on which a plant becomes a controller, its FMU and its C in the browser, and return its file.

    The page is answered by this package itself, as WebAssembly: it needs no server and no network. A wheel of a release contains
    what it needs; with a program from a source folder, `packaging/browser` builds that.

    out: folder for the files of the page. Default: "playground".
    open: True to open the page in the browser. Default: True.

    Raises `Error` if the program comes without the library for browsers.

    >>> import adaptive_fmu
    >>> adaptive_fmu.playground(folder, open=False).name  # doctest: +SKIP
    'index.html'
    """
    request = ["playground", f"--out={os.fspath(out)}", *(["--open"] if open else [])]
    return Path(done(request).text.strip())


@contextmanager
def _folder(out: PathLike | None) -> Iterator[str]:
    """Path of the folder for results; one that is removed where none is wanted."""
    if out is not None:
        yield os.fspath(out)
        return
    with tempfile.TemporaryDirectory() as folder:
        yield folder


E = TypeVar("E", bound="Explored")


class Explored:
    """Loop in a browser, until `stop` or the end of Python.

    >>> import adaptive_fmu
    >>> with adaptive_fmu.explore("3.2.1-cosine", open=False) as explored:
    ...     explored.url[:17]
    'http://127.0.0.1:'
    """

    def __init__(self, name: str, words: Sequence[str]) -> None:
        self._process = subprocess.Popen(
            [os.fspath(program()), "explore", "--json", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        line = self._process.stdout.readline() if self._process.stdout else ""
        if not line:
            _, errors = self._process.communicate()
            raise Error(in_keywords(errors.strip().removeprefix("error: ").split("\n\n")[0]))
        #: Name of the loop.
        self.name = name
        #: Address of the page, on this machine only.
        self.url: str = json.loads(line)["url"]

    def stop(self) -> None:
        """End it; the page remains as it is.

        >>> import adaptive_fmu
        >>> explored = adaptive_fmu.explore("3.2.1-cosine", open=False)
        >>> explored.stop()
        """
        self._process.terminate()
        self._process.communicate()

    def __enter__(self: E) -> E:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __del__(self) -> None:
        if self._process.poll() is None:
            self.stop()

    def __repr__(self) -> str:
        return f"<{self.name} at {self.url}>"

    def _repr_html_(self) -> str:
        return f'<p>{html.escape(self.name)}: <a href="{html.escape(self.url)}" target="_blank">{html.escape(self.url)}</a></p>'


def explore(
    loop: Loop | PathLike,
    *,
    until: float | None = None,
    step: float | None = None,
    values: Mapping[str, Value] | None = None,
    open: bool = True,
) -> Explored:
    """Show a loop in the browser, with sliders for its parameters, and return it as an `Explored`.

    loop: `Loop`, or name or path of one.
    until: stop time, s. Default: the loop's own.
    step: communication step, s. Default: the loop's own.
    values: start values by name, "component.variable".
    open: True to open the page in the browser. Default: True.

    >>> import adaptive_fmu
    >>> with adaptive_fmu.explore("3.2.1-cosine", open=False, values={"plant.omega": 2}) as explored:
    ...     explored
    <3.2.1-cosine at http://127.0.0.1:...>
    """
    name = loop.name if isinstance(loop, Loop) else os.fspath(loop)
    words = ["--open" if open else "--no-open"]
    for option, value in (("--until", until), ("--step", step)):
        words += [f"{option}={number(value)}"] if value is not None else []
    given = [f"--set={place}={text}" for key, each in (values or {}).items() for place, text in elements(key, each)]
    return Explored(name, [*words, *given, "--", name])
