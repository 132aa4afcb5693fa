"""Records as Parquet and MATLAB files, and what is printed of what was assumed of a file."""

import struct
from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from conftest import read_csv
from recorded import SIGNALS, motor, program, record
from sample import NUMBER

pytestmark = pytest.mark.filterwarnings("ignore::adaptive_fmu.ExperimentWarning")
NAMES = {"inputs": ["voltage"], "states": ["speed", "current"]}
COLUMNS = ["time", "voltage", "speed [rad/s]", "current [A]"]
# Sampled at powers of 2, so that communication points are these times.
STEP = 2.0**-7
PARQUET = {
    "pandas": {},
    "plain": {"compression": "none", "use_dictionary": False},
    "gzip": {"compression": "gzip", "use_dictionary": False, "data_page_version": "2.0"},
    "Zstandard": {"compression": "zstd", "data_page_size": 1000, "row_group_size": 400},
    "differences": {"use_dictionary": False, "column_encoding": {"count": "DELTA_BINARY_PACKED", "short": "DELTA_BINARY_PACKED"}},
    "split": {"use_dictionary": False, "column_encoding": {"voltage": "BYTE_STREAM_SPLIT", "float": "BYTE_STREAM_SPLIT"}},
    "second version": {"data_page_version": "2.0", "version": "2.4", "write_page_checksum": True},
}


def frame(rows: int = 1500) -> pd.DataFrame:
    rng = np.random.default_rng(NUMBER + 900)
    return pd.DataFrame(record(rng, *motor(rng), rows=rows), columns=COLUMNS)


def same(found: adaptive_fmu.Identified, expected: adaptive_fmu.Identified) -> None:
    for name in ("A", "B", "offset", "covariance"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name
    assert found.units == expected.units and found.noise.equals(expected.noise)


def written(table: pd.DataFrame, file: Path, how: str) -> None:
    """A Parquet file with those of the encodings that are for its columns."""
    options = dict(PARQUET[how])
    encodings = {name: encoding for name, encoding in options.pop("column_encoding", {}).items() if name in table}
    pq.write_table(pa.Table.from_pandas(table), file, **options, **({"column_encoding": encodings} if encodings else {}))


def read_back(folder: Path, file: str) -> np.ndarray:
    """The numbers of a column `y[1]`, as a comparison with an FMU's output of this name shows them."""
    ran = program(folder, "simulate", "StateSpace", "--input", file, "--compare", "y[1]", "--step", str(STEP), "--out", "results")
    assert ran.returncode == 0, ran.stderr
    return read_csv(folder / "results" / "StateSpace" / "result.csv")["y[1]_recorded"]


@pytest.mark.parametrize("how", PARQUET)
def test_numbers_of_parquet_arrive_to_the_bit(how: str, tmp_path: Path) -> None:
    """Reals and integers of all kinds in all encodings, with values that are missing where nothing is asked of them."""
    rng = np.random.default_rng(NUMBER + 901)
    rows = 1000
    table = pd.DataFrame({"time": STEP * np.arange(rows), "voltage": rng.standard_normal(rows) * 10.0 ** rng.integers(-90, 90, rows)})
    table["levels"] = rng.choice(rng.standard_normal(7), rows)
    table["float"] = rng.standard_normal(rows).astype(np.float32)
    table["count"] = np.cumsum(rng.integers(-1000, 1000, rows))
    table["short"] = rng.integers(-100, 100, rows).astype(np.int32)
    table["large"] = rng.integers(2**31, 2**32, rows).astype(np.uint32)
    table["on"] = rng.uniform(size=rows) > 0.5
    table["few"] = np.where(rng.uniform(size=rows) > 0.3, table["voltage"], np.nan)
    table["text"] = rng.choice(["a", "b"], rows)
    written(table, tmp_path / "table.parquet", how)
    for name in table.columns[1:-1]:
        # One at a time.
        one = pq.read_table(tmp_path / "table.parquet", columns=["time", name]).rename_columns(["time", "y[1]"])
        options = {key: value for key, value in PARQUET[how].items() if key != "column_encoding"}
        if encoding := PARQUET[how].get("column_encoding", {}).get(name):
            options["column_encoding"] = {"y[1]": encoding}
        pq.write_table(one, tmp_path / "one.parquet", **options)
        np.testing.assert_array_equal(read_back(tmp_path, "one.parquet"), table[name].to_numpy(dtype=float), err_msg=f"{name} {NUMBER}")
    options = ["--inputs", "voltage", "--states", "levels,few", "--out", "model.json", "--force", "--verbose"]
    answer = program(tmp_path, "identify", "table.parquet", *options)
    assert "table.parquet: left out: text: has texts, not numbers" in answer.stderr
    assert "the time is the column `time`, in s" in answer.stderr


def test_records_give_the_same_model_from_any_file(tmp_path: Path) -> None:
    table = frame()
    expected = adaptive_fmu.identify(table, **NAMES)
    table.to_parquet(tmp_path / "plain.parquet", index=False)
    # pandas writes an index behind the other columns.
    table.set_index("time").to_parquet(tmp_path / "index.parquet")
    table.set_axis(table["time"].rename(None), axis=0).drop(columns="time").to_parquet(tmp_path / "nameless.parquet")
    vectors = {name.split(" ")[0]: values.to_numpy() for name, values in table.items()}
    units = {"speed": "rad/s", "current": "A"}
    scipy.io.savemat(tmp_path / "v5.mat", vectors | {"Ts": 0.002, "note": "of a bench", "units": units})
    scipy.io.savemat(tmp_path / "v7.mat", {name: values[:, None] for name, values in vectors.items()} | {"units": units}, do_compression=True)
    scipy.io.savemat(tmp_path / "struct.mat", {"data": vectors, "units": units}, do_compression=True)
    for name in ("plain.parquet", "index.parquet", "nameless.parquet", "v5.mat", "v7.mat", "struct.mat"):
        same(adaptive_fmu.identify(tmp_path / name, **NAMES), expected)
    # A file of records that check the model, and a design from a file.
    first, last = table[:1000], table[1000:]
    last.to_parquet(tmp_path / "last.parquet", index=False)
    with_hold_out = adaptive_fmu.identify(first, **NAMES, hold_out=tmp_path / "last.parquet")
    same(with_hold_out, adaptive_fmu.identify(first, **NAMES, hold_out=last))
    assert program(tmp_path, "new", "state-space", "--name", "Own", "--data", "v7.mat", *SIGNALS).returncode in (0, 3)
    with pytest.raises(adaptive_fmu.ArgumentError, match="plant is a record"):
        adaptive_fmu.design(tmp_path / "v5.mat", settling_time=1)


def test_parameters_are_estimated_from_these_files(tmp_path: Path) -> None:
    table = frame(400)
    model = adaptive_fmu.identify(table, **NAMES)
    plant = adaptive_fmu.new("state-space", tmp_path / "Plant.toml", plant=model)
    given = {"inputs": ["voltage"], "outputs": ["speed", "current"], "free": ["B[2,1]"]}
    expected = adaptive_fmu.estimate(plant, table, **given)
    table.to_parquet(tmp_path / "record.parquet")
    scipy.io.savemat(tmp_path / "record.mat", {name.split(" ")[0]: values.to_numpy() for name, values in table.items()})
    for name in ("record.parquet", "record.mat"):
        assert adaptive_fmu.estimate(plant, tmp_path / name, **given).values == expected.values


def test_times_of_pandas_are_seconds_and_labels_divide(tmp_path: Path) -> None:
    table = frame()
    # Times of whole ms are the same after division.
    expected = adaptive_fmu.identify(table, **NAMES)
    ms = (table["time"] * 1000).round().astype(int)
    for unit in ("ms", "us", "ns"):
        dated = table.assign(time=pd.Timestamp("2026-03-01") + pd.to_timedelta(ms, unit="ms").astype(f"timedelta64[{unit}]"))
        dated["time"] = dated["time"].astype(f"datetime64[{unit}]")
        dated.to_parquet(tmp_path / "dated.parquet", index=False)
        spans = table.assign(time=pd.to_timedelta(ms, unit="ms").astype(f"timedelta64[{unit}]"))
        spans.to_parquet(tmp_path / "spans.parquet", index=False)
        for name in ("dated.parquet", "spans.parquet"):
            found = adaptive_fmu.identify(tmp_path / name, **NAMES)
            np.testing.assert_allclose(found.A, expected.A, rtol=1e-6)
    parts = np.where(np.arange(len(table)) < 700, "first", "second")
    expected = adaptive_fmu.identify(table.assign(record=parts), **NAMES)
    table.assign(record=parts).to_parquet(tmp_path / "parts.parquet", index=False)
    table.assign(record=np.arange(len(table)) // 700 % 2 + 1)[:1400].to_parquet(tmp_path / "numbered.parquet", index=False)
    vectors = {name.split(" ")[0]: values.to_numpy() for name, values in table.items()}
    scipy.io.savemat(tmp_path / "parts.mat", vectors | {"record": parts.astype(object)[:, None], "units": {"speed": "rad/s", "current": "A"}})
    for name in ("parts.parquet", "parts.mat"):
        found = adaptive_fmu.identify(tmp_path / name, **NAMES)
        same(found, expected)
        assert [of["file"].removeprefix(f"{name}, ") for of in found.records] == ["record first", "record second"]
    assert len(adaptive_fmu.identify(tmp_path / "numbered.parquet", **NAMES).records) == 2


def test_results_are_read_back_to_the_bit(tmp_path: Path) -> None:
    """What `Result.to_mat`, `Result.to_parquet` and `run --parquet` write, with the names of the signals and their units."""
    loop = adaptive_fmu.Loop("3.3.1-case2")
    result = loop.run(until=0.5)
    data = result.data.rename(columns={name: f"{name} [{unit}]" for name, unit in result.units.items() if unit})
    data = data.rename_axis("time").reset_index()
    names = {"inputs": ["controller.u[1]", "controller.u[2]"], "states": [f"plant.x[{k + 1}]" for k in range(4)], "hold_out": 0.0}
    assert set(names["inputs"] + names["states"]) <= set(result.data.columns)
    expected = adaptive_fmu.identify(data, **names)
    without_units = adaptive_fmu.identify(result.data.rename_axis("time").reset_index(), **names)
    same(adaptive_fmu.identify(result.to_mat(tmp_path / "result.mat"), **names), expected)
    same(adaptive_fmu.identify(result.to_parquet(tmp_path / "result.parquet"), **names), without_units)
    ran = program(tmp_path, "run", "3.3.1-case2", "--until", "0.5", "--parquet", "--out", "results")
    assert ran.returncode in (0, 3), ran.stderr
    same(adaptive_fmu.identify(tmp_path / "results" / "3.3.1-case2" / "result.parquet", **names), expected)


def test_odd_names_are_read_back(tmp_path: Path) -> None:
    from adaptive_fmu._files import write_mat

    names = ["time.x", "a-b.y[1]", "a_b.y[2]", "p.K[1,1]", "p.K[2,2]", "p.é", "units.u", "7 8", "x_m", "x.m", "x", "q.z[1]", "names.w[1,1]"]
    rng = np.random.default_rng(NUMBER + 902)
    data = pd.DataFrame(rng.standard_normal((200, len(names))), columns=names, index=STEP * np.arange(200))
    write_mat(tmp_path / "odd.mat", data, {name: "rad" for name in names})
    table = data.rename(columns={name: f"{name} [rad]" for name in names}).rename_axis("time").reset_index()
    for name in names:
        other = [own for own in names if own != name][:2]
        asked = {"inputs": [name], "states": other, "hold_out": 0.0}
        if "," in name or any("," in own for own in other):
            asked = {"inputs": ["x"], "states": ["x.m", "x_m"], "hold_out": 0.0}
        same(adaptive_fmu.identify(tmp_path / "odd.mat", **asked), adaptive_fmu.identify(table, **asked))


def test_matlab_files_that_are_not_read_are_refused_with_advice(tmp_path: Path) -> None:
    time = np.arange(10.0)
    cells = np.empty((2, 1), dtype=object)
    cells[:, 0] = [time, "text"]
    many = np.array([(time,), (time,)], dtype=[("u", object)])
    for variables, reason in [
        ({"c": cells}, "c is a cell array: save its parts as numeric vectors"),
        ({"s": many}, "s is an array of 2 structs"),
        ({"z": 1j * time}, "z is complex"),
        ({"text": "only"}, "must have numeric vectors of equal length, of which `time` is the time"),
    ]:
        scipy.io.savemat(tmp_path / "wrong.mat", variables)
        with pytest.raises(adaptive_fmu.Error) as error:
            adaptive_fmu.identify(tmp_path / "wrong.mat", **NAMES)
        assert reason in str(error.value) and "wrong.mat" in str(error.value)
    scipy.io.savemat(tmp_path / "old.mat", {"time": time}, format="4")
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    (tmp_path / "text.parquet").write_text("time,u\n0,1\n")
    for name, reason in [("old.mat", "version 4"), ("new.mat", "'-v7'"), ("text.parquet", "is not a Parquet file")]:
        answer = program(tmp_path, "simulate", "StateSpace", "--input", name)
        assert answer.returncode == 1 and reason in answer.stderr and name in answer.stderr, answer.stderr
    # Next to variables that are read, they are left out with a note.
    some = {"time": time, "c": cells, "Ts": 1.0}
    scipy.io.savemat(tmp_path / "some.mat", some)
    answer = program(tmp_path, "simulate", "StateSpace", "--input", "some.mat", "--verbose")
    assert "some.mat: left out: c is a cell array" in answer.stderr and "Ts (1×1) is left out: it has no 10 rows" in answer.stderr
    scipy.io.savemat(tmp_path / "some.mat", some | {"u": time[:, None]})
    answer = program(tmp_path, "simulate", "StateSpace", "--input", "some.mat")
    assert "the FMU has no input `u`; did you mean `u[1]`?" in answer.stderr and "line 1" not in answer.stderr


def test_wrong_rows_are_refused_by_their_number(tmp_path: Path) -> None:
    for times, values, reason in [
        ([0.0, 1.0, 0.5], [0.0, 1.0, 2.0], "row 3: time = 0.5: must not be before the time of the row before"),
        ([0.0, 1.0, np.nan], [0.0, 1.0, 2.0], "row 3: time must be a finite number"),
        ([0.0, 1.0, 2.0], [0.0, np.inf, 2.0], "row 2: u[1] = inf: must be a finite number"),
    ]:
        pd.DataFrame({"time": times, "u[1]": values}).to_parquet(tmp_path / "wrong.parquet", index=False)
        assert reason in program(tmp_path, "simulate", "StateSpace", "--input", "wrong.parquet").stderr


def test_what_was_assumed_of_a_file_is_printed_with_verbose(tmp_path: Path) -> None:
    text = "t [ms];u[1];on\n0;0,5;true\n500;1;false\n500;2,5;true\n1000;1;true\n"
    (tmp_path / "input.csv").write_text(text.replace(";on", "").replace(";true", "").replace(";false", ""))
    answer = program(tmp_path, "simulate", "StateSpace", "--input", "input.csv", "--verbose", "--until", "1")
    assert answer.returncode == 0, answer.stderr
    for line in [
        "the separator is `;`, the decimal mark is `,`",
        "the time is the column `t`, in ms",
        "jumps, since two rows have the same time: 0.5 s",
        "interpolated linearly: u[1]",
    ]:
        assert f"input.csv: {line}\n" in answer.stderr, answer.stderr
    assert "input.csv" not in program(tmp_path, "simulate", "StateSpace", "--input", "input.csv", "--until", "1").stderr
    # Units, held inputs and parameters.
    tunable = "time\tenabled\tadaptation_gain\nms\t\t\n0\ttrue\t100\n1\tfalse\t200\n"
    (tmp_path / "tunable.csv").write_text(tunable)
    answer = program(tmp_path, "simulate", "L1NonlinearSiso", "--input", "tunable.csv", "--verbose", "--until", "0.01")
    for line in ["the separator is a tab", "line 2 has the units of measurement", "true is 1, false is 0", "zero-order hold: enabled"]:
        assert f"tunable.csv: {line}\n" in answer.stderr, answer.stderr
    assert "tunable.csv: set parameters, from row to row: adaptation_gain\n" in answer.stderr, answer.stderr
    table = frame().rename(columns={"speed [rad/s]": "speed [rpm]"})
    table.loc[[3, 5], "speed [rpm]"] = np.nan
    table.assign(record=1).to_csv(tmp_path / "record.csv", index=False)
    answer = program(tmp_path, "identify", "record.csv", *SIGNALS, "--verbose")
    for line in [
        "the separator is `,`, the decimal mark is `.`",
        "missing values (empty cells or NaN): 2",
        "the time is the column `time`, in s",
        "the column `record` divides it: 1 record",
    ]:
        assert f"record.csv: {line}\n" in answer.stderr, answer.stderr
    assert "speed was converted from rpm to rad/s" in answer.stderr


def memory(process: int) -> int:
    """Largest memory of a process, MiB."""
    [line] = [line for line in Path(f"/proc/{process}/status").read_text().splitlines() if line.startswith("VmHWM")]
    return int(line.split()[1]) // 1024


def test_damaged_files_never_end_the_program(tmp_path: Path) -> None:
    """Bytes that changed, parts that are cut off, and sizes that are made large, in all encodings."""
    from adaptive_fmu import _pool

    rng = np.random.default_rng(NUMBER + 903)
    table = frame(60).assign(record="a", count=np.arange(60))
    files = [tmp_path / f"{how}.parquet" for how in PARQUET]
    for how, file in zip(PARQUET, files, strict=True):
        written(table, file, how)
    vectors = {name.split(" ")[0]: values.to_numpy() for name, values in table.items() if name != "record"}
    for compressed in (False, True):
        files.append(tmp_path / f"{compressed}.mat")
        scipy.io.savemat(files[-1], {"s": vectors, "time": vectors["time"], "units": {"s": {"speed": "V"}}}, do_compression=compressed)
    refused = read = 0
    for file in files:
        whole = file.read_bytes()
        for _ in range(150):
            bytes_ = bytearray(whole)
            match rng.integers(4):
                case 0:
                    del bytes_[rng.integers(len(bytes_)) :]
                case 1:
                    place = rng.integers(len(bytes_) - 4)
                    bytes_[place : place + 4] = struct.pack("<I", rng.choice([2**31 - 1, 2**32 - 1, 2**20, 0, 2**28]))
                case 2:
                    # The metadata of Parquet.
                    for place in len(bytes_) - 1 - rng.integers(8, min(1500, len(bytes_)), 3):
                        bytes_[place] = rng.integers(256)
                case _:
                    for place in rng.integers(len(bytes_), size=rng.integers(1, 5)):
                        bytes_[place] = rng.integers(256)
            broken = tmp_path / f"broken{file.suffix}"
            broken.write_bytes(bytes_)
            # What can be read lacks this column.
            with pytest.raises(adaptive_fmu.Error) as error:
                adaptive_fmu.identify(broken, ["nothing"], ["speed"])
            message = str(error.value)
            assert "The program" not in message, (file, NUMBER, message)
            read += "nothing" in message
            refused += "nothing" not in message
    assert refused > 100 and read > 20, (refused, read)
    # 32 MiB, and what the program takes by itself.
    assert memory(_pool._idle[-1].process.pid) < 250
