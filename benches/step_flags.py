"""Do controllers report where a loop of separate FMUs deviates from the loop as a single FMU? Draws variations of loops and
runs them both ways.

    target/venv/bin/python benches/step_flags.py FMUS --seeds 0,1,2,3 6.5.2-l1 6.5.2-neuro

FMUS is the folder of an export. Seed 0 is a loop as it is. docs/step_size.md shows what this prints. Where a flagged loop
deviates by more than 5 %, its step is halved until it doesn't, and compared with the step that the warning names.
"""

import argparse
import csv
import json
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target" / "release" / "adaptive-fmu"
PLANTS = {
    "NonlinearSiso": "a1|a2|omega",
    "TwoLinkRobot": "m1|l1|I_z1|k1|m2|l2|I_z2|k2",
    "Quadrotor": r"m|inertia\[.*|input_gain.*|uncertainty_coefficient.*|disturbance_gain.*",
    "MaresAuv": "m|z_g|linear_damping.*|axial_drag|cross_flow_drag",
    "UnmatchedMimo": r"omega\[(1,1|2,2)\]|A_Delta.*|k\[.*",
    "TwinRotor": "I1|I2|M_g|b1|b2|k1|k2",
    "ActuatedSiso": r"coefficient\[.*|coefficient_mean.*|coefficient_amplitude.*|actuator_rate",
    "CoupledMimo": r"A\[.*|B\[.*|theta_factor.*|d_mean.*|d_sine.*|coefficient\[.*|nonaffine_coefficient.*",
}
ADAPTATION = "adaptation_gain|network_gain|gamma_1|gamma_2|Gamma_l"
GAINS = (
    "feedback_gain|pole_real|position_gain|velocity_gain|k|n_f|eta_Ga|eta_Gb|sigma|lambda|rho_inf|decay_rate|beta|upsilon"
    "|alpha_bar|K_epsilon|switching_width"
)
# Where the default method takes long as one unit.
STIFF = re.compile(r"4-.*|6\.5\..-mrac|3\.3\.2.*|3\.3\.3|3\.4\.2|7\.5\.3.*")
SSP, SSV = (f"{{http://ssp-standard.org/SSP1/SystemStructure{kind}}}" for kind in ("Description", "ParameterValues"))


def starts(loop: str) -> dict[str, tuple[str, dict[str, float]]]:
    """Each unit of a loop: its FMU, and the parameters that it starts with."""
    folder, found = ROOT / "examples" / loop, {}
    for component in ET.parse(folder / "SystemStructure.ssd").iter(f"{SSP}Component"):
        model = Path(component.get("source")).stem
        variables = ET.parse(ROOT / "modelDescription" / f"{model}.xml").iter("ScalarVariable")
        parameters = (v for v in variables if v.get("causality") == "parameter" and v.find("Real") is not None)
        values = {v.get("name"): float(v.find("Real").get("start")) for v in parameters}
        for binding in component.iter(f"{SSP}ParameterBinding"):
            for parameter in ET.parse(folder / binding.get("source")).iter(f"{SSV}Parameter"):
                real = parameter.find(f"{SSV}Real")
                if real is not None:
                    values[parameter.get("name")] = float(real.get("value"))
        found[component.get("name")] = model, values
    return found


def drawn(loop: str, seed: int) -> dict[str, float]:
    """What a variation changes."""
    if seed == 0:
        return {}
    random, common, changed = Random(f"{loop} {seed}"), {}, {}
    for unit, (model, values) in starts(loop).items():
        for name, value in values.items():
            base = name.split("[")[0]
            if value == 0 or unit not in ("plant", "controller", "observer"):
                continue
            if model in PLANTS and re.fullmatch(PLANTS[model], name):
                factor = random.uniform(0.7, 1.3)
            elif unit != "plant" and re.fullmatch(ADAPTATION, base):
                factor = common.setdefault((unit, "adaptation"), 10 ** random.uniform(-1, 1))
            elif unit == "controller" and re.fullmatch(GAINS, base):
                factor = common.setdefault((unit, base), random.uniform(0.7, 1.3))
            else:
                continue
            changed[f"{unit}.{name}"] = value * factor
    return changed


NAMED = re.compile(r"Try (\S+) s or less")


def run(loop: str, changed: dict[str, float], *options: str) -> tuple[dict[str, np.ndarray], float] | str:
    """The recorded columns of a run and the step that a warning names, 0 without; or why it ended."""
    with tempfile.TemporaryDirectory() as out:
        sets = [word for name, value in changed.items() for word in ("--set", f"{name}={value!r}")]
        words = [PROGRAM, "run", loop, "--json", "--out", out, *sets, *options]
        answer = subprocess.run(words, capture_output=True, text=True)
        if answer.returncode not in (0, 3):
            return answer.stderr.strip().splitlines()[-1]
        with (Path(json.loads(answer.stdout)["results"]) / "result.csv").open() as file:
            names, *rows = csv.reader(file)
    named = [float(found[1]) for text in json.loads(answer.stdout)["warnings"] if (found := NAMED.search(text))]
    return dict(zip(names, np.array(rows, float).T, strict=True)), max(named, default=0.0)


def off(split: dict[str, np.ndarray], whole: dict[str, np.ndarray]) -> float:
    """The largest difference of rms and of peak of a control, relative."""
    names = [name for name in split if name.startswith("controller.u[") and np.abs(whole[name]).max() > 0]
    sizes = [lambda u: np.sqrt(np.mean(u**2)), lambda u: np.abs(u).max()]
    return max(abs(size(split[name]) / size(whole[name]) - 1) for name in names for size in sizes)


def compared(loop: str, changed: dict[str, float], fmus: Path, *options: str) -> tuple[float, dict, float] | str:
    """The deviation of a loop of separate FMUs, what it recorded, and the step that it names; or why it ended."""
    stiff = ["--set", "integration_method=stiff"] if STIFF.fullmatch(loop) else []
    split = run(loop, changed, *options, "--fmus", str(fmus))
    whole = run(loop, changed, *options, "--composite", *stiff)
    if isinstance(split, str) or isinstance(whole, str):
        return split if isinstance(split, str) else str(whole)
    return off(split[0], whole[0]), *split


def step_at(limit: float, deviation: Callable[[float], float | None], step: float, part: float) -> float | None:
    """The step at which a loop deviates by this, where a longer one does by more: by halving and interpolation."""
    for _ in range(8):
        shorter = deviation(step / 2)
        if shorter is None:
            return None
        if shorter <= limit:
            return step / 2 * 2 ** (np.log(limit / shorter) / np.log(part / shorter))
        step, part = step / 2, shorter
    return None


def main() -> None:
    """Runs what was asked for, and counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fmus", type=Path)
    parser.add_argument("loops", nargs="+")
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--until", type=float)
    given = parser.parse_args()
    until = ["--until", str(given.until)] if given.until else []
    ratios: list[float | None] = []
    counts = {"more than 5 %": [0, 0], "1 to 5 %": [0, 0], "less than 1 %": [0, 0]}
    for loop in given.loops:
        for seed in map(int, given.seeds.split(",")):
            changed = drawn(loop, seed)
            found = compared(loop, changed, given.fmus, *until)
            if isinstance(found, str):
                print(f"{loop} {seed}: ended early: {found}", flush=True)
                continue
            part, columns, named = found
            flag = bool(columns["controller.step_too_long"].any())
            print(f"{loop} {seed}: {100 * part:.2f} % off, {'flagged' if flag else 'not flagged'}", flush=True)
            if flag and part > 0.05:

                def deviation(step: float, loop: str = loop, changed: dict = changed) -> float | None:
                    found = compared(loop, changed, given.fmus, *until, "--step", repr(step))
                    return None if isinstance(found, str) else found[0]

                right = step_at(0.05, deviation, float(columns["time"][1] - columns["time"][0]), part)
                ratios.append(named / right if right else None)
                print(f"    names {named:.1e} s, 5 % off at {right and f'{right:.1e} s'}", flush=True)
            row = counts["more than 5 %" if part > 0.05 else "1 to 5 %" if part >= 0.01 else "less than 1 %"]
            row[0] += 1
            row[1] += flag
    for name, (runs, flags) in counts.items():
        print(f"| {name} | {runs} | {flags} |")
    near = sum(ratio is not None and 1 / 3 <= ratio <= 3 for ratio in ratios)
    print(f"steps named within a factor of 3: {near} of {len(ratios)}")


if __name__ == "__main__":
    main()
