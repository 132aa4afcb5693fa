"""Functions for comparisons and checks in Python, designs from records, results as files, tables that are shown whole."""

import json
import subprocess
import sys
import tomllib
import urllib.request
import zipfile
from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pytest
import scipy.io
from conftest import ROOT
from recorded import program

LOOP = "3.2.1-cosine"
MOTOR = ROOT / "examples/records/motor.csv"


def test_compare_is_what_the_runs_are(tmp_path: Path) -> None:
    loop = adaptive_fmu.Loop(LOOP)
    values = {"controller.adaptation_gain": 2000.0, "plant.x0": [0.1, -0.1]}
    table = adaptive_fmu.compare(loop, (loop, values), until=6, out=tmp_path / "out")
    assert (tmp_path / "out/comparison/index.html").is_file()
    for column, result in zip(table.columns[1:], [loop.run(until=6), loop.run(until=6, values=values)], strict=True):
        assert table[column].to_dict() == result.metrics["value"].to_dict() and column.startswith(LOOP)
        assert table["limit"].to_dict() == result.metrics["limit"].to_dict()
    # Earlier results, in their folder.
    again = adaptive_fmu.compare(tmp_path / "out" / LOOP, (LOOP, {"plant.omega": 3.0}), until=6)
    assert again[again.columns[1]].to_list() == table[table.columns[1]].to_list()
    with pytest.raises(adaptive_fmu.Error, match="failed at t ="):
        adaptive_fmu.compare(LOOP, (LOOP, {"controller.adaptation_gain": 1e4, "plant.omega_variation": 1e6}), until=60)
    with pytest.raises(adaptive_fmu.Error, match="nix"):
        adaptive_fmu.compare(LOOP, (LOOP, {"plant.nix": 1}))


def test_validate_lists_what_is_wrong_in_an_fmu(tmp_path: Path) -> None:
    [file] = adaptive_fmu.export("NonlinearSiso", out=tmp_path)
    assert adaptive_fmu.validate(file).empty
    with zipfile.ZipFile(file) as archive, zipfile.ZipFile(tmp_path / "Bad.fmu", "w") as bad:
        for name in archive.namelist():
            data = archive.read(name)
            bad.writestr(name, data.replace(b'variability="continuous"', b'variability="often"', 1) if name.endswith(".xml") else data)
    found = adaptive_fmu.validate(tmp_path / "Bad.fmu", run=False)
    output = json.loads(program(tmp_path, "validate", "Bad.fmu", "--no-run", "--json").stdout)
    assert found.to_dict("records") == [{key: each[key] for key in found.columns} for each in output["findings"]] and len(found) > 0
    assert found["what"].str.contains("often").any() and set(found["severity"]) == {"error"}
    with pytest.raises(adaptive_fmu.Error, match=r"Gone\.fmu"):
        adaptive_fmu.validate(tmp_path / "Gone.fmu")


def test_claims_of_the_thesis_and_pairs_of_the_league(tmp_path: Path) -> None:
    claims = adaptive_fmu.report("3.2.1", out=tmp_path / "report")
    assert claims["holds"].all() and set(claims["example"]) == {"3.2.1"} and (tmp_path / "report").is_dir()
    pairs = adaptive_fmu.league(["siso/pid"], quick=True, out=tmp_path / "league")
    again = adaptive_fmu.league("siso/pid", quick=True, out=tmp_path / "league", resume=True)
    pd.testing.assert_frame_equal(pairs, again)
    assert len(pairs.columns) > 5 and (tmp_path / "league/index.html").is_file()
    for arguments in ({"only": "siso/nix"}, {"only": "siso/pid", "resume": True}):
        with pytest.raises(adaptive_fmu.Error):
            adaptive_fmu.league(**arguments, quick=True)


def test_a_loop_is_explored_until_it_is_stopped() -> None:
    with adaptive_fmu.explore(adaptive_fmu.Loop(LOOP), open=False) as explored:
        assert explored.url in explored._repr_html_().replace("&amp;", "&")
        page = urllib.request.urlopen(explored.url, timeout=20).read().decode()
        assert "explore.js" in page
    with pytest.raises(OSError):
        urllib.request.urlopen(explored.url, timeout=5)
    with pytest.raises(adaptive_fmu.Error, match="there is no loop named `nix`"):
        adaptive_fmu.explore("nix", open=False)


def test_a_design_from_a_record(tmp_path: Path) -> None:
    asked = {"inputs": ["voltage"], "output": ["speed"], "reference": 50, "settling_time": 0.5, "kinds": ["pid"], "margin": 1}
    record = pd.read_csv(MOTOR, index_col="time")
    record.columns = [name.split(" ")[0] for name in record.columns]
    designed = adaptive_fmu.design(record, **asked, states=["speed", "current"], out=tmp_path / "design")
    motor = adaptive_fmu.identify(record, ["voltage"], ["speed", "current"])
    by_hand = adaptive_fmu.design(motor, **asked, out=tmp_path / "by hand")
    assert designed.identified is not None and np.array_equal(designed.identified.A, motor.A)
    assert designed.table.drop(columns="file").equals(by_hand.table.drop(columns="file")) and by_hand.identified is None
    assert designed.candidates[0]["kind"] == "pid" and designed.sound
    html = designed._repr_html_()
    assert "<b>pid</b>: sound" in html and designed.candidates[0]["summary"].split(";")[0] in html
    [file] = designed.export(out=tmp_path)
    assert file.name == "Pid.fmu" and adaptive_fmu.validate(file, run=False).empty
    assert len(designed.plot().axes) >= 1
    for no_states in (record, dict(record.items()), [record, record], MOTOR):
        with pytest.raises(adaptive_fmu.ArgumentError, match="plant is a record: give the names of its columns that are states"):
            adaptive_fmu.design(no_states, **asked, out=tmp_path / "none")


def test_new_takes_the_operating_point_of_an_fmu(tmp_path: Path) -> None:
    """By the same arguments as linearise."""
    point = {"at": 0.5, "values": {"u[1]": 0.3, "omega": 2.0}}
    linear = adaptive_fmu.linearise("NonlinearSiso", **point)
    [fmu] = adaptive_fmu.export("NonlinearSiso", out=tmp_path)
    of_fmu = adaptive_fmu.new("pid", tmp_path / "C.toml", plant=fmu, outputs=["y[1]"], **point)
    nominal = tomllib.loads(of_fmu.read_text())["nominal"]
    np.testing.assert_allclose(nominal["A"], linear.A, rtol=1e-6)
    assert not np.allclose(adaptive_fmu.linearise("NonlinearSiso", at=0.5).A, linear.A)
    with pytest.raises(adaptive_fmu.Error) as error:
        adaptive_fmu.new("pid", tmp_path / "D.toml", plant=fmu, values={"nix": 1})
    assert "nix" in str(error.value) and "--" not in str(error.value)


def test_tables_of_names_are_shown_whole() -> None:
    for table in (adaptive_fmu.loops(), adaptive_fmu.fmus(), adaptive_fmu.kinds()):
        assert isinstance(table, pd.DataFrame) and len(table) > 20
        for text in (repr(table), table._repr_html_()):
            assert text is not None and "..." not in text
            assert all(name in text for name in table.index)
        # Parts of it are tables like any other.
        assert type(table.head(3)) is pd.DataFrame
    assert adaptive_fmu.loops().loc["3.2.1-square", "description"].split(",")[-1] in repr(adaptive_fmu.loops())


def test_results_are_files_of_other_tools(tmp_path: Path) -> None:
    result = adaptive_fmu.Loop("3.3.1-case2").run(until=0.5)
    mat = scipy.io.loadmat(result.to_mat(tmp_path / "result.mat"), simplify_cells=True)
    np.testing.assert_array_equal(mat["time"], result.data.index)
    for k in range(4):
        np.testing.assert_array_equal(mat["plant"]["x"][:, k], result.data[f"plant.x[{k + 1}]"])
    assert mat["plant"]["x"].shape == (len(result.data), 4) and mat["units"]["controller"]["u"] == result.units["controller.u[1]"]
    assert mat["units"]["plant"]["x"].tolist() == [result.units[f"plant.x[{k + 1}]"] for k in range(4)]
    assert mat["names"]["plant"]["x"] == "plant.x[1]"
    columns = sum(
        value.shape[1] if value.ndim > 1 else 1
        for name, part in mat.items()
        if name not in {"time", "units", "names"} and not name.startswith("__")
        for value in (part.values() if isinstance(part, dict) else [part])
    )
    assert columns == result.data.shape[1]
    back = pd.read_parquet(result.to_parquet(tmp_path / "result.parquet")).set_index("time")
    pd.testing.assert_frame_equal(back, result.data)


def test_names_that_matlab_does_not_know_stay_apart(tmp_path: Path) -> None:
    """Matrices, names with other characters, and components that are called as what else there is."""
    from adaptive_fmu._files import write_mat

    names = ["time.x", "a-b.y[1]", "a_b.y[2]", "p.K[1,1]", "p.K[2,2]", "p.é", "units.u", "7", "x_m", "x.m", "x"]
    data = pd.DataFrame(np.arange(2.0 * len(names)).reshape(2, -1), columns=names, index=[0.0, 0.1])
    write_mat(tmp_path / "odd.mat", data, {name: "rad" for name in names})
    mat = scipy.io.loadmat(tmp_path / "odd.mat", simplify_cells=True)
    assert mat["time_"]["x"].tolist() == data["time.x"].tolist() and mat["units"]["p"]["K"] == "rad"
    assert mat["p"]["K"].shape == (2, 2, 2) and mat["p"]["K"][1, 1, 1] == data["p.K[2,2]"].iloc[1] and np.isnan(mat["p"]["K"][0, 0, 1])
    values = [value for name, part in mat.items() if not name.startswith("__") and name not in {"units", "names"} for value in leaves(part)]
    found = {number for value in values for number in np.ravel(value) if np.isfinite(number)}
    assert found >= set(data.to_numpy().ravel())


def leaves(part: object) -> list[object]:
    return [leaf for value in part.values() for leaf in leaves(value)] if isinstance(part, dict) else [part]


def test_an_import_needs_no_other_package() -> None:
    """Plots, MATLAB files and the like are imported when they are asked for."""
    code = "import sys, adaptive_fmu; print([m for m in ('matplotlib', 'scipy', 'control', 'tqdm') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT / "python")
    assert done.stdout.strip() == "[]", done.stdout
