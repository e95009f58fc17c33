"""Chunks of a sweep on a real Dask cluster of processes, and after a killed process."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

import mechsim as ms

pytest.importorskip("distributed", reason="dask and distributed are not installed")

# designs are solved one by one, so that the sweep takes long enough
VARY = {"crank": np.linspace(0.025, 0.035, 40), "coupler": np.linspace(0.085, 0.095, 10)}
MEASURES = ["min:transmission", "range:rocker"]
WORDS = (
    "four_bar --vary crank=25mm:35mm:40 --vary coupler=85mm:95mm:10 --measure min:transmission "
    "--measure range:rocker"
)


@contextmanager
def running(*words):
    """Run a process until the context ends."""
    env = {**os.environ, "DASK_DISTRIBUTED__DASHBOARD__LINK": "", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env
    ) as item:
        try:
            yield item
        finally:
            item.kill()


def wait_until(what, seconds=60.0):
    """Return the first true result, or fail after a time limit."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        result = what()
        if result:
            return result
        time.sleep(0.02)
    pytest.fail("no result within the time limit")


@contextmanager
def cluster(folder):
    """Run a scheduler and two workers on the loopback; yield the address and the workers."""
    scheduler_file, local = folder / "scheduler.json", str(folder)
    common = ("--host", "127.0.0.1", "--no-dashboard")
    scheduler = (
        "-m",
        "distributed.cli.dask_scheduler",
        *common,
        "--port",
        "0",
        "--scheduler-file",
        str(scheduler_file),
    )
    with running(*scheduler):
        address = wait_until(
            lambda: (
                scheduler_file.exists()
                and scheduler_file.stat().st_size
                and json.loads(scheduler_file.read_text())["address"]
            )
        )
        worker = ("-m", "distributed.cli.dask_worker", address, *common, "--no-nanny", "--nthreads", "1")
        worker += ("--local-directory", local, "--death-timeout", "60")
        with running(*worker) as first, running(*worker) as second:
            yield address, (first, second)


@pytest.mark.slow
def test_a_cluster_with_a_killed_worker_writes_the_same_file(tmp_path):
    local_file = tmp_path / "here.nc"
    ms.sweep("four_bar", VARY, MEASURES, output=local_file)
    cluster_file = tmp_path / "there.nc"
    with cluster(tmp_path) as (address, workers):
        distributed = pytest.importorskip("distributed")
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        killed = []

        def kill_worker(_, fraction):
            if fraction > 0.2 and not killed:
                workers[0].kill()
                killed.append(fraction)

        ms.sweep("four_bar", VARY, MEASURES, output=cluster_file, scheduler=address, progress=kill_worker)
        assert killed
        assert killed[0] < 1.0
        workers[0].wait(10.0)
        assert workers[1].poll() is None
    assert cluster_file.read_bytes() == local_file.read_bytes()


@pytest.mark.slow
def test_a_killed_sweep_resumes_to_the_same_file(tmp_path):
    interrupted, whole = tmp_path / "cut.nc", tmp_path / "whole.nc"
    with running("-m", "mechsim", "sweep", *WORDS.split(), "-o", str(interrupted)) as item:
        folder = tmp_path / "cut.nc.parts"
        wait_until(lambda: len(list(folder.glob("0*.npz"))) >= 1 if folder.exists() else False)
        item.send_signal(signal.SIGKILL)
        item.wait(10.0)
    assert not interrupted.exists()
    speed = ms.units.rpm(600)
    ms.sweep("four_bar", VARY, MEASURES, output=interrupted, resume=True, speed=speed)
    ms.sweep("four_bar", VARY, MEASURES, output=whole, speed=speed)
    assert interrupted.read_bytes() == whole.read_bytes()
    assert sorted(item.name for item in tmp_path.iterdir()) == ["cut.nc", "whole.nc"]
