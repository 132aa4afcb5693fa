"""Single FMUs: list them, write and check descriptions, export FMUs, and simulate or linearise FMUs of any tool."""

from __future__ import annotations

import math
import os
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ._errors import ArgumentError, ExperimentWarning
from ._linear import Linearisation
from ._plant import is_of_records, plant_file
from ._pool import ask, done
from ._program import in_keywords, reworded
from ._progress import shown
from ._records import Given
from ._result import Result, result_of
from ._values import Events, PathLike, Value, alias, event_words, joined, number, numbers, trim, words


class Listing(pd.DataFrame):
    """Table whose texts are shown whole."""

    @property
    def _constructor(self) -> Callable[..., pd.DataFrame]:
        return pd.DataFrame

    def __repr__(self) -> str:
        with pd.option_context("display.max_colwidth", None, "display.max_rows", None, "display.width", 200):
            return str(super().__repr__())

    def _repr_html_(self) -> str | None:
        with pd.option_context("display.max_colwidth", None, "display.max_rows", None):
            return pd.DataFrame(self).to_html()


def fmus() -> pd.DataFrame:
    """Return the FMUs of this package by their names, with their descriptions and the versions of FMI that `export` writes.

    >>> import adaptive_fmu
    >>> adaptive_fmu.fmus().loc["L1NonlinearSiso", "description"]
    'L1 adaptive controller for an uncertain nonlinear SISO system (example 3.2.1)'
    >>> adaptive_fmu.fmus().loc["L1NonlinearSiso", "versions"]
    ['2.0', '3.0']
    """
    return _listed("fmus", "versions")


def loops() -> pd.DataFrame:
    """Return the closed loops of this package by their names, with their descriptions.

    >>> import adaptive_fmu
    >>> "3.2.1-cosine" in adaptive_fmu.loops().index
    True
    """
    return _listed("loops")


def kinds() -> pd.DataFrame:
    """Return the kinds of FMUs by their names, with their descriptions; the column `new` is True if `new` writes that kind.

    >>> import adaptive_fmu
    >>> bool(adaptive_fmu.kinds().loc["l1", "new"])
    True
    """
    return _listed("kinds", "new")


def _listed(what: str, *further: str) -> pd.DataFrame:
    rows = done(["list", "--json"]).json()[what]
    return Listing(pd.DataFrame(rows, columns=["name", "description", *further]).set_index("name"))


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
    fmi: int = 2,
    reference_results: bool = True,
) -> list[Path]:
    """Export FMUs into a folder and return their paths.

    names: FMUs of this package, or description files (NAME.toml).
    out: folder for the FMUs and archives. Default: "fmus".
    composite: loop to export as a single FMU, or several, with one FMU each.
    ssp: loop to write with its FMUs as one archive (.ssp), or several.
    values: parameter set (.ssv) with start values for the FMU; exactly one FMU must be named.
    source: True to add C sources. Default: False.
    compile: True to add C sources, and libraries compiled from them by the C compiler of this machine. Default: False.
    platforms: platforms to compile for, with zig (`pip install adaptive-fmu[compile]`): "linux64", "win64", "darwin64" …
        They imply `compile`. Default: this platform only, with its own compiler.
    without: components to leave out of the loops of `composite`. The inputs that they drive become inputs of the single FMU.
    terminals: True to add terminalsAndIcons.xml, which some tools use to connect FMUs; tools with FMI Library 3 refuse such FMUs.
        Default: False.
    fmi: version of FMI, 2 or 3; with 3 there are no archives of loops. Default: 2.
    reference_results: False to leave out the reference experiment, with which importers check themselves. Default: True.

    Raises `Error` if an FMU, a description file or a loop does not exist or is refused, and `ArgumentError` for arguments that don't go
    together.

    >>> import adaptive_fmu
    >>> [file.name for file in adaptive_fmu.export("L1NonlinearSiso", out=folder)]
    ['L1NonlinearSiso.fmu']
    >>> [file.name for file in adaptive_fmu.export("L1NonlinearSiso", fmi=3, out=folder / "fmi3")]
    ['L1NonlinearSiso.fmu']
    """
    composite, ssp = ([loops] if isinstance(loops, (str, os.PathLike)) else list(loops) for loops in (composite, ssp))
    if not (names or composite or ssp):
        raise ArgumentError(
            "export() was called without anything to export. Name FMUs or description files, or give loops as composite= or ssp="
        )
    if fmi not in (2, 3):
        raise ArgumentError(f"fmi = {fmi!r} must be 2 or 3")
    if fmi == 3 and ssp:
        raise ArgumentError("fmi=3 writes no archives: leave out ssp, or fmi=3")
    request = ["export", f"--out={os.fspath(out)}", "--json"]
    for option, loops in (("--composite", composite), ("--ssp", ssp), ("--without", without)):
        request += [f"{option}={os.fspath(loop)}" for loop in loops]
    request += [f"--values={os.fspath(values)}"] if values is not None else []
    request += ["--source"] if source else []
    request += ["--terminals"] if terminals else []
    request += [f"--fmi={fmi}"] if fmi != 2 else []
    request += [] if reference_results else ["--no-reference-results"]
    request += ["--compile"] if compile or platforms else []
    request += ["--platforms=" + ",".join(platforms)] if platforms else []
    output = done([*request, "--", *(os.fspath(name) for name in names)]).json()
    return [Path(file) for file in [*output["fmus"], *output.get("ssps", [])]]


def firmware(
    *names: PathLike,
    out: PathLike = "firmware",
    period: float | None = None,
    substeps: int | None = None,
    loop: PathLike | None = None,
    fallback: str = "hold",
    calibrate: Sequence[str] | None = None,
    values: PathLike | None = None,
) -> list[Path]:
    """Write controllers as C for embedded targets, with test vectors and a data sheet, and return the paths of the files.

    names: controllers of this package, or description files (NAME.toml).
    out: folder for the files. Default: "firmware".
    period: time between two calls, s. Default: the sample time of the controller, or the step size of its description.
    substeps: Runge-Kutta steps in each call. Default: as many as the controller needs in its loop.
    loop: loop in which these are found and the test vectors are recorded. Default: the first example with this controller.
    fallback: outputs where a step is refused: "hold" (those before), "zero", or "manual". Default: "hold".
    calibrate: names of the parameters that can change while it runs, without indices. Default: all that allow it.
    values: parameter set (.ssv) with start values; exactly one controller must be named.

    Raises `Error` if a controller does not exist or can't be written so, and `ArgumentError` if none is named.

    >>> import adaptive_fmu
    >>> files = adaptive_fmu.firmware("L1SampledTwoLinkRobot", out=folder)
    >>> [file.name for file in files if file.suffix in (".c", ".h")][:2]
    ['L1SampledTwoLinkRobot.h', 'L1SampledTwoLinkRobot.c']
    """
    if not names:
        raise ArgumentError("firmware() was called without a controller. Name one of this package, or a description file")
    request = ["export", "--firmware", f"--out={os.fspath(out)}", "--json", f"--fallback={fallback}"]
    request += [f"--period={number(period)}"] if period is not None else []
    request += [f"--substeps={substeps}"] if substeps is not None else []
    request += [f"--loop={os.fspath(loop)}"] if loop is not None else []
    request += ["--calibrate=" + ",".join(calibrate)] if calibrate is not None else []
    request += [f"--values={os.fspath(values)}"] if values is not None else []
    output = done([*request, "--", *(os.fspath(name) for name in names)]).json()
    return [Path(file) for file in output["files"]]


def new(
    kind: str,
    file: PathLike,
    *,
    plant: Any = None,
    states: int | str | Sequence[str] | None = None,
    inputs: int | str | Sequence[str] | None = None,
    outputs: int | str | Sequence[str] | None = None,
    bandwidth: float | None = None,
    reference: float | Sequence[float] | None = None,
    uncertainty: float | None = None,
    margin: float | None = None,
    level: float | None = None,
    free: Sequence[str] = (),
    want: Mapping[str, Value] | None = None,
    hold: Sequence[str] = (),
    at: float | None = None,
    values: Mapping[str, Value] | None = None,
    signal: str | None = None,
    amplitude: float | Sequence[float] | None = None,
    operating_point: float | Sequence[float] | None = None,
    settling_time: float | None = None,
    step: float | None = None,
    up_to: float | None = None,
    seed: int | None = None,
    force: bool = False,
) -> Path:
    """Write the description of a new FMU, which can be exported without changes, and return its path.

    kind: kind of FMU, one of `kinds()` whose column `new` is True, such as "l1", "pid" or "state-space".
    file: file to write, NAME.toml. NAME is the name of the FMU, a C identifier.
    plant: nominal plant: a linear system of python-control or scipy.signal, matrices (A, B, C, D), a `Linearisation`, an
        `Identified`, a JSON file with A, B, C, D, or any FMU, which is linearised. A sampled system is converted to continuous
        time. Default: chains of integrators with the sizes below.
    states: number of states of the plant, if `plant` is not given. Default: depends on `kind`, mostly 2. For an FMU that declares
        no states: their names. Default: all its Real outputs.
    inputs: number of inputs of the plant, if `plant` is not given. Default: depends on `kind`, mostly 1. With `plant`: names of
        the inputs to use. Default: all.
    outputs: number of outputs of the plant, if `plant` is not given. Default: depends on `kind`, mostly 1. With `plant`: names of
        the outputs to use. Default: all.
    bandwidth: minimum bandwidth of the controlled system, rad/s. Default: that of the plant's slowest pole not at 0; 2 rad/s if
        all poles are at 0, and for the kind "neuro-ppf".
    reference: usual magnitude of the reference, in the output's unit of measurement, or of each reference. Default: 1.
    uncertainty: uncertainty of the numbers of `plant` as a part of them, 0.2 for 20 %. L1 controllers are designed for it, other
        descriptions keep it for `check`. Default: None, not given: an `Identified` has its own.
    margin: factor of the region of an identified plant, for wear and other loads. Default: 3.
    level: confidence level of that region. Default: that of the model.
    free, want, hold, at, values: operating point at which an FMU is linearised, as for `linearise`.
    signal: signal of an experiment (kind "excitation"), "levels", "multisine" or "chirp". Default: "levels".
    amplitude: its largest deviation from the operating point, of all inputs or of each. Default: 1.
    operating_point: operating point of all inputs or of each. Default: 0.
    settling_time: rough settling time of the plant, s. Default: 4/bandwidth, or that of the slowest pole of `plant`.
    step: step of the signal, s. Default: 1/200 of the settling time, or a fifth of the time of the fastest pole of `plant`, rounded
        down. For other kinds: communication step to linearise an FMU of `plant`. Default: the one it proposes, or 0.001.
    up_to: highest frequency of a multisine or chirp, rad/s. Default: three times the fastest pole of `plant`.
    seed: seed of the levels. Default: 1.
    force: True to overwrite an existing file. Default: False.

    Faults that the record of an experiment would have, and verdicts of a design for the region of an identified plant that
    is not sound or nearly so, are given as `ExperimentWarning`.

    Raises `Error` if no controller can be designed for the plant, or if the file exists and `force` is False.

    >>> import adaptive_fmu
    >>> A, B, C, D = [[0, 1], [0, -10]], [[0], [50]], [[1, 0]], [[0]]
    >>> adaptive_fmu.new("l1", folder / "Motor.toml", plant=(A, B, C, D)).name
    'Motor.toml'
    """
    file = Path(file)
    request = ["new", kind, f"--name={file.stem}", f"--out={os.fspath(file)}"]
    for option, size in (("states", states), ("inputs", inputs), ("outputs", outputs)):
        request += [f"--{option}={joined(option, size) if isinstance(size, Sequence) else size}"] if size is not None else []
    known = (("--bandwidth", bandwidth), ("--uncertainty", uncertainty), ("--margin", margin), ("--level", level))
    request += [f"{option}={number(value)}" for option, value in known if value is not None]
    request += [*trim(free, want, hold), *words("--set", values or {})]
    request += [f"--signal={signal}"] if signal is not None else []
    for option, each in (("--reference", reference), ("--amplitude", amplitude), ("--operating-point", operating_point)):
        request += [f"{option}={numbers(each)}"] if each is not None else []
    for option, value in (("--at", at), ("--settling-time", settling_time), ("--step", step), ("--up-to", up_to)):
        request += [f"{option}={number(value)}"] if value is not None else []
    request += [f"--seed={seed}"] if seed is not None else []
    request += ["--force"] if force else []
    if plant is None:
        answer, is_recorded = done(request), False
    else:
        with plant_file(plant) as given:
            answer, is_recorded = done([*request, f"--plant={given}"]), is_of_records(given)
    # Only experiments have faults that are labelled as warnings; other labels are those of verdicts about uncertain plants.
    for note in answer.notes:
        if note.startswith("warning: ") or is_recorded and note.startswith(("Warning: ", "Not sound: ")):
            warnings.warn(in_keywords(note[0].lower() + note[1:]), ExperimentWarning, stacklevel=2)
    return file


def simulate(
    fmu: PathLike,
    *,
    input: Any = None,
    until: float | None = None,
    step: float | None = None,
    interface: str | None = None,
    values: Mapping[str, Value] | None = None,
    record: Sequence[str] | None = None,
    events: Events = (),
    relative_tolerance: float | None = None,
    start_values: Mapping[str, Value] | None = None,
    stop_time: float | None = None,
    output_interval: float | None = None,
    output: Sequence[str] | None = None,
    out: PathLike | None = None,
    progress: bool | None = None,
) -> Result:
    """Simulate a standalone FMU and return its `Result`.

    fmu: FMU archive (NAME.fmu) of any tool, FMU of this package, description file (NAME.toml), or loop as a single FMU.
    input: inputs over time: a DataFrame whose index is the time (s, Timedelta or Timestamp) or that has a column "time", a dict of
        columns or a structured array (as FMPy has it) with "time", the path of a CSV, Parquet (.parquet) or MATLAB file (.mat,
        version 5 or 7), or a function of the time that returns a dict of inputs, which is called at each communication point.
        Continuous inputs are interpolated linearly; all other inputs use a zero-order hold. Default: None, the inputs are constant.
    until: stop time, s. Default: the FMU's own, or 1. `stop_time` is the same.
    step: communication step, s. Default: the FMU's own, or 0.001. `output_interval` is the same.
    interface: "cs" (co-simulation) or "me" (model exchange). Default: co-simulation if the FMU supports it, else model exchange.
    values: start values of parameters, or constant values of inputs, by name. `start_values` is the same.
    record: variables to record in addition to the outputs. `output` is the same.
    events: values that tunable parameters and inputs get during the run, (time in s, name, value), at the first communication
        point that is not before that time.
    relative_tolerance: relative tolerance of the integration in model exchange. Default: 1e-6.
    out: folder for a page with plots, CSV and metrics. Default: None, nothing is written.
    progress: True to show a progress bar, False to show none. Default: a bar in notebooks and terminals.

    Raises `Error` if the FMU can't be simulated. If it failed during the run, `partial` contains the results until then.

    >>> import adaptive_fmu, pandas as pd
    >>> ramp = pd.DataFrame({"u[1]": [0.0, 1.0]}, index=[0.0, 1.0])
    >>> result = adaptive_fmu.simulate("StateSpace", input=ramp, stop_time=1, output_interval=0.01)
    >>> len(result.data)
    101
    >>> step = adaptive_fmu.simulate("StateSpace", input=lambda t: {"u[1]": t > 0.5}, until=1, step=0.01, record=["u[1]"])
    >>> float(step.data["u[1]"].iloc[-1])
    1.0
    """
    values = alias("values", values, "start_values", start_values)
    until, step = alias("until", until, "stop_time", stop_time), alias("step", step, "output_interval", output_interval)
    record = alias("record", record, "output", output)
    request = ["simulate", "--json", *words("--set", values or {}), *event_words(events)]
    for option, value in (("--until", until), ("--step", step), ("--tolerance", relative_tolerance)):
        request += [f"{option}={number(value)}"] if value is not None else []
    request += [f"--interface={interface}"] if interface is not None else []
    request += [f"--record={joined('record', record)}"] if record else []
    request += [f"--out={os.fspath(out)}"] if out is not None else []
    with tempfile.TemporaryDirectory() as folder, shown(Path(fmu).stem, progress) as show:
        given = Given(folder)
        if input is not None:
            table = sampled(input, until, step) if callable(input) else input
            request += [f"--input={given.record(table, 'input', None, [''])}"]
        with reworded(given.reworded):
            return result_of(ask([*request, "--", os.fspath(fmu)], show))


def sampled(function: Callable[[float], Mapping[str, float]], until: float | None, step: float | None) -> pd.DataFrame:
    """Return the values of a function of the time at the communication points."""
    if until is None or step is None:
        raise ArgumentError("input is a function: give `until` and `step` too, whose communication points it is called at")
    times = [k * step for k in range(math.floor(until / step * (1 + 1e-12)) + 1)]
    rows = [function(time) for time in times]
    if not all(isinstance(row, Mapping) and row for row in rows):
        raise ArgumentError(f"input(0.0) = {rows[0]!r}: a function of the time must return a dict of inputs by name")
    return pd.DataFrame(rows, index=pd.Index(times, name="time"), dtype=float)


def linearise(
    name: PathLike,
    *,
    at: float | None = None,
    steady_state: bool = False,
    free: Sequence[str] = (),
    want: Mapping[str, Value] | None = None,
    hold: Sequence[str] = (),
    values: Mapping[str, Value] | None = None,
    step: float | None = None,
) -> Linearisation:
    """Linearise an FMU or a loop at an operating point and return its `Linearisation`.

    name: FMU archive (NAME.fmu), FMU of this package, description file (NAME.toml), or loop of FMUs of this package.
    at: time of the operating point, s. The states are those of a simulation up to this time with constant inputs, unless
        `steady_state` is True or one of `free`, `want` and `hold` is given. Default: start time.
    steady_state: True to linearise at states whose derivatives are zero at the time of the operating point. Default: False.
    free: names of inputs to adjust such that an operating point is reached: states at which all derivatives are zero or have
        the values of `want`. The search starts from the start values.
    want: values at the operating point by the names of outputs, local variables and derivatives: {"y[3]": 1, "der(x[1])": 1.5}.
    hold: names of states that keep their start values at the operating point.
    values: start values of parameters, or constant values of inputs, by name.
    step: communication step of simulations and experiments, s. Default: the one the FMU proposes, or 0.001.

    Raises `Error` if there is no such operating point, or if an FMU fails.

    >>> import adaptive_fmu
    >>> adaptive_fmu.linearise("3.2.1-cosine", at=0.5).A.shape[0] > 2
    True
    >>> hover = adaptive_fmu.linearise("Quadrotor", free=["u[1]"], want={"y[3]": 1}, values={"m": 0.6})
    >>> round(float(hover.operating_point.loc["u[1]", "value"]), 6)
    5.886
    """
    request = ["linearise", "--json", *words("--set", values or {}), *trim(free, want, hold)]
    request += [f"--at={number(at)}"] if at is not None else []
    request += ["--steady-state"] if steady_state else []
    request += [f"--step={number(step)}"] if step is not None else []
    return Linearisation(done([*request, "--", os.fspath(name)]).json())
