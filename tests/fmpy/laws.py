"""The bare law of a controller or an observer (`law.c`), over the inputs that it has in its loop."""

import ctypes
import re
import subprocess
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import fmpy
import numpy as np
from conftest import ROOT, adaptive_fmu, read_csv
from fmpy.model_description import ScalarVariable

WARNINGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror"]
SAME_BITS = ["-O2", "-ffp-contract=off"]


def table(heading: str) -> list[dict[str, str]]:
    """The rows of the table in docs/source_units.md whose first column has this heading."""
    page = (ROOT / "docs" / "source_units.md").read_text()
    found = re.search(rf"^\| {heading} \|.*\n(\|.*\n)+", page, re.MULTILINE)
    assert found, f"docs/source_units.md has no table of a {heading}"
    titles, _, *rows = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in found[0].splitlines()]
    return [dict(zip(titles, row, strict=True)) for row in rows]


def built(*command: str | Path) -> None:
    """Compiles, without a warning."""
    compiled = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert compiled.returncode == 0 and compiled.stderr == "", compiled.stderr


@dataclass
class Laws:
    """Sources of units, and where files go."""

    folder: Path
    names: list[str]
    recorded: dict[tuple[str, str, int], np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        exported = adaptive_fmu("export", "--source-only", *self.names, "--out", self.folder)
        assert exported.returncode == 0, exported.stderr
        for name in self.names:
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
        inputs = given_in(loop, name, read_csv(next(out.rglob("result.csv"))), self.variables(name, "input"))
        # The controller is stepped last: with what the others have where its step ends.
        assert len(inputs) == steps + 1
        return inputs[1:]

    def outputs(self, name: str, steps: int, inputs: np.ndarray, *defines: str) -> np.ndarray:
        """What a law, compiled for this machine, gives over rows of inputs, with so many substeps."""
        folder, real = self.sources(name), ctypes.c_float if "-DUNIT_FLOAT" in defines else ctypes.c_double
        library = folder / f"law{steps}{''.join(defines)}.so"
        flags = [*WARNINGS, *SAME_BITS, "-fPIC", "-shared", f"-DUNIT_LAW_STEPS={steps}", *defines]
        built("gcc", *flags, folder / "law.c", "-lm", "-o", library)
        law = ctypes.CDLL(str(library))
        given, taken = (real * inputs.shape[1])(), (real * len(self.variables(name, "output")))()
        lengths = dict(re.findall(r"#define (UNIT_REALS|UNIT_INTEGERS) (\d+)", (folder / "unit.h").read_text()))
        state = ctypes.create_string_buffer(8 * (int(lengths["UNIT_REALS"]) + int(lengths["UNIT_INTEGERS"]) + 1))
        law.law_init(state)
        rows = []
        for row in inputs.tolist():
            given[:] = row
            assert law.law_step(state, given, taken) == 1, f"step {len(rows)}"
            rows.append(list(taken))
        return np.array(rows)


def given_in(loop: str, fmu: str, result: dict[str, np.ndarray], inputs: list[ScalarVariable]) -> np.ndarray:
    """What a loop's structure gives to a unit; an input that it doesn't connect stays at its start."""
    structure = (ROOT / "examples" / loop / "SystemStructure.ssd").read_text()
    unit = re.search(rf'<(?:\w+:)?Component name="(\w+)"[^>]*"[^">]*\b{fmu}\.fmu"', structure)
    assert unit, f"{loop} has no {fmu}"
    connection = rf'startElement="(\w+)" startConnector="([^"]+)" endElement="{unit[1]}" endConnector="([^"]+)"'
    sources = {end: f"{start}.{name}" for start, name, end in re.findall(connection, structure)}
    ones = np.ones_like(result["time"])
    return np.column_stack([result[sources[v.name]] if v.name in sources else float(v.start) * ones for v in inputs])
