"""The failure rate of all loops, and against each quantity that was varied: as a table, and as a picture."""

import math
from collections import Counter
from pathlib import Path

import loop
import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402
from matplotlib.ticker import NullLocator  # noqa: E402

PARTS = 5
# Of the normal distribution, for intervals that hold the true rate with a probability of 95 %.
Z = 1.96

Rows = dict[int, dict[str, str]]


def interval(failed: int, count: int) -> tuple[float, float]:
    """Wilson's interval about a rate."""
    if count == 0:
        return 0.0, 1.0
    rate, scale = failed / count, 1 + Z**2 / count
    centre, half = rate + Z**2 / (2 * count), Z * math.sqrt(rate * (1 - rate) / count + Z**2 / (4 * count**2))
    return max(0.0, (centre - half) / scale), min(1.0, (centre + half) / scale)


def parts(quantity: loop.Quantity, rows: list[dict[str, str]]) -> list[tuple[float, int, int]]:
    """Value in the middle, failures and loops of each part of a quantity's range; all parts are equally probable."""
    count = len(quantity.choices) or PARTS
    edges = [quantity.at(i / count) for i in range(1, count)]
    found: list[list[bool]] = [[] for _ in range(count)]
    for row in rows:
        found[sum(float(row[quantity.name]) >= edge for edge in edges)].append(row["outcome"] != loop.HELD)
    return [(quantity.at((i + 0.5) / count), sum(failed), len(failed)) for i, failed in enumerate(found)]


def percent(failed: int, count: int) -> str:
    low, high = interval(failed, count)
    return f"{100 * failed / count:.1f} % ({100 * low:.1f} … {100 * high:.1f})" if count else "-"


def short(value: float) -> str:
    return f"{value:.0f}" if 10 <= value < 1000 else f"{value:.2g}".replace("e+0", "e")


def table(rows: Rows, known: list[dict[str, str]]) -> str:
    """All of it as text; loops that ended with an exception tell nothing about the control."""
    counts = Counter(row["outcome"] for row in rows.values())
    failed = sum(row["outcome"] != loop.HELD for row in known)
    lines = [f"failed: {failed} of {len(known)}, {percent(failed, len(known))}"]
    lines += [f"  {outcome}: {count}" for outcome, count in counts.most_common()]
    lines += ["", f"{'about':>26}  {'failed':>6} of loops, with 95 % interval"]
    for quantity in loop.QUANTITIES:
        lines.append(f"{quantity.name} ({quantity.unit})")
        for value, bad, count in parts(quantity, known):
            lines.append(f"{value:26.3g}  {bad:6} of {count:<6} {percent(bad, count)}")
    return "\n".join(lines)


def picture(known: list[dict[str, str]], file: Path) -> None:
    """The failure rate against each quantity, with its interval, as PNG and SVG."""
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "robustness", "font.size": 8})
    shown, axes = plt.subplots(3, 4, figsize=(9, 6), sharey=True, layout="constrained")
    total = sum(row["outcome"] != loop.HELD for row in known) / len(known)
    for quantity, panel in zip(loop.QUANTITIES, axes.flat, strict=False):
        values, failed, counts = zip(*parts(quantity, known), strict=True)
        rates = [bad / count if count else math.nan for bad, count in zip(failed, counts, strict=True)]
        low, high = zip(*map(interval, failed, counts), strict=True)
        below = [rate - end for rate, end in zip(rates, low, strict=True)]
        above = [end - rate for rate, end in zip(rates, high, strict=True)]
        panel.axhline(total, color="0.7", linewidth=0.8)
        panel.errorbar(values, rates, (below, above), fmt="o-", markersize=3, linewidth=1, capsize=2)
        panel.set_xlabel(f"{quantity.name} ({quantity.unit})")
        if quantity.logarithmic:
            panel.set_xscale("log")
        panel.set_xticks(values, map(short, values))
        panel.xaxis.set_minor_locator(NullLocator())
    for panel in list(axes.flat)[len(loop.QUANTITIES) :]:
        panel.axis("off")
    # One axis for all panels.
    axes.flat[0].set_ylim(bottom=0)
    shown.supylabel(f"failure rate of {len(known)} loops, with 95 % intervals")
    shown.savefig(file.with_suffix(".svg"), metadata={"Date": None})
    shown.savefig(file.with_suffix(".png"), dpi=150)
    plt.close(shown)


def show(rows: Rows, folder: Path) -> str:
    """Writes `summary.txt` and `failure_rate`, as .svg and .png, and gives the table back."""
    known = [row for row in rows.values() if row["outcome"] != loop.EXCEPTION]
    text = table(rows, known)
    (folder / "summary.txt").write_text(text + "\n")
    if known:
        picture(known, folder / "failure_rate")
    return text
