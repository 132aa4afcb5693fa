"""`verify` on a device of OpenCL: the failures of the processor, and what is said where there is none.

The device is pocl's, a processor. Without it, what needs one is skipped.
"""

import csv
import hashlib
import json
import os
import re
import subprocess
from pathlib import Path

import pytest
from conftest import PROGRAM
from ensembles import STUDIES, studied
from sample import ALL, NUMBER

POCL = "Portable Computing Language"


def answer(*words: object, device: str | None = POCL) -> subprocess.CompletedProcess:
    environment = {name: value for name, value in os.environ.items() if name != "ADAPTIVE_FMU_OPENCL"}
    environment |= {} if device is None else {"ADAPTIVE_FMU_OPENCL": device}
    command = [PROGRAM, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.fixture(scope="module")
def device(tmp_path_factory: pytest.TempPathFactory) -> str:
    options = ["--vary", "plant.omega=±1%", "--require", "max |u| <= 9", "--runs", 1, "--until", 0.01, "--backend", "gpu"]
    tried = answer("verify", "3.2.1-cosine", *options, "--out", tmp_path_factory.mktemp("device"))
    if "no driver has a device of OpenCL" in tried.stderr:
        pytest.skip("pocl isn't installed")
    assert tried.returncode == 0, tried.stderr
    return POCL


def samples(result: dict) -> list[dict[str, str]]:
    with open(Path(result["results"]) / "samples.csv", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", list(STUDIES) if ALL else [list(STUDIES)[NUMBER % len(STUDIES)]])
def test_both_find_the_same_failures_and_metrics(device: str, name: str, tmp_path: Path) -> None:
    loop, label, limit, options = studied(PROGRAM, name, tmp_path)
    found = {}
    for backend in ("cpu", "gpu"):
        words = [loop, *options, "--runs", 500 if ALL else 130, "--backend", backend, "--json"]
        made = answer("verify", *words, "--out", tmp_path / backend)
        assert made.returncode == 0, made.stderr
        found[backend] = json.loads(made.stdout)
    accelerated = found["gpu"]["accelerated"]
    assert accelerated["device"] and accelerated["failure"] is None and found["cpu"]["accelerated"] is None
    assert accelerated["with_error_control"] < len(samples(found["gpu"])), "most runs are the device's"
    assert found["cpu"]["failures"] == found["gpu"]["failures"] and 0 < found["cpu"]["failures"] < len(samples(found["cpu"]))
    for exact, other in zip(samples(found["cpu"]), samples(found["gpu"]), strict=True):
        assert exact["result"] == other["result"]
        # Further on than those that were made twice, a metric may be a little less accurate.
        assert abs(float(exact[label]) - float(other[label])) <= max(1e-3, 3 * accelerated["largest_difference"]) * limit


def test_what_is_not_for_fixed_steps_is_made_by_the_processor_and_the_reason_is_given(device: str, tmp_path: Path) -> None:
    options = ["--vary", "plant.omega=±30%", "--until", "0.1", "--runs", "20", "--backend", "gpu", "--out", tmp_path]
    made = answer("verify", "3.2.1-cosine", *options, "--require", "max |u| <= 9", "--separate")
    assert made.returncode == 0 and "No graphics card was used: the loop is not one continuous system." in made.stdout, made
    # A count has no distance to its limit.
    options = ["--vary", "plant.x0[1]=0.1..0.2", "--until", "0.01", "--runs", "20", "--backend", "gpu", "--out", tmp_path]
    made = answer("verify", "6.5.1-mrac", *options, "--require", "funnel")
    assert made.returncode == 0 and "of 20 runs are so near a limit that they need error control." in made.stdout, made


def test_a_study_goes_on_where_it_ended(device: str, tmp_path: Path) -> None:
    loop, vary, _, _ = STUDIES["plain"]
    words = [loop, *(word for text in vary for word in ("--vary", text)), "--require", "max |u| <= 1", "--until", "0.2", "--backend", "gpu"]
    first = json.loads(answer("verify", *words, "--runs", 110, "--json", "--out", tmp_path).stdout)
    begun = samples(first)
    # As it began, although for so few runs a device isn't looked for.
    more = json.loads(answer("verify", *words[:-2], "--runs", 140, "--json", "--out", tmp_path).stdout)
    assert (samples(more)[:110], len(samples(more))) == (begun, 140)
    step = first["accelerated"]["fixed_step"]
    assert more["accelerated"]["fixed_step"] == step
    # An earlier call may have found that shorter steps are needed.
    file = Path(more["results"]) / "runs.bin"
    known = file.read_bytes()[:-64]
    number = int(re.search(rb'"substeps":(\d+)', known)[1])
    known = known.replace(b'"substeps":%d' % number, b'"substeps":%d' % (2 * number))
    file.write_bytes(known + hashlib.sha256(known).hexdigest().encode())
    further = json.loads(answer("verify", *words, "--runs", 150, "--json", "--out", tmp_path).stdout)
    assert further["accelerated"]["fixed_step"] == step / 2


def test_all_metrics_have_the_values_that_they_have_on_the_processor(device: str, own: Path, tmp_path: Path) -> None:
    words = ["verify", own, "--vary", "motor.A[1,2]=±20%", "--require", "settling speed <= 5", "--until", "1.3", "--runs", 104, "--json"]
    made = [answer(*words, "--backend", backend, "--out", tmp_path / backend) for backend in ("cpu", "gpu")]
    exact, found = (json.loads(one.stdout) for one in made)
    assert found["accelerated"]["runs"] > 0
    for one, other in zip(samples(exact), samples(found), strict=True):
        assert {name for name, value in one.items() if value} == {name for name, value in other.items() if value}


def test_without_a_device_the_processor_is_used_or_the_message_says_what_to_do(tmp_path: Path) -> None:
    words = ["verify", "3.2.1-cosine", "--vary", "plant.omega=±30%", "--require", "max |u| <= 9", "--until", "0.1", "--runs", "5"]
    made = answer(*words, "--out", tmp_path, device="no such device")
    assert made.returncode == 0 and "graphics" not in made.stdout
    refused = answer(*words, "--backend", "gpu", "--out", tmp_path, device="no such device")
    assert refused.returncode == 1 and "ADAPTIVE_FMU_OPENCL=no such device: " in refused.stderr
    refused = answer(*words, "--backend", "card", "--out", tmp_path)
    assert refused.returncode == 2 and "must be auto, cpu or gpu" in refused.stderr
