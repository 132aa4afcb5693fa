"""Is every output of a whole loop as accurate as its tolerance says? Runs loops and variations against tight solutions.

    target/venv/bin/python benches/accuracy.py --seeds 0,1,2 3.3.1-case2 3.4.2

Seed 0 is a loop as it is. Each line tells the largest error of an output at the points of the run, relative to the
largest magnitude of that output, in units of the tolerance; and how far two tight solutions by different methods are
apart. Where that is more, the loop itself carries rounding errors so far. What it prints is behind docs/accuracy.md.
"""

import argparse
import time

import numpy as np
import step_flags

TOLERANCES = [1e-4, 1e-6, 1e-9]
# Tolerance and method of the solutions that are compared with, and with each other.
TIGHT = [("1e-11", "stiff"), ("3e-12", "stiff")]
PASSES = 10


def outputs(run: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What is judged: continuous outputs, not time, counters and flags."""
    return {name: values for name, values in run.items() if name != "time" and (values != np.round(values)).any()}


def apart(run: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> tuple[float, str]:
    """The largest difference of an output relative to its magnitude, and which one has it."""
    sizes = {name: np.abs(values).max() for name, values in outputs(other).items()}
    return max((np.abs(run[name] - other[name]).max() / size, name) for name, size in sizes.items() if size > 0)


def solved(loop: str, changed: dict[str, float], options: list[str], tolerance: str, method: str):  # noqa: ANN201
    """A run of the loop as one unit, and the seconds that it took."""
    chosen = ["--set", f"relative_tolerance={tolerance}", "--set", f"integration_method={method}"]
    start = time.perf_counter()
    found = step_flags.run(loop, changed, "--composite", *options, *chosen, "--set", "work_limit=1e12")
    return found if isinstance(found, str) else found[0], time.perf_counter() - start


def main() -> None:
    """Runs what was asked for, and counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("loops", nargs="+")
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--until", default="5")
    parser.add_argument("--step", default="0.01")
    parser.add_argument("--method", default="automatic")
    given = parser.parse_args()
    options = ["--until", given.until, "--step", given.step]
    counts = {tolerance: [0, 0, 0, 0.0] for tolerance in TOLERANCES}
    for loop in given.loops:
        for seed in map(int, given.seeds.split(",")):
            changed = step_flags.drawn(loop, seed)
            (tight, _), (tighter, _) = (solved(loop, changed, options, *how) for how in TIGHT)
            if isinstance(tight, str) or isinstance(tighter, str):
                print(f"{loop} {seed}: ended early: {tight if isinstance(tight, str) else tighter}", flush=True)
                continue
            known, _ = apart(tight, tighter)
            lines = []
            for tolerance in TOLERANCES:
                run, seconds = solved(loop, changed, options, f"{tolerance:e}", given.method)
                if isinstance(run, str):
                    lines.append(f"{tolerance:.0e}: {run}")
                    continue
                error, name = apart(run, tighter)
                row = counts[tolerance]
                row[0] += 1
                if error > PASSES * tolerance and error > PASSES * known:
                    row[1] += 1
                elif error > PASSES * tolerance:
                    row[2] += 1
                else:
                    row[3] = max(row[3], error / tolerance)
                lines.append(f"{tolerance:.0e}: {error / tolerance:.2g} ({name}, {seconds:.2f} s)")
            print(f"{loop} {seed}: {'; '.join(lines)}; tight solutions {known:.0e} apart", flush=True)
    print("| tolerance | runs | above ten times the tolerance | above it, as the loop carries rounding | largest of the rest |")
    for tolerance, (runs, above, carried, largest) in counts.items():
        print(f"| {tolerance:.0e} | {runs} | {above} | {carried} | {largest:.2g} |")


if __name__ == "__main__":
    main()
