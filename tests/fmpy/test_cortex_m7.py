"""Laws of controllers on a Cortex-M7, by an emulator: what they give there, and what they take.

docs/firmware.md and docs/source_units.md tell in tables what they take. The numbers are there alone; the tests hold the laws to them.
"""

import functools
import json
import re
import shutil
import struct
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, adaptive_fmu
from laws import SAME_BITS, WARNINGS, Law, Laws, built, hostile, table
from sample import NUMBER
from test_firmware import LAWS, substeps

COMPILER, SIZES, SYMBOLS, EMULATOR = "arm-none-eabi-gcc", "arm-none-eabi-size", "arm-none-eabi-nm", "qemu-system-arm"


def has_newlib() -> bool:
    """Whether the compiler finds a mathematical library: it tells a path only of a file that is there."""
    found = subprocess.run([COMPILER, "-print-file-name=libm.a"], capture_output=True, text=True, check=False)
    return "/" in found.stdout


TOOLS = [COMPILER, SIZES, SYMBOLS, EMULATOR, "gcc"]
LACKING = [tool for tool in TOOLS if not shutil.which(tool)] or ([] if has_newlib() else ["newlib for it"])
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(LACKING), reason=f"nothing was run on a Cortex-M7: no {', no '.join(LACKING)}"),
]

BOARD = ROOT / "tests" / "cortex_m7"
MACHINE = ["-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"]
# Each instruction takes 2^10 ns of the emulated clock, of which a tick of the timer takes 40: the count is exact.
SHIFT, TICK = 10, 40
# Other compilers' code is a little larger, or smaller.
OTHER_COMPILERS = 1.1
# The loop that a controller's inputs are recorded in, and over how many of its steps.
LOOPS = {
    "L1TwoLinkRobot": ("3.3.1-case1", 100),
    "FuzzyL1ActuatedSiso": ("4-case1-fuzzy", 1000),
    "MracPpfCoupledMimo": ("6.5.1-mrac", 1000),
    "L1QuadrotorObserved": ("7.5.3-case1", 1000),
    "L1Quadrotor": ("3.3.2-case1", 1000),
}
# Of a law that no example has: a reference that the state follows with a lag.
FOLLOWED = 100
# One is designed for this plant, and has so many substeps in a loop with it.
MOTOR, MOTOR_STEPS = ROOT / "examples" / "zoo" / "dc_motor.json", 32
# The most instructions for an operation of a data sheet, for a function of <math.h>, whose argument may be large, and for the rest.
AN_OPERATION, A_FUNCTION, REST = 2.5, 2500, 500
# What firmware doesn't have.
FORBIDDEN = {"malloc", "calloc", "realloc", "free", "_malloc_r", "_sbrk", "printf", "snprintf", "exit", "abort"}


def number(cell: str) -> int:
    """A number as the page shows it: blanks set thousands apart."""
    return int(re.sub(r"\s", "", cell))


each_law = pytest.mark.parametrize("row", table("controller"), ids=lambda row: f"{row['controller']} {row['substeps']}")
each_unit = pytest.mark.parametrize("row", table("FMU with sources"), ids=lambda row: row["FMU with sources"])


@dataclass
class Measured:
    """Results of a run on the target."""

    instructions: np.ndarray
    outputs: np.ndarray
    stack: int
    refused: int
    events: list[int]


def output_of(*command: str | Path) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def sizes(file: Path) -> tuple[int, int]:
    """What a file takes of the flash memory, where initial values lie too, and of the RAM."""
    text, data, bss = map(int, output_of(SIZES, file).splitlines()[1].split()[:3])
    return text + data, data + bss


def inputs_of(laws: Laws, name: str) -> np.ndarray:
    """What a law reads, a row a step."""
    if name in LOOPS:
        return laws.inputs(name, *LOOPS[name])
    if name == "PidNonlinearSiso":
        t = np.arange(FOLLOWED) * 0.001
        return np.column_stack([np.cos(5 * t), np.cos(5 * t - 0.02)])
    if name == "L1Motor":
        return inputs_with_its_motor(laws)
    if name == "LadrcTwoLinkRobot":
        t = np.arange(FOLLOWED) * 0.001
        r = np.array([np.sin(5 * t), 5 * np.cos(5 * t), -25 * np.sin(5 * t), np.sin(5 * t - 0.02)])
        return np.concatenate([[row, 0.8 * row] for row in r]).T
    assert name == "L1SampledTwoLinkRobot"
    rows, t = np.zeros((FOLLOWED, 8)), np.arange(FOLLOWED) * 0.005
    rows[:, 0], rows[:, 1], rows[:, 4], rows[:, 5] = np.sin(t), np.cos(t), np.sin(t - 0.01), np.cos(t - 0.01)
    return rows


def inputs_with_its_motor(laws: Laws) -> np.ndarray:
    """What the law of a motor reads as the motor follows a reference from rest, by 50 Euler steps a period."""
    plant, law = json.loads(MOTOR.read_text()), Law(laws.firmware("L1Motor", MOTOR_STEPS), "L1Motor")
    x, rows = np.zeros(2), []
    for k in range(FOLLOWED):
        rows.append([100 * np.sin(0.02 * (k + 1)), *x])
        _, u = law.step(rows[-1])
        for _ in range(50):
            x = x + law.period / 50 * (np.array(plant["A"]) @ x + np.array(plant["B"]) @ u)
    return np.array(rows)


@pytest.fixture(scope="module")
def laws(tmp_path_factory: pytest.TempPathFactory) -> Laws:
    """The controllers' sources, and the description of one that is designed for a motor."""
    made = Laws(tmp_path_factory.mktemp("laws"), list(LOOPS))
    design = ["--plant", MOTOR, "--bandwidth", "20", "--reference", "100", "--out", made.folder / "L1Motor.toml"]
    designed = adaptive_fmu("new", "l1", "--name", "L1Motor", *design)
    assert designed.returncode == 0, designed.stderr
    return made


def header(name: str, inputs: np.ndarray, outputs: int, sides: str = "0u") -> str:
    """recorded.h of main.c: hexadecimal floating point keeps all bits."""
    rows = ",\n".join("    {" + ", ".join(value.hex() for value in row) + "}" for row in inputs.tolist())
    size = f"[{len(inputs)}][{inputs.shape[1]}]"
    types = "".join(f"typedef {name}_{kind} law_{kind};\n" for kind in ("real", "inputs", "outputs"))
    names = f"#define law_init {name}_init\n#define law_step {name}_step\n#define LAW_REFUSED {name}_REFUSED\n"
    sizes_of = f"#define LAW_OUTPUTS {outputs}\n#define LAW_SIDES(law) {sides}\n#define RECORDED_STEPS {len(inputs)}\n"
    return f'#include "{name}.h"\n\ntypedef {name} law;\n{types}{names}{sizes_of}\nstatic const law_real recorded{size} = {{\n{rows},\n}};\n'


@pytest.fixture(scope="module")
def law_object(laws: Laws, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int], Path]:
    """A controller's law, compiled for the target once."""

    @functools.cache
    def compiled(name: str, steps: int) -> Path:
        made = tmp_path_factory.mktemp("law") / "law.o"
        built(COMPILER, *WARNINGS, *MACHINE, *SAME_BITS, "-c", laws.firmware(name, steps) / f"{name}.c", "-o", made)
        return made

    return compiled


@pytest.fixture(scope="module")
def on_target(laws: Laws, law_object, tmp_path_factory) -> Callable[..., Measured]:
    """Runs a controller's law on the emulated target over its recorded inputs, or hostile ones, once."""

    @functools.cache
    def run(name: str, steps: int, are_hostile: bool = False) -> Measured:
        made = tmp_path_factory.mktemp("target")
        inputs = inputs_of(laws, name)
        outputs = laws.outputs(name, steps, inputs[:1]).shape[1]
        (made / "recorded.h").write_text(header(name, hostile(inputs) if are_hostile else inputs, outputs))
        return emulated(program(laws.firmware(name, steps), law_object(name, steps), made))

    return run


def program(folder: Path, law: Path, made: Path) -> Path:
    """The program of tests/cortex_m7, with a law and its inputs."""
    flags = [*WARNINGS, *MACHINE, *SAME_BITS, f"-I{folder}", f"-I{made}", "-nostartfiles", "-T", BOARD / "board.ld"]
    built(COMPILER, *flags, BOARD / "startup.c", BOARD / "main.c", law, "-lm", "-o", made / "program.elf")
    return made / "program.elf"


def emulated(made: Path) -> Measured:
    machine = ["-M", "mps2-an500", "-display", "none", "-serial", "none", "-monitor", "none"]
    counting = ["-icount", f"shift={SHIFT}", "-semihosting-config", "enable=on,target=native"]
    command = [EMULATOR, *machine, *counting, "-kernel", made]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0, run
    # What a program tells comes out as QEMU's errors do.
    lines = [line.split() for line in run.stderr.splitlines()]
    steps = [words[1:] for words in lines if words[0] == "step"]
    results = {words[0]: int(words[1], 16) for words in lines if words[0] in ("refused", "empty", "stack")}
    ticks = np.array([int(words[0], 16) for words in steps])
    events = [int(words[1], 16) for words in lines if words[0] == "event"]
    outputs = [[struct.unpack(">d", bytes.fromhex(bits))[0] for bits in words[1:]] for words in steps]
    return Measured(np.rint((ticks - results["empty"]) * TICK / 2**SHIFT), np.array(outputs), results["stack"], results["refused"], events)


def as_documented(measured: float, cell: str) -> bool:
    return number(cell) / OTHER_COMPILERS <= measured <= number(cell) * OTHER_COMPILERS


@each_law
def test_a_law_gives_on_the_target_what_it_gives_on_the_host(row, laws, on_target) -> None:
    name, steps = row["controller"], number(row["substeps"])
    inputs = inputs_of(laws, name)
    expected = laws.outputs(name, steps, inputs)
    found = on_target(name, steps).outputs
    assert on_target(name, steps).refused == 0
    assert found.shape == expected.shape and np.ptp(found, axis=0).max() > 0
    # Functions of <math.h> may differ by a rounding: newlib's aren't those of the host.
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@each_law
def test_a_step_takes_no_more_than_documented(row, on_target) -> None:
    results = on_target(row["controller"], number(row["substeps"]))
    mean = results.instructions.mean()
    worst = on_target(row["controller"], number(row["substeps"]), True)
    most = max(results.instructions.max(), worst.instructions.max())
    assert most <= number(row["a step, at most"]) <= 1.2 * most
    assert as_documented(mean, row["a step, mean"])
    assert as_documented(mean / number(row["substeps"]), row["instructions a substep"])
    assert max(results.stack, worst.stack) <= OTHER_COMPILERS * number(row["stack"])


@each_law
def test_a_law_takes_the_documented_memory_and_allocates_none(row, laws, law_object, tmp_path) -> None:
    name, whole = row["controller"], tmp_path / "whole.o"
    folder = laws.firmware(name, number(row["substeps"]))
    (tmp_path / "state.c").write_text(f'#include "{name}.h"\n\n{name} controller;\n')
    # With all that it takes of the libraries, and nothing else.
    flags = [*WARNINGS, *MACHINE, f"-I{folder}", "-r", "-nostdlib"]
    law = law_object(name, number(row["substeps"]))
    built(COMPILER, *flags, tmp_path / "state.c", law, "-lm", "-lc", "-lgcc", "-o", whole)
    flash, memory = sizes(whole)
    assert as_documented(flash, row["flash"]) and as_documented(memory, row["RAM"]), (flash, memory)
    symbols = [line.split() for line in output_of(SYMBOLS, whole).splitlines()]
    assert not FORBIDDEN & {words[-1] for words in symbols}
    assert not [words for words in symbols if words[-2] == "U"]


@pytest.mark.parametrize("name", LAWS)
def test_work_is_bounded_whatever_the_inputs(name, laws, law_object, tmp_path) -> None:
    """At rest, with faults and with inputs of any size: no step takes more instructions than its data sheet's operations allow. An
    event and the start, in the first step, are allowed their own rows."""
    steps = substeps(name) if name.endswith("L1ActuatedSiso") else 5
    folder = laws.firmware(name, steps)
    law = Law(folder, name)
    inputs, outputs = (len(law.numbers(kind)) for kind in ("inputs", "outputs"))
    rows = np.sin(np.arange(100 * inputs)).reshape(100, inputs)
    sides = "(law).d.indicator_sides" if "indicator_sides" in law.header else "0u"
    (tmp_path / "recorded.h").write_text(header(name, hostile(rows), outputs, sides))
    found = emulated(program(folder, law_object(name, steps), tmp_path))
    sheet = (folder / f"{name}_data_sheet.md").read_text()

    def allowed(row: str) -> float:
        simple, divisions, functions = map(int, re.search(rf"{row} \| [^|]*\| (\d+) \| (\d+) \| (\d+)", sheet).groups())
        return AN_OPERATION * (simple + divisions) + A_FUNCTION * functions + REST

    most = np.full(len(found.instructions), allowed(r"\*\*a step\*\*"))
    # An event evaluates outputs and sides anew.
    for row in ("an event, as a hand-over", "outputs", "sides of indicators"):
        most[found.events] += allowed(row) - REST if f"| {row} |" in sheet else 0
    most[0] += allowed("the start") - REST if "| the start |" in sheet else 0
    assert not np.flatnonzero(found.instructions > most).size, (found.instructions - most).max()


@each_unit
def test_whole_units_are_compiled_for_the_target_without_a_warning(row, laws, tmp_path) -> None:
    flags, made = [*WARNINGS, *MACHINE, *SAME_BITS, "-DFMI2_STATIC_INSTANCES=1"], tmp_path / "all.o"
    built(COMPILER, *flags, "-c", laws.sources(row["FMU with sources"]) / "all.c", "-o", made)
    flash, memory = sizes(made)
    assert as_documented(flash, row["flash"]) and as_documented(memory, row["RAM"]), (flash, memory)
    assert not FORBIDDEN & {line.split()[-1] for line in output_of(SYMBOLS, made).splitlines()}


@pytest.mark.parametrize("machine", ["M7", "M4F", "M7 float", "M4F float"])
def test_vectors_are_replayed_on_the_target(machine, laws, tmp_path) -> None:
    """One law a commit, on two boards, in double and in float."""
    names = sorted({row["controller"] for row in table("controller")})
    rows = [row for row in table("controller") if row["controller"] == names[NUMBER % len(names)] and number(row["substeps"]) < 100]
    name, folder = rows[0]["controller"], laws.firmware(rows[0]["controller"], number(rows[0]["substeps"]))
    core, *kind = machine.split()
    board = {"M7": MACHINE, "M4F": ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]}[core]
    defines = [f"-D{name}_REPLAY", *([f"-D{name}_FLOAT"] if kind else [])]
    flags = [*WARNINGS, *board, *SAME_BITS, *defines, f"-I{folder}", "-nostartfiles", "-T", BOARD / "board.ld"]
    sources = [folder / f"{name}.c", folder / f"{name}_replay.c", BOARD / "startup.c", BOARD / "console.c"]
    built(COMPILER, *flags, *sources, "-lm", "-o", tmp_path / "replay.elf")
    on = ["-M", {"M7": "mps2-an500", "M4F": "mps2-an386"}[core], "-display", "none", "-serial", "none", "-monitor", "none"]
    command = [EMULATOR, *on, "-semihosting-config", "enable=on,target=native", "-kernel", tmp_path / "replay.elf"]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0 and f"{name}: passed, 100 steps" in run.stderr, run


# Laws that were written by hand, too: with so many substeps, and how much more instructions, flash memory and RAM generated ones take.
BY_HAND = {
    "L1TwoLinkRobot": ("L1ByHand", 10, 0.95, [1.65, 1.05]),
    "L1SampledTwoLinkRobot": ("L1SampledByHand", 1, 1.1, [1.22, 1.25]),
    "PidNonlinearSiso": ("PidByHand", 1, 1.12, [1.33, 1.15]),
    "LadrcTwoLinkRobot": ("LadrcByHand", 1, 1.04, [1.8, 0.9]),
    "L1Motor": ("L1ZooByHand", MOTOR_STEPS, 0.98, [1.7, 0.75]),
    "L1Quadrotor": ("L1QuadrotorByHand", 10, 1.14, [1.91, 0.97]),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_a_law_by_hand_has_the_same_services(name, laws, tmp_path) -> None:
    """On the host: calls at random, with inputs and parameters of which some are refused."""
    (other, steps, *_), by_hand = BY_HAND[name], BOARD / "by_hand"
    folder = laws.firmware(name, steps)
    headers = [f"-I{folder}", f"-I{by_hand}", "-include", f"{name}.h", "-include", f"{other}.h"]
    names = [f"-DGENERATED={name}", f"-DBY_HAND={other}", f"-DSEED={NUMBER}", *(["-DSAMPLED"] if "Sampled" in name else [])]
    sources = [by_hand / "services.c", by_hand / f"{other}.c", folder / f"{name}.c"]
    built("gcc", "-std=c99", "-Wall", "-Wextra", *SAME_BITS, *headers, *names, *sources, "-lm", "-o", tmp_path / "services")
    run = subprocess.run([tmp_path / "services"], capture_output=True, text=True, check=False, timeout=60)
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize("name", BY_HAND)
def test_a_generated_law_takes_little_more_than_one_that_is_written_by_hand(name, laws, law_object, on_target, tmp_path) -> None:
    (other, steps, slower, more), by_hand = BY_HAND[name], BOARD / "by_hand"
    own = tmp_path / "own.o"
    built(COMPILER, *WARNINGS, *MACHINE, *SAME_BITS, "-c", by_hand / f"{other}.c", "-o", own)
    inputs = inputs_of(laws, name)
    outputs = laws.outputs(name, steps, inputs[:1]).shape[1]
    (tmp_path / "recorded.h").write_text(header(other, inputs, outputs))
    written, generated = emulated(program(by_hand, own, tmp_path)), on_target(name, steps)
    assert written.refused == generated.refused == 0
    # In parts of the largest value: a control that passes 0 is a difference of larger terms, whose roundings stay.
    apart = np.abs(generated.outputs - written.outputs).max(axis=0)
    assert np.all(apart <= 1e-12 * np.abs(written.outputs).max(axis=0)), apart
    assert generated.instructions.mean() <= slower * written.instructions.mean()
    (tmp_path / "by_hand.c").write_text(f'#include "{other}.h"\n\n{other} controller;\n')
    (tmp_path / "generated.c").write_text(f'#include "{name}.h"\n\n{name} controller;\n')
    memory = {}
    for which, law in (("by_hand", own), ("generated", law_object(name, steps))):
        flags = [*MACHINE, f"-I{by_hand}", f"-I{laws.firmware(name, steps)}", "-r", "-nostdlib"]
        built(COMPILER, *flags, tmp_path / f"{which}.c", law, "-o", tmp_path / f"{which}.o")
        memory[which] = np.array(sizes(tmp_path / f"{which}.o"))
    # What the page has of them.
    print(name, np.rint(written.instructions.mean()), generated.instructions.mean() / written.instructions.mean(), memory)
    # Straight lines take more flash memory than loops.
    assert np.all(memory["generated"] <= more * memory["by_hand"]), memory
