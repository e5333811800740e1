"""Studies on a Dask cluster whose workers or scheduler are killed."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster

from deploy.sweep.plan import load_study, points_of
from deploy.sweep.results import Results, differences
from deploy.sweep.row import run_point
from deploy.sweep.workers import DaskCluster, Execution
from tests import ROOT
from tests.helpers.studies import command, tiny
from tests.helpers.waiting import alive, wait_until

pytestmark = pytest.mark.processes


def test_a_dask_worker_killed_half_way_changes_nothing(tmp_path: Path) -> None:
    points = points_of(load_study(str(tiny(tmp_path, 8, 30.0))))
    rows = []
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        workers = DaskCluster(cluster.scheduler_address)
        victim = next(iter(cluster.workers.values())).pid
        for count, (_, run) in enumerate(Execution(workers, "in-process", 1).results(points), 1):
            rows.append(run.row)
            if count == 4:
                os.kill(victim, signal.SIGKILL)
        wait_until(lambda: not alive(victim), "the worker was killed")
        workers.close()
    assert len(rows) == 8
    assert {found["status"] for found in rows} == {"time_limit"}
    alone = [run_point(p.key, p.variant, p.toml, "in-process", 1).row for p in points]
    assert differences(rows, alone) == []


@contextlib.contextmanager
def cluster_of_processes(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A scheduler and a worker, each a process of its own; yields the scheduler and its address."""
    file, module = folder / "scheduler.json", "distributed.cli.dask_"
    with contextlib.ExitStack() as ended:

        def start(role: str, *arguments: object) -> subprocess.Popen[bytes]:
            log = ended.enter_context((folder / f"{role}.log").open("wb"))
            ask = [
                sys.executable,
                "-m",
                module + role,
                "--no-dashboard",
                "--scheduler-file",
                file,
                *map(str, arguments),
            ]
            process = subprocess.Popen(ask, stdout=log, stderr=log, cwd=ROOT)
            ended.callback(process.wait)
            ended.callback(process.kill)
            return process

        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", 0)
        wait_until(file.exists, "the scheduler tells its address")
        start("worker", "--nworkers", 1, "--nthreads", 1, "--no-nanny")
        yield scheduler, json.loads(file.read_text())["address"]


def test_a_dask_scheduler_killed_half_way_leaves_the_rest_to_the_same_command(tmp_path: Path) -> None:
    path, out = tiny(tmp_path, 6, 40.0), tmp_path / "out"
    ask = command(path, "--out", out)
    with cluster_of_processes(tmp_path) as (scheduler, address):
        study = subprocess.Popen(
            [*ask, "--dask", address], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        with study:
            wait_until(lambda: any((out / "parts").glob("*.json")), "one result")
            scheduler.kill()
            assert study.wait() == 1
            assert study.stderr is not None
            said = study.stderr.read()
    done = len(Results(out).rows())
    assert said == (
        f"study.py: the Dask scheduler is gone, with {6 - done} runs in hand; the same command goes on from here\n"
    )
    assert 0 < done < 6
    again = subprocess.run([*ask, "--workers", "1"], capture_output=True, text=True, check=True)
    assert f"6 runs, {done} of them done" in again.stdout
    assert [row["status"] for row in Results(out).rows()] == ["time_limit"] * 6
