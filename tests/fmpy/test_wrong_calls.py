"""Calls that a master should not make: refused with fmi2Error, told in the log, and without any effect."""

from collections.abc import Callable

import pytest
from master import CONTROLLER, PLANT, REFERENCE, Unit, refused

NAN, INFINITY = float("nan"), float("inf")


@pytest.fixture
def plant(unit) -> Unit:
    """A plant that stands at 0.02 s of 1 s."""
    plant = unit(PLANT).start(stop=1.0, **{"u[1]": 0.25})
    plant.step(0.0, 0.02)
    return plant


def assert_refused(unit: Unit, words: list[str], call: Callable, *arguments: object) -> None:
    """The call is an error, one message holds these words, and nothing whatever has changed."""
    before, count = unit.slave.serializeFMUstate(unit.slave.getFMUstate()), len(unit.messages)
    assert refused(call, *arguments).status == 3
    assert len(unit.messages) == count + 1
    message = unit.messages[-1]
    assert (message.status, message.category) == (3, "logStatusError")
    assert [word for word in words if word not in message.text] == [], message.text
    assert unit.slave.serializeFMUstate(unit.slave.getFMUstate()) == before


@pytest.mark.parametrize("reference", [1000, 2**31, 2**32 - 1])
def test_an_unknown_value_reference_is_named(plant: Unit, reference: int) -> None:
    slave, number = plant.slave, str(reference)
    assert_refused(plant, ["fmi2GetReal", number], slave.getReal, [reference])
    assert_refused(plant, ["fmi2GetInteger", number], slave.getInteger, [reference])
    assert_refused(plant, ["fmi2GetBoolean", number], slave.getBoolean, [reference])
    assert_refused(plant, ["fmi2SetReal", number], slave.setReal, [reference], [1.0])
    assert_refused(plant, ["fmi2SetInteger", number], slave.setInteger, [reference], [1])
    assert_refused(
        plant, ["fmi2SetRealInputDerivatives", number], plant.slave.setRealInputDerivatives, [reference], [1], [0.0]
    )
    assert_refused(plant, ["fmi2GetRealOutputDerivatives", number], slave.getRealOutputDerivatives, [reference], [1])


def test_every_value_reference_without_a_variable_is_refused(plant: Unit) -> None:
    known = {variable.valueReference for variable in plant.fmu.variables.values()}
    for reference in set(range(200)) - known:
        refused(plant.slave.getReal, [reference])
        refused(plant.slave.getInteger, [reference])
        refused(plant.slave.setReal, [reference], [0.0])


def test_a_value_of_the_wrong_type_is_named(plant: Unit) -> None:
    real, choice = plant.reference("u[1]"), plant.reference("input_handling")
    assert_refused(plant, ["fmi2GetInteger", "`u[1]`", "Real"], plant.slave.getInteger, [real])
    assert_refused(plant, ["fmi2GetBoolean", "`u[1]`", "Real"], plant.slave.getBoolean, [real])
    assert_refused(plant, ["fmi2GetReal", "`input_handling`"], plant.slave.getReal, [choice])
    assert_refused(plant, ["fmi2SetInteger", "`u[1]`", "Real"], plant.slave.setInteger, [real], [1])
    assert_refused(plant, ["fmi2SetReal", "`input_handling`"], plant.slave.setReal, [choice], [1.0])
    assert_refused(plant, ["fmi2GetString"], plant.slave.getString, [real])
    assert_refused(plant, ["fmi2SetString"], plant.slave.setString, [real], ["1"])


@pytest.mark.parametrize("value", [NAN, INFINITY, -INFINITY])
def test_a_number_that_is_none_is_named(plant: Unit, value: float) -> None:
    text = str(value) if value == value else "NaN"
    assert_refused(plant, ["fmi2SetReal", "`u[1]`", text], plant.__setitem__, "u[1]", value)
    assert_refused(plant, ["fmi2SetReal", "`omega`", text], plant.__setitem__, "omega", value)
    assert_refused(plant, ["fmi2SetRealInputDerivatives", "`u[1]`", text], plant.set_slope, "u[1]", value)


def test_of_several_values_one_wrong_one_keeps_all_from_being_set(plant: Unit) -> None:
    references = [plant.reference("u[1]"), plant.reference("omega"), 77_777]
    assert_refused(plant, ["77777"], plant.slave.setReal, references, [9.0, 9.0, 9.0])
    assert_refused(plant, ["`omega`"], plant.slave.setReal, references[:2], [9.0, NAN])
    assert (plant["u[1]"], plant["omega"]) == (0.25, 2.0)


@pytest.mark.parametrize("name", ["y[1]", "x[1]", "der(x[2])"])
def test_what_the_unit_calculates_is_not_set(plant: Unit, name: str) -> None:
    assert_refused(plant, ["fmi2SetReal", f"`{name}`"], plant.__setitem__, name, 1.0)


@pytest.mark.parametrize("step", [0.0, -0.01, NAN, INFINITY, -INFINITY, 1e-30])
def test_a_step_that_is_none_is_refused_with_its_size(plant: Unit, step: float) -> None:
    text = {"nan": "NaN"}.get(str(step), str(step)) if step != 1e-30 else "too small"
    text = text.removesuffix(".0")
    assert_refused(plant, ["fmi2DoStep", "communicationStepSize", text], plant.step, 0.02, step)
    plant.step(0.02, 0.01)


@pytest.mark.parametrize("time", [0.0, 0.01, 0.0201, 0.03, -0.02, 1e9, NAN, INFINITY])
def test_a_step_from_another_time_is_refused_with_both_times(plant: Unit, time: float) -> None:
    assert_refused(plant, ["fmi2DoStep", "currentCommunicationPoint", "0.02"], plant.step, time, 0.01)
    plant.step(0.02, 0.01)


def test_a_communication_point_that_is_right_up_to_rounding_is_accepted(plant: Unit) -> None:
    for k in range(2, 40):
        # The master counts in its own way, and so it drifts by rounding errors.
        plant.step(sum([0.01] * k), 0.01)
    assert plant.messages == []


def test_a_step_beyond_the_stop_time_is_refused_and_one_up_to_it_is_not(plant: Unit) -> None:
    assert_refused(plant, ["fmi2DoStep", "stopTime = 1"], plant.step, 0.02, 0.99)
    plant.step(0.02, 0.97)
    assert_refused(plant, ["fmi2DoStep", "stopTime = 1"], plant.step, 0.99, 0.02)
    plant.step(0.99, 1.0 - 0.99)
    assert_refused(plant, ["fmi2DoStep", "stopTime = 1"], plant.step, 1.0, 1e-3)


@pytest.mark.parametrize("value", [0, 3, -1, 2**31 - 1])
def test_a_choice_that_is_no_item_is_refused_with_the_items(unit, value: int) -> None:
    reference = unit(REFERENCE)
    words = ["fmi2SetInteger", "`signal`", str(value), "1 cosine", "2 square"]
    assert_refused(reference, words, reference.__setitem__, "signal", value)


@pytest.mark.parametrize("order", [0, 2, 3, -1])
def test_only_first_derivatives_are_taken_and_given(plant: Unit, order: int) -> None:
    u, y = [plant.reference("u[1]")], [plant.reference("y[1]")]
    words = [f"order {order}"]
    assert_refused(plant, ["`u[1]`", *words], plant.slave.setRealInputDerivatives, u, [order], [0.0])
    assert_refused(plant, ["`y[1]`", *words], plant.slave.getRealOutputDerivatives, y, [order])
    assert_refused(plant, ["`u[1]`"], plant.slave.getRealOutputDerivatives, u, [1])
    assert_refused(plant, ["`y[1]`"], plant.slave.setRealInputDerivatives, y, [1], [0.0])


def test_calls_out_of_their_order_are_refused_with_what_would_be_right(unit) -> None:
    controller = unit(CONTROLLER)
    assert_refused(controller, ["fmi2DoStep", "not yet initialised"], controller.step, 0.0, 0.01)
    assert_refused(controller, ["fmi2ExitInitializationMode"], controller.slave.exitInitializationMode)
    assert_refused(controller, ["fmi2Terminate"], controller.slave.terminate)
    controller.slave.setupExperiment()
    controller.slave.enterInitializationMode()
    assert_refused(controller, ["fmi2SetupExperiment", "Initialization Mode"], controller.slave.setupExperiment)
    assert_refused(controller, ["fmi2EnterInitializationMode"], controller.slave.enterInitializationMode)
    assert_refused(controller, ["fmi2DoStep", "Initialization Mode"], controller.step, 0.0, 0.01)
    controller.slave.exitInitializationMode()
    assert_refused(controller, ["fmi2ExitInitializationMode"], controller.slave.exitInitializationMode)
    controller.step(0.0, 0.01)
    controller.slave.terminate()
    assert_refused(controller, ["fmi2DoStep", "terminated"], controller.step, 0.01, 0.01)
    assert_refused(controller, ["fmi2SetReal"], controller.__setitem__, "r[1]", 1.0)
    assert controller["u[1]"] == controller["u_ad[1]"]


@pytest.mark.parametrize(
    "times", [{"startTime": NAN}, {"startTime": 2.0, "stopTime": 1.0}, {"stopTime": NAN}, {"tolerance": 0.0}]
)
def test_an_experiment_that_is_none_is_refused(unit, times: dict[str, float]) -> None:
    controller = unit(CONTROLLER)
    (name, _) = list(times.items())[-1]
    assert refused(lambda: controller.slave.setupExperiment(**times)).status == 3
    assert "fmi2SetupExperiment" in controller.messages[-1].text and name in controller.messages[-1].text
    controller.start()


def test_a_wrong_guid_is_refused_with_the_right_one(fmu) -> None:
    with Unit(fmu(PLANT)) as plant:
        slave, good = plant.slave, plant.slave.guid
        slave.guid = "{00000000-0000-0000-0000-000000000000}"
        first = slave.component
        with pytest.raises(Exception, match="instantiate"):
            slave.instantiate(callbacks=plant._callbacks)
        assert "GUID" in plant.messages[-1].text and good in plant.messages[-1].text
        slave.component, slave.guid = first, good


def test_a_percent_sign_in_a_message_is_none_of_a_format_and_nothing_is_printed(plant: Unit, capfd) -> None:
    refused(plant.slave.setDebugLogging, True, ["100 %s %n"])
    # FMPy shows the format as it is; masters that expand it show one sign each.
    assert "`100 %%s %%n`" in plant.messages[-1].text
    assert capfd.readouterr() == ("", "")


def test_an_accepted_change_of_parameters_is_only_logged_where_that_was_asked_for(fmu) -> None:
    for asked in [False, True]:
        with Unit(fmu(CONTROLLER), logging=asked) as controller:
            controller.start()
            controller["feedback_gain[1,1]"] = 25.0
            controller.step(0.0, 0.01)
            messages = [(message.category, message.text) for message in controller.messages]
            assert [category for category, _ in messages] == (["logEvents"] * len(messages) if asked else [])
            assert any("taken over" in text for _, text in messages) == asked
            assert any("integrated by" in text for _, text in messages) == asked, "by which method, too"
