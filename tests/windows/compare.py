"""Compares what the master recorded on two systems: compare.py LINUX WINDOWS."""

import sys
from pathlib import Path

linux, windows = ([[float(x) for x in line.split()] for line in Path(file).read_text().splitlines()] for file in sys.argv[1:])
if len(linux) != len(windows) or not linux:
    sys.exit(f"{len(linux)} points on Linux, {len(windows)} on Windows")
names = ["time", "x[1]", "x[2]", "u[1]"]
apart = [max(abs(a[k] - b[k]) for a, b in zip(linux, windows, strict=True)) for k in range(len(names))]
print(f"{len(linux)} points; largest differences:", ", ".join(f"{n} {d:.1e}" for n, d in zip(names, apart, strict=True)))
if max(apart) > 1e-9:
    sys.exit("more than 1e-9")
