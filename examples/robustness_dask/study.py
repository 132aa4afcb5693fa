"""How robust is the L1 adaptive control of the two-link robot? Loops with random parameters, on as many machines as Dask has.

The same command continues an interrupted study, or adds further loops.
"""

import argparse
from pathlib import Path

import adaptive_fmu
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from dask.distributed import Client
from matplotlib.ticker import NullLocator

LOOP = "3.3.1-case2-bench"
# From 5 s on, the errors are averaged over a period of the references. The limit is twice the error with the design's parameters.
STOP, LARGEST_RMS = 14.0, 0.05
JOINTS = (1, 2)
# Name and unit, lowest and highest value, variables. Uniform; with True, uniform in the logarithm; a list has the possible values.
QUANTITIES = [
    ("m1 (kg)", 2.56, 3.84, False, ["plant.m1"]),
    ("m2 (kg)", 1.6, 2.8, False, ["plant.m2"]),
    ("l2 (m)", 0.36, 0.44, False, ["plant.l2"]),
    ("friction (N m s/rad)", 0.2, 5.0, True, ["plant.k1", "plant.k2"]),
    ("torque_limit (N m)", 80.0, 150.0, False, [f"{unit}.u_max[{i}]" for unit in ("controller", "actuator") for i in JOINTS]),
    ("drive_lag (s)", 1e-3, 1e-2, True, [f"actuator.time_constant[{i}]" for i in JOINTS]),
    ("sensor_delay (s)", 0.0, 2e-3, [0.0, 1e-3, 2e-3], [f"sensor.delay[{i}]" for i in range(1, 5)]),
    ("rate_noise (rad/s)", 1e-3, 1e-1, True, ["sensor.noise_deviation[3]", "sensor.noise_deviation[4]"]),
    ("adaptation_gain (1)", 1e4, 3e5, True, ["controller.adaptation_gain"]),
    ("feedback_gain (1/s)", 15.0, 45.0, False, [f"controller.feedback_gain[{i},{i}]" for i in JOINTS]),
    ("step (s)", 1e-3, 5e-3, [1e-3, 2e-3, 5e-3], []),
]


def value(part: float, low: float, high: float, how: bool | list[float]) -> float:
    """Value of a quantity below which this part of all samples is."""
    if isinstance(how, list):
        return how[min(int(part * len(how)), len(how) - 1)]
    return low * (high / low) ** part if how else low + (high - low) * part


def sample(seed: int, k: int) -> dict[str, float]:
    """Quantities of loop `k`, and the seed of its noise: independent of all other loops."""
    draw = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(k,)))).random
    return {name: value(draw(), *how) for name, *how, _ in QUANTITIES} | {"noise_seed": int(draw() * 2**31)}


def points(samples: pd.DataFrame) -> pd.DataFrame:
    """Values of the loop's variables."""
    values = {variable: samples[name] for name, *_, variables in QUANTITIES for variable in variables}
    lowest = {name.replace("max", "min"): -of for name, of in values.items() if "u_max" in name}
    return pd.DataFrame({**values, **lowest, "sensor.seed": samples["noise_seed"]})


def study(loops: int, seed: int, executor: object, out: Path | None = None) -> pd.DataFrame:
    """Run the loops: their samples, metrics, and whether each failed."""
    samples, found = pd.DataFrame([sample(seed, k) for k in range(loops)]), []
    for step, of in samples.groupby("step (s)"):
        where = None if out is None else out / f"step_{step}"
        swept = adaptive_fmu.Loop(LOOP).sweep(points(of), executor=executor, step=step, until=STOP, out=where)
        found.append(of.join(swept.data.set_index(of.index)[["ended", "message", *(f"rms e_{i}, t >= 5 s" for i in JOINTS)]]))
    table = pd.concat(found).sort_index()
    # A missing error is that of a run that failed before.
    errors = table[[f"rms e_{i}, t >= 5 s" for i in JOINTS]]
    return table.assign(failed=(table["ended"] != "complete") | ~(errors <= LARGEST_RMS).all(axis=1))


def interval(failed: int, count: int) -> tuple[float, float]:
    """Wilson's interval, which contains the true rate with a probability of 95 %."""
    z, rate = 1.96, failed / count
    centre, half = rate + z**2 / (2 * count), z * np.sqrt(rate * (1 - rate) / count + z**2 / (4 * count**2))
    return max(0.0, (centre - half) / (1 + z**2 / count)), min(1.0, (centre + half) / (1 + z**2 / count))


def rates(table: pd.DataFrame) -> pd.DataFrame:
    """Failure rate in each part of a quantity's range; all parts are equally probable."""
    rows = []
    for name, *how, _ in QUANTITIES:
        count = len(how[2]) if isinstance(how[2], list) else 5
        part = np.searchsorted([value(i / count, *how) for i in range(1, count)], table[name], side="right")
        for i, of in table["failed"].groupby(part):
            rows.append((name, value((i + 0.5) / count, *how), of.sum(), len(of), *interval(of.sum(), len(of))))
    return pd.DataFrame(rows, columns=["quantity", "about", "failed", "loops", "low", "high"])


def picture(parts: pd.DataFrame, total: float, loops: int, file: Path) -> None:
    """Failure rate against each quantity, with its interval."""
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "robustness", "font.size": 8})
    shown, axes = plt.subplots(3, 4, figsize=(9, 6), sharey=True, layout="constrained")
    for (name, _, _, how, _), panel in zip(QUANTITIES, axes.flat, strict=False):
        of = parts[parts["quantity"] == name]
        rate = of["failed"] / of["loops"]
        panel.axhline(total, color="0.7", linewidth=0.8)
        panel.errorbar(of["about"], rate, (rate - of["low"], of["high"] - rate), fmt="o-", markersize=3, linewidth=1, capsize=2)
        panel.set(xlabel=name, xscale="log" if how is True else "linear")
        panel.set_xticks(of["about"], [f"{at:.0f}" if 10 <= at < 1000 else f"{at:.2g}".replace("e+0", "e") for at in of["about"]])
        panel.xaxis.set_minor_locator(NullLocator())
    axes.flat[-1].axis("off")
    axes.flat[0].set_ylim(bottom=0)
    shown.supylabel(f"failure rate of {loops} loops, with 95 % intervals")
    shown.savefig(file, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=1000, help="number of loops (1000)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask's scheduler, e.g. tcp://host:8786 (default: workers on this machine)")
    parser.add_argument("--out", type=Path, default=Path("results/robustness"), help="folder of results")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random numbers (1)")
    given = parser.parse_args()
    with Client(given.scheduler) if given.scheduler else Client(threads_per_worker=1, dashboard_address=":0") as client:
        table = study(given.loops, given.seed, client, given.out)
    table.to_csv(given.out / "results.csv", index_label="loop")
    parts, failed = rates(table), int(table["failed"].sum())
    low, high = interval(failed, len(table))
    text = f"failed: {failed} of {len(table)}, {failed / len(table):.1%} ({low:.1%} to {high:.1%})\n{parts.to_string(index=False)}\n"
    (given.out / "summary.txt").write_text(text)
    picture(parts, failed / len(table), len(table), given.out / "failure_rate.svg")
    print(text)


if __name__ == "__main__":
    main()
