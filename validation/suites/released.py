"""Models of the suites, TOML files in models/, released from their initial state."""

from pathlib import Path

import numpy as np

import mechsim as ms
from mechsim.numerics.arrays import Array

MODELS = Path(__file__).parent / "models"


def released(model: str, duration: float, samples: int = 500) -> ms.dynamics.DynamicRun:
    """Return the run of a model, such as "modelica/NAME"; drivers with motion laws follow them.

    Raises:
        InputError: if the run does not reach its end.
    """
    solver = ms.load(str(MODELS / f"{model}.toml"), still=True)
    laws = solver.motion_laws.drivers
    run = ms.dynamics.run(solver, prescribed=laws, duration=duration, samples=samples)
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
