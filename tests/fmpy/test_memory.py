"""What a unit takes of its host: memory that it gives back, its own description, and nothing else."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
import sample
from conftest import ROOT
from master import at_ease

STEPS = int(os.environ.get("ADAPTIVE_FMU_STEPS", "1000"))


@pytest.fixture(scope="module")
def life(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The master in C, which counts blocks in use where it is told to (valgrind has its own way)."""

    def compiled(*options: str) -> Path:
        program = tmp_path_factory.mktemp("life") / "life"
        command = ["gcc", "-O1", "-g", "-w", *options, "-o", program, ROOT / "tests" / "memory" / "life.c", "-ldl", "-lm"]
        subprocess.run(command, check=True)
        return program

    return compiled


def words(entry: int | tuple[int, float]) -> str:
    return " ".join(map(str, entry)) if isinstance(entry, tuple) else str(entry)


@pytest.fixture(scope="module")
def plan(fmu, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every FMU of the sample in either interface."""
    lines = []
    for name in sample.FMUS:
        unit = fmu(name)
        description, variables = unit.description, unit.variables.values()
        reals = [v for v in variables if v.type == "Real"]
        known = [[v.valueReference for v in reals if v.causality == "input"], [v.valueReference for v in reals]]
        for of_reals in (True, False):
            values = [(unit.variables[name], value) for name, value in at_ease(unit).items()]
            known.append([(v.valueReference, x) for v, x in values if (v.type == "Real") == of_reals])
        references = " ".join(" ".join(map(words, [len(these), *these])) for these in known)
        library = unit.folder / "binaries" / "linux64" / f"{name}.so"
        counts = f"{description.numberOfContinuousStates} {description.numberOfEventIndicators}"
        for interface in (0, 1):
            step = description.defaultExperiment.stepSize
            place = f"file://{unit.folder}/resources"
            lines.append(f"{interface} {step} {library} {description.guid} {place} {counts} {references}")
    file = tmp_path_factory.mktemp("plan") / "plan.txt"
    file.write_text("\n".join(lines) + "\n")
    return file


def test_memory_in_use_does_not_grow_and_the_system_is_asked_for_nothing_but_the_description(life, plan: Path) -> None:
    # Blocks that malloc keeps for the next call count as in use: it keeps none here.
    environment = {**os.environ, "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0"}
    command = [life("-DCOUNTED", "-rdynamic"), plan, str(STEPS)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert done.stdout.count(".so, ") == 2 * len(sample.FMUS) and done.stdout.endswith("all as it should be\n")


@pytest.mark.slow
def test_valgrind_finds_no_wrong_access_and_no_leak(life, plan: Path) -> None:
    if not shutil.which("valgrind"):
        pytest.skip("there is no valgrind")
    checks = ["--leak-check=full", "--show-leak-kinds=definite,indirect", "--errors-for-leak-kinds=definite,indirect"]
    command = ["valgrind", "--quiet", "--error-exitcode=9", *checks, life("-DROUND=5"), plan, "20"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr[-5000:] or done.stdout
