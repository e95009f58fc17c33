"""The motion of a mechanism under programs of its drivers, from its loop equations alone."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.loops.checked_start import checked_start
from mechsim.analytic.loops.continuation_path import ContinuationPath, PathNames
from mechsim.analytic.loops.crank_motion import motion_record
from mechsim.analytic.loops.loop_solver import LoopSolver, loop_solver
from mechsim.analytic.loops.tree_assembly import locked_values, with_locked
from mechsim.analytic.loops.tree_rates import Instants, loop_motion
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import ChangePointPolicy, Motion
from mechsim.model.motion_laws import MotionLaws
from mechsim.numerics.arrays import Array


def path_under_laws(
    mechanism: Mechanism, motion_laws: MotionLaws, change_point: ChangePointPolicy = "smooth"
) -> ContinuationPath:
    """Return the path of a mechanism's assembly over the angle of its programs' clock, begun at time zero.

    Args:
        mechanism: its guess says which assembly is meant, and where the drivers stand in it; from there they
            go straight to where the programs begin.
        motion_laws: of its drivers.
        change_point: "smooth" or "branch" where two assemblies meet.

    Raises:
        AssemblyError: where the loops do not close at the guess or on the way to where the programs begin.
        MobilityError: where the drivers leave joints or tracked points open, or are too many.
    """
    first = checked_start(mechanism)
    locked = locked_values(mechanism)

    def prescribed(parameter: Array) -> Array:
        return with_locked(motion_laws.by_clock(parameter)[0], locked)

    first = _moved_to_start(first, prescribed(np.zeros(1)), change_point)
    names = PathNames(
        "the drivers",
        motion_laws.called,
        lambda parameter: f"{motion_laws.called(parameter)} of the programs",
    )
    return ContinuationPath(first, prescribed, 0.0, change_point, names)


def _moved_to_start(first: LoopSolver, target: Array, policy: ChangePointPolicy) -> LoopSolver:
    """Return what solves the loops where what is prescribed, (driven, 1), has gone straight to its place."""
    loops, driven = first.loops, list(first.loops.driven)
    start = first.reference.values[driven]
    distance = float(np.abs((target - start) / loops.units[driven, None]).max())
    if distance == 0.0:
        return first

    def prescribed(s: Array) -> Array:
        return start + (target - start) * (s / distance)

    def position(s: float) -> str:
        names = (*loops.tree.mechanism.drivers, *loops.tree.mechanism.locked)
        values = prescribed(np.array([s]))[:, 0]
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, values, strict=True))

    path_names = PathNames("the drivers on their way to where the programs begin", position, position)
    path = ContinuationPath(first, prescribed, 0.0, policy, path_names)
    path.reach(distance, 1)
    return loop_solver(loops, path.unflat(path.segments[1][-1].states[-1:], np.array([distance]), target))


def solve_under_laws(
    path: ContinuationPath, motion_laws: MotionLaws, parameter: Array, speed: Array, acceleration: Array
) -> Motion:
    """Return the motion at angles of the clock of programs, and its rates.

    Args:
        path: from `path_under_laws`.
        motion_laws: of the drivers.
        parameter: angles of the clock, (n,) in [rad].
        speed: of the clock, (n,) in [rad/s]; `motion_laws.pace` is real time.
        acceleration: of the clock, (n,) in [rad/s2].

    Raises:
        AssemblyError: at the time beyond which the loops cannot close in this assembly.
    """
    return solve_prescribed(path, motion_laws, instants_of_laws(motion_laws, parameter, speed, acceleration))


def instants_of_laws(
    motion_laws: MotionLaws, parameter: Array, speed: Array, acceleration: Array
) -> Instants:
    """Return where programs have their drivers at angles of their clock, at its rates, (n,) each."""
    value, first, second = motion_laws.by_clock(parameter)
    rate, second_rate = first * speed, first * acceleration + second * speed**2
    return Instants(parameter, speed, acceleration, value, rate, second_rate)


def solve_prescribed(path: ContinuationPath, motion_laws: MotionLaws, instants: Instants) -> Motion:
    """Return the motion where the drivers stand near their programs, at instants that say where.

    Raises:
        AssemblyError: as `solve_under_laws`.
    """
    all_instants = with_locked_values(path, instants)
    motion = motion_record(
        path,
        loop_motion(path, all_instants),
        all_instants.parameter,
        all_instants.speed,
        all_instants.acceleration,
    )
    return replace(motion, time=instants.parameter / motion_laws.pace, drivers=motion_laws.drivers)


def with_locked_values(path: ContinuationPath, instants: Instants) -> Instants:
    """Return instants of which only the drivers are told, with what is held."""
    locked = locked_values(path.loops.tree.mechanism)
    return replace(
        instants,
        value=with_locked(instants.value, locked),
        rate=with_locked(instants.rate, 0.0 * locked),
        second=with_locked(instants.second, 0.0 * locked),
    )
