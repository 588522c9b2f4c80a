"""On a dask cluster a campaign gives the same files, though workers die and tasks kill them."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from toy_campaign import Toy

from drakeplan.campaigns.campaign import Task
from drakeplan.campaigns.engine import CollectOptions, collect
from drakeplan.campaigns.workers import LocalWorkers, timed_task
from learning.shard_file import shard_paths
from scenes.input_error import InputError

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
from drakeplan.campaigns.cluster import ClusterWorkers  # noqa: E402


def shards(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in shard_paths(folder).values()}


@pytest.fixture
def cluster():
    # A LocalCluster gives up workers that have not come back in 15 s, which a busy machine may take.
    with (
        dask.config.set(
            {"distributed.deploy.lost-worker-timeout": "600s", "distributed.scheduler.allowed-failures": 1}
        ),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
    ):
        yield cluster


@pytest.mark.slow
def test_a_worker_that_is_killed_takes_nothing_with_it(cluster, tmp_path: Path) -> None:
    campaign = Toy(pause=0.1)
    with LocalWorkers(Toy(), 2) as workers:
        collect(Toy(), tmp_path / "local", CollectOptions(60, 7, 4), workers)
    victim = next(iter(cluster.workers.values())).pid
    killed = threading.Event()
    (tmp_path / "cluster").mkdir()

    def kill() -> None:
        while not shard_paths(tmp_path / "cluster"):
            time.sleep(0.02)
        os.kill(victim, signal.SIGKILL)
        killed.set()

    threading.Thread(target=kill, daemon=True).start()
    with ClusterWorkers(campaign, cluster.scheduler_address) as workers:
        card = collect(campaign, tmp_path / "cluster", CollectOptions(60, 7, 4), workers)
    assert killed.is_set()
    assert not card.quarantined
    assert shards(tmp_path / "cluster") == shards(tmp_path / "local")


def test_a_task_whose_rows_died_with_their_worker_is_run_again() -> None:
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
        ) as cluster,
        ClusterWorkers(Toy(), cluster.scheduler_address) as workers,
    ):
        task = Task(shard=0, index=0, number=0, seed=7)
        workers.submit(task)
        future = workers._futures[task]
        assert future.exception(timeout=10.0) is None
        future._state.lose()
        assert workers.next_outcome(10.0) is None
        again = workers.next_outcome(10.0)
    assert again is not None and again.task == task
    assert again.table == timed_task(Toy(), task)[0]


@pytest.mark.slow
def test_tasks_that_kill_workers_are_found_out_and_innocent_ones_are_not_blamed(cluster, tmp_path: Path) -> None:
    mischief = {3: "raise", 5: "exit", 10: "hang"}
    campaign = Toy(pause=0.05, mischief=mischief)
    with ClusterWorkers(campaign, cluster.scheduler_address, task_timeout=2.0) as workers:
        card = collect(campaign, tmp_path, CollectOptions(16, 7, 4), workers)
    reasons = {q["task"]: q["reason"] for q in card.quarantined}
    assert reasons.keys() == mischief.keys()
    assert reasons[3] == "ArithmeticError: no answer to this"
    assert "ended every worker" in reasons[5] and "ended every worker" in reasons[10]


def test_a_cluster_that_lost_all_workers_is_given_up(cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drakeplan.campaigns.cluster.PATIENCE", 1.0)
    with ClusterWorkers(Toy(), cluster.scheduler_address) as workers:
        cluster.scale(0)
        while workers._client.nthreads():
            time.sleep(0.05)
        with pytest.raises(InputError, match="no workers for 1 s"):
            collect(Toy(), tmp_path, CollectOptions(4, 7, 4), workers)


def test_when_the_scheduler_goes_away_no_task_is_blamed(tmp_path: Path) -> None:
    campaign = Toy(pause=0.2)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
    ) as cluster:
        workers = ClusterWorkers(campaign, cluster.scheduler_address)
        timer = threading.Timer(0.5, cluster.close)
        timer.start()
        with pytest.raises(InputError, match="--resume goes on"):
            collect(campaign, tmp_path, CollectOptions(4000, 7, 4000), workers)
        timer.join()
        workers.close()
    assert not shard_paths(tmp_path)


def test_workers_with_several_threads_are_refused() -> None:
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, silence_logs=50
        ) as cluster,
        pytest.raises(InputError, match="workers with 2 threads"),
    ):
        ClusterWorkers(Toy(), cluster.scheduler_address)


def test_an_address_where_nobody_answers_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drakeplan.campaigns.cluster.CONNECT_TIMEOUT", 0.3)
    with pytest.raises(InputError, match="no dask scheduler answers there") as error:
        ClusterWorkers(Toy(), "tcp://127.0.0.1:9")
    assert "\n" not in str(error.value)
