"""The nominal plant of a description: written by `new`, carried by the FMU, and read from models in discrete time."""

import json
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from scipy.signal import TransferFunction, cont2discrete, freqresp

MODEL = ROOT / "examples" / "own" / "two_mass_drive" / "model.json"


def new(kind: str, plant: dict | Path, folder: Path, *options: str) -> dict:
    """The description of a new FMU for a plant."""
    if isinstance(plant, dict):
        plant, matrices = folder / "plant.json", plant
        plant.write_text(json.dumps(matrices))
    file = folder / "Mine.toml"
    made = adaptive_fmu("new", kind, "--name", "Mine", "--plant", plant, "--out", file, "--force", "--no-schema", *options)
    assert made.returncode == 0, made.stderr
    return tomllib.loads(file.read_text())


@pytest.mark.parametrize("options", [[], ["--source"]])
def test_an_fmu_carries_and_prints_the_plant_that_it_was_designed_for(options: list[str], tmp_path: Path) -> None:
    nominal = new("pid", MODEL, tmp_path, "--bandwidth", "5", "--reference", "10", "--uncertainty", "20 %")["nominal"]
    plant = json.loads(MODEL.read_text())
    assert nominal == {name: plant[name] for name in "ABC"} | {"bandwidth": 5.0, "reference": 10.0, "uncertainty": 0.2}
    exported = adaptive_fmu("export", tmp_path / "Mine.toml", "--out", tmp_path, *options)
    assert exported.returncode == 0, exported.stderr
    with zipfile.ZipFile(tmp_path / "Mine.fmu") as fmu:
        assert tomllib.loads(fmu.read("resources/description.toml").decode())["nominal"] == nominal
        page, xml = (fmu.read(name).decode() for name in ("documentation/index.html", "modelDescription.xml"))
    assert '<h2 id="nominal">Nominal plant</h2>' in page and "<td>uncertainty<td>20<td>%" in page
    assert "nominal.A" not in xml and "uncertainty" not in xml


@pytest.mark.parametrize(
    ("uncertainty", "reason"),
    [
        ("20", "20 means 2000 %; write 20% or 0.2"),
        ("-1", "must be at least 0 and below 100 %"),
        ("nan", "below 100 %"),
        ("100%", "below 100 %"),
    ],
)
def test_an_uncertainty_that_is_none_is_refused(uncertainty: str, reason: str, tmp_path: Path) -> None:
    refused = adaptive_fmu(
        "new", "pid", "--name", "X", "--plant", MODEL, "--uncertainty", uncertainty, "--out", tmp_path / "X.toml"
    )
    assert refused.returncode == 2 and reason in refused.stderr and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("seed", range(8))
def test_a_sampled_model_becomes_the_plant_that_it_was_sampled_from(seed: int, tmp_path: Path) -> None:
    """With scipy's sampling behind a zero-order hold."""
    random = np.random.default_rng(seed)
    n, m = int(random.integers(1, 6)), int(random.integers(1, 3))
    A, B, C = random.normal(size=(n, n)), random.normal(size=(n, m)), random.normal(size=(1, n))
    dt = 0.9 / max(1.0, np.abs(np.linalg.eigvals(A)).max())
    discrete, input_matrix, *_ = cont2discrete((A, B, C, np.zeros((1, m))), dt)
    plant = {"A": discrete.tolist(), "B": input_matrix.tolist(), "C": C.tolist(), "dt": dt}
    structure = new("state-space", plant, tmp_path)["structure"]
    np.testing.assert_allclose(structure["A"], A, rtol=0, atol=1e-9 * np.abs(A).max())
    np.testing.assert_allclose(structure["B"], B, rtol=0, atol=1e-9 * np.abs(B).max())
    np.testing.assert_allclose(structure["delay"], [0.5 * dt] * m, rtol=1e-12)


@pytest.mark.parametrize(
    ("num", "den"),
    [([2.0], [1.0, 0.5, 1.0]), ([1.0, 3.0], [1.0, 6.0, 11.0, 6.0]), ([0.5, 0.1], [2.0, 3.0]), ([4.0], [1.0, 2.0, 0.0])],
)
@pytest.mark.parametrize("dt", [None, 0.05])
def test_a_transfer_function_becomes_a_plant_with_its_frequency_response(
    num: list[float], den: list[float], dt: float | None, tmp_path: Path
) -> None:
    plant = {"num": num, "den": den}
    if dt:
        [sampled], poles, _ = cont2discrete((num, den), dt)
        plant = {"num": sampled.tolist(), "den": poles.tolist(), "dt": dt}
    structure = new("state-space", plant, tmp_path)["structure"]
    A, B, C = (np.array(structure[name]) for name in "ABC")
    D = structure.get("D", [[0.0]])[0][0]
    for omega in [0.1, 1.0, 10.0]:
        found = (C @ np.linalg.solve(1j * omega * np.eye(len(A)) - A, B)).item() + D
        [expected] = freqresp(TransferFunction(num, den), [omega])[1]
        assert abs(found - expected) <= 1e-9 * max(1.0, abs(expected)), omega
