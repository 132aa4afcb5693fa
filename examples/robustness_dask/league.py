"""The league on as many machines as Dask has: a pair of plant and controller is a task. The same command goes on with an
interrupted league; `adaptive-fmu league --help` and docs/league.md tell what is computed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

sys.dont_write_bytecode = True

import cloudpickle  # noqa: E402
from dask.distributed import Client, as_completed  # noqa: E402

# Workers get this file's functions with their work: they needn't have it.
cloudpickle.register_pickle_by_value(sys.modules[__name__])

OWN = Path(__file__).resolve().parents[1] / "league" / "league.toml"


def arguments(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask's scheduler, say tcp://host:8786 (one of its own)")
    parser.add_argument("--workers", type=int, help="processes, where the scheduler is its own (one for each core)")
    parser.add_argument("--study", type=Path, default=OWN, help="the study's file, with its descriptions beside it")
    parser.add_argument("--out", type=Path, default=Path("results/league"), help="folder of results")
    parser.add_argument("--only", action="append", metavar="PLANT", help="only these plants; repeatable")
    parser.add_argument("--quick", action="store_true", help="a small part of the runs: its numbers are no result")
    return parser.parse_args(words)


def program() -> str:
    """The program: the one that ADAPTIVE_FMU_PROGRAM names, or that of the package that `pip install` installed."""
    return os.environ.get("ADAPTIVE_FMU_PROGRAM", "adaptive-fmu")


def compute(files: dict[str, str], study: str, pair: str, earlier: str | None, options: list[str]) -> str:
    """The result of a pair, as the text of its file. `kept` is what an earlier league left of it."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text)
        result = Path(folder) / "out" / f"{pair}.json"
        if earlier is not None:
            result.parent.mkdir(parents=True)
            result.write_text(earlier)
        # A worker has one task for each of its threads: the program isn't to take all cores.
        command = [program(), "league", "--study", study, "--only", pair, "--out", "out", "--resume", "--jobs", "1", *options]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(done.stderr.strip())
        return result.read_text()


def pairs(study: Path, only: list[str] | None) -> list[str]:
    """All pairs that are asked for, as PLANT/CONTROLLER."""
    plants = tomllib.loads(study.read_text())["plant"]
    chosen = [plant for plant in plants if only is None or plant["name"] in only]
    return [f"{plant['name']}/{entry['name']}" for plant in chosen for entry in plant["controller"]]


def main(words: list[str] | None = None) -> int:
    given = arguments(words)
    files = {file.name: file.read_text() for file in given.study.parent.glob("*.toml")}
    options = ["--quick"] if given.quick else []
    failed = 0
    client = Client(given.scheduler) if given.scheduler else Client(n_workers=given.workers, threads_per_worker=1)
    with client:
        tasks = {}
        for pair in pairs(given.study, given.only):
            file = given.out / f"{pair}.json"
            earlier = file.read_text() if file.is_file() else None
            tasks[client.submit(compute, files, given.study.name, pair, earlier, options, pure=False)] = pair
        for task in as_completed(tasks):
            pair = tasks[task]
            if task.status != "finished":
                failed += 1
                print(f"error: {pair}: {task.exception()}", file=sys.stderr, flush=True)
                continue
            file = given.out / f"{pair}.json"
            file.parent.mkdir(parents=True, exist_ok=True)
            # Replaced at once or not at all.
            part = file.with_suffix(".part")
            part.write_text(task.result())
            part.replace(file)
            print(pair, flush=True)
    page = [program(), "league", "--study", str(given.study), "--page", "--out", str(given.out), *options]
    return subprocess.run(page, check=False).returncode or min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
