"""Chunks of a sweep after a killed process."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

import mechsim as ms

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
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
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
