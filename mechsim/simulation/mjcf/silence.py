"""MuJoCo's own log kept off the console and out of the user's folder while mechsim runs it."""

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
