"""Several FMUs and several instances of each in one process, in turn and at the same time."""

import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from master import CONTROLLER, PLANT, REFERENCE, ClosedLoop, Fmu, Loop, Unit, closed_loop, example

STEP, STOP, COUNT = 1e-3, 0.6, 8


@pytest.fixture
def loops(unit) -> list[ClosedLoop]:
    """Eight loops that differ: by their gain, and every second by its reference."""
    made = []
    for k in range(COUNT):
        reference = unit(REFERENCE, signal=["cosine", "square"][k % 2])
        controller = unit(CONTROLLER, **{"feedback_gain[1,1]": 20.0 + k})
        made.append(example(reference, unit(PLANT, **{"x0[1]": 0.1 * k}), controller))
    return made


@pytest.fixture
def one_after_the_other(loops: list[ClosedLoop]) -> list[Loop]:
    """Their runs, one after the other; they are reset after that and set up again."""
    runs = [loop.start().run(STOP, STEP) for loop in loops]
    assert len({run.u.tobytes() for run in runs}) == COUNT
    for k, loop in enumerate(loops):
        for unit in loop.units.values():
            unit.slave.reset()
        loop.units["reference"]["signal"] = ["cosine", "square"][k % 2]
        loop.units["controller"]["feedback_gain[1,1]"] = 20.0 + k
        loop.units["plant"]["x0[1]"] = 0.1 * k
        loop.start()
    return runs


def test_loops_that_are_stepped_in_turn_dont_feel_each_other(
    loops: list[ClosedLoop], one_after_the_other: list[Loop]
) -> None:
    count = round(STOP / STEP)
    for k in range(count):
        for loop, alone in zip(loops, one_after_the_other, strict=True):
            step = loop.run((k + 1) * STEP, STEP, first=k)
            assert step.same_as(alone.part(k, k + 1))


def test_loops_in_threads_compute_the_same_bits(loops: list[ClosedLoop], one_after_the_other: list[Loop]) -> None:
    # Threads take turns as often as Python lets them.
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    barrier = Barrier(COUNT)

    def run(loop: ClosedLoop) -> Loop:
        barrier.wait()
        return loop.run(STOP, STEP)

    try:
        with ThreadPoolExecutor(COUNT) as threads:
            runs = list(threads.map(run, loops))
    finally:
        sys.setswitchinterval(interval)
    assert all(run.same_as(alone) for run, alone in zip(runs, one_after_the_other, strict=True))


def test_an_instance_may_go_on_in_another_thread(loops: list[ClosedLoop], one_after_the_other: list[Loop]) -> None:
    half = round(STOP / STEP) // 2
    loops[0].run(half * STEP, STEP)
    with ThreadPoolExecutor(1) as thread:
        second = thread.submit(loops[0].run, STOP, STEP, first=half).result()
    assert second.same_as(one_after_the_other[0].part(half, round(STOP / STEP)))


def test_freeing_one_instance_leaves_the_others_alone(unit, fmu) -> None:
    first, second = unit(PLANT).start(**{"u[1]": 0.2}), unit(PLANT).start(**{"u[1]": 0.2})
    first.step(0.0, 0.1), second.step(0.0, 0.1)
    first.free()
    second.step(0.1, 0.1)
    alone = unit(PLANT).start(**{"u[1]": 0.2})
    alone.step(0.0, 0.1), alone.step(0.1, 0.1)
    assert second.everything() == alone.everything()


def test_a_failed_instance_leaves_the_others_alone(unit, fmu) -> None:
    expected = closed_loop(fmu, 0.2, STEP)
    loop = example(unit(REFERENCE), unit(PLANT), unit(CONTROLLER)).start()
    failing = unit(PLANT, **{"x0[1]": 1e6}).start()
    with pytest.raises(Exception, match="fmi2DoStep"):
        failing.step(0.0, 1.0)
    assert loop.run(0.2, STEP).same_as(expected)
    assert all(unit.messages == [] for unit in loop.units.values())


def test_names_of_instances_may_hold_anything(fmu) -> None:
    for name in ["loop/plant 1", "größe ω", "100 %s %n", "a" * 5000]:
        with Unit(fmu(PLANT), name) as plant:
            plant.start().step(0.0, 1e-3)
            with pytest.raises(Exception, match="fmi2DoStep"):
                plant.step(5.0, 1e-3)
            assert "communication" in plant.messages[-1].text.lower()


def test_two_copies_of_a_library_share_nothing_and_one_outlives_the_other(fmu, tmp_path) -> None:
    """As two tools' units in one process, or one that is loaded anew: each copy's instances go on as if alone."""
    original = fmu(CONTROLLER)
    copies = [Fmu(original.path, tmp_path / name) for name in ("one", "other")]
    units = [Unit(copy) for copy in copies]
    libraries = [unit.slave.dll._handle for unit in units]
    assert libraries[0] != libraries[1]

    def run(unit: Unit, first: int, last: int) -> list[float]:
        rows = []
        for k in range(first, last):
            unit["x[1]"] = 0.1 * np.sin(0.01 * k)
            unit.slave.doStep(k * STEP, STEP)
            rows.append(unit["u[1]"])
        return rows

    with Unit(original) as alone:
        expected = run(alone.start(**{"r[1]": 1.0}), 0, 200)
    found: list[list[float]] = [[], []]
    for unit in units:
        unit.start(**{"r[1]": 1.0})
    for first in range(0, 100, 10):
        for unit, rows in zip(units, found, strict=True):
            rows += run(unit, first, first + 10)
    # A refused call of one, whose library then goes, is none of the other's.
    with pytest.raises(FMICallException):
        units[1].slave.doStep(0.0, -1.0)
    units[1].free()
    found[0] += run(units[0], 100, 200)
    assert found[0] == expected and found[1] == expected[:100]
    units[0].free()
