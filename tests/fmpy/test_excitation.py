"""Signals of experiments: by formulas written anew, as FMUs of every form, and on to a model of the plant; and `identify --plan`."""

import csv
import json
import re
import subprocess
from pathlib import Path

import adaptive_fmu
import fmpy
import numpy as np
import pytest
from conftest import PROGRAM
from master import Fmu, Unit
from sample import NUMBER
from scipy.linalg import expm


def program(folder: Path, *arguments: object) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *map(str, arguments)], cwd=folder, capture_output=True, text=True, timeout=300)


def done(folder: Path, *arguments: object) -> subprocess.CompletedProcess:
    ran = program(folder, *arguments)
    assert ran.returncode == 0, (arguments, ran.stdout, ran.stderr)
    return ran


def table(file: Path) -> tuple[list[str], np.ndarray]:
    with file.open() as opened:
        header, *rows = csv.reader(opened)
    return header, np.array(rows, dtype=float)


def begun(folder: Path, *options: object, name: str = "Shaker") -> tuple[list[str], np.ndarray]:
    """An experiment as a table and as a description."""
    done(folder, "new", "excitation", "--name", name, *options, "--csv")
    done(folder, "new", "excitation", "--name", name, *options)
    return table(folder / f"{name}.csv")


def mixed(number: int, word: int) -> int:
    """The output function of SplitMix64."""
    bits = (number + word + 0x9E3779B97F4A7C15) % 2**64
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EB % 2**64
    return bits ^ (bits >> 31)


def uniform(seed: int, channel: int, sample: int) -> float:
    bits = 0
    for word in (seed % 2**64, channel, sample, 0):
        bits = mixed(bits, word)
    return ((bits >> 11) + 1) / 2**53


def levels(seed: int, channel: int, longest: int, rows: int) -> np.ndarray:
    values: list[float] = []
    number = 0
    while len(values) < rows:
        height, length = (uniform(seed, channel, 2 * number + which) for which in (0, 1))
        values += [2 * height - 1] * min(2 + int((1 - length) * (longest - 1)), longest)
        number += 1
    return np.array(values[:rows])


def multisine(channel: int, channels: int, samples: int, harmonics: int) -> np.ndarray:
    own = np.arange(channel + 1, harmonics + 1, channels)
    place = np.arange(1, len(own) + 1)
    phases = -np.pi * place * (place - 1) / len(own)
    k = np.arange(samples)
    whole = np.cos(2 * np.pi * np.outer(k, own) / samples + phases).sum(axis=1)
    return whole / np.abs(whole).max()


def chirp(channel: int, channels: int, samples: int, ratio: float) -> np.ndarray:
    part = (np.arange(samples) + int(channel * samples / channels + 0.5)) % samples / samples
    return np.sin(2 * np.pi / np.log(ratio) * (ratio**part - 1))


def test_levels_are_the_same_numbers_by_another_program(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER)
    # The longest level is written with three digits: here it is a whole number of tenths of a second.
    seed, settling = int(rng.integers(-1000, 1000)), 0.25 * int(rng.integers(2, 20))
    amplitude, point = rng.uniform(0.5, 5, 3).round(3), rng.uniform(-5, 5, 3).round(3)
    options = ["--inputs", 3, "--settling-time", settling, "--step", 0.01, f"--seed={seed}"]
    options += ["--amplitude", ",".join(map(str, amplitude)), f"--operating-point={','.join(map(str, point))}"]
    header, rows = begun(tmp_path, *options)
    longest = int(settling * 0.4 / 0.01 * (1 + 1e-9))
    assert header == ["time", "u[1]", "u[2]", "u[3]"]
    assert np.array_equal(rows[:, 0], np.array([float(f"{k * 0.01:.12e}") for k in range(len(rows))]))
    for i in range(3):
        expected = point[i] + amplitude[i] * levels(seed, i, longest, len(rows))
        assert np.array_equal(rows[:, i + 1], expected), (NUMBER, i)
        # Each level lasts 2 steps or more, and none longer than it may.
        changes = np.flatnonzero(np.diff(rows[:, i + 1]))
        assert np.diff(changes).min() >= 2 and np.diff(changes).max() <= longest, (NUMBER, i)
    assert np.abs(np.corrcoef(rows[:, 1:].T) - np.eye(3)).max() < 0.6, "independent inputs"


@pytest.mark.parametrize("signal", ["multisine", "chirp"])
def test_signals_that_repeat_are_their_formulas(signal: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 1)
    for channels in (1, int(rng.integers(2, 5))):
        settling, highest = round(rng.uniform(0.5, 2), 2), rng.uniform(20, 150)
        options = ["--inputs", channels, "--settling-time", settling, "--step", 0.02, "--signal", signal, "--up-to", highest]
        _, rows = begun(tmp_path, *options, "--amplitude", 2.5, "--states", 2, name=f"S{channels}")
        samples = len(rows) - 1
        period = samples * 0.02
        ratio = highest * period / (2 * np.pi)
        for i in range(channels):
            expected = multisine(i, channels, samples, int(ratio)) if signal == "multisine" else chirp(i, channels, samples, ratio)
            assert np.abs(rows[:-1, i + 1] - 2.5 * expected).max() < 1e-9, (NUMBER, channels, i)
            assert rows[-1, i + 1] == pytest.approx(rows[0, i + 1], abs=1e-9), "it repeats"
        if signal == "multisine":
            spectrum = np.abs(np.fft.rfft(rows[:-1, 1:], axis=0)) > 1e-6 * samples
            assert spectrum.sum(axis=1).max() == 1, "no two inputs share a frequency"
            assert set(np.flatnonzero(spectrum.any(axis=1))) == set(range(1, int(ratio) + 1))
            assert np.abs(rows[:, 1:]).max() == pytest.approx(2.5)


SIGNALS = {"levels": ["--seed", NUMBER % 1000], "multisine": ["--up-to", 60], "chirp": ["--up-to", 90]}


@pytest.mark.parametrize("form", ["generic", "compiled"])
@pytest.mark.parametrize("signal", SIGNALS)
def test_an_fmu_gives_the_numbers_of_the_table_at_any_step(signal: str, form: str, tmp_path: Path) -> None:
    options = ["--inputs", 2, "--settling-time", 1, "--step", 0.01, "--signal", signal, "--amplitude", "3,0.5"]
    _, rows = begun(tmp_path, *options, *SIGNALS[signal])
    done(tmp_path, "export", "Shaker.toml", *(["--compile"] if form == "compiled" else []))
    fmu = Fmu(tmp_path / "fmus" / "Shaker.fmu", tmp_path / "unpacked")
    tolerance = 0.0 if signal == "levels" else 1e-12
    # The step of the table, and one that meets its times now and then.
    for step, shift in [(0.01, 0.0), (0.0073, 0.0), (0.0373, 0.0), (0.01, 7.25)]:
        with Unit(fmu) as unit:
            unit.start(shift)
            count = int(4 / step)
            for k in range(count + 1):
                # At a change both sides are right within rounding: where there is one, look at its middle.
                place = k * step / 0.01
                sample = round(place) if abs(place - round(place)) < 1e-6 else int(place)
                found = [unit["u[1]"], unit["u[2]"]]
                assert np.abs(found - rows[sample, 1:]).max() <= tolerance, (NUMBER, step, k)
                unit.step(shift + k * step, step)


def test_model_exchange_and_communication_points_far_apart_see_each_change(tmp_path: Path) -> None:
    """An integrator behind the levels, as one FMU: its state is the sum of the table, whatever lies between the points."""
    _, rows = begun(tmp_path, "--inputs", "force", "--settling-time", 1, "--step", 0.01, "--seed", NUMBER % 1000)
    done(tmp_path, "export", "Shaker.toml")
    shaker = str(tmp_path / "fmus" / "Shaker.fmu")
    exchanged = fmpy.simulate_fmu(
        shaker, fmi_type="ModelExchange", solver="CVode", step_size=0.05, stop_time=3, output_interval=0.005, output=["force"]
    )
    between = (np.arange(300) + 0.5) * 0.01
    found = exchanged["force"][np.searchsorted(exchanged["time"], between - 1e-6)]
    assert np.array_equal(found, rows[:300, 1])
    (tmp_path / "P.json").write_text(json.dumps({"A": [[0]], "B": [[1]], "C": [[1]], "states": ["speed"], "inputs": ["force"]}))
    done(tmp_path, "new", "state-space", "--name", "P", "--plant", "P.json", "--bandwidth", 1)
    done(tmp_path, "new", "loop", "--units", "Shaker.toml", "P.toml", "--out", "whole", "--step", 0.37, "--until", 3.7)
    done(tmp_path, "run", "whole", "--composite", "--out", "results")
    header, points = table(tmp_path / "results" / "whole-composite" / "result.csv")
    sums = np.concatenate([[0], np.cumsum(rows[:, 1]) * 0.01])
    places = np.rint(points[:, 0] / 0.01).astype(int)
    assert len(points) == 11
    # States are integrated within a tolerance of 1e-6.
    assert np.abs(points[:, header.index("plant.speed")] - sums[places]).max() < 1e-5


def plant(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """A random stable plant with two inputs, in units that differ."""
    poles = rng.uniform(-4, -1, n)
    T = np.linalg.qr(rng.normal(size=(n, n)))[0] @ np.diag(10 ** rng.uniform(-0.3, 0.3, n))
    A = T @ (np.diag(poles) + np.triu(rng.uniform(-2, 2, (n, n)), 1)) @ np.linalg.inv(T)
    units = np.diag(10 ** rng.uniform(-1, 1, n))
    return units @ A @ np.linalg.inv(units), units @ T @ rng.normal(size=(n, 2))


def experiment(folder: Path, A: np.ndarray, B: np.ndarray, name: str, until: float | None = None, seed: int = 1) -> Path:
    """The record of an experiment: excitation, plant and noisy sensors in a loop."""
    n = len(A)
    states, inputs = [f"x_{i}" for i in range(n)], ["left", "right"]
    model = {"A": A.tolist(), "B": B.tolist(), "C": np.eye(n).tolist(), "states": states, "inputs": inputs}
    (folder / "Plant.json").write_text(json.dumps(model))
    done(folder, "new", "state-space", "--name", "Plant", "--plant", "Plant.json", "--bandwidth", 2, "--force")
    done(folder, "new", "sensor", "--name", "Sensors", "--plant", "Plant.json", "--bandwidth", 2, "--force")
    options = ["--inputs", "left,right", "--amplitude", "3,1", "--settling-time", 3, "--step", 0.02, "--states", n, "--seed", seed, "--force"]
    done(folder, "new", "excitation", "--name", "Shaker", *options)
    # Noise of 2 % of what full inputs do at rest.
    noise = 0.02 * np.abs(np.linalg.solve(A, B) @ [3, 1])
    text = (folder / "Sensors.toml").read_text()
    text = re.sub(r"(?m)^noise_deviation = .*$", f"noise_deviation = {noise.tolist()}", text)
    (folder / "Sensors.toml").write_text(text.replace("sample_time = 0.001", "sample_time = 0.02").replace("seed = 1", f"seed = {seed + 7}"))
    units = ["Shaker.toml", "Plant.toml", "Sensors.toml"]
    until = [] if until is None else ["--until", until]
    done(folder, "new", "loop", "--units", *units, "--out", name, "--step", 0.02, *until, "--force")
    done(folder, "run", name, "--out", "results")
    return folder / "results" / name / "result.csv"


def identified(folder: Path, record: Path, n: int, out: str) -> dict:
    signals = ["--inputs", "excitation.left,excitation.right", "--states", ",".join(f"sensor.x_{i}_measured" for i in range(n))]
    ran = program(folder, "identify", record, *signals, "--out", out, "--force")
    assert ran.returncode in (0, 3), ran.stdout + ran.stderr
    return json.loads((folder / out).read_text())


def test_an_experiment_leads_to_the_model_of_the_plant(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 2)
    n = int(rng.integers(2, 4))
    A, B = plant(rng, n)
    record = experiment(tmp_path, A, B, "experiment")
    header, rows = table(record)
    # A row has the input that acts from then on.
    inputs = rows[:, [header.index(f"excitation.{name}") for name in ("left", "right")]]
    states = rows[:, [header.index(f"plant.x_{i}") for i in range(n)]]
    whole = expm(np.block([[A, B], [np.zeros((2, n + 2))]]) * 0.02)
    followed = states[:-1] @ whole[:n, :n].T + inputs[:-1] @ whole[:n, n:].T
    assert np.abs(followed - states[1:]).max() < 1e-4 * np.abs(states).max(), NUMBER
    assert len(rows) == 1501, "10 settling times"
    model = identified(tmp_path, record, n, "model.json")
    errors = np.sqrt(np.diag(model["covariance"]))
    for (matrix, i, j), error in zip(model["free"], errors, strict=True):
        if matrix in "AB":
            true = {"A": A, "B": B}[matrix][i - 1, j - 1]
            assert abs(model[matrix][i - 1][j - 1] - true) < 5 * error, (NUMBER, matrix, i, j)


def test_a_record_as_long_as_planned_gives_the_standard_errors_that_were_wanted(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 3)
    A, B = plant(rng, 2)
    model = identified(tmp_path, experiment(tmp_path, A, B, "first", seed=3), 2, "model.json")
    present = model["records"][0]["to"] - model["records"][0]["from"]

    def shares(model: dict) -> dict[tuple, float]:
        errors = np.sqrt(np.diag(model["covariance"]))
        of = zip(model["free"], errors, strict=True)
        return {(k, i, j): error / abs(model[k][i - 1][j - 1]) for (k, i, j), error in of if k in "AB"}

    first = shares(model)
    # How long it must be is as sure as the entry is: what is known within a few per cent can be planned.
    known = {entry: share for entry, share in first.items() if share < max(0.1, 1.01 * min(first.values()))}
    target = round(max(known.values()) / 1.8, 5)
    planned = json.loads(done(tmp_path, "identify", "--plan", "model.json", "--target", target, "--json").stdout)
    lengths = {tuple(of["entry"]): of["length"] for of in planned["entries"]}
    assert set(lengths) == set(first) and planned["present"] == pytest.approx(present)
    for entry, share in first.items():
        if share > 1 / 3:
            assert lengths[entry] is None, (NUMBER, entry)
        else:
            assert lengths[entry] == pytest.approx(present * (share / target) ** 2, rel=1e-9), (NUMBER, entry)
    sure = max(length for length in lengths.values() if length is not None)
    assert planned["length"] == pytest.approx(sure)
    text = done(tmp_path, "identify", "--plan", "model.json", "--target", f"{100 * target}%").stdout
    assert re.search(r"A\[1,1\]  sensor.x_0_measured' / sensor.x_0_measured +\S+ +\S+ +\S+ +\S+", text), text
    # As long as the entries need that this can be asked of.
    wanted = max(lengths[entry] for entry in known)
    again = shares(identified(tmp_path, experiment(tmp_path, A, B, "second", round(wanted, 1), seed=4), 2, "again.json"))
    for entry in known:
        assert again[entry] < 1.5 * target, (NUMBER, entry, first[entry], again[entry], target)


REFUSED = {
    "--amplitude": (["--settling-time", 2, "--amplitude", 0], "must be a finite number above 0"),
    "negative amplitude": (["--settling-time", 2, "--amplitude=-1"], "must be a finite number above 0"),
    "--settling-time": (["--settling-time", 0], "must be a finite number above 0"),
    "no settling time": ([], "--settling-time is missing"),
    "many amplitudes": (["--settling-time", 2, "--amplitude", "1,2"], "--amplitude = 1.0, 2.0: must be one number, or 1, one for each input"),
    "multisine up to": (["--settling-time", 2, "--signal", "multisine"], "--up-to is missing: give the highest frequency of the signal within 0.3141593 … 314.1592 rad/s"),
    "chirp up to": (["--settling-time", 2, "--signal", "chirp"], "--up-to is missing"),
    "too fast": (["--settling-time", 2, "--signal", "chirp", "--up-to", 315], "--up-to = 315: must be within 0.3141593 … 314.1592 rad/s"),
    "too slow": (["--settling-time", 2, "--signal", "chirp", "--up-to", 0.3], "--up-to = 0.3: must be within 0.3141593 … 314.1592 rad/s"),
    "levels up to": (["--settling-time", 2, "--up-to", 30], "--up-to = 30: is for multisine and chirp"),
    "long step": (["--settling-time", 2, "--step", 0.5], "--step = 0.5: must be at most 0.4 s"),
    "signal": (["--settling-time", 2, "--signal", "noise"], "levels, multisine, chirp"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_experiment_that_shows_nothing_is_refused(case: str, tmp_path: Path) -> None:
    options, reason = REFUSED[case]
    ran = program(tmp_path, "new", "excitation", "--name", "Shaker", *options)
    assert ran.returncode != 0 and reason in ran.stderr, ran.stderr
    assert list(tmp_path.iterdir()) == []


def test_options_of_experiments_are_refused_elsewhere(tmp_path: Path) -> None:
    for options, reason in [
        (["--signal", "chirp"], "--signal is for an experiment, which reference is not"),
        (["--step", 0.1], "--step is for an FMU as the plant"),
    ]:
        ran = program(tmp_path, "new", "reference", "--name", "R", *options)
        assert ran.returncode == 1 and reason in ran.stderr, ran.stderr


def test_a_plant_gives_names_units_limits_and_its_settling_time(tmp_path: Path) -> None:
    plant = {"A": [[-2.0]], "B": [[1.0]], "C": [[1.0]], "inputs": ["voltage"], "units": {"x": [""], "u": ["V"], "y": [""]}}
    (tmp_path / "P.json").write_text(json.dumps({**plant, "u_min": -12, "u_max": 12}))
    ran = done(tmp_path, "new", "excitation", "--name", "S", "--plant", "P.json", "--amplitude", 10, "--operating-point", 5)
    text = (tmp_path / "S.toml").read_text()
    assert 'units = ["V"]' in text and 'u = ["voltage"]' in text and 'command = ["voltage_command"]' in text
    # The pole at -2 settles in 4/2 s, and the input goes beyond its limit.
    assert "longest_level = 0.8" in text and "stop_time = 20.0" in text
    assert "voltage goes from -5 to 15, beyond the plant's limits -12 … 12" in ran.stderr, ran.stderr
    assert "Advised length of the experiment: 20 s (10 settling times of 2 s)" in ran.stderr
    # More unknowns than ten settling times show: 40 numbers for each.
    ran = done(tmp_path, "new", "excitation", "--name", "T", "--states", 6, "--inputs", 2, "--settling-time", 1, "--step", 0.1)
    assert "Advised length of the experiment: 32 s (40 numbers for each of 48 unknowns of a plant with 6 states" in ran.stderr


def test_python_begins_the_same_experiment(tmp_path: Path) -> None:
    asked = {"signal": "multisine", "amplitude": [3, 1], "operating_point": [-2, 0], "settling_time": 2, "step": 0.02, "up_to": 40}
    adaptive_fmu.new("excitation", tmp_path / "S.toml", inputs=2, **asked)
    options = ["--signal", "multisine", "--amplitude", "3,1", "--operating-point=-2,0", "--settling-time", 2, "--step", 0.02, "--up-to", 40]
    done(tmp_path, "new", "excitation", "--name", "S", "--out", "T.toml", "--inputs", 2, *options)
    assert (tmp_path / "S.toml").read_text() == (tmp_path / "T.toml").read_text()
    with pytest.raises(adaptive_fmu.Error, match="settling"):
        adaptive_fmu.new("excitation", tmp_path / "U.toml")
    adaptive_fmu.new("excitation", tmp_path / "U.toml", settling_time=3, seed=5)
    assert "seed = 5" in (tmp_path / "U.toml").read_text()


DESCRIPTIONS = {
    "longest_level": ('signal = "levels"', "`longest_level` is missing"),
    "period": ('signal = "chirp"\nhighest_frequency = 3.0', "`period` is missing"),
    "other": ('signal = "levels"\nlongest_level = 1.0\nperiod = 2.0', "period = 2: belongs to another signal"),
    "short": ('signal = "levels"\nlongest_level = 0.01', "longest_level = 0.01: must be within 0.02 … 10000, in s"),
    "whole": ('signal = "chirp"\nperiod = 1.005\nhighest_frequency = 30.0', "period = 1.005: must be a multiple of sample_time"),
    "fast": ('signal = "multisine"\nperiod = 1.0\nhighest_frequency = 315.0', "highest_frequency = 315: must be within 6.283185 … 314.1593"),
    "large": ('signal = "multisine"\nperiod = 1000.0\nhighest_frequency = 300.0', "shorten the period or lower highest_frequency"),
}


@pytest.mark.parametrize("case", DESCRIPTIONS)
def test_descriptions_of_signals_are_checked(case: str, tmp_path: Path) -> None:
    structure, reason = DESCRIPTIONS[case]
    text = f'name = "S"\nmodel = "excitation"\ndescription = ""\n[structure]\nchannels = 1\nsample_time = 0.01\n{structure}\n'
    (tmp_path / "S.toml").write_text(text)
    ran = program(tmp_path, "export", "S.toml")
    assert ran.returncode == 1 and reason in ran.stderr, ran.stderr


def test_a_plan_of_what_is_no_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{}")
    model = {"A": [[-1.0]], "B": [[1.0]], "C": [[1.0]], "sample_time": 0.1, "offset": [], "free": [["A", 1, 1]], "covariance": [[0.01]]}
    model |= {"kappa": [], "noise": [], "disturbance": [], "level": 0.99, "fit": {}, "whiteness": [], "method": ""}
    model["records"] = [{"file": "a.csv", "rows": 10, "from": 0.0, "to": 10.0}]
    for change, reason in [
        ({"covariance": []}, "covariance = 0 rows: must be 1 × 1"),
        ({"records": []}, "records = 0: must have a length above 0 s together"),
        ({"free": [["A", 1, 7]]}, "free = A[1,7]: must be an entry"),
        ({"covariance": [[-1.0]]}, "free = A[1,1]: must be an entry with a finite value and a variance that is at least 0"),
    ]:
        (tmp_path / "b.json").write_text(json.dumps(model | change))
        ran = program(tmp_path, "identify", "--plan", "b.json")
        assert ran.returncode == 1 and reason in ran.stderr, ran.stderr
    ran = program(tmp_path, "identify", "--plan", "a.json")
    assert ran.returncode == 1 and "a.json: is no model of identify" in ran.stderr, ran.stderr
    for target in ("0", "100%", "-1"):
        ran = program(tmp_path, "identify", "--plan", "b.json", f"--target={target}")
        assert ran.returncode == 2 and "below 100 %" in ran.stderr, ran.stderr
    # By hand: a standard error of 0.1 of 1 in 10 s is one of 0.05 in 40 s.
    (tmp_path / "b.json").write_text(json.dumps(model))
    planned = json.loads(done(tmp_path, "identify", "--plan", "b.json", "--target", "5%", "--json").stdout)
    assert planned["length"] == pytest.approx(40)
