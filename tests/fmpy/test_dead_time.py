"""How much dead time plain MRAC and L1 control tolerate in example 3.2.1, as docs/controllers/mrac.md has it."""

import csv
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM
from sample import ROOT

ACTUATOR = """name = "Late"
model = "actuator"
description = "Dead time"

[structure]
channels = 1
delay_samples = 1000

[start]
delay = [{delay!r}]
sample_time = {step!r}
"""
COMPONENT = """<ssd:Component name="late" type="application/x-fmu-sharedlibrary" source="resources/Late.fmu"><ssd:Connectors>
<ssd:Connector name="u[1]" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="y[1]" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors></ssd:Component>"""
WIRE = '<ssd:Connection startElement="controller" startConnector="u[1]" endElement="late" endConnector="u[1]"/></ssd:Connections>'


def variation(loop: str, delay: float, step: float, folder: Path, *options: str) -> float:
    """The total variation of the control in 20 s, with a dead time between controller and plant."""
    text = (ROOT / f"examples/{loop}/SystemStructure.ssd").read_text()
    for file in (ROOT / f"examples/{loop}").glob("*.ssv"):
        (folder / file.name).write_text(file.read_text())
    late = 'startElement="late" startConnector="y[1]" endElement="plant"'
    text = re.sub(r'startElement="controller" startConnector="u\[1\]" endElement="plant"', late, text)
    place = text.index("</ssd:Component>", text.index('<ssd:Component name="controller"')) + len("</ssd:Component>")
    text = (text[:place] + COMPONENT + text[place:]).replace("</ssd:Connections>", WIRE)
    (folder / "SystemStructure.ssd").write_text(re.sub(r"\s*<(Metric|Plot)\b[^>]*/>", "", text))
    (folder / "Late.toml").write_text(ACTUATOR.format(delay=delay, step=step))
    out = folder / f"results {delay}"
    command = [PROGRAM, "run", ".", "--step", str(step), "--until", "20", "--out", out, "-q", *options]
    ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stderr
    with next(out.rglob("result.csv")).open() as file:
        head, *rows = csv.reader(file)
    u = np.array([float(row[head.index("controller.u[1]")]) for row in rows])
    return float(np.abs(np.diff(u)).sum())


@pytest.mark.parametrize(("gain", "calm", "chatters"), [(100, 1.5e-3, 2.5e-3), (1000, 0.2e-3, 0.3e-3)])
def test_the_dead_time_that_mrac_tolerates_falls_with_its_adaptation_gain(gain: int, calm: float, chatters: float, tmp_path: Path):
    none, below, above = (variation("3.2.1-mrac", delay, 1e-4, tmp_path, f"--set=controller.adaptation_gain={gain}") for delay in (0.0, calm, chatters))
    assert below < 1.5 * none and above > 3 * none, (none, below, above)


def test_the_l1_controller_tolerates_ten_times_as_much(tmp_path: Path):
    below, above = (variation("3.2.1-cosine", delay, 1e-3, tmp_path) for delay in (28e-3, 35e-3))
    assert below < 20 and above > 10 * below, (below, above)
