"""How costs grow: with the number of states, of components of a loop, of points that are recorded, of instances."""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from machine import PROGRAM, Workshop, run_json
from steps import Driver, l1_text, plant_text

STATES = (4, 8, 16, 32, 60, 100, 200)
MOST_OF_L1 = 60  # The design of one of 100 states takes minutes, of 200 longer than anybody waits.
COMPONENTS = (3, 10, 30, 100, 300, 1000)
POINTS = (10_000, 100_000, 1_000_000, 10_000_000)
# Fewer take less memory than can be told from that of the process.
INSTANCES = (1_000, 3_000, 10_000)
ONE = "PlantOf4"


@dataclass
class Series:
    """A figure for each size: in µs, bytes or MB, as `figure` says."""

    panel: str
    figure: str
    name: str
    sizes: list[int]
    values: list[float]

    @property
    def exponent(self) -> float:
        """Slope in logarithms over the larger half."""
        half = len(self.sizes) // 2
        return float(np.polyfit(np.log(self.sizes[half:]), np.log(self.values[half:]), 1)[0])


def measure(workshop: Workshop) -> list[Series]:
    """All series."""
    few = slice(0, 3 if workshop.quick else None)
    sizes = list(STATES[few])
    of_l1 = [size for size in sizes if size <= MOST_OF_L1]
    plants = [by_states(workshop, l1_text, "L1Of{}", of_l1), by_states(workshop, plant_text, "PlantOf{}", sizes)]
    loops = [by_components(workshop, list(COMPONENTS[few]))]
    points = by_points(workshop, [size // 10 if workshop.quick else size for size in POINTS[few]])
    units = ("L1TwoLinkRobot", "NeuroPpfTwoLinkRobot")
    return plants + loops + points + [series for unit in units for series in by_instances(workshop, unit, INSTANCES[few])]


def by_states(workshop: Workshop, text: Callable[[int], str], name: str, sizes: list[int]) -> Series:
    """A step of 1 ms of an L1 controller, or of a plant whose matrix is full."""
    driver, values = Driver(workshop), []
    for n in sizes:
        file = workshop.folder / f"{name.format(n)}.toml"
        file.write_text(text(n))
        fmu, unit = driver.ours(workshop.export(file))
        outputs = [fmu.variables[output].valueReference for output in fmu.named(causality="output", type="Real")]
        inputs = {fmu.variables[fmu.named(causality="input")[0]].valueReference: 0.1}
        run = partial(driver.drive, unit, 1e-3, 100, workshop.long(200_000 // n), outputs, inputs)
        values.append(min(run().step for _ in range(workshop.repeats)) * 1e6)
    what = "L1 controller" if "L1" in name else "linear plant, full matrix"
    return Series("a step of 1 ms, by states", "µs", what, sizes, values)


def chain(workshop: Workshop, count: int) -> Path:
    """The structure of a loop of so many plants, each driven by the one before, the first by the last."""
    folder = workshop.folder / f"chain{count}"
    (folder / "resources").mkdir(parents=True, exist_ok=True)
    file = workshop.folder / f"{ONE}.toml"
    file.write_text(plant_text(4))
    (folder / "resources" / f"{ONE}.fmu").write_bytes(workshop.export(file).read_bytes())
    connector = '<ssd:Connector name="{}" kind="{}"><ssc:Real/></ssd:Connector>'.format
    ports = f"<ssd:Connectors>{connector('u[1]', 'input')}{connector('y[1]', 'output')}</ssd:Connectors>"
    kind = f'type="application/x-fmu-sharedlibrary" source="resources/{ONE}.fmu"'
    parts = (f'<ssd:Component name="part{k}" {kind}>{ports}</ssd:Component>' for k in range(count))
    ends = 'startElement="part{}" startConnector="y[1]" endElement="part{}" endConnector="u[1]"'.format
    wires = (f"<ssd:Connection {ends(k, (k + 1) % count)}/>" for k in range(count if count > 1 else 0))
    spaces = " ".join(
        f'xmlns:{short}="http://ssp-standard.org/SSP1/{long}"'
        for short, long in (("ssd", "SystemStructureDescription"), ("ssc", "SystemStructureCommon"))
    )
    (folder / "SystemStructure.ssd").write_text(
        f'<ssd:SystemStructureDescription {spaces} name="chain{count}" version="1.0"><ssd:System name="loop">'
        f"<ssd:Elements>{''.join(parts)}</ssd:Elements><ssd:Connections>{''.join(wires)}</ssd:Connections>"
        '</ssd:System><ssd:DefaultExperiment startTime="0" stopTime="1"/></ssd:SystemStructureDescription>'
    )
    return folder


def by_components(workshop: Workshop, sizes: list[int]) -> Series:
    """What one component of a loop takes a step, in `run`."""
    values = []
    for count in sizes:
        steps = workshop.long(max(100, 60_000 // count))
        words = ["run", chain(workshop, count), "--step", 1e-3, "--until", 1e-3 * steps, "--out", workshop.folder / "out"]
        values.append(min(run_json(*words)["seconds"] for _ in range(workshop.repeats)) / (steps * count) * 1e6)
    return Series("a component and step of a loop, by components", "µs", "linear plants of 4 states", sizes, values)


def by_points(workshop: Workshop, sizes: list[int]) -> list[Series]:
    """What a point takes, and how much memory the program, from a run of one plant."""
    took, memory = [], []
    for count in sizes:
        words = ["run", chain(workshop, 1), "--step", 1e-3, "--until", 1e-3 * count, "--out", workshop.folder / "out"]
        command = [sys.executable, __file__, json.dumps([str(PROGRAM), *map(str, words)])]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ)
        seconds, most = json.loads(done.stdout)
        took.append(seconds / count * 1e6)
        memory.append(most)
    panel = "a run of one plant, by points"
    return [Series(panel, "µs a point", "time of the whole command", sizes, took), Series(panel, "MB", "memory", sizes, memory)]


def by_instances(workshop: Workshop, unit: str, sizes: tuple[int, ...]) -> list[Series]:
    """What an instance takes to be made and initialised, and its memory, by a process of its own for each count."""
    _, words = Driver(workshop).ours(workshop.fmus / f"{unit}.fmu")
    found = []
    for count in sizes:
        command = [sys.executable, __file__, json.dumps([*words, count])]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        found.append(json.loads(done.stdout))
    panel = "an instance, by instances in a process"
    return [
        Series(panel, figure, unit, list(sizes), [values[k] for values in found])
        for k, figure in enumerate(("µs", "kB"))
    ]


def of_command(command: list[str]) -> list[float]:
    """Seconds of processor time of a command, and the most memory that it had, MB."""
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode in (0, 3), done
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return [used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]


def of_instances(library: str, guid: str, resources: str, count: int) -> list[float]:
    """µs and kB of an instance, of so many that are made and initialised at the same time."""
    import ctypes
    import time

    from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

    functions, libc = ctypes.CDLL(library), ctypes.CDLL(None)
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(lambda *_: None)
    for name, of in (("allocateMemory", libc.calloc), ("freeMemory", libc.free)):
        setattr(callbacks, name, ctypes.cast(of, dict(fmi2CallbackFunctions._fields_)[name]))
    functions.fmi2Instantiate.restype = ctypes.c_void_p
    real, whole = ctypes.c_double, ctypes.c_int

    def make() -> int:
        made = functions.fmi2Instantiate(b"unit", 1, guid.encode(), resources.encode(), ctypes.byref(callbacks), 0, 0)
        one = ctypes.c_void_p(made)
        calls = (
            functions.fmi2SetupExperiment(one, whole(0), real(0), real(0), whole(0), real(0)),
            functions.fmi2EnterInitializationMode(one),
            functions.fmi2ExitInitializationMode(one),
        )
        assert made and calls == (0, 0, 0)
        return made

    instances = [make()]  # the first one makes what all share
    before, begun = resident(), time.process_time()
    instances += [make() for _ in range(count)]
    took, memory = time.process_time() - begun, resident() - before
    return [took / count * 1e6, memory / count]


def resident() -> float:
    """Memory of this process, kB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1024


def table(series: list[Series]) -> str:
    """In Markdown."""
    lines = ["| what | of | sizes | figures | exponent |", "| --- | --- | --- | --- | --- |"]
    for one in series:
        sizes, values = (", ".join(f"{x:.3g}" for x in numbers) for numbers in (one.sizes, one.values))
        lines.append(f"| {one.panel} | {one.name} | {sizes} | {values} {one.figure} | {one.exponent:.2f} |")
    return "\n".join(lines)


COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd")
WIDTH, HEIGHT, EDGE = 420, 300, 48


def plot(series: list[Series]) -> str:
    """Panels on logarithmic axes, as SVG."""
    panels = list(dict.fromkeys(one.panel for one in series))
    drawn = [panel(name, [one for one in series if one.panel == name]) for name in panels]
    placed = (f'<g transform="translate({k % 2 * WIDTH},{k // 2 * HEIGHT})">{one}</g>' for k, one in enumerate(drawn))
    size = f'viewBox="0 0 {2 * WIDTH} {(len(panels) + 1) // 2 * HEIGHT}"'
    style = "text{font:12px sans-serif}.t{font-weight:bold}.g{stroke:#ddd}"
    title = "<title>How costs grow, on logarithmic axes</title>"
    ground = '<rect width="100%" height="100%" fill="white"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{title}<style>{style}</style>{ground}{"".join(placed)}</svg>\n'


def panel(title: str, series: list[Series]) -> str:
    """One of them."""
    xs, ys = ([x for one in series for x in numbers(one)] for numbers in (lambda o: o.sizes, lambda o: o.values))
    top = 34 + 15 * len(series)
    x, y = scale(xs, EDGE, WIDTH - 32), scale(ys, HEIGHT - EDGE, top)
    parts = [f'<text class="t" x="{EDGE}" y="20">{title}</text>']
    for k in decades(xs):
        parts.append(f'<path class="g" d="M{x(k):.1f} {top}V{HEIGHT - EDGE}"/>')
        parts.append(f'<text x="{x(k):.1f}" y="{HEIGHT - EDGE + 16}" text-anchor="middle">{k:g}</text>')
    for k in decades(ys):
        parts.append(f'<path class="g" d="M{EDGE} {y(k):.1f}H{WIDTH - 32}"/>')
        parts.append(f'<text x="{EDGE - 4}" y="{y(k) + 4:.1f}" text-anchor="end">{k:g}</text>')
    for colour, one, k in zip(COLOURS, series, range(len(series)), strict=False):
        points = [f"{x(a):.1f} {y(b):.1f}" for a, b in zip(one.sizes, one.values, strict=True)]
        parts.append(f'<path fill="none" stroke="{colour}" stroke-width="2" d="M{"L".join(points)}"/>')
        parts += (f'<circle cx="{p.split()[0]}" cy="{p.split()[1]}" r="3" fill="{colour}"/>' for p in points)
        parts.append(f'<text x="{EDGE}" y="{38 + 15 * k}" fill="{colour}">{one.name}, {one.figure}</text>')
    return "".join(parts)


def scale(numbers: list[float], low: float, high: float) -> Callable[[float], float]:
    """Where a number lies between two places, by its logarithm."""
    first, last = np.log10(decades(numbers)[0]), np.log10(decades(numbers)[-1])
    return lambda number: low + (high - low) * float((np.log10(number) - first) / (last - first))


def decades(numbers: list[float]) -> list[float]:
    """Powers of ten around them."""
    first, last = int(np.floor(np.log10(min(numbers)))), int(np.ceil(np.log10(max(numbers)) + 1e-9))
    return [10.0**k for k in range(first, max(last, first + 1) + 1)]


def main() -> None:
    """A figure of its own process: of a command, or of instances."""
    words = json.loads(sys.argv[1])
    print(json.dumps(of_instances(*words) if isinstance(words[-1], int) else of_command(words)))


if __name__ == "__main__":
    main()
