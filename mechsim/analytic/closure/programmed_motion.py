"""The motion of a mechanism under programs of its drivers, from its loop equations alone."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.closure.checked_start import checked_start
from mechsim.analytic.closure.followed_path import FollowedPath, Words
from mechsim.analytic.closure.loop_solver import LoopSolver, loop_solver
from mechsim.analytic.closure.tree_assembly import held_values, with_holds
from mechsim.analytic.closure.tree_rates import Instants, loop_motion
from mechsim.analytic.closure.whole_motion import recorded
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import ChangePointPolicy, Motion
from mechsim.model.programs import Programs


def followed_under(
    mechanism: Mechanism, programs: Programs, change_point: ChangePointPolicy = "smooth"
) -> FollowedPath:
    """Return the path of a mechanism's assembly over the angle of its programs' clock, begun at time zero.

    Args:
        mechanism: its guess says which assembly is meant, and where the drivers stand in it; from there they
            go straight to where the programs begin.
        programs: of its drivers.
        change_point: "smooth" or "branch" where two assemblies meet.

    Raises:
        AssemblyError: where the loops do not close at the guess or on the way to where the programs begin.
        MobilityError: where the drivers leave joints or tracked points open, or are too many.
    """
    first = checked_start(mechanism)
    held = held_values(mechanism)

    def drive(clock: Array) -> Array:
        return with_holds(programs.by_clock(clock)[0], held)

    first = _begun(first, drive(np.zeros(1)), change_point)
    words = Words("the drivers", programs.called, lambda clock: f"{programs.called(clock)} of the programs")
    return FollowedPath(first, drive, 0.0, change_point, words)


def _begun(first: LoopSolver, there: Array, through: ChangePointPolicy) -> LoopSolver:
    """Return what solves the loops where what is prescribed, (driven, 1), has gone straight to its place."""
    loops, driven = first.loops, list(first.loops.driven)
    here = first.pinned.values[driven]
    far = float(np.abs((there - here) / loops.units[driven, None]).max())
    if far == 0.0:
        return first

    def straight(s: Array) -> Array:
        return here + (there - here) * (s / far)

    def place(s: float) -> str:
        names = (*loops.tree.mechanism.drivers, *loops.tree.mechanism.locked)
        values = straight(np.array([s]))[:, 0]
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, values, strict=True))

    words = Words("the drivers on their way to where the programs begin", place, place)
    way = FollowedPath(first, straight, 0.0, through, words)
    way.reach(far, 1)
    return loop_solver(loops, way.unflat(way.cells[1][-1].states[-1:], np.array([far]), there))


def solve_programmed(
    path: FollowedPath, programs: Programs, clock: Array, speed: Array, acceleration: Array
) -> Motion:
    """Return the motion at angles of the clock of programs, and its rates.

    Args:
        path: from `followed_under`.
        programs: of the drivers.
        clock: angles of the clock, (n,) in [rad].
        speed: of the clock, (n,) in [rad/s]; `programs.pace` is real time.
        acceleration: of the clock, (n,) in [rad/s2].

    Raises:
        AssemblyError: at the time beyond which the loops cannot close in this assembly.
    """
    return solve_prescribed(path, programs, clock_instants(programs, clock, speed, acceleration))


def clock_instants(programs: Programs, clock: Array, speed: Array, acceleration: Array) -> Instants:
    """Return where programs have their drivers at angles of their clock, at its rates, (n,) each."""
    value, first, second = programs.by_clock(clock)
    rate, bend = first * speed, first * acceleration + second * speed**2
    return Instants(clock, speed, acceleration, value, rate, bend)


def solve_prescribed(path: FollowedPath, programs: Programs, instants: Instants) -> Motion:
    """Return the motion where the drivers stand near their programs, at instants that say where.

    Raises:
        AssemblyError: as `solve_programmed`.
    """
    whole = held_too(path, instants)
    found = recorded(path, loop_motion(path, whole), whole.at, whole.speed, whole.acceleration)
    return replace(found, time=instants.at / programs.pace, drivers=programs.drivers)


def held_too(path: FollowedPath, instants: Instants) -> Instants:
    """Return instants of which only the drivers are told, with what is held."""
    held = held_values(path.loops.tree.mechanism)
    return replace(
        instants,
        value=with_holds(instants.value, held),
        rate=with_holds(instants.rate, 0.0 * held),
        second=with_holds(instants.second, 0.0 * held),
    )
