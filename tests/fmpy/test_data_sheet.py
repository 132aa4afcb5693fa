"""Data sheets of controllers for targets: Runge-Kutta steps that their modes ask for, operations, memory, delay margin."""

import json
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from random import Random

import numpy as np
import pytest
from conftest import adaptive_fmu
from laws import Law, Laws, built, hostile, table
from sample import NUMBER
from test_firmware import LAWS, substeps
from test_source_tools import COUNTED_BY, tool
from test_source_tools import findings as source_findings


@pytest.fixture(scope="module")
def laws(tmp_path_factory: pytest.TempPathFactory) -> Laws:
    return Laws(tmp_path_factory.mktemp("sheets"), [])


def sheet(folder: Path, name: str) -> str:
    return (folder / f"{name}_data_sheet.md").read_text()


def cells(text: str, row: str) -> list[str]:
    found = re.search(rf"^\| {re.escape(row)} \|(.*)\|$", text, re.MULTILINE)
    assert found, (row, text)
    return [cell.strip() for cell in found[1].split("|")]


def row_of(text: str, row: str) -> np.ndarray:
    """Operations of a row; zeros where there is none."""
    return np.array([int(cell) for cell in cells(text, row)[1:]] if f"| {row} |" in text else [0, 0, 0])


def least(folder: Path, name: str) -> int:
    found = re.search(rf"#define {name}_LEAST_SUBSTEPS (\d+)", (folder / f"{name}.h").read_text())
    return int(found[1]) if found else 1


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """A controller of a plant that no example has, by chance, and its period."""
    folder, random = tmp_path_factory.mktemp("own"), Random(NUMBER)
    w, d = random.uniform(0.5, 5), random.uniform(0.1, 1.2)
    plant = {"A": [[0.0, 1.0], [-(w**2), -2 * d * w]], "B": [[0.0], [w**2]], "C": [[1.0, 0.0]]}
    (folder / "plant.json").write_text(json.dumps(plant))
    kind_of_law, bandwidth = random.choice(["l1", "pid", "ladrc"]), str(round(random.uniform(1, 6), 2))
    made = adaptive_fmu("new", kind_of_law, "--name", "Own", "--plant", folder / "plant.json", "--bandwidth", bandwidth, "--out", folder / "Own.toml")
    assert made.returncode == 0, made.stderr
    return folder / "Own.toml", 0.05


def test_fewer_steps_than_the_fastest_mode_asks_for_are_refused(own, tmp_path: Path) -> None:
    """By eigenvalues that numpy finds, and the stability function of the method."""
    file, period = own
    exported = adaptive_fmu("export", file, "--out", tmp_path)
    assert exported.returncode == 0, exported.stderr
    linear = adaptive_fmu("linearise", tmp_path / "Own.fmu", "--json")
    assert linear.returncode == 0, linear.stderr
    values = np.linalg.eigvals(np.array(json.loads(linear.stdout)["A"]))
    values = values[values.real < -1e-9 * abs(values).max()]

    def decays(steps: int) -> bool:
        z = values * period / steps
        return bool(np.all(abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) <= 1 + 1e-9))

    expected = next(n for n in range(1, 10001) if decays(n))

    def export(steps: int) -> subprocess.CompletedProcess:
        return adaptive_fmu("export", "--firmware", file, "--period", str(period), "--substeps", str(steps), "--out", tmp_path)

    done = export(10000)
    assert done.returncode == 0, done.stderr
    # At the start and after one step the same but for what has moved.
    found = least(tmp_path, "Own")
    assert found == pytest.approx(expected, rel=0.02, abs=1)
    assert export(found).returncode == 0
    if found == 1:
        return
    refused = export(found - 1)
    assert refused.returncode == 1 and f"substeps = {found - 1}: must be at least {found}" in refused.stderr, refused.stderr
    # Nor can the number be made smaller afterwards.
    for steps, passes in ((found, True), (found - 1, False)):
        compiled = subprocess.run(
            ["gcc", f"-DOwn_SUBSTEPS={steps}", "-c", tmp_path / "Own.c", "-o", tmp_path / "own.o"], capture_output=True, text=True, check=False
        )
        assert (compiled.returncode == 0) == passes, compiled.stderr
    assert "Own_SUBSTEPS is too small" in compiled.stderr


def test_the_longest_period_is_one_with_which_the_fastest_mode_decays(own, tmp_path: Path) -> None:
    file, period = own

    def export(period: float) -> subprocess.CompletedProcess:
        return adaptive_fmu("export", "--firmware", file, "--period", repr(period), "--substeps", "64", "--out", tmp_path)

    first = export(period / 100)
    assert first.returncode == 0, first.stderr
    longest = float(cells(sheet(tmp_path, "Own"), "longest period with these steps")[0].removesuffix(" s"))
    assert export(0.98 * longest).returncode == 0
    assert "must be at least" in export(1.02 * longest).stderr


@pytest.mark.parametrize("name", LAWS)
def test_a_controller_takes_the_bytes_of_its_sheet(name: str, laws: Laws) -> None:
    folder = laws.firmware(name, substeps(name))
    documented = [int(number) for number in re.search(r"takes (\d+) bytes in double and (\d+) in float", sheet(folder, name)).groups()]
    assert documented == [Law(folder, name, *defines).c.law_size() for defines in ([], [f"-D{name}_FLOAT"])]
    # Of what it doesn't integrate nothing is told.
    assert sheet(folder, name).count("Runge-Kutta step") == (2 if f"{name}_states x;" in (folder / f"{name}.h").read_text() else 0)


COUNTING = """
#ifndef COUNTING_H
#define COUNTING_H
#include <cmath>
#include <cstring>
struct Counts { unsigned long simple, divisions, functions; };
extern Counts counts;
/* A number that counts what is done with it. */
struct Number {
    double value;
    Number() = default;
    Number(double v) : value(v) {}
    explicit operator int() const { return (int)value; }
    explicit operator double() const { return value; }
};
#define SIMPLE(op) \\
    inline Number operator op(Number a, Number b) { counts.simple++; return a.value op b.value; }
#define COMPARISON(op) \\
    inline bool operator op(Number a, Number b) { counts.simple++; return a.value op b.value; }
SIMPLE(+) SIMPLE(-) SIMPLE(*)
COMPARISON(<) COMPARISON(<=) COMPARISON(>) COMPARISON(>=) COMPARISON(==) COMPARISON(!=)
inline Number operator/(Number a, Number b) { counts.divisions++; return a.value / b.value; }
inline Number operator-(Number a) { return -a.value; }
inline Number &operator+=(Number &a, Number b) { return a = a + b; }
inline Number &operator-=(Number &a, Number b) { return a = a - b; }
inline Number &operator*=(Number &a, Number b) { return a = a * b; }
inline bool isfinite(Number a) { counts.simple++; return std::isfinite(a.value); }
inline Number fabs(Number a) { counts.simple++; return std::fabs(a.value); }
inline Number sqrt(Number a) { counts.divisions++; return std::sqrt(a.value); }
#define FUNCTION(name) inline Number name(Number a) { counts.functions++; return std::name(a.value); }
FUNCTION(sin) FUNCTION(cos) FUNCTION(tan) FUNCTION(sinh) FUNCTION(cosh) FUNCTION(tanh) FUNCTION(exp) FUNCTION(log) FUNCTION(log1p)
FUNCTION(atan) FUNCTION(floor) FUNCTION(round)
inline Number fmod(Number a, Number b) { counts.functions++; return std::fmod(a.value, b.value); }
inline Number copysign(Number a, Number b) { counts.simple++; return std::copysign(a.value, b.value); }
inline Number pow(Number a, Number b) { counts.functions++; return std::pow(a.value, b.value); }
#endif
"""
COUNTED = """
#include <stdio.h>
#include "NAME.h"
Counts counts;
extern const double inputs[][INPUTS];
int main()
{
    static NAME law;
    NAME_inputs in;
    NAME_outputs out;
    NAME_init(&law);
    for (int step = 0; step < STEPS; step++) {
        memcpy(&in, inputs[step], sizeof inputs[step]);
        counts = Counts();
        if ((NAME_step(&law, &in, &out) & NAME_REFUSED) && step < VECTORS) {
            return 1;
        }
        printf("%lu %lu %lu\\n", counts.simple, counts.divisions, counts.functions);
    }
    return 0;
}
"""


@pytest.mark.skipif(not shutil.which("g++"), reason="there is no compiler of C++ that counts operations")
@pytest.mark.parametrize("name", LAWS)
def test_no_step_takes_more_operations_than_in_the_sheet(name: str, laws: Laws, tmp_path: Path) -> None:
    """Counted by numbers of a type of their own, over the inputs of the vectors and such as no loop has, which may be refused."""
    folder = laws.firmware(name, substeps(name))
    replay = (folder / f"{name}_replay.c").read_text()
    rows = re.search(r"double replayed_inputs\[(\d+)\]\[(\d+)\] = (\{\n.*?\n\});", replay, re.DOTALL)
    if not rows or re.search(rf"(bool|int32_t) \w+;[^}}]*}} {name}_inputs;", (folder / f"{name}.h").read_text()):
        pytest.skip("its inputs aren't real numbers only")
    (tmp_path / "counting.h").write_text(COUNTING)
    header = (folder / f"{name}.h").read_text().replace('extern "C" {', 'extern "C++" {')
    header = header.replace(f"typedef double {name}_real;", f'#include "counting.h"\ntypedef Number {name}_real;')
    (tmp_path / f"{name}.h").write_text(header)
    shutil.copy(folder / f"{name}.c", tmp_path)
    vectors = np.array(re.findall(r"-?\d[\d.]*(?:e[-+]?\d+)?", rows[3]), dtype=float).reshape(-1, int(rows[2]))
    all_rows = np.concatenate([vectors, hostile(vectors)])
    array = ",\n".join("{" + ", ".join(value.hex() for value in row) + "}" for row in all_rows.tolist())
    inputs = f"extern const double inputs[][{rows[2]}];\nconst double inputs[][{rows[2]}] = {{{array}}};\n"
    main = COUNTED.replace("NAME", name).replace("INPUTS", rows[2]).replace("STEPS", str(len(all_rows))).replace("VECTORS", rows[1])
    (tmp_path / "main.cpp").write_text(inputs + main)
    built("g++", "-w", "-O1", "-x", "c++", f"-I{tmp_path}", tmp_path / "main.cpp", tmp_path / f"{name}.c", "-o", tmp_path / "count")
    run = subprocess.run([tmp_path / "count"], capture_output=True, text=True, check=True, timeout=120)
    # The start is a row of its own.
    found = np.array([[int(word) for word in line.split()] for line in run.stdout.splitlines()])
    documented = np.array([int(cell) for cell in cells(sheet(folder, name), "**a step**")[1:]])
    assert np.all(found[1 : len(vectors)] <= documented), (found, documented)
    # Inputs that no loop has may bring events.
    of_events = ("an event, as a hand-over", "sides of indicators", "outputs", "what the steps below don't change")
    with_events = documented + 8 * sum(row_of(sheet(folder, name), row) for row in of_events)
    assert np.all(found[1:] <= with_events), (found, documented)
    # And not many times as many: branches that aren't taken count.
    assert documented.sum() <= 3 * found[1:].sum(axis=1).max(), (found, documented)


def test_a_sheet_has_the_delay_margin_of_the_design_report(laws: Laws) -> None:
    name = Random(NUMBER).choice(["L1TwoLinkRobot", "L1SampledTwoLinkRobot", "PidNonlinearSiso"])
    output = json.loads(adaptive_fmu("check", name, "--json").stdout)
    margins = [finding["value"] for finding in findings(output) if finding["name"] == "delay margin"]
    text = sheet(laws.firmware(name, substeps(name)), name).split("## Delay margin")[1].split("## ")[0]
    assert len(re.findall("^- ", text, re.MULTILINE)) == len(margins)
    for margin in margins:
        numbers = [float(number) for number in re.findall(r"^- ([\d.e-]+) s", text, re.MULTILINE)]
        assert not isinstance(margin, float) or any(number == pytest.approx(margin, rel=1e-5) for number in numbers), (margin, text)


def findings(output: object) -> list[dict]:
    """All findings of a report, wherever they stand."""
    if isinstance(output, dict):
        if {"name", "value", "verdict"} <= output.keys():
            return [output]
        return [one for each in output.values() for one in findings(each)]
    return [one for each in output for one in findings(each)] if isinstance(output, list) else []




@pytest.mark.slow
def test_misra_counts_are_not_above_those_of_the_page(laws: Laws) -> None:
    version = subprocess.run([tool("cppcheck"), "--version"], capture_output=True, text=True, check=True).stdout.strip()
    if not (version == COUNTED_BY or version.startswith(f"{COUNTED_BY}.")):
        pytest.skip(f"{version} is installed, and the page's counts are those of {COUNTED_BY}")
    known = {tuple(row["rule"].split(", ")): int(row["places"]) for row in table("rule")}
    files = [laws.firmware(name, 1) / f"{name}.c" for name in ("PidNonlinearSiso", "L1SampledTwoLinkRobot")]
    counts = Counter(found[3].removeprefix("misra-c2012-") for file in files for found in source_findings(file, "--addon=misra"))
    assert set(counts) <= {rule for rules in known for rule in rules}
    for rules, most in known.items():
        found = sum(counts[rule] for rule in rules)
        assert found <= most, (rules, found, most)
