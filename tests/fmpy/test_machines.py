"""From a record to a controller, by the program's commands: identify, new, check, export; and the exported controller in a loop with the
machine that was recorded, which isn't linear, through sensors with noise.

Machines and records are those of tests/identification, of seed 1 and of a seed that differs from run to run. FMPy steps the controllers.
"""

import json
import subprocess
import sys
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import sample
from machine_loops import ALL_OF_THEM, MOTOR, Machine, Motion, designed, loop, program, record
from master import Fmu
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import fsolve
from scipy.signal import place_poles

Array = np.ndarray
SEEDS = [1, *(range(2, 10) if sample.ALL else [sample.NUMBER + 2])]
# With records of other seeds the couplings of the tanks may not be seen where all of B is free: each pump fills its own tank.
PUMPS = 'A = [["?<0", "?>0"], ["?>0", "?<0"]]\nB = [["?>0", 0], [0, "?>0"]]\n'
ONE_PLACE = pytest.mark.skipif(sys.platform != "linux", reason="a library is made for this system")


@dataclass(frozen=True)
class Designed:
    """What the commands made of a record."""

    machine: Machine
    folder: Path
    model: dict
    design: dict
    report: dict

    @property
    def step(self) -> float:
        return self.design["experiment"]["step"]

    @property
    def nominal(self) -> tuple[Array, Array, Array]:
        return tuple(np.array(self.design["structure"][name]) for name in "ABC")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory):
    """Controllers and their loops, each once."""
    controllers: dict[tuple[str, int], Designed] = {}
    loops: dict[tuple[str, int], Motion] = {}

    def controller(name: str, seed: int) -> Designed:
        if (name, seed) not in controllers:
            machine, folder = ALL_OF_THEM[name], tmp_path_factory.mktemp(name)
            if name == "tanks" and seed > 1:
                machine = replace(machine, structure=PUMPS)
            record(folder, machine, seed)
            controllers[name, seed] = Designed(machine, folder, *designed(folder, machine, "--margin", "1"))
        return controllers[name, seed]

    def motion(name: str, seed: int) -> Motion:
        if (name, seed) not in loops:
            of = controller(name, seed)
            loops[name, seed] = loop(exported(of), of.machine, of.step, seed)
        return loops[name, seed]

    controller.motion = motion
    return controller


def exported(of: Designed, description: str = "C.toml", folder: str = "fmus") -> Fmu:
    """The controller as a generic FMU."""
    done = program(of.folder, "export", description, "--out", folder)
    assert done.returncode == 0, done.stderr
    return Fmu(of.folder / folder / "C.fmu", of.folder / folder / "unpacked")


def compiled(of: Designed) -> Fmu:
    """The controller as an FMU with the library that a compiler makes of its C sources alone."""
    done = program(of.folder, "export", "C.toml", "--source", "--out", "sources")
    assert done.returncode == 0, done.stderr
    unpacked, library, file = of.folder / "sources" / "unpacked", of.folder / "C.so", of.folder / "compiled.fmu"
    with zipfile.ZipFile(of.folder / "sources" / "C.fmu") as archive:
        archive.extractall(unpacked)
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", unpacked / "sources" / "all.c", "-lm", "-o", library], check=True)
    with zipfile.ZipFile(file, "w") as archive:
        archive.write(unpacked / "modelDescription.xml", "modelDescription.xml")
        archive.write(library, "binaries/linux64/C.so")
        for resource in (unpacked / "resources").rglob("*"):
            archive.write(resource, resource.relative_to(unpacked))
    return Fmu(file, of.folder / "compiled")


def value(report: dict, name: str) -> float:
    [found] = [finding["value"] for finding in report["findings"] if finding["name"] == name]
    return float(found)


def at_rest(of: Designed, r: Array) -> Array:
    """Error of the outputs at rest, without noise, from the equations at rest alone.

    The predictor is where the nominal plant would be: 0 = A_m x̂ + B K_g r. What differs of the machine's state is orthogonal to BᵀP, since
    the estimates rest; which leaves as many unknowns as the machine has states and inputs.
    """
    A, B, C = of.nominal
    n, m = B.shape
    start = of.design["start"]
    if "A_m" in start:
        desired = np.array(start["A_m"])
    else:
        poles = np.array(start["pole_real"]) + 1j * np.array(start["pole_imag"])
        desired = A - B @ place_poles(A, B, poles).gain_matrix
    P = solve_continuous_lyapunov(desired.T, -np.array(start["Q"]))
    predicted = np.linalg.solve(np.block([[A, B], [C, np.zeros((len(C), m))]]), np.concatenate([np.zeros(n), r]))

    def equations(unknowns: Array) -> Array:
        x, u = unknowns[:n] * scale[:n], unknowns[n:] * scale[n:]
        return np.concatenate([of.machine.rates(x, u if m > 1 else u[0]) / rates, B.T @ P @ (x - predicted[:n]) / weights])

    scale = np.maximum(np.abs(predicted), 0.05 * np.abs(predicted).max())
    scale[n:] = np.maximum(np.abs(predicted[n:]), 0.1)
    rates, weights = np.abs(A) @ scale[:n] + np.abs(B) @ scale[n:], np.abs(B.T @ P) @ scale[:n]
    found, _, success, message = fsolve(equations, predicted / scale, full_output=True)
    assert success == 1, message
    return C @ (found[:n] * scale[:n]) - r


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ALL_OF_THEM)
def test_a_record_gives_a_controller_that_is_sound(name: str, seed: int, made) -> None:
    of = made(name, seed)
    model, report = of.model, of.report
    if seed == 1:
        assert len(model["free"]) == of.machine.unknowns
    fits = model["fit"]["held_out"] or model["fit"]["windows"]
    # Other records show less: of 51 seeds one left a fit of 79.5 %, and two λ* of 1.2 and 1.3 with regions that are stable.
    assert min(fits) > (80 if seed == 1 else 70), fits
    assert report["sound"] and value(report, "lambda*") < (1 if seed == 1 else 2), report["text"]
    assert "At most 4.5 % of the plants of the region are not stable" in report["text"]
    print(name, seed, "fit", np.round(fits, 1), "lambda*", round(value(report, "lambda*"), 2), "K", of.design["start"]["feedback_gain"])
    # No step is longer than that between rows, and all of the region is stable with it.
    assert of.step <= model["sample_time"] * (1 + 1e-9)


@pytest.mark.parametrize("name", ALL_OF_THEM)
def test_a_good_record_has_no_fault(name: str, made) -> None:
    """What is said of it is what is true: residuals are coloured where friction or curves aren't in the model."""
    of = made(name, 1)
    words = [*of.machine.signals, "--structure", "structure.toml", "--json", "--out", "again.json"]
    output = json.loads(program(of.folder, "identify", "record.csv", *words).stdout)
    print(name, output["findings"], "beyond the model", output["model"]["disturbance"], output["unmatched"])
    assert {finding["kind"] for finding in output["findings"]} <= {"coloured_residuals"}, output["findings"]
    assert output["model"] == of.model
    if name == "motor":
        # Friction acts on both speeds, and nothing on the current.
        matched, unmatched = output["model"]["disturbance"], output["unmatched"]
        assert max(matched) < 0.05 and 20 < unmatched[1] < 80 and 3 < unmatched[3] < 14, output


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ALL_OF_THEM)
def test_the_machine_follows_its_reference(name: str, seed: int, made) -> None:
    of, motion = made(name, seed), made.motion(name, seed)
    machine, outputs = of.machine, [list(of.design["names"]["x"]).index(output) for output in of.machine.outputs]
    for line, error in zip(machine.references, motion.error(machine), strict=True):
        r = np.array(line[1:])
        rest = (motion.time >= line[0] + machine.settled) & (np.abs(motion.r - r) < 1e-12).all(1)
        off = (motion.x[rest][:, outputs] - r).mean(0)
        spread = motion.x[rest][:, outputs].std(0)
        reported = at_rest(of, r)
        print(name, seed, r, "rms", error.round(5), "mean", off.round(5), "by equations", reported.round(5), "spread", spread.round(5))
        # The cart sways slowly with noise: its mean over so short a time isn't 0.
        allowed = np.array(machine.error) * (1 if seed == 1 else 1.5)
        assert (spread < 2 * allowed).all(), (seed, spread)
        if machine is MOTOR:
            # Unmatched friction shifts its speed at rest.
            assert (np.abs(off - reported) < allowed).all(), (seed, off, reported)
            assert (error < 0.06 * np.abs(r)).all(), (seed, error)
        else:
            assert (error < 2 * allowed).all(), (seed, error)


def test_weights_that_are_equal_leave_the_speed_where_it_should_be(made) -> None:
    """With Q = I friction shifts the motor's speed by a tenth of what it does with the weights that `new` writes."""
    of = made("motor", 1)
    text = (of.folder / "C.toml").read_text()
    before, rest = text.split("Q = [\n", 1)
    equal = "Q = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]\n"
    (of.folder / "equal.toml").write_text(before + equal + rest.split("\n]\n", 1)[1])
    one_step = replace(of.machine, references=MOTOR.references[:1], stop=1.2)
    errors = np.ravel(loop(exported(of, "equal.toml", "equal"), one_step, of.step, 1).error(one_step))
    print("rms", errors)
    assert (errors < 2 * MOTOR.error[0]).all(), errors


@ONE_PLACE
@pytest.mark.parametrize("name", ALL_OF_THEM)
def test_the_controller_from_c_sources_moves_the_machine_alike(name: str, made) -> None:
    of, generic = made(name, 1), made.motion(name, 1)
    other = loop(compiled(of), of.machine, of.step, 1)
    for one, two in [(generic.x, other.x), (generic.u, other.u)]:
        difference = np.abs(one - two).max(0) / np.abs(one).max(0)
        print(name, "largest difference", difference)
        assert (difference < 1e-6).all(), difference
