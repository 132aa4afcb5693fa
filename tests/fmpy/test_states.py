"""States that a master saves, restores, and keeps as bytes; reset."""

import pytest
from master import CONTROLLER, PLANT, REFERENCE, ClosedLoop, at_ease, example, refused

STEP, SAVED, STOP = 1e-3, 700, 1200
NAMES = ["reference", "plant", "controller"]


@pytest.fixture
def make_loop(unit):
    """Makes the example's loop with the square wave (its next edge after 0.7 s is at 2.17 s), not yet started."""

    def make() -> ClosedLoop:
        return example(unit(REFERENCE, signal="square"), unit(PLANT), unit(CONTROLLER))

    return make


def test_a_restored_loop_goes_on_bit_for_bit(make_loop) -> None:
    loop = make_loop().start()
    loop.run(SAVED * STEP, STEP)
    states = {name: loop.units[name].slave.getFMUstate() for name in NAMES}
    first = loop.run(STOP * STEP, STEP, first=SAVED)
    for _ in range(2):
        for name in NAMES:
            loop.units[name].slave.setFMUstate(states[name])
            loop.give(name)
        assert loop.run(STOP * STEP, STEP, first=SAVED).same_as(first)
    for name in NAMES:
        loop.units[name].slave.freeFMUstate(states[name])


def test_bytes_of_a_state_go_on_in_other_instances_bit_for_bit(make_loop) -> None:
    loop, other = make_loop().start(), make_loop()
    loop.run(SAVED * STEP, STEP)
    stored = {}
    for name in NAMES:
        slave = loop.units[name].slave
        stored[name] = slave.serializeFMUstate(slave.getFMUstate())
    first = loop.run(STOP * STEP, STEP, first=SAVED)
    for name in NAMES:
        # The other instances weren't even initialised.
        slave = other.units[name].slave
        slave.setFMUstate(slave.deSerializeFMUstate(stored[name]))
        other.give(name)
    assert other.run(STOP * STEP, STEP, first=SAVED).same_as(first)
    for name in NAMES:
        assert other.units[name].everything() == loop.units[name].everything()


def test_a_restored_unit_keeps_a_parameter_that_was_set_but_not_yet_taken_over(make_loop) -> None:
    loop = make_loop().start()
    loop.run(SAVED * STEP, STEP)
    loop.units["controller"]["feedback_gain[1,1]"] = 70.0
    loop.units["controller"].set_slope("r[1]", 3.0)
    states = {name: loop.units[name].slave.getFMUstate() for name in NAMES}
    first = loop.run(STOP * STEP, STEP, first=SAVED)
    for name in NAMES:
        loop.units[name].slave.setFMUstate(states[name])
        loop.give(name)
    assert loop.run(STOP * STEP, STEP, first=SAVED).same_as(first)


def test_with_an_edge_before_it_a_restored_reference_takes_it_again(unit) -> None:
    reference = unit(REFERENCE, signal="square").start()
    reference.step(0.0, 2.0)
    state = reference.slave.getFMUstate()
    for _ in range(3):
        assert reference["r[1]"] == 1.0
        reference.step(2.0, 0.5)
        assert reference["r[1]"] == -1.0
        reference.slave.setFMUstate(state)


def test_a_step_is_taken_back_as_masters_with_error_control_do(unit) -> None:
    """Two half steps come nearer than one whole step to many small ones, all from the same state."""
    plant = unit(PLANT).start(**{"u[1]": -0.2})
    plant.step(0.0, 0.1)
    state = plant.slave.getFMUstate()
    ends = []
    for count in [1, 2, 64]:
        plant.slave.setFMUstate(state)
        for k in range(count):
            plant["u[1]"] = -0.2 - 2 * (k * 0.4 / count)
            plant.step(0.1 + k * 0.4 / count, 0.4 / count)
        ends.append(plant["x[2]"])
    assert abs(ends[1] - ends[2]) < 0.6 * abs(ends[0] - ends[2])


@pytest.mark.parametrize("spoil", ["shortened", "lengthened", "one bit", "empty", "zeros", "of another unit"])
def test_bytes_that_are_no_state_of_the_unit_are_refused_and_nothing_changes(unit, spoil: str) -> None:
    plant, controller = unit(PLANT).start(**{"u[1]": 0.1}), unit(CONTROLLER).start()
    plant.step(0.0, 0.01)
    stored = plant.slave.serializeFMUstate(plant.slave.getFMUstate())
    foreign = controller.slave.serializeFMUstate(controller.slave.getFMUstate())
    flipped = bytearray(stored)
    flipped[len(stored) // 2] ^= 4
    spoiled = {
        "shortened": stored[:-1],
        "lengthened": stored + b"\0",
        "one bit": bytes(flipped),
        "empty": b"",
        "zeros": bytes(len(stored)),
        "of another unit": foreign,
    }
    before = plant.everything()
    refused(plant.slave.deSerializeFMUstate, spoiled[spoil])
    assert "fmi2DeSerializeFMUstate" in plant.messages[-1].text
    assert plant.everything() == before
    assert plant.slave.serializeFMUstate(plant.slave.getFMUstate()) == stored


def test_a_freed_state_is_not_found_again(unit) -> None:
    plant = unit(PLANT).start()
    state = plant.slave.getFMUstate()
    number = state.value
    plant.slave.freeFMUstate(state)
    assert state.value is None
    refused(plant.slave.setFMUstate, number)
    assert "fmi2SetFMUstate" in plant.messages[-1].text
    refused(plant.slave.setFMUstate, 0xDEAD_BEEF)


def test_after_a_reset_the_same_run_comes_again_bit_for_bit(make_loop) -> None:
    loop = make_loop().start()
    first = loop.run(1.0, STEP)
    loop.units["controller"]["feedback_gain[1,1]"] = 70.0
    loop.run(1.5, STEP, first=1000)
    for name in NAMES:
        loop.units[name].slave.reset()
    # Everything is at its start value again, the choice of the signal included.
    loop.units["reference"]["signal"] = "square"
    loop.forget()
    assert loop.start().run(1.0, STEP).same_as(first)


def test_a_reset_forgets_parameters_and_inputs(each_fmu, unit) -> None:
    instance = unit(each_fmu.name)
    fresh = unit(each_fmu.name).start().everything()
    for name, value in at_ease(each_fmu).items():
        instance[name] = value
    for name in [*each_fmu.named(causality="input"), "signal"]:
        if name in each_fmu.variables:
            # From a large output error an observer escapes within the step.
            instance[name] = 0.3 if name.startswith("y[") else 2
    instance.start(time=3.0)
    instance.step(3.0, 1e-3)
    instance.slave.reset()
    assert instance.start().everything() == fresh


def test_after_a_failed_step_a_saved_state_brings_the_unit_back(unit) -> None:
    plant = unit(PLANT).start(**{"u[1]": 5.0})
    plant.step(0.0, 0.1)
    state, before = plant.slave.getFMUstate(), plant.everything()
    assert refused(plant.step, 0.1, 5.0).status == 3
    assert "diverges" in plant.messages[-1].text or "relative tolerance" in plant.messages[-1].text
    assert plant.everything() == before
    refused(plant.step, 0.1, 1e-3)
    plant.slave.setFMUstate(state)
    plant["u[1]"] = -5.0
    plant.step(0.1, 1e-3)
