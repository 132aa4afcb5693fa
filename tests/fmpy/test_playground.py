"""The page from a plant to an FMU: what the library answers in a browser is what the program does.

It is asked by Node.js, where the library was built for wasm32-unknown-unknown (tests/platforms/build)."""

import base64
import io
import json
import re
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
import random_plants
from conftest import ROOT, adaptive_fmu
from sample import ALL, NUMBER
from test_explore_pages import library as library  # noqa: PLC0414 (a fixture)

KINDS = ["pid", "ladrc", "l1", "l1-sampled"]
MOTOR = (ROOT / "examples/own/dc_motor/model.json").read_text()
# Functions of the C library round differently in a browser: figures with three digits may differ in the last one.
APART = 2e-3
# Roundings of the plant, in parts of A: a figure that they move in the program itself may be anywhere between.
ROUNDINGS = (1e-12, -1e-12, 1e-10, -1e-10)
PLANTS = 50 if ALL else 6


class Asker:
    """The library of a page, in Node.js."""

    def __init__(self, wasm: Path) -> None:
        command = ["node", str(ROOT / "tests/fmpy/ask.mjs"), str(wasm)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, question: dict[str, Any], libraries: list[Path] = []) -> dict[str, Any]:
        """The last line of the answer, with its milliseconds."""
        assert self.process.stdin and self.process.stdout
        self.process.stdin.write(json.dumps({"question": question, "libraries": list(map(str, libraries))}) + "\n")
        self.process.stdin.flush()
        lines = json.loads(self.process.stdout.readline())
        assert all("text" in line for line in lines[:-2]), "what comes before the answer is progress"
        return lines[-2] | lines[-1]

    def design(self, plant: str, kind: str, name: str = "Own", **options: Any) -> dict[str, Any]:
        defaults = {"bandwidth": None, "uncertainty": None, "reference": [], "noise": None, "values": {}, "quick": False}
        return self.ask({"design": defaults | {"plant": plant, "kind": kind, "name": name} | options})

    def file(self, what: str, plant: str, kind: str, name: str = "Own", libraries: list[Path] = [], **options: Any) -> bytes:
        wanted = {"plant": plant, "kind": kind, "name": name, "bandwidth": None, "uncertainty": None} | options
        answer = self.ask({"file": {"what": what} | wanted}, libraries)
        assert "error" not in answer, answer
        return base64.b64decode(answer["base64"])


@pytest.fixture(scope="module")
def asker(library: Path) -> Iterator[Asker]:
    if not shutil.which("node"):
        pytest.skip("there is no Node.js: the library for browsers is not asked without one")
    asker = Asker(library)
    yield asker
    asker.process.kill()


@pytest.fixture(scope="module")
def shared_library() -> Path:
    """The shared library that the program has for this machine."""
    release = ROOT / "target" / "release"
    found = [place for place in (release / "deps" / "libadaptive_fmu_library.so", release / "libadaptive_fmu_library.so") if place.is_file()]
    if not found:
        pytest.skip("the library for FMUs isn't there as a file")
    return found[0]


def new(folder: Path, kind: str, plant: str, *options: str) -> subprocess.CompletedProcess[str]:
    (folder / "plant.json").write_text(plant)
    options = (*options, "--no-schema", "--force", "--plant", "plant.json", "--name", "Own")
    return adaptive_fmu("new", kind, *options, folder=folder)


def numbers(findings: list[dict[str, Any]], key: str) -> list[tuple[str, str, Any]]:
    return [(it["section"], it["name"], it[key]) for it in findings]


def same_description(ours: str, theirs: str) -> bool:
    """The same text, but for the last of all digits of a number."""
    number = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")
    values = [[float(value) for value in number.findall(text)] for text in (ours, theirs)]
    return number.sub("#", ours) == number.sub("#", theirs) and np.allclose(*values, rtol=1e-9, atol=0)


def near(ours: Any, theirs: Any) -> bool:
    """Texts and numbers, as they are printed."""
    try:
        values = [[float(part.strip(" ±j%")) for part in str(text).strip(",").replace("…", ",").split(",")] for text in (ours, theirs)]
    except ValueError:
        return ours == theirs
    return np.allclose(*values, rtol=APART, atol=1e-9)


def without_poles(text: str) -> list[str]:
    """The lines of a report but for poles: of a multiple one, as dead times make them, roundings decide how it is shown."""
    return [line for line in text.splitlines() if not re.match(r"  (poles|eigenvalues) |  {30,}\S+.* 1/s", line)]


def rounded_report(folder: Path, kind: str, plant: random_plants.Plant, part: float) -> list[str]:
    """The program's report on a plant whose A differs by a rounding."""
    text = json.dumps(plant.json() | {"A": (np.array(plant.A) * (1 + part)).tolist()})
    assert new(folder, kind, text, "--bandwidth", str(plant.bandwidth)).returncode in {0, 3}
    return without_poles(json.loads(adaptive_fmu("check", "Own.toml", "--json", folder=folder).stdout)["text"])


@pytest.mark.parametrize("number", range(PLANTS))
def test_figures_of_a_random_plant_are_those_of_new_and_check(asker: Asker, number: int, tmp_path: Path) -> None:
    random = Random(f"playground {NUMBER} {number}")
    kind, of = random.choice(KINDS), random.choice(random_plants.CLASSES)
    plant = random_plants.plant(of, random)
    text, options = json.dumps(plant.json()), ["--bandwidth", str(plant.bandwidth)]
    ours = asker.design(text, kind, bandwidth=plant.bandwidth)
    written = new(tmp_path, kind, text, *options)
    if written.returncode == 1:
        assert "error" in ours and ours["error"].split(": ", 1)[-1][:40] in written.stderr, (ours, written.stderr)
        return
    assert "error" not in ours, (of, kind, ours)
    assert same_description(ours["description"], (tmp_path / "Own.toml").read_text())
    theirs = json.loads(adaptive_fmu("check", "Own.toml", "--json", folder=tmp_path).stdout)
    assert ours["verdict"] == theirs["verdict"], (of, kind)
    shown = [(it["section"], it["name"], it["verdict"]) for it in theirs["findings"]]
    assert [(it["section"], it["name"], it["verdict"]) for it in ours["findings"]] == shown
    reports = [without_poles(ours["text"]), without_poles(theirs["text"])]
    pairs = [(mine.split(), line.split()) for mine, line in zip(*reports, strict=True)]
    apart = [k for k, words in enumerate(pairs) if not all(near(a, b) for a, b in zip(*words, strict=True))]
    rounded = [rounded_report(tmp_path, kind, plant, part) for part in ROUNDINGS] if apart else []
    for k in apart:
        others = [pairs[k][1], *(report[k].split() for report in rounded)]
        for place, word in enumerate(pairs[k][0]):
            values = [float(words[place]) for words in others] if not near(word, others[0][place]) else []
            assert not values or min(values) * (1 - APART) <= float(word) <= max(values) * (1 + APART), (pairs[k], values)
    assert [len(it["curves"]) for it in ours["pictures"]] == [len(it["curves"]) for it in theirs["pictures"]]


def test_the_command_that_the_page_shows_writes_the_same_description(asker: Asker, tmp_path: Path) -> None:
    ours = asker.design(MOTOR, "l1", name="Drive", bandwidth=20.0, uncertainty=0.25, reference=[100.0])
    (tmp_path / "plant.json").write_text(MOTOR)
    done = adaptive_fmu(*ours["command"].split()[1:], "--no-schema", folder=tmp_path)
    assert done.returncode in {0, 3}, done.stderr
    assert (tmp_path / "Drive.toml").read_text() == ours["description"]


def test_a_quick_answer_has_the_nominal_figures_of_the_whole_one(asker: Asker) -> None:
    for kind in KINDS:
        whole = asker.design(MOTOR, kind, bandwidth=20.0, reference=[100.0])
        quick = asker.design(MOTOR, kind, bandwidth=20.0, reference=[100.0], quick=True)
        nominal = [it for it in whole["findings"] if it["section"] == "Nominal loop"]
        assert [it for it in quick["findings"] if it["section"] == "Nominal loop"] == nominal != []
        assert {curve["of"] for picture in quick["pictures"] for curve in picture["curves"]} <= {"nominal", "bound", "marks"}
        assert [it["title"] for it in quick["pictures"]] == [it["title"] for it in whole["pictures"]]


def test_start_values_that_were_changed_act_and_what_is_refused_is_reported(asker: Asker) -> None:
    plain = asker.design(MOTOR, "pid", bandwidth=20.0)
    gain = next(it for it in plain["parameters"] if it["name"].startswith("K_i"))
    changed = asker.design(MOTOR, "pid", bandwidth=20.0, values={gain["name"]: 2 * gain["value"]})
    after = next(it for it in changed["parameters"] if it["name"] == gain["name"])
    assert after["value"] == 2 * gain["value"] and after["default"] == gain["value"]
    assert changed["findings"] != plain["findings"]
    refused = asker.design(MOTOR, "l1", bandwidth=20.0, values={"adaptation_gain": -1.0})
    assert "adaptation_gain" in refused["error"] and "-1" in refused["error"]
    assert "not valid JSON" in asker.design("{", "pid")["error"]


def test_noise_of_the_measurement_moves_the_control_in_proportion(asker: Asker) -> None:
    one, two = (asker.design(MOTOR, "pid", bandwidth=20.0, noise=size)["noise"]["controls"][0] for size in (0.01, 0.02))
    assert two == pytest.approx(2 * one, rel=1e-6) and one > 0


def test_an_fmu_is_byte_for_byte_that_of_export(asker: Asker, shared_library: Path, tmp_path: Path) -> None:
    for kind in KINDS:
        assert new(tmp_path, kind, MOTOR, "--bandwidth", "20").returncode in {0, 3}
        done = adaptive_fmu("export", "Own.toml", "--library", shared_library, "--out", "fmus", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        ours = asker.file("fmu", MOTOR, kind, libraries=[shared_library], bandwidth=20.0)
        theirs = (tmp_path / "fmus/Own.fmu").read_bytes()
        if ours != theirs:
            checksums = [{entry.filename: entry.CRC for entry in zipfile.ZipFile(io.BytesIO(it)).infolist()} for it in (ours, theirs)]
            different = {name for name in checksums[0] | checksums[1] if checksums[0].get(name) != checksums[1].get(name)}
            # Reference results are written with all digits, of which the last few follow from functions of the C library.
            assert different == {f"extra/org.fmi-standard.fmi-ls-ref/{name}" for name in ("references.csv",)}, different


def test_libraries_of_a_refused_file_are_not_in_the_next(asker: Asker, shared_library: Path) -> None:
    wanted = {"plant": MOTOR, "kind": "l1", "name": "Own", "bandwidth": 20.0, "uncertainty": None}
    refused = asker.ask({"file": {"what": "fmu"} | wanted | {"values": {"adaptation_gain": -1.0}}}, [shared_library])
    assert "adaptation_gain" in refused["error"]
    assert "choose a platform" in asker.ask({"file": {"what": "fmu"} | wanted})["error"]
    assert zipfile.ZipFile(io.BytesIO(asker.file("fmu", MOTOR, "l1", libraries=[shared_library], bandwidth=20.0))).testzip() is None


def test_a_question_that_is_wrong_gets_the_reason(asker: Asker) -> None:
    assert "missing field `kind`" in asker.ask({"design": {"plant": MOTOR, "name": "Own"}})["error"]


def test_a_loop_runs_as_it_is(asker: Asker, shared_library: Path, tmp_path: Path) -> None:
    packed = asker.file("loop", MOTOR, "l1", libraries=[shared_library], bandwidth=20.0, reference=[100.0])
    (tmp_path / "Own_loop.ssp").write_bytes(packed)
    done = adaptive_fmu("run", "Own_loop.ssp", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    table = np.genfromtxt(next(tmp_path.rglob("*.csv")), delimiter=",", names=True, deletechars="")
    speed = next(name for name in table.dtype.names if name.startswith("plant.speed"))
    settled = table[speed][-1]
    assert settled == pytest.approx(100, rel=0.02)


def test_the_c_of_a_law_compiles_and_repeats_its_vectors(asker: Asker, tmp_path: Path) -> None:
    packed = asker.file("c", MOTOR, "l1", bandwidth=20.0)
    zipfile.ZipFile(io.BytesIO(packed)).extractall(tmp_path)
    sources = ["Own.c", "Own_replay.c"]
    subprocess.run(["cc", "-std=c99", "-O2", "-ffp-contract=off", "-DOwn_REPLAY", *sources, "-o", "replay", "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run(["./replay"], cwd=tmp_path, capture_output=True, check=False).returncode == 0


def test_a_record_becomes_the_plant_that_identify_finds(asker: Asker, tmp_path: Path) -> None:
    random = np.random.default_rng(NUMBER)
    time, u = np.arange(0, 20, 0.01), np.repeat(random.choice([-1.0, 1.0], 40), 50)
    x = np.zeros(len(time))
    for k in range(1, len(time)):
        x[k] = x[k - 1] + 0.01 * (-1.5 * x[k - 1] + 3 * u[k - 1])
    rows = [f"{t:.2f},{a:.1f},{b:.12g}" for t, a, b in zip(time, u, x + 1e-3 * random.standard_normal(len(x)), strict=True)]
    text = "\n".join(["time,u,speed", *rows]) + "\n"
    assert asker.ask({"columns": {"csv": text}})["columns"] == ["u", "speed"]
    ours = json.loads(asker.ask({"identify": {"csv": text, "inputs": ["u"], "states": ["speed"]}})["plant"])
    (tmp_path / "record.csv").write_text(text)
    done = adaptive_fmu("identify", "record.csv", "--inputs", "u", "--states", "speed", folder=tmp_path)
    assert done.returncode in {0, 3}, done.stderr
    theirs = json.loads((tmp_path / "model.json").read_text())
    assert ours["A"][0][0] == pytest.approx(theirs["A"][0][0], rel=1e-6) == pytest.approx(-1.5, rel=0.05)
    assert ours.keys() == theirs.keys()
    designed = asker.design(json.dumps(ours), "l1", bandwidth=4.0)
    assert "error" not in designed and designed["verdict"] in {"ok", "warning", "not_sound"}
