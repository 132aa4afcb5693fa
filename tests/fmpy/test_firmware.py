"""Laws as C for targets: what the FMU gives, what is refused, who is in command, and which gains may change."""

import ctypes
import json
import math
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
import pytest
from conftest import PROGRAM, ROOT, adaptive_fmu
from laws import PLANTS, WARNINGS, Law, Laws, built, kind
from master import Fmu, Unit
from sample import ALL, FMUS, NUMBER


def substeps(name: str) -> int:
    """How many Runge-Kutta steps a law takes in a period: with fewer than 480, the fastest mode of the fastest law grows."""
    return 500 if name == "L1ActuatedSiso" else 100


LAWS = [name for name in FMUS if kind(name) not in PLANTS]


@pytest.fixture(scope="module")
def laws(tmp_path_factory: pytest.TempPathFactory) -> Laws:
    return Laws(tmp_path_factory.mktemp("laws"), [])


class Reference:
    """The FMU of a law, with steps of the same length."""

    def __init__(self, fmu: Fmu, law: Law, steps: int | None = None) -> None:
        self.unit, self.period, self.steps = Unit(fmu, fmu.name), law.period, 0
        if "integration_method" in fmu.variables:
            self.unit["integration_method"] = "fixed"
            self.unit["fixed_steps"] = steps or substeps(fmu.name)
        if "sample_time" in fmu.variables and float(fmu.variables["sample_time"].start) == 0:
            self.unit["sample_time"] = law.period
        self.inputs = [n for n in fmu.named(causality="input", type="Real") if not n.startswith("u_manual")]
        is_stored = lambda v: v.variability == "discrete"
        self.outputs = [n for n in fmu.named(causality="output", type="Real") if not is_stored(fmu.variables[n])]

    def step(self, inputs: list[float]) -> list[float]:
        if self.steps == 0:
            self.unit.start()
        for name, value in zip(self.inputs, inputs, strict=True):
            self.unit[name] = value
        time = self.steps * self.period
        self.steps += 1
        self.unit.slave.doStep(time, self.steps * self.period - time)
        return [self.unit[name] for name in self.outputs]


def signals(fmu: Fmu, names: list[str], random: Random) -> Callable[[float], list[float]]:
    """Smooth inputs about their starts."""
    drawn = [(float(fmu.variables[n].start), *(random.uniform(*of) for of in [(0, 0.04), (0.5, 3), (-3, 3)])) for n in names]
    return lambda t: [start + size * math.sin(frequency * t + phase) for start, size, frequency, phase in drawn]


def assert_same(found: list[float], expected: list[float], what: object, digits: float = 1e-11) -> None:
    for one, other in zip(found, expected, strict=True):
        assert abs(one - other) <= digits * max(1.0, abs(other)), (what, found, expected)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_gives_what_its_fmu_gives_with_the_same_steps(name: str, laws: Laws, fmu) -> None:
    law = Law(laws.firmware(name, substeps(name)), name)
    reference = Reference(fmu(name), law)
    drawn = signals(fmu(name), reference.inputs, Random(f"{name} {NUMBER}"))
    near = [law.step([value * (1 + 2.3e-16) for value in drawn(k * law.period)])[1] for k in range(60)]
    law.c.law_init()
    for k in range(60):
        inputs = drawn(k * law.period)
        status, given = law.step(inputs)
        assert status & law.bits["REFUSED"] == 0, (k, status)
        # Inputs that no plant has may ask for more substeps: then the law itself amplifies a rounding of its inputs.
        if any(abs(one - other) > 1e-12 * max(1.0, abs(other)) for one, other in zip(near[k], given, strict=True)):
            assert k >= 20, (near[k], given)
            break
        assert_same(given, reference.step(inputs), k)
    reference.unit.free()


@pytest.mark.parametrize("name", LAWS)
def test_no_input_that_is_no_number_changes_anything(name: str, laws: Laws, fmu) -> None:
    law = Law(laws.firmware(name, substeps(name)), name)
    inputs = Reference(fmu(name), law).inputs
    drawn = signals(fmu(name), inputs, Random(f"{name} {NUMBER}"))
    law.c.law_forget()
    status, given = law.step(drawn(0.0))
    assert status == law.bits["REFUSED"] | law.bits["NOT_INITIALISED"] and set(given) == {0.0}
    law.c.law_init()
    for k in range(3):
        _, taken = law.step(drawn(k * law.period))
    for place in range(len(inputs)):
        for bad in (math.nan, math.inf, -math.inf):
            before, refused = law.state(), law.c.law_refused()
            wrong = drawn(0.0)
            wrong[place] = bad
            status, given = law.step(wrong)
            assert status == law.bits["REFUSED"] | law.bits["BAD_INPUT"] and given == taken, inputs[place]
            assert law.c.law_refused() == refused + 1
            changed = [k for k, (one, other) in enumerate(zip(before, law.state(), strict=True)) if one != other]
            # The counter alone.
            assert 1 <= len(changed) <= 2 and max(changed) - min(changed) < 4, (inputs[place], changed)
    untroubled = Law(laws.firmware(name, substeps(name)), name)
    for k in range(3):
        untroubled.step(drawn(k * law.period))
    assert law.step(drawn(1.0)) == untroubled.step(drawn(1.0)), "it goes on as if nothing had been"


def test_a_refused_step_gives_what_the_export_documents(laws: Laws) -> None:
    name = "L1TwoLinkRobot"
    inputs = [0.1, -0.1, 0.0, 0.05, 0.0, 0.0]
    given = {}
    for fallback in ("hold", "zero", "manual"):
        law = Law(laws.firmware(name, substeps(name), "--fallback", fallback), name)
        law.c.law_enable(1, law.numbers("manual", [3.0, -4.0]))
        _, taken = law.step(inputs)
        status, given[fallback] = law.step([math.nan, *inputs[1:]])
        assert status & law.bits["REFUSED"], fallback
        assert given[fallback] == {"hold": taken, "zero": [0.0, 0.0], "manual": [3.0, -4.0]}[fallback]
        # A manual control that is no number changes nothing.
        before = law.state()
        assert not law.c.law_enable(0, law.numbers("manual", [math.nan, 0.0])) and law.state() == before
    assert given["hold"] != [0.0, 0.0]


def test_a_manual_control_keeps_to_the_limits_where_a_step_is_refused(laws: Laws) -> None:
    name = "L1TwoLinkRobot"
    for options in ([], ["--calibrate", "adaptation_gain"]):
        law = Law(laws.firmware(name, substeps(name), "--fallback", "manual", *options), name)
        if not options:
            values, places = law.defaults(), law.places("parameters")
            values[places["u_min"]], values[places["u_max"] + 1] = -2.0, 1.5
            assert law.c.law_calibrate(values) == 0
        assert law.c.law_enable(1, law.numbers("manual", [-3.0, 4.0]))
        _, given = law.step([math.nan] * 6)
        assert given == ([-3.0, 4.0] if options else [-2.0, 1.5])


@pytest.mark.parametrize("name", LAWS)
def test_a_control_at_its_limit_is_reported(name: str, laws: Laws, fmu) -> None:
    law = Law(laws.firmware(name, substeps(name)), name)
    members = law.members["parameters"]
    if not {"u_min", "u_max"} <= members.keys() or re.search(r"^    (?:bool|int32_t) \w+;.*\n", parameters_of(law.header), re.M):
        pytest.skip("it has no limits that are parameters among real numbers")
    values, places = law.defaults(), law.places("parameters")
    inputs = Reference(fmu(name), law).inputs
    drawn = signals(fmu(name), inputs, Random(f"limits {name} {NUMBER}"))
    first = law.places("outputs")["u"]
    free = [law.step(drawn(k * law.period)) for k in range(20)]
    sizes = [max(abs(given[first + k]) for _, given in free) for k in range(members["u_min"])]
    assert not any(status & law.bits["LIMITED"] for status, _ in free), "limits that are far away"
    for k, size in enumerate(sizes):
        values[places["u_min"] + k], values[places["u_max"] + k] = -0.5 * size - 1e-9, 0.5 * size + 1e-9
    law.c.law_init()
    assert law.c.law_calibrate(values) == 0
    messages = []
    for k in range(20):
        status, given = law.step(drawn(k * law.period))
        at_limit = any(abs(given[first + i]) >= 0.5 * size + 1e-9 for i, size in enumerate(sizes))
        assert bool(status & law.bits["LIMITED"]) == at_limit, (k, given, sizes)
        messages.append(at_limit)
    assert any(messages) or not any(sizes)


def parameters_of(header: str) -> str:
    """The members of the struct of parameters."""
    return re.search(r"typedef struct {\n([^}]*)} \w+_parameters;", header)[1]


@pytest.mark.parametrize("name", ["L1TwoLinkRobot", "L1SampledTwoLinkRobot", "PidNonlinearSiso", "LadrcNonlinearSiso"])
def test_a_person_hands_over_without_a_jump_as_in_the_fmu(name: str, laws: Laws, fmu) -> None:
    law = Law(laws.firmware(name, substeps(name)), name)
    reference = Reference(fmu(name), law)
    drawn = signals(fmu(name), reference.inputs, Random(f"{name} {NUMBER}"))
    by_hand = [0.5 + k for k in range(law.members["manual"]["u_manual"])]
    names = [n for n in fmu(name).named(causality="input") if n.startswith("u_manual")]
    for k in range(30):
        enabled = not 10 <= k < 20
        law.c.law_enable(int(enabled), law.numbers("manual", by_hand))
        reference.unit["enabled"] = enabled
        for one, value in zip(names, by_hand, strict=True):
            reference.unit[one] = value
        inputs = drawn(k * law.period)
        status, given = law.step(inputs)
        assert status & law.bits["REFUSED"] == 0
        assert_same(given, reference.step(inputs), k)
        if 10 < k < 20:
            assert given == by_hand
    reference.unit.free()


@pytest.mark.parametrize("name", ["L1TwoLinkRobot", "FuzzyL1ActuatedSiso", "MracPpfCoupledMimo", "PidNonlinearSiso"])
def test_gains_change_while_a_law_runs_all_or_none(name: str, laws: Laws, fmu) -> None:
    law = Law(laws.firmware(name, substeps(name)), name)
    reference = Reference(fmu(name), law)
    drawn = signals(fmu(name), reference.inputs, Random(f"{name} {NUMBER}"))
    random = Random(f"gains {name} {NUMBER}")
    members, defaults, places = law.members["parameters"], list(law.defaults()), law.places("parameters")
    for member, place in places.items():
        before, wrong = law.state(), law.numbers("parameters", defaults)
        wrong[place] = math.nan
        assert law.c.law_calibrate(wrong) > 0 and law.state() == before, member
    # One that is no limit and no size of an event.
    gain = {"L1TwoLinkRobot": "adaptation_gain", "FuzzyL1ActuatedSiso": "adaptation_gain"}.get(name, "gamma_1")
    gain = "K_p" if name == "PidNonlinearSiso" else gain
    for k in range(30):
        if k == 10:
            factor = random.uniform(0.5, 0.9)
            changed = law.numbers("parameters", defaults)
            for at in range(places[gain], places[gain] + members[gain]):
                changed[at] *= factor
            assert law.c.law_calibrate(changed) == 0
            for one in fmu(name).named(causality="parameter"):
                if one.split("[")[0] == gain:
                    reference.unit[one] = float(fmu(name).variables[one].start) * factor
        inputs = drawn(k * law.period)
        status, given = law.step(inputs)
        assert status & law.bits["REFUSED"] == 0
        assert_same(given, reference.step(inputs), k)
    reference.unit.free()


POKED = """
void law_run_for(double seconds);
void law_run_for(double seconds)
{
    law.steps = (uint64_t)(seconds / NAME_PERIOD + 0.5);
    law.d.samples_taken = law.steps;
}
double law_samples(void);
double law_samples(void) { return (double)law.d.samples_taken; }
"""


@pytest.mark.parametrize("since", [0.0, 365 * 86400.0])
def test_no_sample_is_lost_in_float_after_any_time(since: float, laws: Laws, fmu) -> None:
    name, steps = "MracPpfCoupledMimo", 10_000_000 if ALL else 200_000
    folder = laws.firmware(name, 1)
    law = Law(folder, name, f"-D{name}_FLOAT", further=POKED)
    law.c.law_run_for.argtypes, law.c.law_samples.restype = [ctypes.c_double], ctypes.c_double
    inputs = law.numbers("inputs", [float(fmu(name).variables[n].start) for n in Reference(fmu(name), law).inputs])
    out = law.numbers("outputs")
    law.c.law_step(inputs, out)
    law.c.law_run_for(since)
    before = law.c.law_samples()
    for _ in range(steps):
        assert law.c.law_step(inputs, out) & law.bits["REFUSED"] == 0
    assert law.c.law_samples() - before == steps


MAIN = """
#include "L1TwoLinkRobot.h"
#include "PidNonlinearSiso.h"
int main()
{
    static L1TwoLinkRobot one;
    static PidNonlinearSiso other;
    L1TwoLinkRobot_inputs in_one = L1TwoLinkRobot_inputs();
    PidNonlinearSiso_inputs in_other = PidNonlinearSiso_inputs();
    L1TwoLinkRobot_outputs out_one;
    PidNonlinearSiso_outputs out_other;
    L1TwoLinkRobot_init(&one);
    PidNonlinearSiso_init(&other);
    unsigned status = L1TwoLinkRobot_step(&one, &in_one, &out_one);
    status |= PidNonlinearSiso_step(&other, &in_other, &out_other);
    return status & L1TwoLinkRobot_REFUSED ? 1 : 0;
}
"""


def test_several_laws_are_in_one_source_file(laws: Laws, tmp_path: Path) -> None:
    names = ["L1TwoLinkRobot", "MracPpfCoupledMimo", "FuzzyL1ActuatedSiso"]
    folders = [laws.firmware(name, substeps(name)) for name in names]
    (tmp_path / "all.c").write_text("".join(f'#include "{name}.c"\n' for name in names))
    built("gcc", *WARNINGS, *(f"-I{folder}" for folder in folders), "-c", tmp_path / "all.c", "-o", tmp_path / "all.o")


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only"])
def test_checks_of_numbers_cannot_be_compiled_away(flag: str, laws: Laws, tmp_path: Path) -> None:
    file = laws.firmware("L1SampledTwoLinkRobot", 1) / "L1SampledTwoLinkRobot.c"
    done = subprocess.run(["gcc", flag, "-O2", "-c", file, "-o", tmp_path / "o"], capture_output=True, text=True, check=False)
    assert done.returncode != 0 and "takes away the checks" in done.stderr


@pytest.mark.skipif(not shutil.which("g++"), reason="there is no g++")
def test_several_laws_are_in_one_program_of_cpp(laws: Laws, tmp_path: Path) -> None:
    objects = []
    for name in ("L1TwoLinkRobot", "PidNonlinearSiso"):
        folder = laws.firmware(name, 10)
        # C++ compilers take the C itself, too.
        built("g++", "-std=c++17", "-Wall", "-Wextra", "-O1", "-x", "c++", "-c", folder / f"{name}.c", "-o", tmp_path / "cpp.o")
        built("gcc", "-std=c99", "-O1", "-c", folder / f"{name}.c", "-o", tmp_path / f"{name}.o")
        objects += [tmp_path / f"{name}.o", f"-I{folder}"]
    (tmp_path / "main.cpp").write_text(MAIN)
    built("g++", "-std=c++17", "-Wall", "-Wextra", "-pedantic", tmp_path / "main.cpp", *objects, "-lm", "-o", tmp_path / "main")
    assert subprocess.run([tmp_path / "main"], check=False).returncode == 0


def test_what_does_not_fit_is_refused_with_what_does(tmp_path: Path) -> None:
    def refused(*words: str) -> str:
        answer = adaptive_fmu("export", "--firmware", *words, "--out", tmp_path / "none")
        assert answer.returncode == 1 and not (tmp_path / "none").exists(), answer
        return answer.stderr

    assert re.search(
        "calibrate.*`Q`.*must be a parameter that can change.*adaptation_gain", refused("L1TwoLinkRobot", "--calibrate", "Q")
    )
    assert re.search(r"period = 0\.003.*sample time, 0\.005 s", refused("L1SampledTwoLinkRobot", "--period", "0.003"))
    assert "substeps = 0" in refused("L1TwoLinkRobot", "--substeps", "0")
    assert re.search("events at times.*`export --source`", refused("ReferenceNonlinearSiso"))
    assert "no manual control" in refused("ObserverTwoLinkRobot", "--fallback", "manual")
    assert "fallback" in refused("L1TwoLinkRobot", "--fallback", "stop")


def test_a_sampled_law_is_called_several_times_a_sample(laws: Laws, tmp_path: Path) -> None:
    name, inputs = "L1SampledTwoLinkRobot", [0.1, -0.1, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0]
    law = Law(laws.firmware(name, 1, "--period", "0.001"), name)
    given = [law.step(inputs)[1] for _ in range(20)]
    changes = [k for k in range(1, 20) if given[k] != given[k - 1]]
    assert changes and all((k + 1) % 5 == 0 for k in changes), changes


def test_constants_take_no_memory(laws: Laws) -> None:
    size = lambda *options: Law(laws.firmware("L1TwoLinkRobot", 10, *options), "L1TwoLinkRobot").c.law_size()
    all_of_them, one, none = size(), size("--calibrate", "adaptation_gain"), size("--calibrate", "")
    assert none + 8 <= one < all_of_them
    # Its 14 states, the control by hand and the last one, what the step flags look at: no more than three times the states.
    assert none <= 3 * 14 * 8


def test_the_program_of_the_page_is_compiled(laws: Laws, tmp_path: Path) -> None:
    page = (ROOT / "docs/firmware.md").read_text()
    (tmp_path / "main.c").write_text(page.split("```c\n")[1].split("```")[0])
    folder = laws.firmware("L1SampledTwoLinkRobot", 1)
    built("gcc", *WARNINGS, f"-I{folder}", "-c", tmp_path / "main.c", "-o", tmp_path / "main.o")


@pytest.mark.parametrize("name", LAWS)
def test_compilers_and_checkers_find_nothing(name: str, laws: Laws, tmp_path: Path) -> None:
    file = laws.firmware(name, substeps(name)) / f"{name}.c"
    for compiler in filter(shutil.which, ("gcc", "clang")):
        for defines in ([], [f"-D{name}_FLOAT"]):
            built(compiler, *WARNINGS, *defines, "-c", file, "-o", tmp_path / "law.o")
    # Of long straight lines cppcheck takes minutes.
    if shutil.which("cppcheck") and len(file.read_text().splitlines()) < 600:
        options = ["--std=c99", "--quiet", "--enable=warning,portability,performance", "--error-exitcode=1"]
        built("cppcheck", *options, file)


@pytest.mark.parametrize("name", LAWS)
def test_variables_of_a_header_have_the_units_and_descriptions_of_the_fmu(name: str, laws: Laws, fmu) -> None:
    header = (laws.firmware(name, substeps(name)) / f"{name}.h").read_text()
    described, no_limit = 0, " (1e15: no limit)"
    for member, comment in re.findall(rf"^    {name}_real (\w+)(?:\[\d+\])?; /\* (.*) \*/$", header, re.MULTILINE):
        for variable in (v for v in fmu(name).variables.values() if v.name.split("[")[0] == member):
            # Elements share what is the same in their descriptions; what isn't in ASCII is written otherwise.
            text = re.escape(re.sub(r", (\d+ of \d+|row \d+, column \d+)$", "", variable.description.removesuffix(no_limit)))
            assert re.search(re.sub(r"[^ -~]", ".+?", text), comment), (comment, variable.description)
            assert comment.endswith(no_limit) == variable.description.endswith(no_limit), comment
            assert variable.unit in (None, "1") or variable.unit in re.split("[,; ]+", comment), (comment, variable.unit)
            described += 1
    assert described >= len([v for v in fmu(name).variables.values() if v.causality in ("input", "output") and v.type == "Real"])


@pytest.mark.parametrize("name", ["L1Quadrotor", "L1TwoLinkRobot"])
def test_the_number_of_steps_is_the_one_that_its_loop_needs(name: str, laws: Laws, tmp_path: Path) -> None:
    exported = adaptive_fmu("export", "--firmware", name, "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    found = int(re.search(rf"{name}: (\d+) Runge-Kutta steps", exported.stderr)[1])
    assert Law(tmp_path, name).header.count(f"define {name}_SUBSTEPS {found}\n") == 1
    loop = {"L1Quadrotor": "3.3.2-case1", "L1TwoLinkRobot": "3.3.1-case1"}[name]
    laws.add(name)
    inputs = laws.inputs(name, loop, 1000)
    few, many = laws.outputs(name, found, inputs), laws.outputs(name, 4 * found, inputs)
    assert abs(few - many).max() <= 1e-2 * abs(many).max()


def test_without_a_loop_the_number_of_steps_is_asked_for(tmp_path: Path) -> None:
    def exported(*words: str) -> tuple[int, str]:
        answer = adaptive_fmu("export", "--firmware", *words, "--out", tmp_path)
        return answer.returncode, answer.stderr

    code, output = exported("PidNonlinearSiso")
    assert code == 1 and "--loop LOOP" in output and "--substeps N" in output
    code, output = exported("PidNonlinearSiso", "--loop", "3.2.1-cosine")
    assert code == 1 and "3.2.1-cosine has no component of PidNonlinearSiso" in output
    assert exported("PidNonlinearSiso", "--substeps", "1") == (0, "")
    # Nothing of it is integrated.
    assert exported("L1SampledTwoLinkRobot") == (0, "")


def test_a_users_own_controller_of_a_foreign_plant_is_one_too(laws: Laws, tmp_path: Path) -> None:
    """Of a plant whose states have names that C++ has for itself."""
    plant = {"A": [[-2.0, -4.0], [1.0, 0.0]], "B": [[3.0], [0.0]], "C": [[0.0, 1.0]]}
    plant |= {"states": ["class", "READY"], "inputs": ["new"], "outputs": ["angle"]}
    (tmp_path / "plant.json").write_text(json.dumps(plant))

    def ran(*words: str) -> str:
        done = subprocess.run([PROGRAM, *words], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 0, done.stderr
        return done.stderr

    ran("new", "l1", "--name", "Own", "--plant", "plant.json", "--bandwidth", "2")
    ran("export", "--firmware", "Own.toml", "--substeps", "200", "--out", "c")
    ran("export", "Own.toml", "--out", "fmus")
    fmu, law = Fmu(tmp_path / "fmus/Own.fmu", tmp_path / "unpacked"), Law(tmp_path / "c", "Own")
    if shutil.which("g++"):
        built("g++", "-x", "c++", "-std=c++17", "-Wall", "-Wextra", "-c", tmp_path / "c/Own.c", "-o", tmp_path / "own.o")
    reference = Reference(fmu, law, 200)
    drawn = signals(fmu, reference.inputs, Random(f"own {NUMBER}"))
    for k in range(60):
        status, given = law.step(drawn(k * law.period))
        assert status & law.bits["REFUSED"] == 0
        assert_same(given, reference.step(drawn(k * law.period)), k)
    reference.unit.free()


def replayed(folder: Path, name: str, made: Path, *options: str) -> subprocess.CompletedProcess:
    """Runs the program that replays a law's vectors."""
    flags = [*WARNINGS, "-O2", "-ffp-contract=off", f"-I{folder}", f"-D{name}_REPLAY", *options]
    built("gcc", *flags, folder / f"{name}.c", folder / f"{name}_replay.c", "-lm", "-o", made)
    return subprocess.run([made], capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize("name", LAWS)
def test_the_vectors_of_a_law_are_replayed(name: str, laws: Laws, tmp_path: Path) -> None:
    folder = laws.firmware(name, substeps(name))
    for options in ([], [f"-D{name}_FLOAT"]):
        run = replayed(folder, name, tmp_path / "replay", *options)
        match = re.search(rf"{name}: passed, (\d+) steps are apart by", run.stdout)
        assert run.returncode == 0 and match, run.stdout
        assert int(match[1]) == 100, run.stdout
    # All files of a folder are compiled where the user's program has a main.
    built("gcc", *WARNINGS, f"-I{folder}", "-c", folder / f"{name}_replay.c", "-o", tmp_path / "empty.o")


def test_a_replay_finds_a_law_that_is_another(laws: Laws, tmp_path: Path) -> None:
    name = "L1TwoLinkRobot"
    for file in laws.firmware(name, 10).glob(f"{name}*.[ch]"):
        shutil.copy(file, tmp_path)
    text = (tmp_path / f"{name}.c").read_text()
    # An adaptation gain that is a millionth larger.
    changed = text.replace("self->p.adaptation_gain", "(self->p.adaptation_gain * R(1.000001))")
    assert changed != text
    (tmp_path / f"{name}.c").write_text(changed)
    run = replayed(tmp_path, name, tmp_path / "replay")
    assert run.returncode == 1 and f"{name}: failed" in run.stdout, run.stdout


def test_vectors_are_of_the_loop_where_there_is_one_and_else_move_each_input(laws: Laws) -> None:
    def vectors(name: str) -> np.ndarray:
        text = (laws.firmware(name, 10) / f"{name}_replay.c").read_text()
        rows = re.search(r"double replayed_inputs\[100\]\[\d+\] = \{\n(.*?)\n\};", text, re.DOTALL)
        return np.array([[float(number) for number in row.split(",")] for row in re.findall(r"\{([^}]*)\}", rows[1])])

    laws.add("L1TwoLinkRobot")
    expected = laws.inputs("L1TwoLinkRobot", "3.3.1-case1", 100)
    for k, (row, of_loop) in enumerate(zip(vectors("L1TwoLinkRobot").tolist(), expected.tolist(), strict=True)):
        assert_same(row, of_loop, k, 1e-4)
    assert np.all(np.ptp(vectors("PidNonlinearSiso"), axis=0) > 1e-3)


@pytest.mark.skipif(not shutil.which("cmake"), reason="there is no cmake")
def test_cmake_builds_and_tests_all_controllers_of_a_folder(tmp_path: Path) -> None:
    for names in (["PidNonlinearSiso"], ["L1TwoLinkRobot", "L1SampledTwoLinkRobot"]):
        done = adaptive_fmu("export", "--firmware", *names, "--substeps", "8", "--out", tmp_path)
        assert done.returncode == 0, done.stderr
    for kind in ("OFF", "ON"):
        for command in (["-S", tmp_path, "-B", tmp_path / kind, f"-DFLOAT={kind}"], ["--build", tmp_path / kind]):
            done = subprocess.run(["cmake", *command], capture_output=True, text=True, check=False, timeout=120)
            assert done.returncode == 0, done.stdout + done.stderr
        tested = subprocess.run(["ctest"], cwd=tmp_path / kind, capture_output=True, text=True, check=False, timeout=60)
        assert tested.returncode == 0 and "100% tests passed, 0 tests failed out of 3" in tested.stdout, tested.stdout
    # The user's own stays.
    (tmp_path / "CMakeLists.txt").write_text("# mine\n")
    adaptive_fmu("export", "--firmware", "PidNonlinearSiso", "--substeps", "8", "--out", tmp_path)
    assert (tmp_path / "CMakeLists.txt").read_text() == "# mine\n"


def test_a_law_holds_its_inputs_where_its_fmu_ramps_them(tmp_path: Path) -> None:
    (tmp_path / "ramps.ssv").write_text(
        '<ParameterSet xmlns="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="ramps"><Parameters>'
        '<Parameter name="input_handling"><Enumeration value="interpolate"/></Parameter></Parameters></ParameterSet>'
    )
    options = ["--substeps", "4", "--values", tmp_path / "ramps.ssv", "--out", tmp_path]
    done = adaptive_fmu("export", "--firmware", "PidNonlinearSiso", *options)
    assert done.returncode == 0, done.stderr
    run = replayed(tmp_path, "PidNonlinearSiso", tmp_path / "replay")
    assert run.returncode == 0, run.stdout
