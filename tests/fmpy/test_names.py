"""The names that other people's scripts use, and what the capability flags promise."""

import pytest
from master import CONTROLLER, PLANT, REFERENCE, Fmu, FMICallException, Unit, at_ease, refused

CONTRACT = {
    PLANT: {
        "input": ["u[1]"],
        "output": ["x[1]", "x[2]", "y[1]"],
        "parameter": [
            "x0[1]",
            "x0[2]",
            "input_handling",
            "integration_method",
            "relative_tolerance",
            "on_step_failure",
        ],
    },
    REFERENCE: {"output": ["r[1]", "dr[1]", "ddr[1]"], "parameter": ["signal"]},
    "Reference": {"output": ["r[1]", "dr[1]", "ddr[1]"]},
    CONTROLLER: {
        "input": ["r[1]", "x[1]", "x[2]"],
        "output": ["u[1]"],
        "parameter": [
            "adaptation_gain",
            "feedback_gain[1,1]",
            *(f"{matrix}[{i},{j}]" for matrix in ("A_m", "Q") for i in (1, 2) for j in (1, 2)),
            "omega_min[1,1]",
            "omega_max[1,1]",
            "theta_bound[1]",
            "sigma_bound[1]",
            "projection_tolerance",
            "input_handling",
            "integration_method",
            "relative_tolerance",
        ],
        "local": [
            "u_ad[1]",
            "x_hat[1]",
            "x_hat[2]",
            "omega_hat[1,1]",
            "theta_hat[1,1]",
            "theta_hat[1,2]",
            "sigma_hat[1]",
            "eta_hat[1]",
            "adaptation_frequency",
            "K_g[1,1]",
            *(f"P[{i},{j}]" for i in (1, 2) for j in (1, 2)),
        ],
    },
}


@pytest.mark.parametrize("name", CONTRACT)
def test_every_name_that_scripts_use_is_there_with_its_causality(fmu, name: str) -> None:
    for causality, names in CONTRACT[name].items():
        found = {variable: getattr(fmu(name).variables.get(variable), "causality", None) for variable in names}
        assert found == dict.fromkeys(names, causality)


def test_numbers_of_the_law_are_tunable_and_initial_values_fixed(fmu) -> None:
    controls = {"input_handling", "integration_method", "relative_tolerance"}
    law = [name for name in CONTRACT[CONTROLLER]["parameter"] if name not in controls]
    assert {fmu(CONTROLLER).variables[name].variability for name in law} == {"tunable"}
    assert {fmu(PLANT).variables[name].variability for name in ["x0[1]", "x0[2]"]} == {"fixed"}


def test_the_controller_has_the_values_of_the_example(fmu) -> None:
    starts = {name: float(v.start) for name, v in fmu(CONTROLLER).variables.items() if v.start and v.type == "Real"}
    values = {"adaptation_gain": 1e5, "feedback_gain[1,1]": 20, "omega_min[1,1]": 0.5, "omega_max[1,1]": 3}
    values |= {"theta_bound[1]": 10, "sigma_bound[1]": 10, "projection_tolerance": 0.1}
    values |= {"A_m[1,1]": 0, "A_m[1,2]": 1, "A_m[2,1]": -1, "A_m[2,2]": -1.4, "Q[1,1]": 1, "Q[1,2]": 0, "Q[2,2]": 1}
    assert {name: starts[name] for name in values} == values


def test_the_reference_offers_the_two_signals_of_the_example(fmu) -> None:
    assert [item.name for item in fmu(REFERENCE).variables["signal"].declaredType.items] == ["cosine", "square"]


def test_flags_promise_what_every_unit_can_do(each_fmu: Fmu) -> None:
    flags = each_fmu.description.coSimulation
    assert flags.modelIdentifier == each_fmu.name
    assert flags.canHandleVariableCommunicationStepSize
    inputs, outputs = (each_fmu.named(causality=causality, type="Real") for causality in ("input", "output"))
    assert flags.canInterpolateInputs == bool(inputs)
    assert flags.canGetAndSetFMUstate and flags.canSerializeFMUstate and flags.maxOutputDerivativeOrder == 1
    assert not flags.canRunAsynchronuously and not flags.canBeInstantiatedOnlyOncePerProcess
    with Unit(each_fmu, "a") as unit, Unit(each_fmu, "b"):
        assert (unit.slave.getVersion(), unit.slave.getTypesPlatform()) == ("2.0", "default")
        for name, value in at_ease(each_fmu).items():
            unit[name] = value
        unit.start()
        saved = unit.slave.getFMUstate()
        for k, step in enumerate([1e-3, 7e-4, 1e-6]):
            time = sum([1e-3, 7e-4][:k])
            for name in inputs:
                unit.set_slope(name, 0.0)
            unit.step(time, step)
            assert all(isinstance(unit.slope(name), float) for name in outputs)
        unit.slave.setFMUstate(unit.slave.deSerializeFMUstate(unit.slave.serializeFMUstate(saved)))
        unit.step(0.0, 1e-3)
        assert unit.messages == []


def test_what_no_flag_promises_is_refused_not_answered_wrongly(each_fmu: Fmu) -> None:
    with Unit(each_fmu) as unit:
        unit.start()
        output = unit.reference(each_fmu.named(causality="output", type="Real")[0])
        if not each_fmu.description.coSimulation.providesDirectionalDerivative:
            refused(unit.slave.getDirectionalDerivative, [output], [], [])
            assert "providesDirectionalDerivative" in unit.messages[-1].text
        refused(unit.slave.cancelStep)
        answer = refused(unit.slave.getRealOutputDerivatives, [output], [2])
        assert isinstance(answer, FMICallException) and answer.status == 3
        assert "order 2" in unit.messages[-1].text
