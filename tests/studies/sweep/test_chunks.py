"""Parts of a sweep on a real Dask cluster of processes, and after a process was killed."""

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

# each design by itself, so that a sweep lasts a while
VARY = {"crank": np.linspace(0.025, 0.035, 40), "coupler": np.linspace(0.085, 0.095, 10)}
MEASURES = ["min:transmission", "range:rocker"]
WORDS = (
    "four_bar --vary crank=25mm:35mm:40 --vary coupler=85mm:95mm:10 --measure min:transmission "
    "--measure range:rocker"
)


@contextmanager
def started(*words):
    """Run a process as long as it is wanted."""
    env = {**os.environ, "DASK_DISTRIBUTED__DASHBOARD__LINK": "", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env
    ) as item:
        try:
            yield item
        finally:
            item.kill()


def waited(what, seconds=60.0):
    """Return what comes true, or fail."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        result = what()
        if result:
            return result
        time.sleep(0.02)
    pytest.fail("waited in vain")


@contextmanager
def cluster(folder):
    """Run a scheduler and two workers on the loopback; give the address and the workers."""
    note, local = folder / "scheduler.json", str(folder)
    common = ("--host", "127.0.0.1", "--no-dashboard")
    scheduler = (
        "-m",
        "distributed.cli.dask_scheduler",
        *common,
        "--port",
        "0",
        "--scheduler-file",
        str(note),
    )
    with started(*scheduler):
        address = waited(
            lambda: note.exists() and note.stat().st_size and json.loads(note.read_text())["address"]
        )
        worker = ("-m", "distributed.cli.dask_worker", address, *common, "--no-nanny", "--nthreads", "1")
        worker += ("--local-directory", local, "--death-timeout", "60")
        with started(*worker) as first, started(*worker) as second:
            yield address, (first, second)


@pytest.mark.slow
def test_a_cluster_gives_what_one_process_gives_though_a_worker_is_killed(tmp_path):
    here = tmp_path / "here.nc"
    ms.sweep("four_bar", VARY, MEASURES, output=here)
    there = tmp_path / "there.nc"
    with cluster(tmp_path) as (address, workers):
        distributed = pytest.importorskip("distributed")
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        killed = []

        def watch(_, part):
            if part > 0.2 and not killed:
                workers[0].kill()
                killed.append(part)

        ms.sweep("four_bar", VARY, MEASURES, output=there, scheduler=address, progress=watch)
        assert killed
        assert killed[0] < 1.0
        workers[0].wait(10.0)
        assert workers[1].poll() is None
    assert there.read_bytes() == here.read_bytes()


@pytest.mark.slow
def test_a_process_that_is_killed_leaves_parts_from_which_the_same_file_comes(tmp_path):
    cut, whole = tmp_path / "cut.nc", tmp_path / "whole.nc"
    with started("-m", "mechsim", "sweep", *WORDS.split(), "-o", str(cut)) as item:
        parts = tmp_path / "cut.nc.parts"
        waited(lambda: len(list(parts.glob("0*.npz"))) >= 1 if parts.exists() else False)
        item.send_signal(signal.SIGKILL)
        item.wait(10.0)
    assert not cut.exists()
    speed = ms.units.rpm(600)
    ms.sweep("four_bar", VARY, MEASURES, output=cut, resume=True, speed=speed)
    ms.sweep("four_bar", VARY, MEASURES, output=whole, speed=speed)
    assert cut.read_bytes() == whole.read_bytes()
    assert sorted(item.name for item in tmp_path.iterdir()) == ["cut.nc", "whole.nc"]
