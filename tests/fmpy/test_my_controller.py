"""A controller of one's own: examples/my_controller built, exported, simulated alone and run in a loop, as docs/own_controller.md does."""

import csv
import re
import shlex
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest
from conftest import PROGRAM, ROOT
from sample import ALL

PAGE = (ROOT / "docs" / "own_controller.md").read_text().split("### A controller in Rust")[1]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a reader who has done what the page says; a commit builds without optimisation, which is soon done."""
    folder = tmp_path_factory.mktemp("reader")
    for name in ["examples", "target"]:
        (folder / name).symlink_to(ROOT / name)
    text = re.search(r"```sh\n(.*?)```", PAGE, re.S)[1].replace("\\\n", "")
    for command in (text if ALL else text.replace(" --release", "").replace("/release/", "/debug/")).splitlines():
        program, *words = shlex.split(command)
        called, at = (PROGRAM, folder) if program == "adaptive-fmu" else (program, ROOT if program == "cargo" else folder)
        subprocess.run([called, *words], check=True, cwd=at, capture_output=True)
    return folder


def test_the_controller_alone_adapts_as_its_equations_do(drive: Path) -> None:
    """With y = 0 the reference model is r (1 - exp(-a t)), and k_r the integral of Gamma y_m r."""
    fmu, r, a, gain = drive / "mine" / "drive" / "resources" / "SpeedController.fmu", 100.0, 4.0, 5e-6
    for interface, options in [("CoSimulation", {}), ("ModelExchange", {"solver": "CVode", "relative_tolerance": 1e-9})]:
        start = {"bandwidth": a, "speed_reference": r}
        ran = fmpy.simulate_fmu(str(fmu), stop_time=2.0, output_interval=0.1, fmi_type=interface, start_values=start, **options)
        t = ran["time"]
        k_r = gain * r**2 * (t - (1 - np.exp(-a * t)) / a)
        assert ran["model_speed"] == pytest.approx(r * (1 - np.exp(-a * t)), rel=1e-4, abs=1e-9), interface
        assert ran["gains[1]"] == pytest.approx(k_r, rel=1e-4, abs=1e-9) and not ran["gains[2]"].any(), interface
        assert ran["voltage"] == pytest.approx(k_r * r, rel=1e-4, abs=1e-7), interface


def test_the_motor_comes_to_its_reference_though_the_controller_knows_no_motor(drive: Path) -> None:
    with (drive / "results" / "drive" / "result.csv").open() as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    assert rows[-1]["time"] == 10.0 and rows[-1]["reference.speed_reference"] == 100.0
    error = [row["plant.speed"] - row["controller.model_speed"] for row in rows]
    assert max(map(abs, error)) > 10 and max(map(abs, error[-1000:])) < 1e-3
    # What the motor needs for 100 rad/s: i = 0.5 / 250 * 100 A, u = i + 0.05 * 100 V.
    assert rows[-1]["controller.voltage"] == pytest.approx(5.2, abs=1e-6)
