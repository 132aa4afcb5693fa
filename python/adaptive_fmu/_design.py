"""From a plant to the recommended controller."""

from __future__ import annotations

import html
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ._errors import ArgumentError, Error
from ._identify import Identified, identify
from ._loop import Loop
from ._plant import is_record, plant_file
from ._pool import done
from ._units import export
from ._values import PathLike, Value, number, numbers, shown, trim

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Designed:
    """Controllers for a plant, the recommended one first.

    >>> import adaptive_fmu
    >>> plant = [[-1.0]], [[2.0]], [[1.0]], [[0.0]]
    >>> designed = adaptive_fmu.design(plant, settling_time=1.0, kinds=["pid", "ladrc"], out=folder / "first")
    >>> designed.sound, sorted(designed.table.index)
    (True, ['ladrc', 'pid'])
    """

    def __init__(self, answer: dict[str, Any], folder: Path, identified: Identified | None = None) -> None:
        #: Candidates as the command `design` prints them as JSON, the recommended one first; `summary` describes one in words.
        self.candidates: list[dict[str, Any]] = answer["candidates"]
        #: Model that was identified, if the plant was given as records; else None.
        self.identified: Identified | None = identified
        rows = [row(candidate) for candidate in answer["candidates"]]
        #: One row a kind of controller, the recommended one first: sound, settling_time (s), worst_settling_time, overshoot (a part
        #: of the step), worst_overshoot, peak (largest size of a control with the worst plant), noise (largest standard deviation of
        #: a control at rest, if `noise` is given), operations, file, and refused (why there is no controller, or why it isn't sound
        #: or wasn't compared).
        self.table: pd.DataFrame = pd.DataFrame(rows).set_index("kind")
        #: True if the recommended controller is sound.
        self.sound: bool = bool(answer["candidates"][0].get("sound"))
        #: Verdict of the recommended controller: sound, not compared (its runs would take long) or not sound.
        self.verdict: str = answer["candidates"][0]["verdict"]
        #: Folder with the descriptions, the loop and the page.
        self.folder: Path = folder
        #: Page with a table and step responses.
        self.page: Path = folder / "index.html"

    @property
    def loop(self) -> Loop:
        """Loop of the recommended controller with the linear plant.

        >>> import adaptive_fmu
        >>> plant = [[-1.0]], [[2.0]], [[1.0]], [[0.0]]
        >>> designed = adaptive_fmu.design(plant, settling_time=1.0, kinds=["pid"], out=folder / "second")
        >>> designed.loop.run().data.shape[1] > 2
        True
        """
        return Loop(self.folder / "loop")

    def export(self, *, out: PathLike = "fmus", **options: Any) -> list[Path]:
        """Export the recommended controller as an FMU and return the paths of the files; see `adaptive_fmu.export`.

        out: folder for the FMU. Default: "fmus".
        **options: further arguments of `adaptive_fmu.export`, such as `source=True`.

        >>> import adaptive_fmu
        >>> plant = [[-1.0]], [[2.0]], [[1.0]], [[0.0]]
        >>> designed = adaptive_fmu.design(plant, settling_time=1.0, kinds=["pid"], out=folder / "exported")
        >>> [file.name for file in designed.export(out=folder)]
        ['Pid.fmu']
        """
        file = self.table["file"].iloc[0]
        if file is None:
            raise Error("There is no controller to export: `table` has the reasons in the column `refused`")
        return export(file, out=out, **options)

    def plot(self) -> Figure:
        """Return the plots of a run of `loop` as a figure of matplotlib's pyplot.

        >>> import adaptive_fmu
        >>> plant = [[-1.0]], [[2.0]], [[1.0]], [[0.0]]
        >>> designed = adaptive_fmu.design(plant, settling_time=1.0, kinds=["pid"], out=folder / "plotted")
        >>> len(designed.plot().axes) > 0
        True
        """
        return self.loop.run().plot()

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the table, and what is to be known of the recommended controller."""
        first = self.candidates[0]
        notes = [text for text in (first.get("summary"), first.get("reason"), *(first.get("notes") or [])) if text]
        lines = "".join(f"<li>{html.escape(text)}</li>" for text in notes)
        head = f"<p><b>{html.escape(first['kind'])}</b>: {self.verdict}</p>"
        table = self.table.drop(columns="file").dropna(axis=1, how="all").to_html(float_format=shown, na_rep="")
        return f"{head}<ul>{lines}</ul>{table}"

    def __repr__(self) -> str:
        first = self.table.index[0]
        return f"<{first}: {self.verdict}, {len(self.table)} kinds tried>"


def row(candidate: dict[str, Any]) -> dict[str, Any]:
    """Row of the table for a candidate."""
    nominal, worst = candidate.get("nominal") or {}, candidate.get("worst") or {}
    files = candidate.get("files") or [None]
    return {
        "kind": candidate["kind"],
        "sound": candidate.get("sound", False),
        "settling_time": nominal.get("settling_time"),
        "worst_settling_time": worst.get("settling_time"),
        "overshoot": nominal.get("overshoot"),
        "worst_overshoot": worst.get("overshoot"),
        "peak": max(worst.get("peaks") or [float("nan")]),
        "noise": max(candidate.get("noise") or [float("nan")]),
        "operations": candidate.get("operations"),
        "file": files[0],
        "refused": candidate.get("refused") or candidate.get("reason"),
    }


def design(
    plant: Any,
    *,
    settling_time: float | None = None,
    bandwidth: float | None = None,
    output: Sequence[str] = (),
    inputs: Sequence[str] = (),
    states: Sequence[str] | None = None,
    measured: Sequence[str] | None = None,
    uncertainty: float | None = None,
    margin: float | None = None,
    level: float | None = None,
    free: Sequence[str] = (),
    want: Mapping[str, Value] | None = None,
    hold: Sequence[str] = (),
    kinds: Sequence[str] = (),
    reference: float | Sequence[float] = 1.0,
    noise: float | dict[str, float] | None = None,
    out: PathLike = "design",
    force: bool = False,
) -> Designed:
    """Design controllers of several kinds for a plant, simulate them as FMUs, and return them ranked.

    Each is simulated with the nominal plant and with the plants within the uncertainty that are worst for it. The first is sound,
    settles in time with the worst plant, and has the smallest peak of the control.

    plant: as for `new`; or a record, or several, as `identify` takes them, with `inputs` and `states`: the model is identified first.
    settling_time: time in which the nominal loop is to settle to 2 % of a step of the reference, s.
    bandwidth: bandwidth of the loop, in place of one that follows from `settling_time`, rad/s. One of both must be given.
    output: names of the outputs to control, as many as inputs. Default: all.
    inputs: names of the inputs to use. Default: all.
    states: names of the columns of a record that are the states. Default: None, the plant is no record.
    measured: names of the states that are measured, in addition to the outputs. Default: None, all are measured.
    uncertainty: uncertainty of each number of A and B as a part of it. Default: 0.2 for 20 %; an identified plant has its own.
    margin: factor of the region of an identified plant, for wear and other loads. Default: 3.
    level: confidence level of that region. Default: that of the model.
    free, want, hold: operating point at which an FMU is linearised, as for `linearise`.
    kinds: kinds of controllers to try, such as "pid" or "l1". Default: all that `design` knows.
    reference: usual magnitude of the reference, in the output's unit of measurement, or of each reference. Default: 1.
    noise: standard deviation of the noise of all measured signals, or of some of them by name. Default: None, no noise.
    out: folder for descriptions (NAME.toml), the loop of the recommended controller and a page. Default: "design".
    force: True to overwrite existing files. Default: False.

    Raises `Error` if no controller can be designed for the plant, or if a file exists and `force` is False.

    >>> import adaptive_fmu, control
    >>> plant = control.tf([1], [1, 1, 0])
    >>> adaptive_fmu.design(plant, settling_time=5, kinds=["pid"], out=folder / "third")
    <pid: sound, 1 kinds tried>
    """
    identified = None
    if states is not None:
        identified = plant = identify(plant, inputs, states)
    elif is_record(plant):
        raise ArgumentError(
            "plant is a record: give the names of its columns that are states as `states`, of its inputs as `inputs`"
        )
    folder = Path(out)
    request = [
        "design",
        "--json",
        f"--out={os.fspath(folder)}",
        f"--reference={numbers(reference)}",
    ]
    known = (("--settling-time", settling_time), ("--bandwidth", bandwidth), ("--uncertainty", uncertainty))
    for option, value in (*known, ("--margin", margin), ("--level", level)):
        request += [f"{option}={number(value)}"] if value is not None else []
    request += trim(free, want, hold)
    for option, names in (("--output", output), ("--inputs", inputs), ("--measured", measured), ("--kinds", kinds)):
        request += [f"{option}={','.join(names)}"] if names else []
    every = noise if isinstance(noise, dict) else {"": noise}
    request += [f"--noise={f'{name}=' if name else ''}{number(value)}" for name, value in every.items() if value is not None]
    request += ["--force"] if force else []
    with plant_file(plant) as given:
        return Designed(done([*request, "--", given]).json(), folder, identified)
