"""The closed loop of example 3.2.1 in FMPy: reference, plant and controller, 1 ms apart.

Needs FMPy, and the FMUs in the folder given as argument (default: fmus).
"""

import sys
from pathlib import Path

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

STEP = 1e-3
STOP = 20.0


class Unit:
    """An FMU with its variables by name."""

    def __init__(self, file: Path) -> None:
        description = read_model_description(file)
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        identifier = description.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(guid=description.guid, unzipDirectory=extract(file), modelIdentifier=identifier)
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0, stopTime=STOP)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, name: str) -> float:
        return self.fmu.getReal([self.references[name]])[0]

    def set(self, name: str, value: float) -> None:
        self.fmu.setReal([self.references[name]], [value])


folder = Path(sys.argv[1] if len(sys.argv) > 1 else "fmus")
reference = Unit(folder / "ReferenceNonlinearSiso.fmu")
plant = Unit(folder / "NonlinearSiso.fmu")
controller = Unit(folder / "L1NonlinearSiso.fmu")

for k in range(round(STOP / STEP)):
    reference.fmu.doStep(k * STEP, STEP)
    plant.set("u[1]", controller.get("u[1]"))
    plant.fmu.doStep(k * STEP, STEP)
    controller.set("r[1]", reference.get("r[1]"))
    controller.set("x[1]", plant.get("x[1]"))
    controller.set("x[2]", plant.get("x[2]"))
    controller.fmu.doStep(k * STEP, STEP)
    if (k + 1) % 2000 == 0:
        print(f"t = {(k + 1) * STEP:4.0f} s   r = {reference.get('r[1]'):7.4f}   y = {plant.get('y[1]'):7.4f}")
