"""Motions to draw by each method, and forces along them."""

from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.loops.record import tracked_points, with_all_joints
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import dynamic_model, prescribed
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import LinkMotion, Motion
from mechsim.mechanism.motion_laws import CrankProfile
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.motions import driven_as, simulated
from mechsim.studies.scene.own_settings import published_motion, runs_as_published

# largest number of samples of a picture or video
MAX_SAMPLES = 100_000


def drawn_motion(solver: KinematicSolver, method: str, profile: CrankProfile, samples: float) -> Motion:
    """Return a motion to draw, with evenly spread samples after the first.

    Args:
        solver: the mechanism's solver.
        method: "closed", "simulated" (stepped by MuJoCo) or "posed" (solved by it pose by pose). A file that
            MuJoCo can run is stepped with its own settings, so that its drift is shown.
        profile: of the crank.
        samples: number of samples; rounded.
    """
    if method not in ("closed", "simulated", "posed"):
        raise InputError(f"there is no method {method!r}; choose closed, simulated or both")
    count = round(samples)
    if not 1 <= count <= MAX_SAMPLES:
        raise InputError(f"{samples:g} frames or samples requested; give 1 to {MAX_SAMPLES}")
    if method == "closed":
        return solver.solve_along(*profile.state(np.linspace(0.0, profile.duration, count + 1)))
    if method == "simulated":
        return stepped(solver, profile, count)
    return simulated(solver, profile, samples=count, method="pose").motion


def is_undriven(solver: KinematicSolver) -> bool:
    """Return whether neither a crank nor motion laws move a mechanism."""
    return solver.motion_laws.crank and not solver.mechanism.has_crank


def moved_by_forces(solver: KinematicSolver) -> bool:
    """Return whether only its own forces move a mechanism: it is drawn in a run from its start."""
    return is_undriven(solver) and solver.forces is not None


def initial_pose(mechanism: Mechanism) -> Motion:
    """Return the initial pose of a mechanism, as a motion of one instant."""
    rest, zero = np.zeros((1, 3)), np.zeros(1)
    links = {
        name: LinkMotion(pose.position[None], pose.rotation[None], rest, rest, rest, rest)
        for name, pose in start_poses(mechanism)[0].items()
    }
    motion = Motion("pose", zero, zero, zero, tracked_points(mechanism, links), links, time=zero)
    return with_all_joints(mechanism, motion)


def stepped(solver: KinematicSolver, profile: CrankProfile, samples: int) -> Motion:
    """Return a motion stepped by MuJoCo, of a file that MuJoCo can run with its own settings."""
    if runs_as_published(solver):
        return published_motion(solver, profile, samples)
    return simulated(solver, profile, samples=samples, method="step").motion


def joint_loads(
    solver: KinematicSolver, method: str, profile: CrankProfile, motion: Motion
) -> dict[str, Any]:
    """Return forces and moments in the joints at the samples of a motion, by the same method as the motion.

    They act on link b of each joint, under the masses and forces of `dynamic_model`.
    """
    if method == "simulated":
        model = dynamic_model(solver.starting_at(profile.angles))
        study = driven(model.mechanism, model.forces, samples=len(motion) - 1, **driven_as(solver, profile))
    else:
        instants = (motion.angle, motion.speed, motion.acceleration)
        study = prescribed(dynamic_model(solver), *instants, time=motion.time, as_run=motion)
    reactions = study.forces.reactions
    forces = {name: reaction.force for name, reaction in reactions.items()}
    # a moment smaller than the largest force times a billionth of the size is rounding and gets no arrow
    largest = max(float(np.abs(force).max()) for force in forces.values())
    least = 1e-9 * solver.mechanism.characteristic_length * largest
    moments = {
        name: np.where(np.abs(reaction.moment) > least, reaction.moment, 0.0)
        for name, reaction in reactions.items()
    }
    return {"forces": forces, "moments": moments}
