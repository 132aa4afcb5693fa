"""Sizes of FMUs of FMI 3.0 that change in Configuration Mode: the same numbers as those of an FMU that was exported with these sizes."""

import ctypes
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import adaptive_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from master3 import Fmu3, Unit3, dependencies
from sample import ALL, NUMBER

STATE_SPACE = """
name = "Plant"
model = "state-space"
description = "A plant of any size"
[structure]
A = {A}
B = {B}
C = {C}
"""

L1 = """
name = "Law"
model = "l1"
description = "A controller of any size"
[structure]
B = {B}
C = {C}
regressor = "state"
input_gain = "{gain}"
[start]
A_m = {A_m}
adaptation_gain = 2000.0
omega_min = {low}
omega_max = {high}
theta_bound = {theta}
sigma_bound = {sigma}
"""


def matrix(rows: int, columns: int, entry: Callable[[int, int], float]) -> list[list[float]]:
    return [[float(entry(i, j)) for j in range(columns)] for i in range(rows)]


def plant(n: int, m: int, p: int) -> str:
    """The description of a chain of two integrators, in a plant with further states, inputs and outputs that do nothing yet."""
    A = matrix(n, n, lambda i, j: (i, j) == (0, 1))
    B = matrix(n, m, lambda i, j: (i, j) == (1, 0))
    C = matrix(p, n, lambda i, j: (i, j) == (0, 0))
    return STATE_SPACE.format(A=A, B=B, C=C)


def law(gain: str) -> Callable[[int, int], str]:
    """The description of a controller, as a controller that had two states and one input gets these sizes."""

    def described(n: int, m: int) -> str:
        cascade = matrix(n, n, lambda i, j: (j == i + m) - (i == j))
        of_input = (lambda value: [value] * m) if gain == "diagonal" else (lambda value: matrix(m, m, lambda i, j: value * (i == j)))
        return L1.format(
            B=matrix(n, m, lambda i, j: i + m == n + j),
            C=matrix(m, n, lambda i, j: i == j),
            A_m=[[0.0, 1.0], [-1.0, -1.4]] if (n, m) == (2, 1) else cascade,
            gain=gain,
            low=of_input(0.5),
            high=of_input(2.0),
            theta=[10.0] * m,
            sigma=[10.0] * m,
        )

    return described


# Description of a size, the size that is exported, and sizes that it gets.
KINDS = {
    "plant": (plant, (2, 1, 1), [(3, 2, 2), (1, 1, 1), (5, 1, 4), (2, 3, 1)]),
    "law": (law("diagonal"), (2, 1), [(4, 2), (3, 1), (3, 2), (2, 2), (1, 1)]),
    "full law": (law("full"), (2, 1), [(3, 2)]),
}
CASES = [(kind, sizes) for kind, (_, _, all_of) in KINDS.items() for sizes in (all_of if ALL else [all_of[NUMBER % len(all_of)]])]
each_case = pytest.mark.parametrize(("kind", "sizes"), CASES, ids=[f"{kind} {sizes}" for kind, sizes in CASES])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Fmu3]:
    """The FMU of a kind's description of a size, exported once."""
    opened = dict[tuple, Fmu3]()

    def get(kind: str, sizes: tuple[int, ...]) -> Fmu3:
        if (kind, sizes) not in opened:
            folder = tmp_path_factory.mktemp("sizes")
            (folder / "unit.toml").write_text(KINDS[kind][0](*sizes))
            opened[kind, sizes] = exported(folder / "unit.toml")
        return opened[kind, sizes]

    return get


def exported(description: Path) -> Fmu3:
    folder = description.parent
    done = adaptive_fmu("export", "--fmi", "3", description, "--out", folder)
    assert done.returncode == 0, done.stderr
    return Fmu3(next(folder.glob("*.fmu")), folder / "unpacked")


class Sized(Unit3):
    """An instance whose sizes are set before anything else."""

    def __init__(self, fmu: Fmu3, sizes: tuple[int, ...] = (), **options: bool) -> None:
        super().__init__(fmu, **options)
        named = [v.name for v in fmu.about.modelVariables if v.causality == "structuralParameter"]
        self.sizes = {name: int(fmu.variables[name].start) for name in named}
        if sizes:
            self.resize(*sizes)

    def resize(self, *sizes: int) -> None:
        self.instance.enterConfigurationMode()
        self.instance.setUInt64([self.reference(name) for name in self.sizes], sizes)
        self.instance.exitConfigurationMode()
        self.sizes = dict(zip(self.sizes, sizes, strict=True))

    def count(self, name: str) -> int:
        """Number of elements of a variable."""
        dimensions = self.fmu.variables[name].dimensions
        return math.prod(int(d.start) if d.start else self.sizes[d.variable.name] for d in dimensions)

    def __getitem__(self, name: str) -> list[float]:
        kind = self.fmu.variables[name].type
        get = getattr(self.instance, "getInt64" if kind == "Enumeration" else f"get{kind}")
        return list(get([self.reference(name)], self.count(name)))

    def fill(self, random: np.random.Generator) -> None:
        """Sets inputs and parameters whose sizes change at random, so that the law or plant is valid."""
        n = self.sizes["n"]
        A = np.triu(random.standard_normal((n, n)), 1) - np.diag(random.uniform(0.5, 2.0, n))
        for name, variable in self.fmu.variables.items():
            if name in ("A", "A_m"):
                base = A if name == "A" else A * 0.2 + np.array(self[name]).reshape(n, n)
                self[name] = list(base.flatten())
            elif variable.causality in ("input", "parameter") and variable.type == "Float64" and name in ("B", "C", "u", "d", "x", "r", "x0"):
                self[name] = list(random.standard_normal(self.count(name)))

    def all(self) -> dict[str, list[float]]:
        return {name: self[name] for name, v in self.fmu.variables.items() if v.type not in ("UInt64", "Clock")}


def settable(unit: Sized) -> dict[str, list[float]]:
    return {name: unit[name] for name, v in unit.fmu.variables.items() if v.causality in ("input", "parameter")}


@each_case
def test_a_resized_unit_is_one_that_was_exported_with_these_sizes(
    kind: str, sizes: tuple[int, ...], made: Callable[..., Fmu3]
) -> None:
    """Start values, steps, derivatives in both directions, dependencies: to the bit. Value references stay."""
    base, same = made(kind, KINDS[kind][1]), made(kind, sizes)
    assert validate_fmu(str(base.file)) == []
    references = [{name: v.valueReference for name, v in fmu.variables.items()} for fmu in (base, same)]
    assert references[0] == references[1]
    with Sized(base, sizes) as new, Sized(same) as old:
        assert new.sizes == old.sizes
        assert settable(new) == settable(old)
        for unit in (new, old):
            unit.fill(np.random.default_rng(NUMBER))
            unit.start()
        assert new.all() == old.all()
        for k in range(5):
            for unit in (new, old):
                random = np.random.default_rng(k)
                for name in ("u", "d") if kind == "plant" else ("x", "r"):
                    unit[name] = list(random.standard_normal(unit.count(name)))
                unit.instance.doStep(0.01 * k, 0.01)
            assert new.all() == old.all()
        assert directions(new) == directions(old)
        for name in new.fmu.named(causality="output"):
            reference = new.reference(name)
            assert dependencies(new, reference) == dependencies(old, reference)


def directions(unit: Sized) -> list[list[float]]:
    """Derivatives of outputs and rates by inputs and states in a direction, and adjoint ones."""
    variables = unit.fmu.variables
    unknowns = [name for name, v in variables.items() if v.type == "Float64" and (v.causality == "output" or name.startswith("der("))]
    states = [v.derivative.name for v in variables.values() if v.derivative is not None]
    knowns = [name for name, v in variables.items() if v.type == "Float64" and v.causality == "input"] + states
    counts = [sum(unit.count(name) for name in names) for names in (unknowns, knowns)]
    random = np.random.default_rng(NUMBER)
    references = [[unit.reference(name) for name in names] for names in (unknowns, knowns)]
    w, v = random.standard_normal(counts[0]), random.standard_normal(counts[1])
    forward = unit.instance.getDirectionalDerivative(*references, list(v), counts[0])
    backward = unit.instance.getAdjointDerivative(*references, list(w), counts[1])
    terms = np.abs(w * np.array(forward)).sum() + np.abs(v * np.array(backward)).sum()
    assert abs(w @ np.array(forward) - v @ np.array(backward)) <= 1e-12 * max(terms, 1e-300)
    return [list(forward), list(backward)]


def number_of(unit: Sized, what: str) -> int:
    count = ctypes.c_size_t()
    getattr(unit.instance, f"fmi3GetNumberOf{what}")(unit.instance.component, ctypes.byref(count))
    return count.value


@each_case
def test_states_of_model_exchange_are_in_the_order_of_the_arrays(
    kind: str, sizes: tuple[int, ...], made: Callable[..., Fmu3]
) -> None:
    """Their number follows the sizes; they are the arrays of states one after the other, each by rows, and so are rates and nominals."""
    with Sized(made(kind, KINDS[kind][1]), sizes, exchange=True) as unit:
        unit.fill(np.random.default_rng(NUMBER))
        unit.start()
        unit.update()
        unit.instance.enterContinuousTimeMode()
        rates = [one.variable for one in unit.fmu.about.derivatives]
        n = number_of(unit, "ContinuousStates")
        assert n == sum(unit.count(v.name) for v in rates)
        x = (ctypes.c_double * n)(*(0.01 * (1 + k) for k in range(n)))
        unit.instance.setContinuousStates(x, n)
        get = (ctypes.c_double * n)()
        unit.instance.getContinuousStates(get, n)
        assert list(get) == list(x) == [value for v in rates for value in unit[v.derivative.name]]
        unit.instance.getContinuousStateDerivatives(get, n)
        assert list(get) == [value for v in rates for value in unit[v.name]]
        z = number_of(unit, "EventIndicators")
        assert z == unit.count("event_indicators")
        indicators = (ctypes.c_double * z)()
        unit.instance.getEventIndicators(indicators, z)
        assert list(indicators) == unit["event_indicators"]


def shapes(fmu: Fmu3) -> dict[str, list[str]]:
    """Dimensions that aren't numbers, by variable."""
    named = {v.name: [d.variable.name if d.variable else str(d.start) for d in v.dimensions] for v in fmu.about.modelVariables}
    return {name: dimensions for name, dimensions in named.items() if dimensions}


def test_dimensions_are_those_of_the_equations(made: Callable[..., Fmu3]) -> None:
    """And not those of equal numbers: p and m are 1 both."""
    found = shapes(made("plant", (2, 1, 1)))
    n, m, p = (["n"], ["m"], ["p"])
    expected = {"A": n + n, "B": n + m, "C": p + n, "x0": n, "x_op": n, "u_op": m, "y_op": p, "u_min": m, "u_max": m}
    expected |= {"u": m, "d": m, "x": n, "der(x)": n, "y": p, "u_acting": m, "event_indicators": [*m, "2"]}
    assert found == expected
    found = shapes(made("law", (2, 1)))
    for name, dimensions in {"theta_hat": m + n, "x_hat": n, "omega_hat": m, "sigma_hat": m, "r": m, "K_g": m + m, "P": n + n}.items():
        assert found[name] == dimensions, name


def test_start_values_that_a_description_gives_stay(tmp_path: Path) -> None:
    """The last one of a vector is repeated; matrices are continued on their diagonal."""
    text = plant(2, 1, 1) + "[start]\nx0 = [1.0, 2.0]\nA = [[-1.0, 1.0], [0.0, -3.0]]\nu_max = [4.0]\n[magnitudes]\nx = [10.0, 20.0]\n"
    (tmp_path / "unit.toml").write_text(text)
    fmu = exported(tmp_path / "unit.toml")
    with Sized(fmu, (3, 2, 1)) as unit:
        assert unit["x0"] == [1.0, 2.0, 2.0]
        assert unit["u_max"] == [4.0, 4.0] and unit["u_min"] == [-1e15, -1e15]
        assert unit["A"] == [-1.0, 1.0, 0.0, 0.0, -3.0, 0.0, 0.0, 0.0, -3.0]
        assert unit["B"] == [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    with Sized(fmu, (1, 1, 1), exchange=True) as unit:
        assert (unit["x0"], unit["A"]) == ([1.0], [-1.0])
        nominal = (ctypes.c_double * 1)()
        unit.instance.getNominalsOfContinuousStates(nominal, 1)
        assert nominal[0] == 10.0


def test_what_was_set_before_stays_where_its_size_does(made: Callable[..., Fmu3]) -> None:
    """Other arrays have start values again, and a reset brings back all sizes."""
    with Sized(made("plant", (2, 1, 1))) as unit:
        unit["u_max"], unit["x0"], unit["relative_tolerance"] = 3.0, [1.0, 2.0], 1e-4
        unit.resize(3, 1, 1)
        assert (unit["u_max"], unit["relative_tolerance"], unit["x0"]) == ([3.0], [1e-4], [0.0] * 3)
        unit.resize(3, 1, 1)
        assert unit["u_max"] == [3.0]
        unit.start()
        unit.instance.doStep(0.0, 0.1)
        unit.instance.reset()
        assert list(unit.instance.getUInt64([0, 1, 2])) == [2, 1, 1]
        unit.sizes = {"n": 2, "m": 1, "p": 1}
        assert (unit["u_max"], unit["x0"]) == ([1e15], [0.0, 0.0])


@pytest.fixture
def refused(capfd: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What an instance logs as it refuses a call."""

    def call(what: Callable[[], object]) -> str:
        capfd.readouterr()
        with pytest.raises(FMICallException) as error:
            what()
        assert error.value.status == 3
        return "".join(capfd.readouterr())

    return call


def test_sizes_that_are_refused_leave_the_instance_as_it_was(made: Callable[..., Fmu3], refused: Callable[..., str]) -> None:
    """Beyond their limits, against each other, of no such variable, too many values: with names and numbers."""
    with Sized(made("law", (2, 1))) as unit:
        instance = unit.instance
        before = settable(unit)
        assert "fmi3SetUInt64 is not allowed while the instance is instantiated" in refused(lambda: instance.setUInt64([0], [3]))
        instance.enterConfigurationMode()
        for value in (0, 201, 2**63):
            error = refused(lambda value=value: instance.setUInt64([1, 0], [1, value]))
            assert f"`n` (value reference 0) = {value} must be within 1 … 200" in error
        assert "nValues = 1, but these variables have 2 values" in refused(lambda: instance.setUInt64([0, 1], [1]))
        assert "value reference 7" in refused(lambda: instance.setUInt64([7], [1]))
        assert "fmi3SetFloat64 is not allowed while the instance is in Configuration Mode" in refused(
            lambda: instance.setFloat64([unit.reference("r")], [0.0])
        )
        assert "fmi3GetFMUState is not allowed" in refused(lambda: instance.getFMUState())
        assert list(instance.getUInt64([0, 1])) == [2, 1]
        instance.setUInt64([1], [3])
        assert "n = 2, m = 3: B = 2 x 3: must have 1 … 200 rows, and no more columns than rows" in refused(
            lambda: instance.exitConfigurationMode()
        )
        instance.setUInt64([0, 1], [200, 200])
        assert "sizes must be smaller" in refused(lambda: instance.exitConfigurationMode())
        instance.setUInt64([0, 1], [2, 1])
        instance.exitConfigurationMode()
        assert settable(unit) == before
        assert "`n` (value reference 0) is of type UInt64" in refused(lambda: instance.getFloat64([0], 1))
        unit.start()
        assert "fmi3EnterConfigurationMode is not allowed" in refused(lambda: instance.enterConfigurationMode())
        assert "fmi3SetUInt64 is not allowed" in refused(lambda: instance.setUInt64([0], [3]))
        instance.doStep(0.0, 0.001)


def test_start_values_that_do_not_fit_are_refused_at_the_start(made: Callable[..., Fmu3], refused: Callable[..., str]) -> None:
    """As any are; a valid matrix is enough."""
    with Sized(made("law", (2, 1)), (3, 1)) as unit:
        unit["A_m"] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        unit.instance.enterInitializationMode(startTime=0.0)
        assert "A_m" in refused(lambda: unit.instance.exitInitializationMode())
        unit["A_m"] = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -1.0, -3.0, -3.0]
        unit.instance.exitInitializationMode()


def test_saved_states_belong_to_sizes(made: Callable[..., Fmu3], refused: Callable[..., str]) -> None:
    """Those of other sizes are refused, as bytes too; those of the same sizes go on in another instance with the same bits."""
    fmu = made("plant", (2, 1, 1))
    with Sized(fmu, (3, 2, 1)) as one, Sized(fmu, (3, 2, 1)) as same, Sized(fmu) as other:
        early = other.instance.getFMUState()
        for unit in (one, same, other):
            unit.fill(np.random.default_rng(NUMBER))
            unit.start()
        one.instance.doStep(0.0, 0.1)
        saved = one.instance.serializeFMUState(one.instance.getFMUState())
        one.instance.doStep(0.1, 0.1)
        same.instance.setFMUState(same.instance.deserializeFMUState(saved))
        same.instance.doStep(0.1, 0.1)
        assert one.all() == same.all()
        assert "bytes; a state of this FMU has" in refused(lambda: other.instance.deserializeFMUState(saved))
        other.instance.reset()
        other.resize(3, 2, 1)
        assert "this state has other sizes than the instance" in refused(lambda: other.instance.setFMUState(early))
        other.instance.setFMUState(other.instance.deserializeFMUState(saved))
        other.instance.doStep(0.1, 0.1)
        assert one.all() == other.all()


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("plant", '[names]\nx = ["position", "speed"]\n'),
        ("plant", '[structure.quantities]\nx = ["position", "speed"]\n'),
        ("plant", '[structure.units]\nx = ["m", "m/s"]\n'),
        ("law", '[names]\nadaptation_gain = "n"\n'),
        ("law", '[structure.units]\nx = ["m", "m/s"]\n'),
    ],
)
def test_values_of_single_elements_fix_the_sizes(kind: str, more: str, tmp_path: Path, refused: Callable[..., str]) -> None:
    """Names, units and quantities of a user's own; a size's name that is taken."""
    (tmp_path / "unit.toml").write_text(KINDS[kind][0](*KINDS[kind][1]) + more)
    fmu = exported(tmp_path / "unit.toml")
    assert fmu.named(causality="structuralParameter") == []
    with Unit3(fmu) as unit:
        assert "no structural parameters" in refused(lambda: unit.instance.enterConfigurationMode())
        assert "no variable of type UInt64" in refused(lambda: unit.instance.setUInt64([0], [1]))


def test_event_mode_goes_on_with_other_sizes(made: Callable[..., Fmu3]) -> None:
    """Inputs act on feedthrough outputs at the communication point."""
    with Sized(made("law", (2, 1)), (4, 2), event_mode=True) as unit:
        unit.start()
        unit.update()
        unit["u_max"] = [3.0, 3.0]
        unit.update()
        unit.instance.enterStepMode()
        unit.instance.doStep(0.0, 0.001)
        unit.instance.enterEventMode()
        unit["r"] = [1.0, -1.0]
        unit.update()
        assert len(unit["u"]) == 2


@pytest.mark.parametrize("kind", ["plant", "law"])
def test_calls_at_random_are_answered(kind: str, made: Callable[..., Fmu3], capfd: pytest.CaptureFixture[str]) -> None:
    """In any order, with sizes and values that may be none: no fault is reported, and the instance can be reset and used."""
    random = np.random.default_rng(NUMBER)
    with Sized(made(kind, KINDS[kind][1])) as unit:
        instance = unit.instance
        references = [v.valueReference for v in unit.fmu.about.modelVariables]
        states = []

        def save() -> None:
            states.append(instance.getFMUState())

        def some(count: int) -> list[int]:
            return [int(random.choice([*references, max(references) + 1, 2**32 - 1])) for _ in range(count)]

        calls = [
            instance.enterConfigurationMode,
            instance.exitConfigurationMode,
            lambda: instance.setUInt64([int(random.integers(3))], [int(random.choice([0, 1, 2, 3, 5, 201, 2**64 - 1]))]),
            lambda: instance.getUInt64(some(1)),
            lambda: instance.getFloat64(some(1), int(random.integers(10))),
            lambda: instance.setFloat64(some(1), list(random.standard_normal(random.integers(10)))),
            lambda: dependencies(unit, some(1)[0]),
            lambda: instance.enterInitializationMode(startTime=0.0),
            instance.exitInitializationMode,
            lambda: instance.doStep(0.0, 0.001),
            instance.reset,
            save,
            lambda: instance.setFMUState(states[random.integers(len(states))]) if states else None,
            lambda: instance.getDirectionalDerivative(some(1), some(1), [1.0] * random.integers(4), int(random.integers(4))),
        ]
        for _ in range(600):
            try:
                calls[random.integers(len(calls))]()
            except FMICallException as error:
                assert error.status in (2, 3)
        instance.reset()
        unit.resize(*KINDS[kind][2][0])
        unit.start()
    assert "internal fault" not in "".join(capfd.readouterr())
