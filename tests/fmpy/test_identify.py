"""`identify`: a record of a plant, the model with its uncertainty, and a controller for it."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from recorded import SIGNALS, STEP, motor, program, record, written
from sample import NUMBER


def test_a_model_is_the_plant_within_its_uncertainty_and_gives_a_controller(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER)
    A, B = motor(rng)
    written(tmp_path, record(rng, A, B))
    ran = program(tmp_path, "identify", "record.csv", *SIGNALS)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    model = json.loads((tmp_path / "model.json").read_text())
    errors = np.sqrt(np.diag(model["covariance"]))
    for (matrix, i, j), error in zip(model["free"], errors, strict=True):
        if matrix in "AB":
            true = {"A": A, "B": B}[matrix][i - 1, j - 1]
            assert abs(model[matrix][i - 1][j - 1] - true) < 5 * error, (NUMBER, matrix, i, j)
            assert error < 0.05 * max(abs(A).max(), abs(true)), (NUMBER, matrix, i, j)
    assert model["states"] == ["speed", "current"] and model["inputs"] == ["voltage"]
    [of] = model["records"]
    assert of["sha256"] == hashlib.sha256((tmp_path / "record.csv").read_bytes()).hexdigest()
    # As one would go on: a controller for the model, which is sound, exported and run in a loop with the model.
    made = program(tmp_path, "new", "pid", "--name", "C", "--plant", "model.json", "--outputs", "speed", "--reference", "50")
    assert made.returncode == 0, made.stderr
    checked = program(tmp_path, "check", "C.toml")
    assert checked.returncode == 0, checked.stdout


def test_the_table_and_json_agree(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 1)
    A, B = motor(rng)
    written(tmp_path, record(rng, A, B))
    output = json.loads(program(tmp_path, "identify", "record.csv", *SIGNALS, "--json").stdout)
    text = program(tmp_path, "identify", "record.csv", *SIGNALS, "--force").stdout
    assert output["model"] == json.loads((tmp_path / "model.json").read_text())
    for entry in output["entries"]:
        matrix, i, j = entry["entry"]
        line = next(line for line in text.splitlines() if line.startswith(f"{matrix}[{i},{j}] "))
        value = float(line.split()[-2])
        assert value == pytest.approx(entry["value"], rel=1e-5)
    for finding in output["findings"]:
        assert finding["text"] in text


def test_structure_that_is_known_stays_and_makes_the_rest_surer(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 2)
    A, B = motor(rng)
    written(tmp_path, record(rng, A, B))
    # As the page shows it.
    [shown] = re.findall("```toml\n(.*?)```", (ROOT / "docs/identify.md").read_text(), re.S)
    (tmp_path / "structure.toml").write_text(shown)
    free, known = (
        json.loads(program(tmp_path, "identify", "record.csv", *SIGNALS, "--json", "--out", f"{k}.json", *options).stdout)
        for k, options in enumerate([[], ["--structure", "structure.toml"]])
    )
    assert known["model"]["B"][0] == [0]
    assert ["B", 1, 1] not in [entry["entry"] for entry in known["entries"]]
    error = [{tuple(entry["entry"]): entry["error"] for entry in found["entries"]} for found in (free, known)]
    # Without the factors of coloured residuals, which are estimates of their own.
    kappa = [{tuple(entry["entry"]): entry["kappa"] for entry in found["entries"]} for found in (free, known)]
    plain = [{place: of[place] / by[place] for place in of} for of, by in zip(error, kappa, strict=True)]
    ratios = {place: plain[1][place] / plain[0][place] for place in plain[1] if place[0] in "AB"}
    assert max(ratios.values()) <= 1.05, (NUMBER, ratios)


REFUSED = {
    "voltage never moves": lambda table: table[:, 1].fill(12.0),
    "line 102: time": lambda table: table[100].__setitem__(0, table[99, 0]),
}


@pytest.mark.parametrize("reason", REFUSED)
def test_a_record_that_shows_nothing_is_refused_with_the_reason(reason: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 3)
    table = record(rng, *motor(rng))
    REFUSED[reason](table)
    written(tmp_path, table)
    ran = program(tmp_path, "identify", "record.csv", *SIGNALS)
    assert ran.returncode == 1 and reason in ran.stderr, ran.stdout + ran.stderr
    assert not (tmp_path / "model.json").exists()


def test_a_model_that_does_not_follow_is_written_with_code_3(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 4)
    table = record(rng, *motor(rng))
    # In the held-out part the motor turns the other way.
    table[1050:, 2:] *= -1
    written(tmp_path, table)
    ran = program(tmp_path, "identify", "record.csv", *SIGNALS)
    assert ran.returncode == 3 and "not sound" in ran.stdout, ran.stdout + ran.stderr
    assert (tmp_path / "model.json").exists()


def test_options_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 5)
    written(tmp_path, record(rng, *motor(rng), rows=400))
    for options, reason in [
        (["--inputs", "voltag", "--states", "speed,current"], "did you mean `voltage`?"),
        ([*SIGNALS, "--hold-out", "0.95"], "--hold-out = 0.95: must be at least 0 and below 90 %, as 30% or 0.3, or a file: .csv, .parquet or .mat"),
        ([*SIGNALS, "--order", "3"], "--order = 3: is for --outputs"),
        ([*SIGNALS, "--delay", "0,1"], "--delay = 2 numbers: must be one number, or 1"),
        ([*SIGNALS, "--time", "hours"], "hours"),
    ]:
        ran = program(tmp_path, "identify", "record.csv", *options)
        assert ran.returncode == 1 and reason in ran.stderr, ran.stderr
    (tmp_path / "structure.toml").write_text('A = [["?", "maybe"], ["?", "?"]]\n')
    ran = program(tmp_path, "identify", "record.csv", *SIGNALS, "--structure", "structure.toml")
    assert ran.returncode == 1 and "structure.toml: line 1, `A = [[" in ran.stderr and '"?"' in ran.stderr, ran.stderr
    first = program(tmp_path, "identify", "record.csv", *SIGNALS)
    again = program(tmp_path, "identify", "record.csv", *SIGNALS)
    assert first.returncode == 0 and again.returncode == 1 and "Use --force" in again.stderr


def test_times_in_ms_give_the_same_model(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 7)
    table = record(rng, *motor(rng))
    written(tmp_path, table)
    seconds = json.loads(program(tmp_path, "identify", "record.csv", *SIGNALS, "--json", "--force").stdout)
    table[:, 0] *= 1000
    written(tmp_path, table, header="time [ms],voltage,speed [rad/s],current [A]")
    found = json.loads(program(tmp_path, "identify", "record.csv", *SIGNALS, "--json", "--force").stdout)
    np.testing.assert_allclose(found["model"]["A"], seconds["model"]["A"], rtol=1e-6)
    written(tmp_path, table, header="time [d],voltage,speed,current")
    ran = program(tmp_path, "identify", "record.csv", *SIGNALS, "--force")
    assert ran.returncode == 1 and "record.csv: time is in d: must be in s, ms, us, min or h" in ran.stderr, ran.stderr


def test_an_input_that_is_left_out_takes_its_delay_along(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 8)
    table = record(rng, *motor(rng))
    # The voltage acts a row after it is recorded; a fan that always runs comes first.
    late = np.column_stack([table[:-1, 0], np.full(len(table) - 1, 3.0), table[1:, 1], table[:-1, 2:]])
    written(tmp_path, late, header="time,fan,voltage,speed,current")
    signals = ["--inputs", "fan,voltage", "--states", "speed,current", "--fixed", "fan", "--delay", f"0,{STEP}"]
    ran = program(tmp_path, "identify", "record.csv", *signals, "--json")
    model = json.loads(ran.stdout)["model"]
    assert model["inputs"] == ["voltage"] and model["delay"] == [STEP]
    assert min(model["fit"]["held_out"]) > 97


def test_what_is_not_checked_and_what_has_no_meaning_is_reported(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 9)
    written(tmp_path, record(rng, *motor(rng), rows=600))
    ran = program(tmp_path, "identify", "record.csv", *SIGNALS, "--hold-out", "0.003")
    assert ran.returncode == 0 and "warning: nothing is held out" in ran.stdout, ran.stdout
    outputs = ["identify", "record.csv", "--force", "--inputs", "voltage", "--outputs", "speed"]
    for options, reason in [(["--offset", "none"], "can't be left out"), (["--windows", "1"], "there is no longest window")]:
        ran = program(tmp_path, *outputs, *options)
        assert ran.returncode == 1 and reason in ran.stderr, ran.stderr
    ran = program(tmp_path, *outputs, "--hold-out", "0")
    assert "is by BIC" in ran.stdout and "as given" not in ran.stdout, ran.stdout
    assert json.loads((tmp_path / "model.json").read_text())["states"][:2] == ["speed", "speed_1"]


def test_outputs_alone_give_a_model_whose_order_is_chosen(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 6)
    A, B = motor(rng)
    table = record(rng, A, B, noise=0.002)
    written(tmp_path, table)
    ran = program(tmp_path, "identify", "record.csv", "--inputs", "voltage", "--outputs", "speed", "--json")
    assert ran.returncode == 0, ran.stdout + ran.stderr
    model = json.loads(ran.stdout)["model"]
    poles, true = (np.sort_complex(np.linalg.eigvals(np.array(matrix))) for matrix in (model["A"], A))
    # A state more is allowed where noise fits; the plant's poles are among them.
    assert len(true) <= len(poles) <= 4
    for pole in true:
        assert np.abs(poles - pole).min() < 0.15 * abs(pole)


def test_units_are_converted_to_base_units(tmp_path: Path) -> None:
    """The same record in rpm and mA, by the line of names and by --unit."""
    rng = np.random.default_rng(NUMBER + 9)
    table = record(rng, *motor(rng))
    written(tmp_path, table, "si.csv")
    others = table * np.array([1, 1, 30 / np.pi, 1e3])
    written(tmp_path, others, "named.csv", "time,voltage [V],speed [rpm],current [mA]")
    written(tmp_path, others, "bare.csv", "time,voltage,speed,current")
    of_si = json.loads(program(tmp_path, "identify", "si.csv", *SIGNALS, "--json", "--out", "si.json").stdout)["model"]
    for name, options in [("named", []), ("bare", ["--unit", "speed=rpm", "--unit", "current=mA"])]:
        ran = program(tmp_path, "identify", f"{name}.csv", *SIGNALS, *options, "--json", "--out", f"{name}.json")
        assert ran.returncode == 0 and "speed was converted from rpm to rad/s" in ran.stderr, ran.stderr
        model = json.loads(ran.stdout)["model"]
        assert model["units"]["x"] == ["rad/s", "A"]
        np.testing.assert_allclose(model["A"], of_si["A"], rtol=1e-5)
        np.testing.assert_allclose(model["B"], of_si["B"], rtol=1e-5, atol=1e-5)
    refused = program(tmp_path, "identify", "bare.csv", *SIGNALS, "--unit", "speed=knots/h2x", "--out", "no.json")
    assert refused.returncode == 1 and "--unit = speed=knots/h2x: must be NAME=UNIT" in refused.stderr, refused.stderr
