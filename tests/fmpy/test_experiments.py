"""Defaults and refusals of `new excitation`: step and frequencies from a plant's poles, faults of records, tables, and the picture on the page."""

import html
import json
import re
import subprocess
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM
from recorded import SIGNALS, motor, record, written
from sample import NUMBER
from test_excitation import done, program, table

# Keys of descriptions, which a user of `new` hasn't given.
KEYS = re.compile(r"\b(sample_time|longest_level|highest_frequency|period =|channels)")


def round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten."""
    decade = 10.0 ** np.floor(np.log10(value * (1 + 1e-9)))
    return max(step * decade for step in (1, 2, 5) if step * decade <= value * (1 + 1e-9))


def plant(file: Path, rng: np.random.Generator, poles: list[complex], inputs: list[str]) -> None:
    """A plant in a random basis with these poles, of which complex ones bring their conjugates."""
    blocks = [np.array([[p.real]]) if not p.imag else np.array([[p.real, p.imag], [-p.imag, p.real]]) for p in map(complex, poles)]
    n = sum(len(block) for block in blocks)
    A, place = np.zeros((n, n)), 0
    for block in blocks:
        A[place : place + len(block), place : place + len(block)] = block
        place += len(block)
    T = np.linalg.qr(rng.normal(size=(n, n)))[0] @ np.diag(10 ** rng.uniform(-0.2, 0.2, n))
    model = {"A": T @ A @ np.linalg.inv(T), "B": T @ rng.normal(size=(n, len(inputs))), "C": np.eye(n)}
    file.write_text(json.dumps({key: matrix.tolist() for key, matrix in model.items()} | {"inputs": inputs}))


def begun(folder: Path, *options: object, name: str = "S") -> tuple[dict, str]:
    """A description and the notes on it."""
    ran = done(folder, "new", "excitation", "--name", name, *options, "--force")
    return tomllib.loads((folder / f"{name}.toml").read_text()), ran.stderr


def slow_and_fast(rng: np.random.Generator, ratio: float) -> tuple[float, list[complex]]:
    """A slow pole, and poles whose fastest is so many times as fast."""
    slow, angle = rng.uniform(0.2, 5), rng.uniform(0.1, 1.4)
    fast = ratio * slow * complex(-np.cos(angle), np.sin(angle))
    return slow, [complex(-slow), fast, complex(-slow * rng.uniform(1.1, 2))]


@pytest.mark.parametrize("ratio", [3.0, 9.0, 60.0, 1500.0])
def test_step_and_highest_frequency_follow_from_the_poles(ratio: float, tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + round(ratio))
    slow, poles = slow_and_fast(rng, ratio)
    inputs = ["left", "right"][: int(rng.integers(1, 3))]
    plant(tmp_path / "P.json", rng, poles, inputs)
    levels, output = begun(tmp_path, "--plant", "P.json")
    settling, fastest = 4 / slow, ratio * slow
    step = round_down(min(settling / 200, 1 / (5 * fastest)))
    assert levels["structure"]["sample_time"] == levels["experiment"]["step"] == pytest.approx(step), (NUMBER, poles)
    assert levels["structure"]["longest_level"] == pytest.approx(0.4 * settling, rel=0.02)
    length = levels["experiment"]["stop_time"]
    assert length >= max(10 * settling * 0.98, 40 * (4 + len(inputs)) * step * 0.999), (NUMBER, length)
    assert "warning" not in output and "fastest pole" not in output
    for signal in ("chirp", "multisine"):
        wave, _ = begun(tmp_path, "--plant", "P.json", "--signal", signal)
        assert wave["structure"]["sample_time"] == pytest.approx(step)
        # A multisine has at most 3e7 terms in a period.
        most = np.pi / step if signal == "chirp" else min(np.pi / step, 2 * np.pi / length * 3e7 / (length / step))
        expected = min(3 * fastest, most)
        highest = wave["structure"]["highest_frequency"]
        assert expected * 0.99 <= highest <= expected * (1 + 1e-9), (NUMBER, signal, highest, expected)


def test_a_pole_too_fast_for_the_settling_time_is_noted(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 1)
    slow, poles = slow_and_fast(rng, 2e4)
    plant(tmp_path / "P.json", rng, poles, ["u"])
    levels, output = begun(tmp_path, "--plant", "P.json")
    assert levels["structure"]["sample_time"] == pytest.approx(round_down(4 / slow / 200)), (NUMBER, slow)
    note = re.search(r"warning: at this step the record does not show the plant's fastest pole, (\S+) rad/s.*--step (\S+), and", output)
    assert note, output
    assert float(note[1]) == pytest.approx(2e4 * slow, rel=1e-3)
    assert float(note[2]) == pytest.approx(round_down(1 / (5 * 2e4 * slow)))
    # A step of one's own is taken without further words.
    own, output = begun(tmp_path, "--plant", "P.json", "--step", note[2], "--settling-time", 4000 * float(note[2]))
    assert own["structure"]["sample_time"] == float(note[2]) and "fastest pole" not in output


def test_plants_that_do_not_settle_are_reported(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 2)
    growth = round(rng.uniform(0.1, 3), 3)
    plant(tmp_path / "Unstable.json", rng, [growth, -2, -7], ["u"])
    plant(tmp_path / "Drifts.json", rng, [0, -rng.uniform(1, 9)], ["u"])
    (tmp_path / "Zero.json").write_text(json.dumps({"A": [[0, 1], [0, 0]], "B": [[0], [1]], "C": [[1, 0]]}))
    for name, reason in [("Unstable", f"the plant has an unstable pole, with the real part {growth} 1/s"), ("Zero", "all poles of the plant are at 0")]:
        ran = program(tmp_path, "new", "excitation", "--name", "S", "--plant", f"{name}.json")
        assert ran.returncode == 1 and f"{reason}, so that it doesn't settle: give --settling-time or --bandwidth" in ran.stderr, ran.stderr
        assert not (tmp_path / "S.toml").exists()
    _, output = begun(tmp_path, "--plant", "Unstable.json", "--settling-time", 2)
    assert f"warning: the plant has an unstable pole, with the real part {growth} 1/s. Without a controller nothing settles" in output
    assert begun(tmp_path, "--plant", "Unstable.json", "--bandwidth", 2)[0]["structure"]["longest_level"] == 0.8
    for name in ("Zero", "Drifts"):
        _, output = begun(tmp_path, "--plant", f"{name}.json", "--settling-time", 2)
        assert "warning: the plant has a pole at 0, so that it drifts" in output and "unstable" not in output, (NUMBER, name, output)
    assert "has a pole at 0" in begun(tmp_path, "--plant", "Drifts.json")[1], "its other pole settles"


def test_a_table_for_the_plant_of_records_keeps_the_verdict_on_them(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 3)
    rows = record(rng, *motor(rng), rows=3000)
    written(tmp_path, rows, "good.csv")
    rows[2100:, 2:] *= -1
    written(tmp_path, rows, "turned.csv")
    for name, code in [("good", 0), ("turned", 3)]:
        for csv in ([], ["--csv"]):
            options = ["--name", name, "--data", f"{name}.csv", *SIGNALS, "--settling-time", 1, "--force"]
            ran = program(tmp_path, "new", "excitation", *options, *csv, "--out", f"{name}-signal.{'csv' if csv else 'toml'}")
            assert ran.returncode == code, (NUMBER, name, csv, ran.stdout, ran.stderr)
            assert ("held-out" in ran.stdout + ran.stderr) == (code == 3) or code == 0
        assert table(tmp_path / f"{name}-signal.csv")[0] == ["time", "voltage"]


REFUSED = {
    "seed of a multisine": (["--settling-time", 1, "--signal", "multisine", "--up-to", 20, "--seed", 3], "--seed selects levels"),
    "seed of a chirp": (["--settling-time", 1, "--signal", "chirp", "--up-to", 20, "--seed", 1], "--seed selects levels"),
    "two speeds": (["--settling-time", 1, "--bandwidth", 4], "--settling-time is 4/bandwidth: give --settling-time or --bandwidth, not both"),
    "reference": (["--settling-time", 1, "--reference", 2], "--reference is for controllers: give --amplitude"),
    "fast": (["--settling-time", 1e-12], "the step of 5e-15 s must be within 1e-9 … 1e9 s: give another --settling-time"),
    "slow": (["--settling-time", 1e13], "give another --settling-time"),
    "short step": (["--settling-time", 1, "--step", 1e-10], "--step = 1e-10: must be within 1e-9 … 1e9 s"),
    "many steps of a level": (["--settling-time", 1, "--step", 1e-8], "--step = 1e-8: must be at least 4.000001e-7 s"),
    "many steps of a period": (["--settling-time", 1, "--step", 1e-6, "--signal", "chirp", "--up-to", 9], "--step = 1e-6: must be at least"),
    "many terms": (["--settling-time", 50, "--step", 1e-3, "--signal", "multisine", "--up-to", 3000], "--up-to = 3000: must be within"),
    "one line each": (["--settling-time", 1, "--inputs", 9, "--signal", "multisine", "--up-to", 2], "--up-to = 2: must be within"),
    "outputs": (["--settling-time", 1, "--outputs", 2], "is no size of excitation; its sizes are --inputs, --states"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_options(case: str, tmp_path: Path) -> None:
    options, reason = REFUSED[case]
    ran = program(tmp_path, "new", "excitation", "--name", "S", *options)
    assert ran.returncode == 1 and reason in ran.stderr, ran.stderr
    assert not KEYS.search(ran.stderr), ran.stderr
    assert list(tmp_path.iterdir()) == []


def test_random_options_give_an_experiment_or_a_refusal_that_helps(tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 4)
    refused = 0
    for _ in range(60):
        signal = str(rng.choice(["levels", "multisine", "chirp"]))
        settling, step, highest = (f"{10 ** rng.uniform(low, high):.3g}" for low, high in ((-4, 6), (-9, 4), (-3, 6)))
        options = ["--inputs", int(rng.integers(1, 9)), "--settling-time", settling, "--step", step, "--signal", signal]
        options += ["--up-to", highest] if signal != "levels" else []
        ran = program(tmp_path, "new", "excitation", "--name", "S", *options, "--force", "--no-schema")
        assert ran.returncode in (0, 1) and not KEYS.search(ran.stderr), (NUMBER, options, ran.stderr)
        if ran.returncode == 1:
            refused += 1
            option, allowed = re.search(r"(--step|--up-to) = \S+: must be (.*)", ran.stderr).groups()
            if bound := re.search(r"at (?:least|most) (\S+) s|within (\S+) …", allowed):
                options[options.index(option) + 1] = bound[1] or bound[2]
                again = program(tmp_path, "new", "excitation", "--name", "S", *options, "--force", "--no-schema")
                # The bound itself is allowed; what it was about doesn't come again.
                assert f"{option} = {bound[1] or bound[2]}: " not in again.stderr, (NUMBER, options, ran.stderr, again.stderr)
    assert refused > 10


def test_tables_are_bounded_by_their_numbers_and_quote_names(tmp_path: Path) -> None:
    options = ["--settling-time", 2e4, "--step", 1, "--csv"]
    done(tmp_path, "new", "excitation", "--name", "One", "--inputs", 1, *options)
    assert len((tmp_path / "One.csv").read_text().splitlines()) == 200002
    ran = program(tmp_path, "new", "excitation", "--name", "T", "--inputs", 50, *options)
    assert ran.returncode == 1 and "200001 rows of 51 numbers are too many" in ran.stderr and "give a longer --step" in ran.stderr, ran.stderr
    assert not (tmp_path / "T.csv").exists()
    done(tmp_path, "new", "excitation", "--name", "Q", "--inputs", "axis[1,2],force", "--settling-time", 1, "--csv")
    assert (tmp_path / "Q.csv").read_text().startswith('time,"axis[1,2]",force\n')
    assert table(tmp_path / "Q.csv")[0] == ["time", "axis[1,2]", "force"]
    named, _ = begun(tmp_path, "--inputs", "joint[1],joint[2]", "--settling-time", 1)
    assert named["names"] == {"u": ["joint[1]", "joint[2]"], "command": ["joint_command[1]", "joint_command[2]"]}


def page(folder: Path, name: str) -> str:
    subprocess.run([PROGRAM, "export", f"{name}.toml"], cwd=folder, check=True, capture_output=True)
    with zipfile.ZipFile(folder / "fmus" / f"{name}.fmu") as opened:
        return opened.read("documentation/index.html").decode()


def drawn(text: str) -> tuple[list[np.ndarray], list[tuple[float, str, str]], float]:
    """Curves of the picture by time, labels of its time axis (place, anchor, text), and its width."""
    picture = re.search(r'<svg role="img".*?</svg>', text, re.DOTALL)[0]
    width = float(re.search(r'viewBox="0 0 (\S+) ', picture)[1])
    labels = re.findall(r'd="M(\S+) \S+V\S+"/><text class="soft" x="\S+" y="\S+" text-anchor="(\w+)">([^<]*)<', picture)
    labels = [(float(at), anchor, html.unescape(label)) for at, anchor, label in labels]
    (zero, _, _), (last, _, end) = labels[0], labels[-1]
    points = re.findall(r'<polyline [^>]*points="([^"]*)"', picture)
    curves = [np.array([[float(part) for part in point.split(",")] for point in curve.split()]) for curve in points]
    for curve in curves:
        curve[:, 0] = (curve[:, 0] - zero) * float(end) / (last - zero)
    return curves, labels, width


def turns(values: np.ndarray) -> int:
    """How often a course turns back, by more than a twentieth of its range."""
    least, count, up, extreme = 0.05 * np.ptp(values), 0, None, values[0]
    for value in values:
        if up is None and abs(value - extreme) > least:
            up, extreme = value > extreme, value
        elif up is not None and (value > extreme) == up:
            extreme = value
        elif up is not None and abs(value - extreme) > least:
            up, extreme, count = not up, value, count + 1
    return count


@pytest.mark.parametrize("signal", ["levels", "multisine", "chirp"])
def test_the_picture_shows_the_signal_as_it_is(signal: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(NUMBER + 5)
    for number in range(3):
        name, settling, inputs = f"{signal.title()}{number}", round(10 ** rng.uniform(-1, 2), 2), int(rng.integers(1, 4)) if number else 1
        options = ["--inputs", inputs, "--settling-time", settling]
        options += ["--up-to", f"{rng.uniform(50, 600) / settling:.4g}", "--signal", signal] if signal != "levels" else []
        begun(tmp_path, *options, name=name)
        done(tmp_path, "new", "excitation", "--name", name, *options, "--csv")
        _, rows = table(tmp_path / f"{name}.csv")
        text = page(tmp_path, name)
        curves, labels, width = drawn(text)
        assert len(curves) == inputs
        for k, curve in enumerate(curves):
            expected = rows[rows[:, 0] <= curve[-1, 0] * (1 + 1e-3), k + 1]
            assert len(expected) > 90, "enough of the signal"
            # Upwards in the picture is down in its numbers.
            assert abs(turns(-curve[:, 1]) - turns(expected)) <= 1 + 0.05 * turns(expected), (NUMBER, name, options, k, turns(expected))
        assert max(turns(curve[:, 1]) for curve in curves) >= 4, (NUMBER, name, options)
        for at, anchor, label in labels:
            right = at + {"middle": 0.5, "end": 0.0}[anchor] * 6 * len(label)
            assert right <= width, (NUMBER, name, at, anchor, label)


def test_the_page_is_about_the_signal_that_is_used(tmp_path: Path) -> None:
    about = {"levels": "<strong>Levels</strong>", "multisine": "<strong>Multisine</strong>", "chirp": "<strong>Chirp</strong>"}
    of_limits = {"levels": "same seed give the same levels", "multisine": "uncorrelated over whole periods only", "chirp": "each frequency once in a period"}
    for signal in about:
        up_to = [] if signal == "levels" else ["--up-to", 30]
        begun(tmp_path, "--settling-time", 1, "--signal", signal, *up_to, name=signal.title())
        text = page(tmp_path, signal.title())
        for other in about:
            assert (about[other] in text) == (of_limits[other] in text) == (other == signal), (signal, other)
        assert ("Schroeder" in text) == (signal == "multisine") and "<!-- only" not in text
