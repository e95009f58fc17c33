"""Runs of a mechanism in MuJoCo under a motion of its crank, or under its motion laws."""

from typing import Any

from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import CrankProfile, State, within_range
from mechsim.numerics.arrays import Array
from mechsim.simulation.run import Run, simulate


def profile_of(
    solver: KinematicSolver, speed: float, turns: float, through: float | None = None
) -> CrankProfile:
    """Return the crank's motion: whole revolutions, or one swing of a crank that cannot turn fully.

    The swing passes the angle `through`, by default that of the start. Under motion laws the motion is that
    of their path parameter.
    """
    if not solver.motion_laws.crank:
        return solver.motion_laws.path_profile
    if not (turns != 0.0 and abs(turns) < 1e4):
        raise InputError(f"{turns:g} turns; give turns other than 0, fewer than 10000 either way")
    return within_range(
        solver.mechanism, solver.crank_range(), speed if turns > 0 else -speed, abs(turns), through
    )


def scaled_law(law: State, factor: float, offset: float = 0.0) -> State:
    """Return a motion law times a factor, plus an offset."""

    def scaled(time: Array) -> tuple[Array, Array, Array]:
        value, rate, acceleration = law(time)
        return factor * value + offset, factor * rate, factor * acceleration

    return scaled


def simulated(solver: KinematicSolver, profile: CrankProfile, **options: Any) -> Run:
    """Return a run in MuJoCo under the motion laws of the drivers, or else under the crank motion."""
    return simulate(solver, **driven_as(solver, profile), **options)


def driven_as(solver: KinematicSolver, profile: CrankProfile) -> dict[str, Any]:
    """Return the driver motion of a run as arguments: motion laws of the drivers, or a crank motion."""
    return {"profile": profile} if solver.motion_laws.crank else {"motion_laws": solver.motion_laws}
