"""A run in MuJoCo of whatever `load` takes: a name or a file, beside what is a model already."""

from functools import wraps
from os import PathLike
from typing import Any

from mechsim.simulation import Run
from mechsim.simulation import simulate as simulated
from mechsim.subjects.subject import MODELS, load


@wraps(simulated)
def simulate(source: Any, *given: Any, **options: Any) -> Run:
    """Run a model in MuJoCo: as `mechsim.simulation.simulate`, and by a name or a file that `load` takes."""
    if isinstance(source, str | PathLike):
        text = str(source)
        # MJCF is MuJoCo's own: its text or file is run as it is
        if "<" not in text and not text.lower().endswith(MODELS):
            source = load(source)
    return simulated(source, *given, **options)
