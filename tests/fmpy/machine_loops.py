"""Machines of tests/identification, from their records to controllers by the program's commands, and loops of exported controllers with the
machines as they are: not linear, with noise at the sensors."""

import json
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from conftest import PROGRAM, ROOT
from master import Fmu, Unit, Values

sys.path.append(str(ROOT / "tests" / "identification"))

import machines  # noqa: E402

Array = np.ndarray


def program(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *map(str, arguments)], cwd=folder, capture_output=True, text=True, timeout=120, check=False)


@dataclass(frozen=True)
class Machine:
    """A machine, its record and a task for its controller. `references` are lines of a table: a time in s, then a number for each output."""

    name: str
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    structure: str
    unknowns: int
    rates: Callable[..., Array]
    rest: tuple[float, ...]
    """State in which the loop begins."""
    noise: tuple[float, ...]
    """Standard deviation of the sensors' noise, as in the record."""
    limits: tuple[float, float]
    usual: tuple[float, ...]
    """Usual magnitude of each reference, `new --reference`."""
    references: tuple[tuple[float, ...], ...]
    stop: float
    settled: float
    """Time from a reference's step on after which the output rests, s."""
    error: tuple[float, ...]
    """Error at rest, rms, that the method reached with programs of its own."""

    @property
    def signals(self) -> list[str]:
        of = lambda names: ",".join(name.split(" ")[0] for name in names)  # noqa: E731
        return ["--inputs", of(self.inputs), "--states", of(self.states)]


MOTOR = Machine(
    name="motor",
    inputs=("voltage [V]",),
    states=("current [A]", "motor_speed [rad/s]", "twist [rad]", "load_speed [rad/s]"),
    outputs=("load_speed",),
    structure="""A = [["?", "?", 0, 0], ["?", "?", "?", "?"], "twist' = motor_speed - load_speed", [0, "?", "?", "?"]]
B = [["?"], [0], [0], [0]]
""",
    unknowns=13,
    rates=machines.motor_rates,
    rest=(0.0, 0.0, 0.0, 0.0),
    noise=(0.03, 0.5, 0.002, 0.5),
    limits=(-24.0, 24.0),
    usual=(50.0,),
    references=((0.0, 50.0), (1.5, -30.0)),
    stop=3.0,
    settled=0.9,
    error=(0.12,),
)
TANKS = Machine(
    name="tanks",
    inputs=("pump_1 [V]", "pump_2 [V]"),
    states=("level_1 [m]", "level_2 [m]"),
    outputs=("level_1", "level_2"),
    structure='A = [["?", "?"], ["?", "?"]]\nB = [["?", "?"], ["?", "?"]]\n',
    unknowns=10,
    rates=machines.tank_rates,
    rest=(0.3, 0.2),
    noise=(1e-3, 1e-3),
    limits=(0.0, 24.0),
    usual=(0.05, 0.05),
    references=((0.0, 0.32, 0.24), (500.0, 0.28, 0.2)),
    stop=1000.0,
    settled=300.0,
    error=(0.0022, 0.0038),
)
CART = Machine(
    name="cart",
    inputs=("force [N]",),
    states=("position [m]", "speed [m/s]", "angle [rad]", "rate [rad/s]"),
    outputs=("position",),
    structure="""A = ["position' = speed", [0, "?", "?", "?"], "angle' = rate", [0, "?", "?", "?"]]\n""",
    unknowns=10,
    rates=machines.cart_rates,
    rest=(0.0, 0.0, 0.05, 0.0),
    noise=(1e-3, 0.01, 2e-3, 0.02),
    limits=(-15.0, 15.0),
    usual=(0.3,),
    references=((0.0, 0.3), (12.0, -0.3)),
    stop=24.0,
    settled=4.0,
    error=(0.002,),
)
ALL_OF_THEM = {machine.name: machine for machine in (MOTOR, TANKS, CART)}


def record(folder: Path, machine: Machine, seed: int) -> Path:
    """The machine's record and structure as files."""
    step, u, measured = getattr(machines, machine.name)(seed)
    table = np.column_stack([step * np.arange(len(u)), u, measured])
    header = ",".join(["time", *machine.inputs, *machine.states])
    np.savetxt(folder / "record.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    (folder / "structure.toml").write_text(machine.structure)
    return folder / "record.csv"


def designed(folder: Path, machine: Machine, *options: str) -> tuple[dict, dict, dict]:
    """Model, description of an L1 controller and report of `check`."""
    done = program(folder, "identify", "record.csv", *machine.signals, "--structure", "structure.toml", "--force")
    assert done.returncode == 0, done.stdout + done.stderr
    outputs = ["--outputs", ",".join(machine.outputs), "--reference", ",".join(map(str, machine.usual))]
    done = program(folder, "new", "l1", "--name", "C", "--plant", "model.json", *outputs, *options, "--no-schema", "--force")
    assert done.returncode == 0, done.stdout + done.stderr
    done = program(folder, "check", "C.toml", "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    model, design = json.loads((folder / "model.json").read_text()), tomllib.loads((folder / "C.toml").read_text())
    return model, design, json.loads(done.stdout)


def advanced(rates: Callable[..., Array], x: Array, u: Array, step: float, count: int) -> Array:
    """The machine's state after a communication step, by so many steps of the method of Runge and Kutta."""
    given = u if len(u) > 1 else float(u[0])
    for _ in range(count):
        x = machines.fourth_order(rates, x, given, step / count)
    return x


@dataclass(frozen=True)
class Motion:
    """What a loop did: at each communication point the reference, the true state and the control."""

    time: Array
    r: Array
    x: Array
    u: Array

    def error(self, machine: Machine) -> list[Array]:
        """Error of each output at rest, rms, after each step of the reference."""
        names = [name.split(" ")[0] for name in machine.states]
        e = self.x[:, [names.index(name) for name in machine.outputs]] - self.r
        begins = [line[0] for line in machine.references]
        ends = [*begins[1:], machine.stop]
        # A reference steps at the row that is nearest.
        half = self.time[1] / 2
        at_rest = [(self.time >= a + machine.settled) & (self.time < b - half) for a, b in zip(begins, ends, strict=True)]
        return [np.sqrt((e[part] ** 2).mean(0)) for part in at_rest]


def loop(fmu: Fmu, machine: Machine, step: float, seed: int, substeps: int = 2) -> Motion:
    """The loop of an FMU, stepped at its communication step, with the machine and noise of its sensors: of all states, or of those that the FMU
    measures."""
    rng = np.random.default_rng(seed)
    n, m, p = len(machine.states), len(machine.inputs), len(machine.outputs)
    steps = round(machine.stop / step)
    time, r, x, u = step * np.arange(steps), np.empty((steps, p)), np.empty((steps, n)), np.empty((steps, m))
    noise = rng.normal(size=(steps, n)) * machine.noise
    state = np.array(machine.rest)
    plain = lambda names: [name.split(" ")[0] for name in names]  # noqa: E731
    with Unit(fmu) as unit:
        for j in range(m):
            unit[f"u_min[{j + 1}]"], unit[f"u_max[{j + 1}]"] = machine.limits
        seen = [place for place, name in enumerate(plain(machine.states)) if name in fmu.variables]
        references = [f"{name}_reference" for name in machine.outputs]
        given = Values(unit, references + [plain(machine.states)[place] for place in seen])
        control = Values(unit, plain(machine.inputs))
        for k in range(steps):
            r[k] = [line for line in machine.references if line[0] <= time[k] + step / 2][-1][1:]
            x[k] = state
            given.values[:] = [*r[k], *(state + noise[k])[seen]]
            if k == 0:
                unit.slave.setupExperiment(startTime=0.0)
                unit.slave.enterInitializationMode()
                given.set()
                unit.slave.exitInitializationMode()
            else:
                given.set()
            control.get()
            u[k] = control.values
            unit.step(time[k], step)
            state = advanced(machine.rates, state, u[k], step, substeps)
    return Motion(time, r, x, u)
