"""Models of the suites, TOML files in models/, released from their initial state."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics.arrays import Array

MODELS = Path(__file__).parent / "models"


def entries(suite: str) -> dict[str, dict[str, Any]]:
    """Return the cases of a suite, a file in models/."""
    return tomllib.loads((MODELS / f"{suite}.toml").read_text())


def model_of(name: str) -> KinematicSolver:
    """Return a model, such as "modelica/NAME"."""
    return ms.load(str(MODELS / f"{name}.toml"), still=True)


def run_of(model: KinematicSolver, duration: float, samples: int = 500) -> ms.dynamics.DynamicRun:
    """Return the run of a model; drivers with motion laws follow them.

    Raises:
        InputError: if the run does not reach its end.
    """
    laws = model.motion_laws.drivers
    run = ms.dynamics.run(model, prescribed=laws, duration=duration, samples=samples)
    if run.outcome != "done":
        raise ms.InputError(run.reason)
    return run


def columns(run: ms.dynamics.DynamicRun) -> dict[str, Array]:
    """Return the columns of a run, and LINK.wx to LINK.wz, angular velocities in the links' own frames."""
    own = dict(run.columns())
    for name, link in run.motion.links.items():
        rates = np.einsum("nji,nj->ni", link.rotation, link.angular_velocity)
        own |= {f"{name}.w{axis}": column for axis, column in zip("xyz", rates.T, strict=True)}
    return own
