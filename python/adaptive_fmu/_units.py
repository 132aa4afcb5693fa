"""Single units: what there is, descriptions of one's own, FMUs of them, and FMUs of any tool run alone."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Union

import numpy as np
import pandas as pd

from ._errors import ArgumentError, LimitExceeded
from ._linear import Linearisation
from ._pool import ask, done
from ._progress import shown
from ._result import Result, result_of
from ._values import Value, number, words

#: A file or folder.
PathLike = Union[str, "os.PathLike[str]"]


def fmus() -> pd.DataFrame:
    """The FMUs of this package by their names, with what they are.

    >>> import adaptive_fmu
    >>> adaptive_fmu.fmus().loc["L1NonlinearSiso", "description"]
    'L1 adaptive controller for an uncertain nonlinear SISO system (example 3.2.1)'
    """
    return _listed("fmus")


def loops() -> pd.DataFrame:
    """The closed loops of this package by their names, with what they show.

    >>> import adaptive_fmu
    >>> "3.2.1-cosine" in adaptive_fmu.loops().index
    True
    """
    return _listed("loops")


def kinds() -> pd.DataFrame:
    """The kinds of systems that descriptions ask for, by their names; `new` tells whether `new` writes one.

    >>> import adaptive_fmu
    >>> bool(adaptive_fmu.kinds().loc["l1", "new"])
    True
    """
    return _listed("kinds", "new")


def _listed(what: str, *further: str) -> pd.DataFrame:
    rows = done(["list", "--json"]).json()[what]
    return pd.DataFrame(rows, columns=["name", "description", *further]).set_index("name")


class Checked:
    """The report on the design of a unit.

    >>> import adaptive_fmu
    >>> adaptive_fmu.check("L1CoupledMimo")
    <L1CoupledMimo: sound>
    """

    def __init__(self, told: dict[str, Any]) -> None:
        #: Name of the unit.
        self.name: str = told["name"]
        #: Whether all its conditions hold.
        self.sound: bool = told["sound"]
        #: In a word, where the worst finding is meant.
        self.verdict: str = told["verdict"]
        #: The report as the program prints it.
        self.text: str = told["text"]
        #: section, name, value, unit, verdict and note of each finding.
        self.findings: pd.DataFrame = pd.DataFrame(
            told["findings"], columns=["section", "name", "value", "unit", "verdict", "note"]
        )

    def check(self) -> Checked:
        """Raises `LimitExceeded` where the design isn't sound; else the report itself, to go on with.

        >>> import adaptive_fmu
        >>> adaptive_fmu.check("L1CoupledMimo").check().sound
        True
        """
        if not self.sound:
            raise LimitExceeded(self.text)
        return self

    def __repr__(self) -> str:
        return f"<{self.name}: {'sound' if self.sound else self.verdict}>"


def check(description: PathLike) -> Checked:
    """Reports on the design of a description (NAME.toml) or an FMU of this package: poles, margins, its conditions.

    Raises `Error` for a description that is refused.

    >>> import adaptive_fmu
    >>> adaptive_fmu.check("L1CoupledMimo").sound
    True
    """
    return Checked(done(["check", "--json", "--", os.fspath(description)]).json())


def export(
    *names: PathLike,
    out: PathLike = "fmus",
    composite: PathLike | Sequence[PathLike] = (),
    ssp: PathLike | Sequence[PathLike] = (),
    values: PathLike | None = None,
    source: bool = False,
    compile: bool = False,
    platforms: Sequence[str] = (),
    without: Sequence[str] = (),
    terminals: bool = False,
) -> list[Path]:
    """Writes FMUs into a folder; their paths.

    names: FMUs of this package, or description files (NAME.toml).
    composite, ssp: loops, as one FMU each, or as one archive with all FMUs.
    values: parameter set (.ssv) that the one FMU named is to start with.
    source, compile: with C sources; with libraries compiled from these, by the C compiler of this machine.
    platforms: for which they are compiled, by zig (`pip install adaptive-fmu[compile]`): "linux64", "win64", "darwin64" …
    without: units that are left out of whole loops, whose signals are inputs then.
    terminals: with terminalsAndIcons.xml, by which some tools connect FMUs; tools with FMI Library 3 refuse such FMUs.

    Raises `Error` for what isn't there or is refused.

    >>> import adaptive_fmu
    >>> [file.name for file in adaptive_fmu.export("L1NonlinearSiso", out=folder)]
    ['L1NonlinearSiso.fmu']
    """
    composite, ssp = ([loops] if isinstance(loops, (str, os.PathLike)) else list(loops) for loops in (composite, ssp))
    if not (names or composite or ssp):
        raise ArgumentError("export what? Name FMUs, description files, or loops (composite=, ssp=)")
    request = ["export", f"--out={os.fspath(out)}", "--json"]
    for option, loops in (("--composite", composite), ("--ssp", ssp), ("--without", without)):
        request += [f"{option}={os.fspath(loop)}" for loop in loops]
    request += [f"--values={os.fspath(values)}"] if values is not None else []
    request += ["--source"] if source else []
    request += ["--terminals"] if terminals else []
    request += ["--compile"] if compile or platforms else []
    request += ["--platforms=" + ",".join(platforms)] if platforms else []
    told = done([*request, "--", *(os.fspath(name) for name in names)]).json()
    return [Path(file) for file in [*told["fmus"], *told.get("ssps", [])]]


def new(
    kind: str,
    file: PathLike,
    *,
    plant: Any = None,
    states: int | None = None,
    inputs: int | None = None,
    outputs: int | None = None,
    bandwidth: float | None = None,
    reference: float = 1.0,
    force: bool = False,
) -> Path:
    """Writes the description of a unit of one's own, ready to be exported as it stands; its path.

    kind: one of `kinds()` with `new`, such as "l1", "pid" or "state-space".
    file: NAME.toml; NAME is the unit's, a C identifier.
    plant: the nominal plant: a linear system of python-control or scipy.signal, matrices (A, B, C, D), a `Linearisation`, a
        JSON file with A, B, C, D, or any FMU, which is linearised. Without one, `states`, `inputs` and `outputs` give sizes.
    bandwidth: how fast the controlled system is to be at least, rad/s.
    reference: usual magnitude of the reference.
    force: whether a file that is there is overwritten.

    Raises `Error` where no controller can be proposed, or the file is there.

    >>> import adaptive_fmu
    >>> A, B, C, D = [[0, 1], [0, -10]], [[0], [50]], [[1, 0]], [[0]]
    >>> adaptive_fmu.new("l1", folder / "Motor.toml", plant=(A, B, C, D)).name
    'Motor.toml'
    """
    file = Path(file)
    request = ["new", kind, f"--name={file.stem}", f"--out={os.fspath(file)}", f"--reference={number(reference)}"]
    for option, size in (("--states", states), ("--inputs", inputs), ("--outputs", outputs)):
        request += [f"{option}={size}"] if size is not None else []
    request += [f"--bandwidth={number(bandwidth)}"] if bandwidth is not None else []
    request += ["--force"] if force else []
    if plant is None:
        done(request)
    elif isinstance(plant, (str, os.PathLike)):
        done([*request, f"--plant={os.fspath(plant)}"])
    else:
        with tempfile.TemporaryDirectory() as folder:
            matrices = Path(folder) / "plant.json"
            matrices.write_text(json.dumps(_matrices(plant)))
            done([*request, f"--plant={os.fspath(matrices)}"])
    return file


def _matrices(plant: Any) -> dict[str, Any]:
    """The plant as the program reads it."""
    if hasattr(plant, "to_ss"):  # of scipy.signal
        plant = plant.to_ss()
    elif hasattr(plant, "num") and hasattr(plant, "den") and not hasattr(plant, "A"):
        try:
            import control
        except ImportError:
            raise ArgumentError(f"{type(plant).__name__}: give it as matrices (A, B, C, D)") from None
        plant = control.ss(plant)
    if getattr(plant, "dt", None) not in (None, 0, 0.0):
        raise ArgumentError(f"the plant is sampled every {plant.dt} s; a design starts from a continuous one")
    parts = plant if isinstance(plant, (tuple, list)) else [getattr(plant, name, None) for name in "ABCD"]
    if len(parts) != 4 or any(part is None for part in parts):
        raise ArgumentError("plant: must be a linear system, matrices (A, B, C, D), or a file")
    return {name: np.atleast_2d(np.asarray(part, dtype=float)).tolist() for name, part in zip("ABCD", parts)}


def simulate(
    fmu: PathLike,
    *,
    input: pd.DataFrame | None = None,
    until: float | None = None,
    step: float | None = None,
    interface: str | None = None,
    values: Mapping[str, Value] | None = None,
    record: Sequence[str] = (),
    out: PathLike | None = None,
    progress: bool | None = None,
) -> Result:
    """Runs one unit alone: an FMU file of any tool, an FMU of this package, a description, or a loop as one unit.

    input: inputs over time: the index is the time in s, a column an input. Continuous inputs are linear in between.
    until, step: stop time and communication step, s; the unit's own where they aren't given.
    interface: "cs" (co-simulation) or "me" (model exchange).
    values: start values of parameters, or values of inputs, by name.
    record: variables to be recorded beside the outputs.
    out: folder for a page with plots, CSV and metrics; nothing is written without one.

    Raises `Error` where it can't be run; one of a unit that failed on the way has `partial`.

    >>> import adaptive_fmu, pandas as pd
    >>> ramp = pd.DataFrame({"u[1]": [0.0, 1.0]}, index=[0.0, 1.0])
    >>> result = adaptive_fmu.simulate("StateSpace", input=ramp, until=1, step=0.01)
    >>> len(result.data)
    101
    """
    request = ["simulate", "--json", *words("--set", values or {})]
    for option, value in (("--until", until), ("--step", step)):
        request += [f"{option}={number(value)}"] if value is not None else []
    request += [f"--interface={interface}"] if interface is not None else []
    request += ["--record=" + ",".join(record)] if record else []
    request += [f"--out={os.fspath(out)}"] if out is not None else []
    with tempfile.TemporaryDirectory() as folder, shown(Path(fmu).stem, progress) as show:
        if input is not None:
            file = Path(folder) / "input.csv"
            input.rename_axis("time").to_csv(file)
            request += [f"--input={os.fspath(file)}"]
        return result_of(ask([*request, "--", os.fspath(fmu)], show))


def linearise(
    name: PathLike,
    *,
    at: float | None = None,
    steady_state: bool = False,
    values: Mapping[str, Value] | None = None,
    step: float | None = None,
) -> Linearisation:
    """The linear system that an FMU, a description or a loop as one unit is like about an operating point.

    at: time in s; the states are those of a simulation until then, with held inputs. The start time unless given.
    steady_state: at states whose derivatives are zero at that time instead.
    values: start values of parameters, or values of inputs, by name.
    step: communication step of simulations and experiments, s. The one that the FMU proposes unless given.

    Raises `Error` where there is no such point, or a unit fails.

    >>> import adaptive_fmu
    >>> adaptive_fmu.linearise("3.2.1-cosine", at=0.5).A.shape[0] > 2
    True
    """
    request = ["linearise", "--json", *words("--set", values or {})]
    request += [f"--at={number(at)}"] if at is not None else []
    request += ["--steady-state"] if steady_state else []
    request += [f"--step={number(step)}"] if step is not None else []
    return Linearisation(done([*request, "--", os.fspath(name)]).json())
