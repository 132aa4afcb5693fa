"""One loop of the study: what is varied, how the loop is run with FMPy, and when it counts as failed.

A result depends on this file, on the FMUs and on the seed alone, whichever machine it comes from.
"""

import ctypes
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import fmpy
import numpy as np
from fmpy import fmi2
from fmpy.fmi1 import FMICallException

# Judged for about a period of the references, after the transient from rest.
STOP, JUDGED_FROM = 13.0, 4.0
# Twice the errors with the parameters that the loop was designed for, 0.0250 and 0.0229 rad.
LARGEST_RMS = 0.05
# A joint that is half a turn off is lost, and the loop ended: it would only whirl about, which takes long to integrate.
LARGEST_ERROR = np.pi

HELD, LOST, NOT_FINITE, UNIT_FAILED, EXCEPTION = "held", "tracking lost", "not finite", "unit failed", "exception"

# The units in the order in which they are stepped, each with what it is handed first: unit, outputs, inputs.
UNITS = {
    "reference": ("ReferenceTwoLinkRobot", []),
    "plant": ("TwoLinkRobot", [("actuator", "y[1] y[2]", "u[1] u[2]")]),
    "sensor": ("SensorTwoLinkRobot", [("plant", "x[1] x[2] x[3] x[4]", "u[1] u[2] u[3] u[4]")]),
    "controller": (
        "L1TwoLinkRobot",
        [("reference", "r[1] r[2]", "r[1] r[2]"), ("sensor", "y[1] y[2] y[3] y[4]", "x[1] x[2] x[3] x[4]")],
    ),
    "actuator": ("ActuatorTwoLinkRobot", [("controller", "u[1] u[2]", "u[1] u[2]")]),
}
FMUS = [name for name, _ in UNITS.values()]

JOINTS = (1, 2)


@dataclass(frozen=True)
class Quantity:
    """What is varied: uniformly from `low` to `high`, or uniformly in its logarithm, or as one of `choices`."""

    name: str
    unit: str
    low: float
    high: float
    design: float
    logarithmic: bool = False
    choices: tuple[float, ...] = ()

    def at(self, part: float) -> float:
        """Its value below which this part of all samples is."""
        if self.choices:
            return self.choices[min(int(part * len(self.choices)), len(self.choices) - 1)]
        if self.logarithmic:
            return self.low * (self.high / self.low) ** part
        return self.low + (self.high - self.low) * part


QUANTITIES = (
    Quantity("m1", "kg", 2.56, 3.84, design=3.2),
    Quantity("m2", "kg", 1.6, 2.8, design=2.0),
    Quantity("l2", "m", 0.36, 0.44, design=0.4),
    Quantity("friction", "N m s/rad", 0.2, 5.0, design=1.0, logarithmic=True),
    Quantity("torque_limit", "N m", 80.0, 150.0, design=120.0),
    Quantity("drive_lag", "s", 1e-3, 1e-2, design=5e-3, logarithmic=True),
    Quantity("sensor_delay", "s", 0.0, 2e-3, design=0.0, choices=(0.0, 1e-3, 2e-3)),
    Quantity("rate_noise", "rad/s", 1e-3, 1e-1, design=1e-3, logarithmic=True),
    Quantity("adaptation_gain", "1", 1e4, 3e5, design=1e5, logarithmic=True),
    Quantity("feedback_gain", "1/s", 15.0, 45.0, design=30.0),
    Quantity("step", "s", 1e-3, 5e-3, design=1e-3, choices=(1e-3, 2e-3, 5e-3)),
)

Sample = dict[str, float]


def sample(seed: int, k: int) -> Sample:
    """The varied quantities of loop `k`, and the seed of its noise: independent of those of all other loops."""
    draw = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(k,)))).random
    values = {quantity.name: quantity.at(draw()) for quantity in QUANTITIES}
    return values | {"noise_seed": int(draw() * 2**31)}


def design() -> Sample:
    """The values that the loop was designed for."""
    return {quantity.name: quantity.design for quantity in QUANTITIES} | {"noise_seed": 1}


def start_values(sample: Sample) -> dict[str, dict[str, float]]:
    """What is set of each unit before it starts: poles as in case 2 of example 3.3.1, and the sample."""
    limit = sample["torque_limit"]
    plant = {name: sample[name] for name in ("m1", "m2", "l2")} | {f"k{i}": sample["friction"] for i in JOINTS}
    sensor = {f"delay[{i}]": sample["sensor_delay"] for i in range(1, 5)} | {"seed": sample["noise_seed"]}
    controller = {"adaptation_gain": sample["adaptation_gain"]}
    actuator = {}
    poles = ((-30.0, 0.5), (-30.0, -0.5), (-40.0, 0.5), (-40.0, -0.5))
    for i, (real, imaginary) in enumerate(poles, start=1):
        controller |= {f"pole_real[{i}]": real, f"pole_imag[{i}]": imaginary}
    for i in JOINTS:
        sensor[f"noise_deviation[{i + 2}]"] = sample["rate_noise"]
        # The predictor of the controller knows what the drives can give.
        controller |= {f"feedback_gain[{i},{i}]": sample["feedback_gain"], f"u_min[{i}]": -limit, f"u_max[{i}]": limit}
        actuator |= {f"time_constant[{i}]": sample["drive_lag"], f"u_min[{i}]": -limit, f"u_max[{i}]": limit}
    return {"reference": {}, "plant": plant, "sensor": sensor, "controller": controller, "actuator": actuator}


class Fmu:
    """An unpacked FMU, which instances are made of."""

    def __init__(self, folder: Path, loading: threading.Lock) -> None:
        # FMPy changes the working directory of the whole process while it loads a library.
        self.folder, self.loading = folder, loading
        self.description = fmpy.read_model_description(folder)
        self.variables = {variable.name: variable for variable in self.description.modelVariables}


class Unit:
    """An instance of an FMU, by the names of its variables."""

    def __init__(self, fmu: Fmu, name: str) -> None:
        self.name, self.fmu, self.messages = name, fmu, []
        description = fmu.description
        with fmu.loading:
            self.slave = fmi2.FMU2Slave(
                guid=description.guid,
                modelIdentifier=description.coSimulation.modelIdentifier,
                unzipDirectory=str(fmu.folder),
                instanceName=name,
            )
        self._callbacks = fmi2.fmi2CallbackFunctions()
        self._callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log)
        self.slave.instantiate(callbacks=self._callbacks)

    def _log(self, _environment: int, _name: bytes, _status: int, _category: bytes, text: bytes) -> None:
        self.messages.append(text.decode())

    def references(self, names: str) -> list[int]:
        """Value references of variables, their names separated by spaces."""
        return [self.fmu.variables[name].valueReference for name in names.split()]

    def start(self, values: dict[str, float]) -> Self:
        """Sets parameters, and goes through Initialization Mode."""
        self.slave.setupExperiment(startTime=0.0, stopTime=STOP)
        for name, value in values.items():
            set_it = self.slave.setInteger if self.fmu.variables[name].type == "Integer" else self.slave.setReal
            set_it(self.references(name), [value])
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self


# At a communication point: errors of both joints, and the torques that acted on them.
Point = tuple[float, float, float, float]


def steps(units: dict[str, Unit], step: float) -> Iterator[Point]:
    """Steps all units, each with the latest outputs of the others, to the end of the experiment."""
    # What each unit handed on last. FMPy's getReal and setReal would make new arrays each time.
    said, order = {}, []
    for name, (_, wires) in UNITS.items():
        handed = []
        for source, outputs, inputs in wires:
            outs, ins = units[source].references(outputs), units[name].references(inputs)
            said[source] = (ctypes.c_double * len(outs))()
            references = ctypes.c_uint * len(outs)
            handed.append((units[source].slave, references(*outs), references(*ins), len(outs), said[source]))
        order.append((units[name].slave, handed))
    for k in range(round(STOP / step)):
        for slave, handed in order:
            for source, outputs, inputs, count, values in handed:
                source.fmi2GetReal(source.component, outputs, count, values)
                slave.fmi2SetReal(slave.component, inputs, count, values)
            slave.doStep(k * step, step)
        r, x, u = said["reference"], said["plant"], said["actuator"]
        yield r[0] - x[0], r[1] - x[1], u[0], u[1]


def judge(points: np.ndarray, step: float) -> dict[str, float | str]:
    """Whether a loop that came to its end held, and its figures."""
    if not np.isfinite(points).all():
        return {"outcome": NOT_FINITE}
    later = points[round(JUDGED_FROM / step) - 1 :]
    rms, largest = np.sqrt((later[:, :2] ** 2).mean(axis=0)), np.abs(points[:, 2:]).max(axis=0)
    figures = {f"rms_e{i}": float(rms[i - 1]) for i in JOINTS} | {f"max_u{i}": float(largest[i - 1]) for i in JOINTS}
    return {"outcome": HELD if rms.max() <= LARGEST_RMS else LOST} | figures


def run(fmus: dict[str, Fmu], sample: Sample) -> dict[str, float | str]:
    """Closes the loop with these values: its outcome, its figures where it came to its end, else when and why not."""
    points: list[Point] = []
    with ExitStack() as stack:
        units = {}
        try:
            for name, (fmu, _) in UNITS.items():
                units[name] = Unit(fmus[fmu], name)
                stack.callback(units[name].slave.freeInstance)
            for name, values in start_values(sample).items():
                units[name].start(values)
            for point in steps(units, sample["step"]):
                points.append(point)
                if max(map(abs, point[:2])) > LARGEST_ERROR:
                    return {"outcome": LOST, "message": f"t = {len(points) * sample['step']:g} s: half a turn off"}
        except FMICallException as refused:
            said = [f"{unit.name}: {text}" for unit in units.values() for text in unit.messages[-1:]]
            message = f"t = {len(points) * sample['step']:g} s: {refused}; {'; '.join(said)}"
            return {"outcome": UNIT_FAILED, "message": message}
    return judge(np.array(points), sample["step"])
