"""How robust is the L1 adaptive control of the two-link robot? Loops with random parameters, on as many machines as
Dask has. The same command goes on with an interrupted study, or with more loops; README.md tells the rest.
"""

import argparse
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

# Cargo watches this folder: compiled Python in it would have it build the program again.
sys.dont_write_bytecode = True

import cloudpickle  # noqa: E402
import figure  # noqa: E402
import loop  # noqa: E402
import worker  # noqa: E402
from dask.distributed import Client, Future, as_completed, get_worker  # noqa: E402
from results import Refused, Results  # noqa: E402

# Workers get these, and what stands in this file, with their work: they needn't have the files.
cloudpickle.register_pickle_by_value(loop)
cloudpickle.register_pickle_by_value(worker)

CONNECT = 5.0  # s


def arguments(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=1000, help="loops that the results shall hold (1000)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask's scheduler, say tcp://host:8786 (one of its own)")
    parser.add_argument("--workers", type=int, help="processes, where the scheduler is its own (one for each core)")
    parser.add_argument("--fmus", type=Path, default=Path("fmus"), help="folder of the exported FMUs (fmus)")
    parser.add_argument("--out", type=Path, default=Path("results/robustness"), help="folder of results")
    parser.add_argument("--seed", type=int, default=1, help="which random numbers (1)")
    parser.add_argument("--again", action="store_true", help="run loops again that ended with a Python exception")
    return parser.parse_args(words)


def read(folder: Path) -> dict[str, bytes]:
    """The FMUs of the study."""
    try:
        return {name: (folder / f"{name}.fmu").read_bytes() for name in loop.FMUS}
    except OSError as missing:
        raise Refused(f"{missing.filename}: {missing.strerror}; `adaptive-fmu export --all` writes it") from None


def connect(scheduler: str | None, workers: int | None) -> Client:
    """A client of this scheduler, or of a cluster on this machine."""
    if scheduler is None:
        return Client(n_workers=workers, threads_per_worker=1, dashboard_address=":0")
    try:
        return Client(scheduler, timeout=CONNECT)
    except (OSError, ValueError) as failure:
        raise Refused(f"no scheduler at {scheduler}: {failure}") from None


def run_loop(study: str, sample: loop.Sample) -> dict[str, float | str]:
    """Runs a loop with these values, on the worker that this is called on."""
    return get_worker().plugins[study].run(sample)


def outcome(future: Future) -> dict[str, float | str]:
    """What became of a loop. What went wrong in Python is told, not lost; a lost scheduler is no result."""
    try:
        return future.result()
    except Exception as failure:
        if future.status != "error":
            raise Refused("the scheduler is lost; the same command goes on where this ended") from failure
        return {"outcome": loop.EXCEPTION, "message": f"{type(failure).__name__}: {failure}"}


def outcomes(client: Client, fmus: dict[str, bytes], seed: int, missing: list[int]) -> Iterator[tuple[int, dict]]:
    """Runs loops on all workers, and tells of each as it ends. Those of a lost worker are run by another one."""
    study = uuid.uuid4().hex
    client.register_plugin(worker.Fmus(study, fmus))
    try:
        samples, keys = [loop.sample(seed, k) for k in missing], [f"{study}-{k}" for k in missing]
        for future in as_completed(client.map(partial(run_loop, study), samples, key=keys)):
            yield int(future.key.split("-")[1]), outcome(future)
    finally:
        # A scheduler that is lost has none of it.
        with suppress(OSError):
            client.unregister_worker_plugin(study)


class Progress:
    """A line that tells how far it is: overwritten on a terminal, else written anew now and then."""

    def __init__(self, results: Results, loops: int) -> None:
        self.results, self.loops, self.before = results, loops, len(results.rows)
        self.started = self.told = time.monotonic()

    def tell(self) -> None:
        """Tells it, where it is time to."""
        rows, now, terminal = self.results.rows, time.monotonic(), sys.stdout.isatty()
        if now - self.told < (0.2 if terminal else 10.0) and len(rows) < self.loops:
            return
        self.told = now
        rate = (len(rows) - self.before) / (now - self.started)
        failed = sum(row["outcome"] != loop.HELD for row in rows.values())
        left = (self.loops - len(rows)) / rate
        line = f"{len(rows)} of {self.loops} loops, {failed} failed, {rate:.2f} loops/s, {left / 60:.1f} min left"
        end = "" if terminal and len(rows) < self.loops else "\n"
        print(f"\r{line:<78}" if terminal else line, end=end, flush=True)


def study(given: argparse.Namespace) -> int:
    """Runs what is missing, and shows all that is there."""
    fmus = read(given.fmus)
    results = Results(given.out, given.seed, fmus, given.again)
    missing = [k for k in range(given.loops) if k not in results.rows]
    print(f"{len(results.rows)} loops are in {results.file}, {len(missing)} are to be run", flush=True)
    if missing:
        with connect(given.scheduler, given.workers) as client:
            progress = Progress(results, len(results.rows) + len(missing))
            for k, became in outcomes(client, fmus, given.seed, missing):
                results.add(k, became)
                progress.tell()
    print(figure.show(results.rows, given.out))
    return 1 if any(row["outcome"] == loop.EXCEPTION for row in results.rows.values()) else 0


def main(words: list[str] | None = None) -> int:
    given = arguments(words)
    try:
        return study(given)
    except Refused as refused:
        print(f"error: {refused}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"\ninterrupted: what ended is in {given.out}, and the same command goes on", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
