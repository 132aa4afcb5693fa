"""What a person meets who runs `fmpy simulate X.fmu`: each unit alone, as it is, by FMPy's own defaults."""

import fmpy
import numpy as np
import pytest
from master import Fmu

# Units whose outputs stand still while nobody gives them anything, and why.
CONTROLLERS = {  # The measured state is the reference: there is no error to act on.
    "FunnelNonlinearSiso", "FunnelTwoLinkRobot", "FuzzyL1ActuatedSiso", "L1ActuatedSiso", "L1ActuatedSisoObserved",
    "L1CoupledMimo", "L1LimitNonlinearSiso", "L1LimitTwoLinkRobot", "L1MaresAuv", "L1NonlinearSiso",
    "L1SampledNonlinearSiso", "L1SampledTwoLinkRobot", "L1TwinRotor", "L1TwoLinkRobot", "L1UnmatchedMimo",
    "LadrcNonlinearSiso", "LadrcTwoLinkRobot", "MracPpfCoupledMimo", "NeuroPpfCoupledMimo", "PidNonlinearSiso",
}
HOVERING = {"L1Quadrotor", "L1QuadrotorObserved"}  # The thrust is the weight.
BALANCED = {"ActuatedSiso", "MaresAuv", "StateSpace", "TwinRotor"}  # Without a control these plants rest where they start.
HANDED_ON = {"Actuator", "ActuatorTwoLinkRobot", "Sensor"}  # They hand on what they are given.
UNSHAPED = {"Reference"}  # The general reference is 0 until a shape is set.
AT_REST = CONTROLLERS | HOVERING | BALANCED | HANDED_ON | UNSHAPED


def test_a_unit_alone_runs_by_the_defaults_of_fmpy_and_says_nothing(each_fmu: Fmu) -> None:
    told: list[tuple[int, str]] = []
    result = fmpy.simulate_fmu(
        str(each_fmu.path), logger=lambda _, instance, status, category, message: told.append((status, message))
    )
    assert told == [], "neither warnings nor errors"
    outputs = [name for name in result.dtype.names if name != "time"]
    assert all(np.isfinite(result[name]).all() for name in outputs)
    moves = {name for name in outputs if np.ptp(result[name].astype(float)) > 1e-6}
    assert (each_fmu.name not in AT_REST) == bool(moves), moves


def test_the_controllers_of_the_quadrotor_alone_carry_its_weight(fmu) -> None:
    for name in sorted(HOVERING):
        result = fmpy.simulate_fmu(str(fmu(name).path))
        assert np.allclose(result["u[1]"], 0.5 * 9.81), "mass times gravity"
