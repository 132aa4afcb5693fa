"""Prints one table of what units and loops cost, against peers; see `benches/peers`."""

import argparse
import json
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

import compiled
import growth
import loops
import steps
import whole
from machine import Workshop
from table import Row, table


def measure(workshop: Workshop) -> list[Row]:
    """All rows."""
    parts = [
        steps.van_der_pol,
        loops.against_fmpy,
        lambda workshop: [loops.against_python(workshop)],
        whole.against_c,
        loops.compiled_equations,
        loops.closed_form,
        lambda workshop: [steps.all_loops(workshop)],
        steps.lifetimes,
        steps.exports,
        steps.growth,
        compiled.van_der_pol,
        compiled.controllers,
        compiled.composites,
        compiled.separate_units,
    ]
    rows = []
    for k, part in enumerate(parts):
        print(f"{k + 1} of {len(parts)}", file=sys.stderr)
        rows += part(workshop)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description="What units and loops cost, against peers.")
    parser.add_argument("--quick", action="store_true", help="every row once, loops cut short: to see that it runs")
    parser.add_argument("--json", action="store_true", help="for a script")
    parser.add_argument("--growth", type=Path, metavar="FILE.svg", help="how costs grow, in place of all that, as a plot")
    options = parser.parse_args()
    # FMPy prints what units log.
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(sys.stderr):
        workshop = Workshop(Path(folder), options.quick)
        if options.growth:
            series = growth.measure(workshop)
            options.growth.write_text(growth.plot(series))
        else:
            rows = measure(workshop)
    if options.growth:
        print(growth.table(series))
        return
    print(json.dumps([row.as_dict() for row in rows]) if options.json else table(rows))


main()
