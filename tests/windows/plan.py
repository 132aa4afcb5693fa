"""Unpacks the three units of example 3.2.1, and writes what the master in loop.c is to do with them.

    plan.py FMUS FOLDER PLATFORM SUFFIX [Z:]

The last one stands before the paths of what runs under Wine.
"""

import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

# Inputs and outputs of each unit, in the order in which the master hands them on.
UNITS = {
    "ReferenceNonlinearSiso": ([], ["r[1]"]),
    "NonlinearSiso": (["u[1]"], ["x[1]", "x[2]"]),
    "L1NonlinearSiso": (["r[1]", "x[1]", "x[2]"], ["u[1]"]),
}


def main(fmus: str, folder: str, platform: str, suffix: str, drive: str = "") -> None:
    lines = []
    for name, signals in UNITS.items():
        place = Path(folder).resolve() / platform / name
        with zipfile.ZipFile(Path(fmus) / f"{name}.fmu") as archive:
            archive.extractall(place)
        root = ElementTree.parse(place / "modelDescription.xml").getroot()
        known = {v.get("name"): v.get("valueReference") for v in root.iter("ScalarVariable")}
        # The plant is told no location, as some masters do: its library finds its resources by its own path.
        resources = "" if name == "NonlinearSiso" else f"file:///{drive}{place}/resources"
        lines += [f"{drive}{place}/binaries/{platform}/{name}{suffix}", root.get("guid"), resources]
        lines += [" ".join([str(len(names)), *(known[name] for name in names)]) for names in signals]
    (Path(folder) / f"{platform}.txt").write_text("\n".join(lines) + "\n")


main(*sys.argv[1:])
