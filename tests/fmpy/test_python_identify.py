"""`adaptive_fmu.identify`: records in memory and as files, and models as plants of controllers."""

import json
import os
import tomllib
import warnings
from itertools import pairwise
from pathlib import Path

import adaptive_fmu
import control
import numpy as np
import pandas as pd
import pytest
from adaptive_fmu import _identify
from matplotlib.backends.backend_agg import FigureCanvasAgg
from recorded import SIGNALS, motor, program, record
from sample import NUMBER
from scipy.linalg import expm
from scipy.stats import chi2, kstest

# Some random motors are slow for their records.
pytestmark = pytest.mark.filterwarnings("ignore::adaptive_fmu.ExperimentWarning")
NAMES = {"inputs": ["voltage"], "states": ["speed", "current"]}
COLUMNS = ["time", "voltage", "speed [rad/s]", "current [A]"]
FOR_SPEED = {"outputs": ["speed"], "reference": 50}
BY_COMMAND = ["--outputs", "speed", "--reference", "50", "--no-schema", "--force"]


def frame(seed: int, **further) -> pd.DataFrame:
    """A record of a random motor, with the time as the index."""
    rng = np.random.default_rng(NUMBER + seed)
    return pd.DataFrame(record(rng, *motor(rng), **further), columns=COLUMNS).set_index("time")


@pytest.fixture(scope="module")
def identified() -> adaptive_fmu.Identified:
    return adaptive_fmu.identify(frame(40), **NAMES)


def numbers(found: adaptive_fmu.Identified) -> dict:
    """The model without what tells of its files."""
    return {key: value for key, value in found.to_dict().items() if key != "records"}


def test_records_in_any_form_give_the_bits_that_their_files_give(tmp_path: Path) -> None:
    table = frame(41)
    table.iloc[[100, 101], 1] = np.nan
    table.iloc[200] = np.nan
    table.to_csv(tmp_path / "record.csv")
    ran = program(tmp_path, "identify", "record.csv", *SIGNALS)
    assert ran.returncode == 0, ran.stderr
    expected = json.loads((tmp_path / "model.json").read_text())
    [of] = expected.pop("records")
    column, spans = table.reset_index(), pd.to_timedelta(np.round(1e3 * table.index), unit="ms")
    forms = {
        "index": table,
        "column": column[[*COLUMNS[1:], "time"]],
        "Timedelta": table.set_index(spans),
        "Timestamp": table.set_index(pd.Timestamp("2026-01-01", tz="UTC") + spans),
        "dict": column.to_dict("list"),
        "objects": table.set_index(pd.Index(list(table.index), dtype=object)),
        "structured": column.to_records(index=False),
        "texts": column.assign(note="texts are nothing that a model is of"),
        "path": tmp_path / "record.csv",
        "paths": [str(tmp_path / "record.csv")],
    }
    for form, data in forms.items():
        found = adaptive_fmu.identify(data, **NAMES)
        assert numbers(found) == expected, form
        [own] = found.records
        assert own == of if "path" in form else own == of | {"file": "data", "sha256": own["sha256"]}, form
    # Rows count from 0, as in the table; the file has a line of names.
    texts = list(adaptive_fmu.identify(table, **NAMES).findings["text"])
    assert [text.split(":")[1] for text in texts if text.startswith("data:")] == [" row 200", " row 100, 101"], texts
    assert adaptive_fmu.identify(forms["path"], **NAMES).findings["text"][1].startswith("record.csv: line 102, 103:")


def test_the_time_has_a_name_and_a_unit(tmp_path: Path) -> None:
    table = frame(48, rows=600)
    milliseconds = table.set_index(1e3 * table.index).rename_axis("time [ms]")
    milliseconds.to_csv(tmp_path / "record.csv")
    expected = adaptive_fmu.identify(tmp_path / "record.csv", **NAMES)
    assert expected.sample_time == pytest.approx(0.002)
    for data in (milliseconds, milliseconds.reset_index()):
        assert numbers(adaptive_fmu.identify(data, **NAMES)) == numbers(expected)
    named = adaptive_fmu.identify(milliseconds.rename_axis("t [ms]"), **NAMES, time="t")
    assert numbers(named) == numbers(expected)
    assert numbers(adaptive_fmu.identify(table.rename_axis("t"), **NAMES, time="t")) == numbers(
        adaptive_fmu.identify(table, **NAMES)
    )


def test_several_records_are_those_of_the_command(tmp_path: Path) -> None:
    tables = [frame(42, rows=700), frame(42, rows=900)]
    for number, table in enumerate(tables):
        table.to_csv(tmp_path / f"{number}.csv")
    ran = program(tmp_path, "identify", "0.csv", "1.csv", *SIGNALS)
    assert ran.returncode == 0, ran.stderr
    found = adaptive_fmu.identify(tables, **NAMES)
    expected = json.loads((tmp_path / "model.json").read_text())
    assert numbers(found) == {key: value for key, value in expected.items() if key != "records"}
    assert [one["file"] for one in found.records] == ["data[0]", "data[1]"] and found.offset.shape == (2, 2)
    together = pd.concat([table.reset_index().assign(record=name) for name, table in zip("ab", tables, strict=True)])
    assert numbers(adaptive_fmu.identify(together, **NAMES)) == numbers(found)
    # One of them checks the model.
    table, other = tables
    checked = adaptive_fmu.identify(table, **NAMES, hold_out=other)
    assert numbers(checked) == numbers(adaptive_fmu.identify(table, **NAMES, hold_out=tmp_path / "1.csv"))
    assert numbers(checked) != numbers(adaptive_fmu.identify(table, **NAMES))


def test_a_model_is_what_the_command_writes_and_prints(identified: adaptive_fmu.Identified, tmp_path: Path) -> None:
    found, table = identified, frame(40)
    A, B = motor(np.random.default_rng(NUMBER + 40))
    for name, (matrix, row, column) in zip(found.errors.index, found.free, strict=True):
        assert name == f"{matrix}[{row},{column}]"
        if matrix in "AB":
            true = {"A": A, "B": B}[matrix][row - 1, column - 1]
            assert abs(getattr(found, matrix)[row - 1, column - 1] - true) < 5 * found.errors[name], (NUMBER, name)
    np.testing.assert_allclose(found.errors, np.sqrt(np.diag(found.covariance)))
    np.testing.assert_allclose(np.sort_complex(found.poles["pole"]), np.sort_complex(np.linalg.eigvals(found.A)), rtol=1e-9)
    assert (found.poles["real_error"] > 0).all() and found.sound and found.level == 0.99
    assert found.units == {"speed": "rad/s", "current": "A", "voltage": ""}
    assert (found.fit["held_out"] > 95).all() and list(found.noise.index) == ["speed", "current"]
    for part in ["held_out", "B[2,1]", found.method]:
        assert part in found.report and part in found._repr_html_()
    header = found.report.splitlines()[0].split()
    assert " ".join(header) == "held_out, % windows, % ceiling, % noise unit of noise", header
    assert found.report.splitlines()[2].split()[-2:] == [f"{found.noise['speed']:.6g}", "rad/s"]
    system = found.ss()
    assert isinstance(system, control.StateSpace) and system.state_labels == ["speed", "current"]
    np.testing.assert_array_equal(system.A, found.A)
    assert len(found.plot().axes) == 3
    # As the command writes it, with the record as Python writes it.
    assert found.save(tmp_path / "motor.json").read_text() == found.text and json.loads(found.text) == found.to_dict()
    with pytest.raises(adaptive_fmu.Error, match="Use force=True to overwrite it"):
        found.save(tmp_path / "motor.json")
    found.save(tmp_path / "model.json", force=True)
    table.to_csv(tmp_path / "data.csv")
    assert program(tmp_path, "identify", "data.csv", *SIGNALS, "--out", "own.json").returncode == 0
    own = json.loads((tmp_path / "own.json").read_text())
    assert numbers(found) == {key: value for key, value in own.items() if key != "records"}
    assert (tmp_path / "own.json").read_text().count("\n") == found.text.count("\n")


def test_outputs_alone_give_a_model_of_the_order_that_was_asked_for() -> None:
    found = adaptive_fmu.identify(frame(43, noise=0.002), "voltage", outputs="speed", order=2)
    assert found.states == ["speed", "speed_1"] and list(found.fit.index) == ["speed"] and "outputs only" in found.method
    np.testing.assert_array_equal(found.ss().D, [[0.0]])


def test_structure_is_a_dict_or_a_file(tmp_path: Path) -> None:
    table = frame(44)
    known = {"A": [["?<0", "?>0"], ["?<0", "?<0"]], "B": np.array([[0], ["?>0"]], dtype=object)}
    found = adaptive_fmu.identify(table, **NAMES, structure=known)
    assert found.B[0, 0] == 0.0 and ("B", 1, 1) not in found.free
    (tmp_path / "structure.toml").write_text('A = [["?<0", "?>0"], ["?<0", "?<0"]]\nB = [[0], ["?>0"]]\n')
    assert numbers(adaptive_fmu.identify(table, **NAMES, structure=tmp_path / "structure.toml")) == numbers(found)
    # Numbers of numpy are numbers.
    known["B"] = [[np.int64(0)], np.array(["?>0"])]
    assert numbers(adaptive_fmu.identify(table, **NAMES, structure=known)) == numbers(found)
    # A row in words, of a motor whose current is told as the rate of a charge.
    worded = adaptive_fmu.identify(
        table.assign(angle=0.002 * table["speed [rad/s]"].cumsum().shift(fill_value=0.0)),
        ["voltage"],
        ["angle", "speed", "current"],
        structure={"A": ["angle' = speed", [0, "?", "?"], [0, "?", "?"]]},
    )
    np.testing.assert_array_equal(worded.A[0], [0.0, 1.0, 0.0])


def test_plants_lie_in_the_region(identified: adaptive_fmu.Identified) -> None:
    used = [place for place, (matrix, *_) in enumerate(identified.free) if matrix != "d"]
    inverse = np.linalg.inv(identified.covariance[np.ix_(used, used)])

    def squared(plant: tuple[np.ndarray, np.ndarray]) -> float:
        change = {"A": plant[0] - identified.A, "B": plant[1] - identified.B}
        along = np.array([change[matrix][row - 1, column - 1] for matrix, row, column in (identified.free[k] for k in used)])
        return along @ inverse @ along

    radius = chi2.ppf(identified.level, len(used))
    distances = np.array([squared(plant) for plant in identified.plants(400, seed=NUMBER)])
    np.testing.assert_allclose(distances[::2], radius, rtol=1e-6)
    # The others by the density, those beyond the surface on it.
    within = distances[1::2]
    assert within.max() <= radius * (1 + 1e-6)
    assert kstest(within[within < radius * (1 - 1e-6)], chi2(len(used)).cdf).pvalue > 1e-4, NUMBER
    larger = np.array([squared(plant) for plant in identified.plants(4, seed=NUMBER, margin=3, level=0.9)])
    np.testing.assert_allclose(larger[::2], 9 * chi2.ppf(0.9, len(used)), rtol=1e-6)
    again, other = identified.plants(4, seed=NUMBER), identified.plants(4, seed=NUMBER + 1)
    np.testing.assert_array_equal(again[3][0], identified.plants(400, seed=NUMBER)[3][0])
    assert not np.array_equal(again[3][0], other[3][0])


def test_plants_that_cannot_be_drawn_are_refused(identified: adaptive_fmu.Identified) -> None:
    assert identified.plants(0) == [] and len(identified.plants(np.int64(3))) == 3
    for arguments, reason in [
        ({"n": -1}, "n = -1: must be a whole number, at least 0"),
        ({"n": 2.5}, "n = 2.5: must be a whole number"),
        ({"seed": -1}, "seed = -1: must be a whole number, at least 0"),
        ({"margin": -1}, "margin = -1: must be a finite number above 0"),
        ({"margin": 0.0}, "margin = 0.0: must be"),
        ({"margin": np.nan}, "margin = nan: must be"),
        ({"level": 1}, "level = 1: must be above 0 and below 1"),
    ]:
        with pytest.raises(adaptive_fmu.ArgumentError) as error:
            identified.plants(**arguments)
        assert str(error.value).startswith(reason), error.value


@pytest.mark.parametrize("level", [1e-3, 0.5, 0.9, 0.99, 0.999999])
def test_quantiles_are_those_of_another_program(level: float) -> None:
    found = [_identify.quantile(level, degrees) for degrees in (1, 2, 3, 6, 25, 120)]
    np.testing.assert_allclose(found, chi2.ppf(level, [1, 2, 3, 6, 25, 120]), rtol=1e-9)


def refused(data: object, **arguments: object) -> str:
    with pytest.raises(adaptive_fmu.Error) as error:
        adaptive_fmu.identify(data, **(NAMES | arguments))
    return str(error.value)


def test_what_is_refused_is_reported_in_words_of_python() -> None:
    table = frame(45, rows=400)
    still, doubled, endless = table.copy(), table.reset_index(), table.copy()
    still["voltage"] = 12.0
    doubled.loc[100, "time"] = doubled.loc[99, "time"]
    endless.iloc[7, 1] = np.inf
    expected = {
        "did you mean `voltage`?": refused(table, inputs=["voltag"]),
        "did you mean `speed`?": refused(table, states=["sped", "current"]),
        "fixed=NAME leaves an input out": refused(still),
        "data: row 100: time = ": refused(doubled),
        "data[1]: row 100: time = ": refused([table, doubled]),
        "hold_out: row 100: time = ": refused(table, hold_out=doubled),
        "data: row 7: speed = inf: must be a finite number": refused(endless),
        "With structure fewer entries are unknown": refused(table.head(20)),
        "its index counts the rows": refused(table.reset_index(drop=True)),
        "data[0] has no column `t` for the time": refused([table, table], time="t"),
        "data has the type int": refused(3),
        "must be a record": refused([]),
        "hold_out = 0.95: must be at least 0 and below 90 %": refused(table, hold_out=0.95),
        "invalid value '2' for 'level'": refused(table, level=2),
        "following required arguments were not provided": refused(table, states=None),
        "'states' cannot be used with 'outputs'": refused(table, outputs=["speed"]),
        'structure: line 1, `A = [["?", "maybe"], ["?", "?"]]`': refused(table, structure={"A": [["?", "maybe"], ["?", "?"]]}),
        "structure = 3 is not allowed": refused(table, structure=3),
        "structure = {'A': [{1, 2}]} is not allowed. It must be a dict with A and B, lists": refused(
            table, structure={"A": [{1, 2}]}
        ),
        "delay = 2 numbers": refused(table, delay=[0, 0.1]),
        "nix.csv": refused("nix.csv"),
        "data: time = '0.0': must be a number, or a date: pd.to_datetime": refused(table.set_index(table.index.astype(str))),
        "data: t = '0.0': must be": refused(doubled.assign(t=doubled["time"].astype(str)), time="t"),
        "data: `voltage` is the name of two columns": refused(pd.concat([table, table[["voltage"]]], axis=1)),
        "data: `time` is the name of two columns": refused(pd.concat([doubled, doubled[["time"]]], axis=1)),
        "data has no rows": refused(table.head(0)),
        "hold_out has no rows": refused(table, hold_out={name: [] for name in COLUMNS}),
        "All arrays must be of the same length": refused({"time": [0.0, 1.0], "voltage": [1.0]}),
        "inputs = [0] is not allowed. It must be a name, or a list of names": refused(table, inputs=[0]),
        "states = 3 is not allowed. It must be a name": refused(table, states=3),
    }
    for part, message in expected.items():
        assert part in message and "--" not in message and os.sep + "tmp" not in message, (part, message)


def test_faults_of_records_are_warnings() -> None:
    # Always the same one: of some motors that turn round, no model is left that follows, which is an error.
    table = frame(46 - NUMBER, rows=3000)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert adaptive_fmu.identify(table, **NAMES).sound
    other = table.copy()
    # In the held-out part the motor turns the other way.
    other.iloc[2100:, 1:] *= -1
    with pytest.warns(adaptive_fmu.ExperimentWarning, match="not sound: ") as warned:
        found = adaptive_fmu.identify(other, **NAMES)
    assert not found.sound and "not sound" in repr(found) and "held_out_fit" in set(found.findings["kind"])
    assert warned[0].filename == __file__ and str(warned[0].message) in found.report
    limited = table.assign(voltage=table["voltage"].clip(upper=table["voltage"].quantile(0.75)))
    with pytest.warns(adaptive_fmu.ExperimentWarning, match=r"warning: voltage is at [\d.]+ in"):
        adaptive_fmu.identify(limited, **NAMES)


def ticks(labels: list, axis: int, limits: tuple[float, float]) -> list:
    """The labels of an axis that are drawn."""
    low, high = sorted(limits)
    return [label for label in labels if label.get_text() and low <= label.get_position()[axis] <= high]


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (4, 2), (6, 3)])
def test_a_picture_shows_all_of_it_whatever_the_size(n: int, m: int) -> None:
    rng = np.random.default_rng(NUMBER + n)
    A, rows = rng.normal(size=(n, n)) - 2 * n**0.5 * np.eye(n), 2000
    whole = expm(np.block([[A, rng.normal(size=(n, m))], [np.zeros((m, n + m))]]) * 0.02)
    u, x = rng.uniform(-1, 1, (rows // 20, m)).repeat(20, axis=0), np.zeros((rows, n))
    for k in range(rows - 1):
        x[k + 1] = whole[:n, :n] @ x[k] + whole[:n, n:] @ u[k]
    x += 0.02 * x.std(axis=0) * rng.standard_normal(x.shape)
    inputs, states = [f"drive_{j}_voltage" for j in range(m)], [f"joint_{i}_angular_velocity" for i in range(n)]
    found = adaptive_fmu.identify(
        pd.DataFrame(np.hstack([u, x]), columns=inputs + states, index=0.02 * np.arange(rows)), inputs, states
    )
    figure = found.plot()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    drawn, (fits, poles, errors) = canvas.get_renderer(), figure.axes
    sheet, frames = figure.bbox, [axes.get_window_extent() for axes in figure.axes]
    # Texts lie within the sheet, numbers within their axes, and none of them covers another.
    for axes, frame in zip(figure.axes, frames, strict=True):
        boxes = {
            "across": ticks(axes.get_xticklabels(), 0, axes.get_xlim()),
            "up": ticks(axes.get_yticklabels(), 1, axes.get_ylim()),
            "numbers": [text for text in axes.texts if text.get_text()],
        }
        extents = {kind: [text.get_window_extent(drawn) for text in texts] for kind, texts in boxes.items()}
        others = [
            text.get_window_extent(drawn) for text in (axes.xaxis.label, axes.yaxis.label, axes._left_title) if text.get_text()
        ]
        for box in [*others, *(box for kind in extents.values() for box in kind)]:
            assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= sheet.x1 + 1 and box.y1 <= sheet.y1 + 1, (n, box)
        assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 for box in extents["numbers"]), n
        for kind, of_kind in extents.items():
            for one, other in pairwise(of_kind):
                assert not one.padded(-1).overlaps(other.padded(-1)), (n, axes.get_title(loc="left"), kind)
    legend = fits.get_legend().get_window_extent(drawn)
    assert not any(legend.overlaps(frame) for frame in frames) and not legend.padded(-1).overlaps(
        fits._left_title.get_window_extent(drawn)
    )
    # Each fit and each error has its bar and number, each pole and its errors lie within the limits.
    assert len(fits.texts) == 3 * n and len(errors.texts) == len(found.entries)
    shares = 100 * found.errors / found.entries["value"].abs()
    np.testing.assert_allclose([float(text.get_text()) for text in errors.texts], shares, rtol=0.006)
    assert errors.get_xlim()[0] < shares.min() and shares.max() < errors.get_xlim()[1]
    (left, right), (below, above) = poles.get_xlim(), poles.get_ylim()
    for pole, along, across in found.poles.itertuples(index=False):
        assert (
            left < pole.real - along and pole.real + along < right and below < pole.imag - across and pole.imag + across < above
        )


def test_new_warns_of_a_region_and_of_experiments(tmp_path: Path) -> None:
    # So short and noisy a record leaves too much uncertain for a design.
    with pytest.warns(adaptive_fmu.ExperimentWarning):
        poor = adaptive_fmu.identify(frame(47, rows=150, noise=0.2), **NAMES)
    with pytest.warns(adaptive_fmu.ExperimentWarning, match="^(not sound|warning): ") as warned:
        adaptive_fmu.new("l1", tmp_path / "C.toml", plant=poor, **FOR_SPEED)
    assert warned[0].filename == __file__
    poor.save(tmp_path / "poor.json")
    with pytest.warns(adaptive_fmu.ExperimentWarning):
        adaptive_fmu.new("l1", tmp_path / "D.toml", plant=tmp_path / "poor.json", **FOR_SPEED)
    unstable = [[0.5]], [[1.0]], [[1.0]], [[0.0]]
    with pytest.warns(adaptive_fmu.ExperimentWarning, match="^warning: the plant has an unstable pole"):
        adaptive_fmu.new("excitation", tmp_path / "E.toml", plant=unstable, settling_time=2)
    stable = {"A": [[-1.0, 0.0], [0.0, -1e5]], "B": [[1.0], [1.0]], "C": [[1.0, 0.0]], "u_min": -1, "u_max": 1}
    (tmp_path / "P.json").write_text(json.dumps(stable))
    with pytest.warns(adaptive_fmu.ExperimentWarning) as warned:
        adaptive_fmu.new("excitation", tmp_path / "F.toml", plant=tmp_path / "P.json", amplitude=2)
    assert [str(one.message)[:31] for one in warned] == ["warning: at this step the recor", "warning: u[1] goes from -2 to 2"]
    assert all("--" not in str(one.message) for one in warned)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        adaptive_fmu.new("excitation", tmp_path / "G.toml", plant=tmp_path / "P.json", settling_time=4, step=0.02)
        # A verdict about assumed uncertainty is no fault of a record.
        adaptive_fmu.new("l1", tmp_path / "H.toml", plant=unstable, uncertainty=0.9, bandwidth=2)


@pytest.mark.parametrize("kind", ["pid", "l1"])
def test_a_controller_is_that_of_the_command(identified: adaptive_fmu.Identified, kind: str, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    identified.save(tmp_path / "model.json")
    ran = program(tmp_path, "new", kind, "--name", "C", "--plant", "model.json", "--margin", "2", "--level", "0.95", *BY_COMMAND)
    assert ran.returncode == 0, ran.stderr
    file = adaptive_fmu.new(kind, tmp_path / "own" / "C.toml", plant=identified, margin=2, level=0.95, **FOR_SPEED)
    own, other = (tomllib.loads(path.read_text()) for path in (file, tmp_path / "C.toml"))
    assert own == other and own["nominal"]["margin"] == 2.0 and own["nominal"]["model"] == "model.json"
    report = adaptive_fmu.check(file)
    assert report.sound and report.region["plants tried"] > 200 and report.region["stable up to"] == "2 times the region"


def test_arguments_without_a_use_are_refused(identified: adaptive_fmu.Identified, tmp_path: Path) -> None:
    plain = identified.A, identified.B, identified.C, identified.D
    for kind, plant, arguments, reason in [
        ("reference", identified, {"margin": 2}, "margin = 2: reference doesn't use it"),
        ("pid", plain, {"level": 0.9}, "level = 0.9: needs a plant with the covariance"),
        ("pid", identified, {"margin": 0}, "must be a finite number above 0"),
        ("pid", identified, {"margin": 2, "uncertainty": 0.1}, "cannot be used with"),
        ("pid", identified, {"outputs": ["sped"]}, "plant: outputs = sped: must be one of speed, current"),
        ("pid", identified, {"free": ["voltage"]}, "plant: states, at, step, values, free, want and hold are for an FMU"),
        ("pid", identified, {"hold": "speed"}, "must be a list of names"),
    ]:
        with pytest.raises(adaptive_fmu.Error) as error:
            adaptive_fmu.new(kind, tmp_path / "No.toml", plant=plant, **arguments)
        assert reason in str(error.value) and "--" not in str(error.value), error.value
        assert not (tmp_path / "No.toml").exists()


def test_experiments_are_refused_in_words_of_python(tmp_path: Path) -> None:
    for kind, arguments, reason in [
        ("excitation", {"signal": "chirp"}, ": up_to is missing"),
        ("excitation", {"signal": "noise"}, "'noise' for 'signal'"),
        ("excitation", {"up_to": 0}, "invalid value '0' for 'up_to': must be a finite number above 0"),
        ("excitation", {"amplitude": [1, 2, 3], "inputs": 2}, ": amplitude = 1.0, 2.0, 3.0: must be one number, or 2"),
        ("excitation", {"operating_point": [1, 2], "inputs": 3}, ": operating_point = 1.0, 2.0: must be one number, or 3"),
        ("pid", {}, "settling_time is for an experiment"),
    ]:
        with pytest.raises(adaptive_fmu.Error) as error:
            adaptive_fmu.new(kind, tmp_path / "No.toml", **arguments, settling_time=1)
        assert reason in str(error.value) and "--" not in str(error.value), error.value
        assert not (tmp_path / "No.toml").exists()


def test_design_takes_the_region_of_a_model(identified: adaptive_fmu.Identified, tmp_path: Path) -> None:
    asked = {"settling_time": 0.5, "output": ["speed"], "reference": 50, "kinds": ["pid"]}
    designed = adaptive_fmu.design(plant=identified, **asked, margin=2, level=0.9, out=tmp_path / "design")
    nominal = tomllib.loads(Path(designed.table.loc["pid", "file"]).read_text())["nominal"]
    assert (nominal["margin"], nominal["level"]) == (2.0, 0.9) and designed.sound
    with pytest.raises(adaptive_fmu.ArgumentError, match="cannot be used with"):
        adaptive_fmu.design(identified, **asked, margin=2, uncertainty=0.2, out=tmp_path / "none")


def test_an_fmu_is_a_plant_where_it_is_at_rest(tmp_path: Path) -> None:
    [fmu] = adaptive_fmu.export("Quadrotor", out=tmp_path)
    point = {"free": ["u[1]"], "want": {"y[3]": 1}}
    hover = adaptive_fmu.linearise(fmu, **point)
    file = adaptive_fmu.new("state-space", tmp_path / "Hover.toml", plant=fmu, **point)
    np.testing.assert_allclose(tomllib.loads(file.read_text())["structure"]["A"], hover.A, atol=1e-9)
    start = adaptive_fmu.new("state-space", tmp_path / "Start.toml", plant=fmu)
    assert not np.allclose(tomllib.loads(start.read_text())["structure"]["A"], hover.A, atol=1e-9)
