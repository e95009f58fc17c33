"""Motions to draw, and what acts in the joints over them, by the closed form or by MuJoCo."""

from typing import Any

import numpy as np

from mechsim.analytic import dynamics
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import InputError
from mechsim.model.force_record import ForceRecord
from mechsim.model.forces import Forces
from mechsim.model.motion import Motion
from mechsim.model.motion_laws import CrankProfile, within_range
from mechsim.simulation import Run, simulate
from mechsim.simulation.dynamics.prescribed_motion import driven

# what one picture or video may hold
MOST_SAMPLES = 100_000
WEIGHT = Forces(gravity=(0.0, -9.81, 0.0))


def profile_of(
    solver: KinematicSolver, speed: float, turns: float, through: float | None = None
) -> CrankProfile:
    """Return the crank's motion: whole turns, or for a crank that cannot turn fully one swing to and fro.

    The swing passes a crank angle, or where assembly begins. Of motion laws it is their path parameter.
    """
    if not solver.motion_laws.crank:
        return solver.motion_laws.path_profile
    if not (turns != 0.0 and abs(turns) < 1e4):
        raise InputError(f"{turns:g} turns; give turns other than 0, fewer than 10000 either way")
    return within_range(
        solver.mechanism, solver.crank_range(), speed if turns > 0 else -speed, abs(turns), through
    )


def simulated(solver: KinematicSolver, profile: CrankProfile, **options: Any) -> Run:
    """Return a run in MuJoCo under the motion laws of the drivers, or else under the motion of the crank."""
    return simulate(solver, **driven_as(solver, profile), **options)


def driven_as(solver: KinematicSolver, profile: CrankProfile) -> dict[str, Any]:
    """Return what drives a run in MuJoCo: the motion laws of the drivers, or a motion of the crank."""
    return {"profile": profile} if solver.motion_laws.crank else {"motion_laws": solver.motion_laws}


def drawn_motion(solver: KinematicSolver, method: str, profile: CrankProfile, samples: float) -> Motion:
    """Return a motion to be drawn, with so many evenly spread samples after the first.

    Args:
        solver: what moves.
        method: "closed", "simulated" (stepped by MuJoCo) or "posed" (solved by it pose by pose).
        profile: of the crank.
        samples: how many; rounded.
    """
    if method not in ("closed", "simulated", "posed"):
        raise InputError(f"there is no method {method!r}; known are closed, simulated and, to draw, both")
    count = round(samples)
    if not 1 <= count <= MOST_SAMPLES:
        raise InputError(f"{samples:g} frames or samples asked for; give 1 to {MOST_SAMPLES}")
    if method == "closed":
        return solver.solve_along(*profile.state(np.linspace(0.0, profile.duration, count + 1)))
    method = "step" if method == "simulated" else "pose"
    return simulated(solver, profile, samples=count, method=method).motion


def weighing(solver: KinematicSolver) -> dynamics.DynamicModel:
    """Return a mechanism under what its file says acts on it; else links of steel that weigh."""
    return dynamics.dynamic_model(solver, solver.forces or WEIGHT)


def joint_loads(
    solver: KinematicSolver, method: str, profile: CrankProfile, motion: Motion
) -> dict[str, Any]:
    """Return forces and moments in the joints at the samples of a motion, by the same method as the motion.

    They act on the link b of each joint, under what acts as `weighing` has it.
    """
    if method == "simulated":
        reactions = simulated_forces(solver, profile, len(motion) - 1).reactions
    else:
        instants = (motion.angle, motion.speed, motion.acceleration)
        study = dynamics.prescribed(weighing(solver), *instants, time=motion.time, as_run=motion)
        reactions = study.forces.reactions
    forces = {name: reaction.force for name, reaction in reactions.items()}
    # a moment that the largest force makes on a billionth of the size is rounding, and no arrow
    least = (
        1e-9
        * solver.mechanism.characteristic_length
        * max(float(np.abs(force).max()) for force in forces.values())
    )
    moments = {
        name: np.where(np.abs(reaction.moment) > least, reaction.moment, 0.0)
        for name, reaction in reactions.items()
    }
    return {"forces": forces, "moments": moments}


def simulated_forces(solver: KinematicSolver, profile: CrankProfile, samples: int) -> ForceRecord:
    """Return MuJoCo's efforts along a motion, under what acts as `weighing` has it."""
    model = weighing(solver.starting_at(profile.angles))
    return driven(model.mechanism, model.forces, samples=samples, **driven_as(solver, profile)).forces
