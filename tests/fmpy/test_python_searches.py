"""Searches whose runs executors carry out: the same to the bit, and nothing lost with a worker."""

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import adaptive_fmu
import numpy as np
import pandas as pd
import pytest
from sample import NUMBER as SEED
from test_python_executor import client, executor, wait_for  # noqa: F401 (fixtures)

LOOP = "3.2.1-cosine"
GAIN = {"controller.feedback_gain[1,1]": (2.0, 40.0)}


def tuned(**further: object) -> adaptive_fmu.Tuned:
    options = {"metric": "rms (y - y_m), t >= 5 s", "until": 6, "particles": 4, "generations": 3, "seed": SEED}
    return adaptive_fmu.Loop(LOOP).tune(GAIN, **options | further)


def test_a_search_is_the_same_to_the_bit_wherever_its_particles_run(executor: object, tmp_path: Path) -> None:  # noqa: F811
    corner = tmp_path / "corner.ssv"
    corner.write_text(
        '<?xml version="1.0"?><ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" name="c" '
        'version="1.0"><ssv:Parameters><ssv:Parameter name="plant.omega"><ssv:Real value="1.5"/></ssv:Parameter></ssv:Parameters>'
        "</ssv:ParameterSet>"
    )
    here, there = tuned(worst_of=[corner]), tuned(worst_of=[corner], executor=executor)
    assert (there.values, there.objective, there.verified) == (here.values, here.objective, here.verified)
    assert (there.runs, there.failed, there.ended) == (here.runs, here.failed, "complete") == (12, 0, "complete")


class Counting:
    """An executor of two threads that counts its jobs; from one of them on, it is broken."""

    def __init__(self, broken_from: float = float("inf")) -> None:
        self.pool, self.jobs, self.broken_from = ThreadPoolExecutor(2), 0, broken_from

    def submit(self, call: Callable[..., object], *words: object) -> Future:
        self.jobs += 1
        if self.jobs >= self.broken_from:
            raise RuntimeError("no workers are left")
        return self.pool.submit(call, *words)


def test_each_particle_is_a_job_and_a_search_that_lost_its_workers_goes_on(tmp_path: Path) -> None:
    whole = Counting()
    here = tuned(executor=whole)
    assert whole.jobs == 12
    with pytest.raises(adaptive_fmu.Error, match=r"(?s)RuntimeError: no workers are left.*continues"):
        tuned(executor=Counting(broken_from=7), out=tmp_path)
    rest = Counting()
    again = tuned(executor=rest, out=tmp_path)
    assert again.values == here.values and again.objective == here.objective
    # The first generation was complete.
    assert rest.jobs == 8
    # A request of the same process, later: it isn't given to those workers.
    assert tuned().objective == here.objective and rest.jobs == 8


def test_a_killed_worker_is_an_error_with_the_reason(tmp_path: Path) -> None:
    with ProcessPoolExecutor(1) as pool:
        victim = pool.submit(os.getpid).result()
        timer = threading.Timer(1.0, os.kill, (victim, signal.SIGKILL))
        timer.start()
        with pytest.raises(adaptive_fmu.Error, match="A worker process ended"):
            tuned(executor=pool, generations=200, out=tmp_path)
        timer.join()
    assert (tmp_path / f"{LOOP}-tuned" / "search.json").is_file()


def test_what_a_worker_refuses_is_the_error_of_the_search(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(adaptive_fmu.Error, match="no metric `nothing`"):
            tuned(metric="nothing", executor=pool)
        with pytest.raises(adaptive_fmu.ArgumentError, match="executor = 3 is not allowed"):
            tuned(executor=3)


@pytest.fixture
def description(tmp_path: Path) -> Path:
    plant = [[0.0, 1.0], [-4.0, -0.4]], [[0.0], [2.0]], [[1.0, 0.0]], [[0.0]]
    return adaptive_fmu.new("pid", tmp_path / "Swing.toml", plant=plant, bandwidth=3, uncertainty=0.3)


def test_the_worst_plant_is_searched_by_an_executor(executor: object, description: Path) -> None:  # noqa: F811
    # One generation: how many there are depends on the time.
    here = adaptive_fmu.check(description, worst_case=1e-3, seed=SEED + 1).worst_case
    there = adaptive_fmu.check(description, worst_case=1e-3, seed=SEED + 1, executor=executor).worst_case
    assert here == there and here["tried"] == 24


def test_records_are_simulated_by_an_executor(executor: object, tmp_path: Path) -> None:  # noqa: F811
    random = np.random.default_rng(SEED)
    plant = [[-0.7, 3.0], [-1.0, -2.0]], [[0.0], [1.5]], [[1.0, 0.0]], [[0.0]]
    file = adaptive_fmu.new("state-space", tmp_path / "Plant.toml", plant=plant)
    records = []
    for _ in range(3):
        time = 0.05 * np.arange(200)
        given = pd.DataFrame({"u[1]": np.repeat(random.choice([-1.0, 1.0], 20), 10)}, index=pd.Index(time, name="time"))
        data = adaptive_fmu.simulate(file, input=given, stop_time=time[-1], output_interval=0.05).data
        data = data[["y[1]"]] + 1e-3 * random.standard_normal((len(data), 1))
        records.append(given.join(data))

    def estimate(**further: object) -> adaptive_fmu.Estimated:
        free = {"A[1,1]": (-3.0, 0.0), "B[2,1]": (0.5, 3.0)}
        return adaptive_fmu.estimate(file, records, ["u[1]"], ["y[1]"], free=free, offset=None, **further)

    counting = Counting()
    here, there = estimate(), estimate(executor=executor)
    pd.testing.assert_frame_equal(here.parameters, there.parameters, check_exact=True)
    assert (here.covariance == there.covariance).all()
    estimate(executor=counting)
    # Each record by itself.
    assert counting.jobs % len(records) == 0 and counting.jobs >= 5 * len(records)


def test_pairs_of_the_league_are_computed_by_an_executor(tmp_path: Path) -> None:
    counting = Counting()
    only = ["siso/pid", "siso/ladrc"]
    here = adaptive_fmu.league(only, quick=True)
    there = adaptive_fmu.league(only, quick=True, executor=counting, out=tmp_path)
    pd.testing.assert_frame_equal(here, there, check_exact=True)
    # Four stages of each.
    assert counting.jobs == 8
    assert (tmp_path / "index.html").is_file() and (tmp_path / "siso" / "pid.json").is_file()
    more = Counting()
    again = adaptive_fmu.league([*only, "siso/mrac"], quick=True, executor=more, out=tmp_path, resume=True)
    assert more.jobs == 4 and again["controller"].tolist().count("mrac") == 1


def test_dask_repeats_the_runs_of_a_worker_that_is_killed(client) -> None:  # noqa: F811
    here = tuned(generations=6)
    before = set(client.run(os.getpid).values())
    timer = threading.Timer(0.3, os.kill, (min(before), signal.SIGKILL))
    timer.start()
    there = tuned(generations=6, executor=client)
    timer.join()
    assert (there.values, there.objective) == (here.values, here.objective)
    wait_for(lambda: len(client.scheduler_info()["workers"]) == 2)
