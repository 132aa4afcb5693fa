"""How many instructions does a step of each controller of the league take? Runs its loop with the controller as compiled C
under valgrind, which counts them: the same on every machine with the same compiler.

    target/venv/bin/python benches/instructions.py --results site/league [PLANT/CONTROLLER ...]

Needs valgrind and a C compiler. Gains are those that the league found. What it finds is written into the folder of
results, as instructions.json, which `league --page` shows; pairs that aren't named keep what is there.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LEAGUE = ROOT / "examples" / "league"
# Communication steps that are counted.
STEPS = 1000
NAMED = re.compile(r"\((\d+)\)(?: (.*))?")


class Failed(Exception):
    """A loop that can't run so."""


def values(folder: Path, found: dict[str, float]) -> Path:
    """A parameter set of a controller's values."""
    lines = [
        f'<ssv:Parameter name="{name}"><ssv:Real value="{value!r}"/></ssv:Parameter>' for name, value in found.items()
    ]
    namespace = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    file = folder / "gains.ssv"
    file.write_text(
        f'<ssv:ParameterSet xmlns:ssv="{namespace}" version="1.0" name="gains"><ssv:Parameters>{"".join(lines)}'
        "</ssv:Parameters></ssv:ParameterSet>"
    )
    return file


def called(profile: str, library: str) -> tuple[int, int]:
    """How often fmi2DoStep of a library was called, and the instructions of these calls."""
    names: dict[tuple[str, str], str] = {}
    times = total = 0
    at: dict[str, str] = {}
    lines = iter(profile.splitlines())
    for line in lines:
        key, _, rest = line.partition("=")
        if key in ("ob", "cob", "fn", "cfn"):
            number, name = NAMED.match(rest).groups()
            kind = key[-2:]
            at[key] = names.setdefault((kind, number), name or "")
            if key == "fn":
                at.pop("cob", None)
        elif key == "calls":
            inside = at.pop("cob", at.get("ob", ""))
            cost = int(next(lines).split()[1])
            if at.get("cfn", "").startswith("fmi2DoStep") and Path(inside).stem == library:
                times, total = times + int(rest.split()[0]), total + cost
    return times, total


def counted(program: Path, plant: dict, entry: dict, gains: dict[str, float], folder: Path) -> float:
    """Instructions of a communication step of a pair's controller."""

    def run_program(*words: object, before: tuple[object, ...] = ()) -> None:
        done = subprocess.run([str(word) for word in (*before, program, *words)], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise Failed(f"{' '.join(map(str, words))}: {done.stderr.strip()}")

    def unit(name: str) -> str:
        return str(LEAGUE / name) if (LEAGUE / name).is_file() else name

    own = entry.get("set", {}) | {name.removeprefix("controller."): value for name, value in gains.items()}
    run_program("export", unit(entry["unit"]), "--compile", "--values", values(folder, own), "--out", folder)
    (controller,) = folder.glob("*.fmu")
    units = [f"reference={unit(plant['reference'])}", f"plant={unit(plant['unit'])}", f"controller={controller}"]
    step = plant["step"]
    run_program("new", "loop", "--units", *units, "--step", step, "--until", STEPS * step, "--name", "counted", "--out", folder / "loop")
    profile = folder / "profile"
    valgrind = ("valgrind", "--tool=callgrind", f"--callgrind-out-file={profile}")
    settings = [word for name, value in plant.get("set", {}).items() for word in ("--set", f"{name}={value}")]
    run_program("run", folder / "loop", "--in-process", "--quiet", "--out", folder / "run", *settings, before=valgrind)
    times, total = called(profile.read_text(), controller.stem)
    if times != STEPS:
        raise Failed(f"{times} steps were counted, not {STEPS}")
    return total / times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", nargs="*", help="PLANT/CONTROLLER; all that have results without any")
    parser.add_argument("--results", type=Path, default=ROOT / "site" / "league")
    parser.add_argument("--program", type=Path, default=ROOT / "target" / "release" / "adaptive-fmu")
    asked = parser.parse_args()
    file = asked.results / "instructions.json"
    known = json.loads(file.read_text()) if file.is_file() else {}
    study = tomllib.loads((LEAGUE / "league.toml").read_text())
    for plant in study["plant"]:
        for entry in plant["controller"]:
            name = f"{plant['name']}/{entry['name']}"
            record = asked.results / f"{name}.json"
            if not record.is_file() or (asked.pairs and name not in asked.pairs):
                continue
            gains = json.loads(record.read_text())["gains"]["values"]
            known.pop(name, None)
            with tempfile.TemporaryDirectory() as folder:
                try:
                    known[name] = round(counted(asked.program, plant, entry, gains, Path(folder)))
                    print(f"{name}: {known[name]} instructions a step of {plant['step']} s", flush=True)
                except Failed as failed:
                    print(f"{name}: none: {failed}", file=sys.stderr, flush=True)
            file.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
