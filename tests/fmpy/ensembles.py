"""Studies that tests and benches/ensembles make twice, on a device of OpenCL and on the processor."""

import csv
import json
import subprocess
from pathlib import Path

# A loop, what varies, the metric of the requirement, and further options: noise that is sampled, limits, and an event among them.
STUDIES = {
    "plain": ("3.2.1-cosine", ["plant.omega=±30%", "adaptation_gain=1e4..1e5/log"], "max |u|", ["--until", "2"]),
    "an event": (
        "3.2.1-cosine",
        ["plant.omega=±30%", "event[1].time=0.2..0.8"],
        "max |u|",
        ["--until", "1", "--event", "0.5: reference.offset[1]=0.5"],
    ),
    "noise": ("3.3.1-case2-bench", ["plant.m1=±30%"], "max |u_2| that acts", ["--until", "0.3"]),
    "limits": ("3.3.2-case1-rotors", ["plant.g=±5%"], "max", ["--until", "1"]),
    "a fuzzy law": ("4-case1-fuzzy", ["plant.C[1,1]=±20%"], "rms e", ["--until", "0.2"]),
}


def studied(program: Path, name: str, out: Path) -> tuple[str, str, float, list[str]]:
    """The loop of a study, its metric and the limit of that, which about a fifth of the runs exceed, and the options of `verify`."""
    loop, vary, begin, options = STUDIES[name]

    def answer(*words: object) -> dict:
        command = [program, *words, "--json", "--out", out]
        return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    known = {metric["label"]: metric["value"] for metric in answer("run", loop, *options, "--composite")["metrics"]}
    label = next(label for label, value in known.items() if label.startswith(begin) and value)
    varied = [word for text in vary for word in ("--vary", text)]
    pilot = answer("verify", loop, *varied, "--require", f"{label} <= 0", *options, "--runs", "20", "--seed", "2", "--backend", "cpu")
    with open(Path(pilot["results"]) / "samples.csv", newline="") as file:
        limit = sorted(float(row[label]) for row in csv.DictReader(file))[15]
    return loop, label, limit, [*varied, "--require", f"{label} <= {limit}", *options]
