"""Drivers that the loop constraints do not allow to move independently: at least one is redundant."""

import numpy as np

from mechsim.errors import MobilityError
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE
from mechsim.simulation.model_loops import ModelLoops

# residual, relative to the largest Jacobian entry, above which the other DOFs cannot follow a driver
LOCKED_FRACTION = 1e-6


def immobile_drivers(loops: ModelLoops, jacobian: Array) -> tuple[str, ...]:
    """Return the crank, or the drivers, that cannot move while the other drivers are locked.

    Args:
        loops: of the model.
        jacobian: at one state, (m, nv).
    """
    names, moves = ("crank",), -jacobian[:, [loops.crank]]
    if loops.drivers is not None:
        names, moves = loops.drivers.names, np.eye(len(jacobian))[:, -len(loops.drivers.names) :]
    held = loops.constrained_jacobian(jacobian[None])[0]
    missed = np.abs(held @ (np.linalg.pinv(held, rcond=RANK_TOLERANCE) @ moves) - moves).max(0, initial=0.0)
    bound = max(LOCKED_FRACTION * float(np.abs(jacobian).max(initial=0.0)), loops.rounding)
    return tuple(name for name, miss in zip(names, missed, strict=True) if not miss <= bound)


def overdetermined_error(loops: ModelLoops, locked: tuple[str, ...], angle: float) -> MobilityError:
    """Return the error that names the immobile drivers; `angle` is the crank's, in [rad]."""
    if loops.drivers is None:
        said = f"the loops leave the crank no motion at {loops.driver_text(angle)}"
        remedy = "take away a driver, a gear or a joint"
    else:
        others = "the other drivers are" if len(loops.drivers.names) > 1 else "all else is"
        said = f"the loops do not let {', '.join(locked)} move while {others} held"
        remedy = "take away a driver, a coupling, a hold or a joint"
    return MobilityError(f"{loops.name}: overdetermined: {said}; {remedy}", "overdetermined")
