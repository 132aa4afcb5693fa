"""What a person meets who runs `fmpy simulate X.fmu`: each unit alone, as it is, by FMPy's own defaults."""

import ctypes
import re
import zipfile
from collections.abc import Callable

import fmpy
import fmpy.logging
import numpy as np
import pytest
import responses
import sample

from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE, printLogMessage
from lxml import html
from master import Fmu

# Units whose outputs stand still while nobody gives them anything, and why.
CONTROLLERS = {  # There is no error; one that no plant answers would take their estimates to their bounds.
    "FunnelNonlinearSiso", "FunnelTwoLinkRobot", "FuzzyL1ActuatedSiso", "FuzzyL1CoupledMimo",
    "FuzzyL1TwoLinkRobot", "L1ActuatedSiso", "L1ActuatedSisoObserved",
    "L1CoupledMimo", "L1LimitNonlinearSiso", "L1LimitTwoLinkRobot", "L1MaresAuv", "L1NonlinearSiso", "L1PpfCoupledMimo",
    "L1PpfTwoLinkRobot",
    "L1SampledNonlinearSiso", "L1SampledTwoLinkRobot", "L1SampledUnmatchedMimo", "L1TwinRotor", "L1TwoLinkRobot",
    "L1UnmatchedMimo",
    "LadrcNonlinearSiso", "LadrcTwoLinkRobot", "MracNonlinearSiso", "MracPpfUnmatchedMimo", "MracTwoLinkRobot",
}
HOVERING = {"L1Quadrotor", "L1QuadrotorObserved"}  # The same, but their thrust is the weight.
BALANCED = {"ActuatedSiso", "MaresAuv", "StateSpace", "TwinRotor"}  # Without a control these plants rest where they start.
HANDED_ON = {"Actuator", "ActuatorTwoLinkRobot", "QuadrotorMixer", "Sensor", "Unwrap"}  # They hand on what they are given.
UNSHAPED = {"Reference"}  # The general reference is 0 until a shape is set.
AT_REST = CONTROLLERS | HOVERING | BALANCED | HANDED_ON | UNSHAPED
# Inputs that start with something, and what they would be without sense at 0: the thrust that carries the vehicle, and what
# a controller measures, without which it is of no use.
GIVEN = {
    "Quadrotor": {"u[1]": 0.5 * 9.81},
    "PidNonlinearSiso": {"y[1]": 1.0},
    "MracPpfCoupledMimo": {f"x[{k}]": 0.01 for k in (1, 2, 3)},
    "NeuroPpfCoupledMimo": {f"x[{k}]": 0.003 for k in (1, 2, 3)},
    "NeuroPpfTwoLinkRobot": {"x[1]": 0.02, "x[2]": 0.02},
}
LOGGER = fmi2CallbackLoggerTYPE(printLogMessage)
STAYING = fmi2CallbackFunctions()


def alone(fmu: Fmu) -> tuple[np.ndarray, list[tuple[int, str]]]:
    """What a unit shows at FMPy's defaults, and what it says."""
    messages: list[tuple[int, str]] = []
    hear = lambda _, instance, status, category, message: messages.append((status, message))  # noqa: E731
    result = fmpy.simulate_fmu(str(fmu.path), logger=hear)
    # All loggers of FMPy go by one proxy, which keeps the last one although it is gone: it gets one that stays.
    STAYING.logger = LOGGER
    fmpy.logging.addLoggerProxy(ctypes.byref(STAYING))
    return result, messages


def test_a_standalone_fmu_runs_by_the_defaults_of_fmpy_and_logs_nothing(each_fmu: Fmu) -> None:
    result, messages = alone(each_fmu)
    assert messages == [], "neither warnings nor errors"
    outputs = [name for name in result.dtype.names if name != "time"]
    assert all(np.isfinite(result[name]).all() for name in outputs)
    moves = {name for name in outputs if np.ptp(result[name].astype(float)) > 1e-6}
    assert (each_fmu.name not in AT_REST) == bool(moves), moves


def test_a_page_describes_what_its_fmu_shows_standalone(each_fmu: Fmu) -> None:
    with zipfile.ZipFile(each_fmu.path) as archive:
        page = html.document_fromstring(archive.read("documentation/index.html").decode())
    shown = page.get_element_by_id("alone").text_content()
    assert shown.startswith("With nothing connected ")
    words = {"it rests": CONTROLLERS | BALANCED, "carries the vehicle": HOVERING, "is 0|of 0": HANDED_ON}
    for word, names in words.items():
        assert each_fmu.name not in names or re.search(word, shown), shown


def test_the_controllers_of_the_quadrotor_alone_carry_its_weight(fmu: Callable[[str], Fmu]) -> None:
    for name in sorted(HOVERING):
        result, _ = alone(fmu(name))
        assert np.allclose(result["u[1]"], 0.5 * 9.81), "mass times gravity"


def test_the_quadrotor_alone_hovers_and_drifts_as_it_starts_tilted(fmu: Callable[[str], Fmu]) -> None:
    result, _ = alone(fmu("Quadrotor"))
    rates = [np.gradient(result[f"x[{k}]"], result["time"]) for k in (4, 5, 6)]
    tilt = np.hypot(result["x[7]"][0], result["x[8]"][0])
    assert np.allclose(np.hypot(rates[0], rates[1]), 9.81 * np.sin(tilt), rtol=0.02)
    assert np.abs(rates[2]).max() < 0.15, "it loses little of its lift, where it would fall by 9.81 m/s2"


def test_controllers_alone_answer_the_error_that_they_start_with_within_bounds(fmu: Callable[[str], Fmu]) -> None:
    bounds = {"PidNonlinearSiso": 200.0, "MracPpfCoupledMimo": 20.0, "NeuroPpfCoupledMimo": 12.0, "NeuroPpfTwoLinkRobot": 40.0}
    for name, bound in bounds.items():
        result, _ = alone(fmu(name))
        largest = max(np.abs(result[u]).max() for u in result.dtype.names if u.startswith("u["))
        assert 0.25 * bound < largest < bound, (name, largest)
    answer, _ = alone(fmu("PidNonlinearSiso"))
    # S = 1/2 makes twice the plant's gain of the control: K_p/2 at once, K_i/2 a second.
    assert np.allclose(answer["u[1]"], -0.5 * (64.0 + 5.0 * answer["time"]), atol=1e-6)


@pytest.mark.parametrize("name", sample.FMUS)
def test_inputs_start_at_0_but_for_those_that_are_senseless_there(name: str, fmu: Callable[[str], Fmu]) -> None:
    variables = fmu(name).description.modelVariables
    starts = {v.name: float(v.start) for v in variables if v.causality == "input" and v.type == "Real"}
    assert {input_: start for input_, start in starts.items() if start} == GIVEN.get(name, {})


@pytest.mark.parametrize("loop", sample.LOOPS)
def test_no_loop_leaves_an_input_open_that_starts_with_something(loop: str) -> None:
    connected = {(link.get("endElement"), link.get("endConnector")) for link in responses.elements(loop, "Connection")}
    for unit in responses.elements(loop, "Component"):
        fmu = unit.get("source").rsplit("/", 1)[-1].removesuffix(".fmu")
        open_ = {name for name in GIVEN.get(fmu, {}) if (unit.get("name"), name) not in connected}
        assert open_ == set(), fmu
