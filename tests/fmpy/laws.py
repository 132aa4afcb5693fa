"""A law as C for a target, of a controller or an observer, over the inputs that it has in its loop."""

import ctypes
import re
import subprocess
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import fmpy
import numpy as np
import tomllib
from conftest import ROOT, adaptive_fmu, read_csv
from fmpy.model_description import ScalarVariable

WARNINGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror"]
SAME_BITS = ["-O2", "-ffp-contract=off"]


def table(heading: str) -> list[dict[str, str]]:
    """The rows of the table in docs/firmware.md or docs/source_units.md whose first column has this heading."""
    page = "\n".join((ROOT / "docs" / f"{name}.md").read_text() for name in ("firmware", "source_units"))
    found = re.search(rf"^\| {heading} \|.*\n(\|.*\n)+", page, re.MULTILINE)
    assert found, f"no page has a table of a {heading}"
    titles, _, *rows = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in found[0].splitlines()]
    return [dict(zip(titles, row, strict=True)) for row in rows]


def built(*command: str | Path) -> None:
    """Compiles, without a warning."""
    compiled = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert compiled.returncode == 0 and compiled.stderr == "", compiled.stderr


# Kinds that are no laws.
PLANTS = [
    "actuated-siso",
    "actuator",
    "coupled-mimo",
    "excitation",
    "mares-auv",
    "nonlinear-siso",
    "quadrotor",
    "reference",
    "sensor",
    "state-space",
    "twin-rotor",
    "two-link-robot",
    "unmatched-mimo",
]


def kind(name: str) -> str:
    """The kind of an FMU of this package."""
    return tomllib.loads((ROOT / "modelDescription" / f"{name}.toml").read_text())["model"]


@dataclass
class Laws:
    """Sources of units, and where files go."""

    folder: Path
    names: list[str]
    recorded: dict[tuple[str, str, int], np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.names:
            self.add(*self.names)

    def add(self, *names: str) -> None:
        """Exports the C sources of units."""
        exported = adaptive_fmu("export", "--source-only", *names, "--out", self.folder)
        assert exported.returncode == 0, exported.stderr
        for name in names:
            zipfile.ZipFile(self.folder / f"{name}.fmu").extractall(self.folder / name)

    def sources(self, name: str) -> Path:
        """The C files of a unit."""
        return self.folder / name / "sources"

    def variables(self, name: str, causality: str) -> list[ScalarVariable]:
        """Real inputs or outputs, in the order of the description, which is the law's."""
        variables = fmpy.read_model_description(str(self.folder / name)).modelVariables
        return [v for v in variables if v.causality == causality and v.type == "Real"]

    def inputs(self, name: str, loop: str, steps: int) -> np.ndarray:
        """What a unit reads in its loop, a row a step of its default experiment."""
        if (name, loop, steps) not in self.recorded:
            self.recorded[name, loop, steps] = self._record(name, loop, steps)
        return self.recorded[name, loop, steps]

    def _record(self, name: str, loop: str, steps: int) -> np.ndarray:
        period = float(fmpy.read_model_description(str(self.folder / name)).defaultExperiment.stepSize)
        out = self.folder / f"loop of {name}"
        answer = adaptive_fmu("run", loop, "--step", str(period), "--until", str(steps * period), "--out", out)
        # 3: a peak beyond its limit, as the beginning of a run may have.
        assert answer.returncode in (0, 3), answer.stderr
        read = [v for v in self.variables(name, "input") if not v.name.startswith("u_manual")]
        inputs = given_in(loop, name, read_csv(next(out.rglob("result.csv"))), read)
        # The controller is stepped last: with what the others have where its step ends.
        assert len(inputs) == steps + 1
        return inputs[1:]

    def firmware(self, name: str, steps: int, *options: str) -> Path:
        """A law for a target, with so many Runge-Kutta steps in a period: the folder of its files."""
        folder = self.folder / f"{name} {steps} {' '.join(options)}"
        if not folder.exists():
            described = self.folder / f"{name}.toml"
            named = described if described.exists() else name
            exported = adaptive_fmu("export", "--firmware", named, "--substeps", str(steps), *options, "--out", folder)
            assert exported.returncode == 0, exported.stderr
        return folder

    def outputs(self, name: str, steps: int, inputs: np.ndarray, *defines: str) -> np.ndarray:
        """What a law, compiled for this machine, gives over rows of inputs, with so many substeps."""
        law = Law(self.firmware(name, steps), name, *defines)
        rows = []
        for row in inputs.tolist():
            status, given = law.step(row)
            assert status & 1 == 0, f"step {len(rows)}: {status:#x}"
            rows.append(given)
        return np.array(rows)


HARNESS = """
#include "NAME.h"
#include <string.h>
static NAME law;
unsigned law_size(void) { return (unsigned)sizeof law; }
void law_init(void) { NAME_init(&law); }
void law_reset(void) { NAME_reset(&law); }
void law_forget(void) { memset(&law, 0, sizeof law); }
void law_copy(void *to) { memcpy(to, &law, sizeof law); }
unsigned law_refused(void) { return law.refused; }
unsigned law_step(const NAME_inputs *in, NAME_outputs *out) { return NAME_step(&law, in, out); }
"""
CALIBRATION = """
void law_defaults(NAME_parameters *p) { *p = NAME_defaults; }
int law_calibrate(const NAME_parameters *p) { return (int)NAME_calibrate(&law, p); }
"""
BY_HAND = "int law_enable(int enabled, const NAME_manual *manual) { return NAME_enable(&law, enabled != 0, manual); }\n"


def hostile(inputs: np.ndarray) -> np.ndarray:
    """Inputs as no loop gives them: of any size and sign, at rest, and those of the loop with a fault in one."""
    rng = np.random.default_rng(50)
    rows = rng.choice([-1.0, 1.0], (300, inputs.shape[1])) * 10 ** rng.uniform(-9, 6, (300, inputs.shape[1]))
    faults = inputs[rng.integers(len(inputs), size=100)]
    faults[np.arange(100), rng.integers(inputs.shape[1], size=100)] *= 10 ** rng.uniform(-9, 9, 100)
    return np.concatenate([np.zeros((20, inputs.shape[1])), inputs[:20], faults, rows, np.zeros((20, inputs.shape[1]))])


class Law:
    """A law, compiled for this machine. Its structs are arrays of real numbers."""

    def __init__(self, folder: Path, name: str, *defines: str, further: str = "") -> None:
        self.header = (folder / f"{name}.h").read_text()
        self.real = ctypes.c_float if f"-D{name}_FLOAT" in defines else ctypes.c_double
        text = HARNESS + (CALIBRATION if f"{name}_calibrate(" in self.header else "")
        text = (text + (BY_HAND if f"{name}_enable(" in self.header else "") + further).replace("NAME", name)
        stem = f"harness{len(list(folder.glob('*.so')))}"
        (folder / f"{stem}.c").write_text(text)
        library = folder / f"{stem}.so"
        built("gcc", *WARNINGS, *SAME_BITS, "-fPIC", *defines, "-c", folder / f"{name}.c", "-o", folder / f"{stem}.o")
        # Nobody but these tests calls the functions of the harness.
        flags = ["-std=c99", "-O2", "-fPIC", "-shared", *defines]
        built("gcc", *flags, folder / f"{stem}.c", folder / f"{stem}.o", "-lm", "-o", library)
        self.c = ctypes.CDLL(str(library))
        self.period = float(re.search(rf"#define {name}_PERIOD (\S+)", self.header)[1])
        kinds = ("inputs", "outputs", "manual", "parameters")
        self.members = {kind: self.members_of(self.header, name, kind) for kind in kinds}
        self.bits = {
            flag: 1 << int(bit) for flag, bit in re.findall(rf"#define {name}_(\w+) \(UINT32_C\(1\) << (\d+)\)", self.header)
        }
        self.c.law_init()

    @staticmethod
    def members_of(header: str, name: str, kind: str) -> dict[str, int]:
        """The members of a struct, and how many numbers each has."""
        body = re.search(rf"typedef struct {{\n([^}}]*)}} {name}_{kind};", header)
        found = re.findall(r"^    \w+ (\w+)(?:\[(\d+)\])?;", body[1], re.MULTILINE) if body else []
        return {member: int(size or 1) for member, size in found}

    def numbers(self, kind: str, values: list[float] | None = None) -> ctypes.Array:
        """A struct as an array."""
        size = sum(self.members[kind].values())
        return (self.real * size)(*(values or [0.0] * size))

    def places(self, kind: str) -> dict[str, int]:
        """Where each member of a struct begins in its array."""
        sizes = list(self.members[kind].values())
        return {member: sum(sizes[:k]) for k, member in enumerate(self.members[kind])}

    def defaults(self) -> ctypes.Array:
        """The parameters of the export."""
        values = self.numbers("parameters")
        self.c.law_defaults(values)
        return values

    def step(self, inputs: list[float]) -> tuple[int, list[float]]:
        """A step: its status, and the outputs."""
        out = self.numbers("outputs")
        return self.c.law_step(self.numbers("inputs", inputs), out), list(out)

    def state(self) -> bytes:
        """All that the law goes on with."""
        state = ctypes.create_string_buffer(self.c.law_size())
        self.c.law_copy(state)
        return state.raw


def given_in(loop: str, fmu: str, result: dict[str, np.ndarray], inputs: list[ScalarVariable]) -> np.ndarray:
    """What a loop's structure gives to a unit; an input that it doesn't connect stays at its start."""
    structure = (ROOT / "examples" / loop / "SystemStructure.ssd").read_text()
    unit = re.search(rf'<(?:\w+:)?Component name="(\w+)"[^>]*"[^">]*\b{fmu}\.fmu"', structure)
    assert unit, f"{loop} has no {fmu}"
    connection = rf'startElement="(\w+)" startConnector="([^"]+)" endElement="{unit[1]}" endConnector="([^"]+)"'
    sources = {end: f"{start}.{name}" for start, name, end in re.findall(connection, structure)}
    ones = np.ones_like(result["time"])
    return np.column_stack([result[sources[v.name]] if v.name in sources else float(v.start) * ones for v in inputs])
