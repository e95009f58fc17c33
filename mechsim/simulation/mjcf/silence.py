"""MuJoCo's own log kept off the console and out of the user's folder while mechsim runs it."""

import os
from collections.abc import Generator
from contextlib import contextmanager

import mujoco


@contextmanager
def quiet() -> Generator[None]:
    """Silence MuJoCo's log: what it warns of is read from its counters and reported as an outcome.

    Left alone it writes MUJOCO_LOG.TXT into the current folder.
    """
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    silent.set()
    try:
        yield
    finally:
        before.set()


@contextmanager
def wordless() -> Generator[None]:
    """Keep what libraries in C print themselves, as Qhull does of narrow meshes, off the console."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no console to keep it off
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
