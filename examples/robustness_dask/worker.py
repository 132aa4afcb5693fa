"""What a worker is given: the FMUs, which it unpacks once, and the loops that it is to run."""

import shutil
import threading
from pathlib import Path

import fmpy
import loop
from dask.distributed import Worker, WorkerPlugin


class Fmus(WorkerPlugin):
    """The FMUs of a study as bytes: worker and client share no disk. A worker that comes later gets them too."""

    def __init__(self, study: str, files: dict[str, bytes]) -> None:
        self.name, self.files, self.unpacked = study, files, {}

    def setup(self, worker: Worker) -> None:
        """Unpacks them where the worker keeps its files."""
        self.folder, loading = Path(worker.local_directory) / self.name, threading.Lock()
        self.folder.mkdir()
        for name, content in self.files.items():
            packed = self.folder / f"{name}.fmu"
            packed.write_bytes(content)
            fmpy.extract(str(packed), str(self.folder / name))
            self.unpacked[name] = loop.Fmu(self.folder / name, loading)

    def teardown(self, worker: Worker) -> None:
        """Removes them after the study."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def run(self, sample: loop.Sample) -> dict[str, float | str]:
        """Runs the loop with these values."""
        return loop.run(self.unpacked, sample)
