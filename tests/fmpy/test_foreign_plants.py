"""From the unit of another tool to a closed loop, with the commands of docs/own_controller.md: a motor in C, and one in
Python (PythonFMU)."""

import json
import os
import platform
import re
import shlex
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu, read_csv

FOREIGN = ROOT / "tests" / "foreign"
TITLE = "## With a plant of another tool"
_, SECTION = (ROOT / "docs" / "own_controller.md").read_text().split(TITLE)
COMMANDS = [
    line for block in re.findall(r"```sh\n(.*?)```", SECTION.split("\n## ")[0], re.S) for line in block.splitlines()
]
# The step of the reference, at 1 s.
HEIGHT = 100.0

MOTOR = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Motor(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.voltage = self.speed = self.current = 0.0
        self.register_variable(Real("voltage", causality=Fmi2Causality.input))
        self.register_variable(Real("speed", causality=Fmi2Causality.output))
        self.register_variable(Real("current", causality=Fmi2Causality.output))

    def rates(self, speed, current):
        voltage = min(max(self.voltage, -12.0), 12.0)
        return -0.5 * speed + 250.0 * current, -25.0 * speed - 500.0 * current + 500.0 * voltage

    def do_step(self, current_time, step_size):
        if current_time > 0.5 and FAILS:
            raise ValueError("the shaft is broken")
        steps = max(1, round(step_size / 2e-4))
        h = step_size / steps
        for _ in range(steps):
            x = self.speed, self.current
            k1 = self.rates(*x)
            k2 = self.rates(*(a + h / 2 * k for a, k in zip(x, k1)))
            k3 = self.rates(*(a + h / 2 * k for a, k in zip(x, k2)))
            k4 = self.rates(*(a + h * k for a, k in zip(x, k3)))
            self.speed, self.current = (
                a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)
            )
        return True
"""


def in_c(folder: Path) -> Path:
    """The motor in C, built as another tool's unit."""
    library, file = folder / "Motor.so", folder / "Motor.fmu"
    compile_it = ["cc", "-shared", "-fPIC", "-O1", "-w", "-fvisibility=hidden", "-o", library]
    subprocess.run([*compile_it, FOREIGN / "dc_motor.c", "-lm"], check=True)
    with zipfile.ZipFile(file, "w") as archive:
        archive.write(FOREIGN / "dc_motor.xml", "modelDescription.xml")
        archive.write(library, "binaries/linux64/Motor.so")
    return file


def in_python(folder: Path, fails: bool = False) -> Path:
    """The motor in Python, as PythonFMU builds it."""
    script = folder / "motor.py"
    script.write_text(MOTOR.replace("FAILS", str(fails)))
    words = [sys.executable, "-m", "pythonfmu", "build", "-f", script, "-d", folder, "--no-external-tool"]
    built = subprocess.run(words, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder / "Motor.fmu"


# What the program needs to find the Python of these tests, with PythonFMU in it.
PYTHON = {
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "PYTHONPATH": sysconfig.get_paths()["purelib"],
}


def shared_python() -> bool:
    """Whether the `python3` that the program finds has a shared library, which such a unit needs."""
    question = "import sysconfig; print(sysconfig.get_config_var('Py_ENABLE_SHARED'))"
    answer = subprocess.run(
        ["python3", "-c", question], env={**os.environ, **PYTHON}, capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() == "1"


is_here = (sys.platform, platform.machine()) == ("linux", "x86_64")
C_ONLY = pytest.mark.skipif(not is_here, reason="the motor in C is built for Linux on x86-64")
C = pytest.param(in_c, id="C", marks=C_ONLY)
needs_python = pytest.mark.skipif(
    not (is_here and shared_python()),
    reason="python3 has no shared library (Py_ENABLE_SHARED is 0), or PythonFMU no library for this machine",
)
PYTHON_FMU = pytest.param(in_python, id="PythonFMU", marks=needs_python)


def command(line: str, folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """A command of the page, where `mine` is a folder."""
    program, *words = shlex.split(line)
    assert program == "adaptive-fmu", line
    words = [str(PROGRAM), *(re.sub(r"^mine(?=/|$)", str(folder), word) for word in words)]
    environment = {**os.environ, **PYTHON}
    return subprocess.run([*words, *more], cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The folder that the commands of the page leave for a motor, once for each, but for the last, which runs the loop."""
    folders: dict[Callable, Path] = {}

    def get(build: Callable[[Path], Path]) -> Path:
        if build not in folders:
            folder = folders[build] = tmp_path_factory.mktemp("mine")
            build(folder)
            for line in COMMANDS[:-1]:
                done = command(line, folder)
                assert done.returncode == 0, done.stderr
        return folders[build]

    return get


def test_the_page_leads_from_the_unit_to_the_run() -> None:
    kinds = ["new l1 ", "new reference ", "new loop ", "run "]
    assert len(COMMANDS) == 4 and all(kind in line for kind, line in zip(kinds, COMMANDS, strict=True)), COMMANDS


@pytest.mark.parametrize("build", [C, PYTHON_FMU])
def test_a_controller_is_begun_for_the_unit_and_the_loop_is_wired(build: Callable, begun: Callable) -> None:
    folder = begun(build)
    output = command(COMMANDS[2], folder, "--force")
    assert output.returncode == 0 and "connected inputs: 4; open inputs, each with a comment in the file: 0" in output.stdout, output
    wired = (folder / "SystemStructure.ssd").read_text()
    assert wired.count("<ssd:Connection ") == 4 and "TO DECIDE" not in wired
    # The motor's limits are the controller's, where its description tells them.
    limits = re.findall(r"^u_(?:min|max) = \[(.*)\]", (folder / "MotorController.toml").read_text(), re.M)
    assert [float(limit.split("]")[0]) for limit in limits] == ([-12.0, 12.0] if build is in_c else [-1e15, 1e15])


@pytest.mark.parametrize("options", [[], ["--in-process"]], ids=["own process", "in process"])
@pytest.mark.parametrize("build", [C, PYTHON_FMU])
def test_the_speed_follows_its_step_and_stays(
    build: Callable, options: list[str], begun: Callable, tmp_path: Path
) -> None:
    if options and build is in_python:
        pytest.skip("Python can't be unloaded: it runs in a process of its own")
    done = command(COMMANDS[-1], begun(build), *options, "--until", "2", "--json", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["ended"] == "complete"
    result = read_csv(Path(output["results"]) / "result.csv")
    time, speed = result["time"], result["plant.speed"]
    reference = result["reference.speed_reference"]
    assert time[-1] == 2.0 and np.all(reference[time > 1.001] == HEIGHT) and np.all(speed[time < 1.0] == 0.0)
    assert np.abs(speed[time > 1.5] - HEIGHT).max() < 0.01 * HEIGHT
    assert speed.max() < 1.05 * HEIGHT
    if build is in_c:
        assert np.abs(result["controller.voltage"]).max() <= 12.0
    labels = {metric["label"]: metric["value"] for metric in output["metrics"]}
    errors = [value for label, value in labels.items() if label.startswith("rms (speed - speed_reference)")]
    assert len(errors) == 1 and abs(errors[0] - np.sqrt(np.mean((speed - reference) ** 2))) < 1e-9


@needs_python
def test_an_exception_of_an_fmu_in_python_is_reported_by_its_text(begun: Callable, tmp_path: Path) -> None:
    whole = begun(in_python)
    for name in ["MotorController.toml", "MotorReference.toml", "SystemStructure.ssd"]:
        (tmp_path / name).write_text((whole / name).read_text())
    in_python(tmp_path, fails=True)
    done = command(COMMANDS[-1], tmp_path, "--until", "2", "--out", str(tmp_path / "results"))
    assert done.returncode == 1, done
    error = done.stderr.splitlines()[-1]
    assert error.startswith("error: plant: fmi2DoStep failed at t = 0.5") and "the shaft is broken" in error, done.stderr
    (table,) = (tmp_path / "results").glob("*/result.csv")
    assert 0.5 <= read_csv(table)["time"][-1] < 0.51, "what was computed until then is kept"


def test_the_error_names_what_is_missing_where_there_is_no_such_fmu(tmp_path: Path) -> None:
    refused = adaptive_fmu("new", "loop", "--units", tmp_path / "Gone.fmu", "--out", tmp_path / "loop")
    assert refused.returncode == 1 and "Gone.fmu" in refused.stderr and not (tmp_path / "loop").exists()


STUDY = """
title = "Motors"
about = "A motor of another tool."
[budget]
particles = 1
generations = 1
noises = 1
tuning_time = 1.0
plants = 3
margin = 1.0
[[plant]]
name = "motor"
title = "DC motor"
unit = "Motor.fmu"
reference = "MotorReference.toml"
duration = 3.0
step = 0.001
settled = 2.0
errors = [["plant.speed", "reference.speed_reference"]]
error_limits = [20.0]
envelope = 1e4
uncertain = []
pulse = { "actuator.bias[1]" = 1.0 }
[plant.bench]
u_min = [-12.0]
u_max = [12.0]
lag = 0.001
noise = { speed = 0.1 }
[[plant.controller]]
name = "l1"
unit = "MotorController.toml"
"""


@C_ONLY
def test_it_takes_part_in_a_league(begun: Callable, tmp_path: Path) -> None:
    """As separate units, and with the numbers of the loop: the bench that does nothing changes none of them."""
    folder = begun(in_c)
    study = folder / "study.toml"
    study.write_text(STUDY)
    done = adaptive_fmu("league", "--study", study, "--out", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    (record,) = json.loads(done.stdout)["pairs"]
    assert record["as_one"] is False and record["conditions"]["nominal"]["outcome"]["failure"] is None
    ran = command(COMMANDS[-1], folder, "--until", "3", "--json", "--out", str(tmp_path / "run"))
    result = read_csv(Path(json.loads(ran.stdout)["results"]) / "result.csv")
    settled = result["time"] >= 2.0
    error = (result["plant.speed"] - result["reference.speed_reference"])[settled]
    (rms,) = record["conditions"]["nominal"]["outcome"]["rms"]
    assert rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.02, abs=1e-3)
    # Another file of the same name is another unit.
    (folder / "Motor.fmu").write_bytes((folder / "Motor.fmu").read_bytes() + b" ")
    again = adaptive_fmu("league", "--study", study, "--out", tmp_path / "out")
    assert again.returncode == 1 and "descriptions of its FMUs differ" in again.stderr, again.stderr
