"""Studies that tests and benches/ensembles make twice, on a device of OpenCL and on the processor."""

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
    "noise": ("3.3.1-case2-bench", ["plant.m1=±10%"], "max", ["--until", "0.2"]),
    "limits": ("3.3.2-case1-rotors", ["plant.g=±5%"], "max", ["--until", "1"]),
    "a fuzzy law": ("4-case1-fuzzy", ["plant.C[1,1]=±20%"], "max", ["--until", "0.1"]),
}


def studied(program: Path, name: str, out: Path) -> tuple[str, str, float, list[str]]:
    """The loop of a study, its metric and the limit of that, 1 % above what it is without variations, and the options of `verify`."""
    loop, vary, begin, options = STUDIES[name]
    answer = subprocess.run([program, "run", loop, *options, "--composite", "--json", "--out", out], capture_output=True, text=True, check=True)
    known = {metric["label"]: metric["value"] for metric in json.loads(answer.stdout)["metrics"]}
    label, limit = next((label, 1.01 * value) for label, value in known.items() if label.startswith(begin) and value)
    varied = [word for text in vary for word in ("--vary", text)]
    return loop, label, limit, [*varied, "--require", f"{label} <= {limit}", *options]
