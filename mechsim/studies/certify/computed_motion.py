"""The motion to be certified, in coordinates of the loop equations at any path parameter."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.constraints import TreeLoops, cuts_of
from mechsim.kinematics.loops.kinematics import link_poses
from mechsim.kinematics.loops.motion import driven_path
from mechsim.kinematics.loops.path import LoopPath
from mechsim.kinematics.loops.start import with_locked
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.initial_state import rotation_matrices, rotation_quaternions
from mechsim.mechanism.mechanism import starting_at
from mechsim.mechanism.motion_laws import NOT_ENCLOSED, MotionLaws, state_in_balls
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.balls import OUTWARD, Ball, ball
from mechsim.numerics.rank import pivot_columns
from mechsim.studies.certify.loop_equations import ClosureEquations, loop_equations

# number of configurations that determine the independent equations
SAMPLES = 9


@dataclass(frozen=True, slots=True)
class CentreConfigurations:
    """Approximate configurations at n path parameters.

    Attributes:
        values: coordinates in [m] and [rad], zero for ball joints, (n, count).
        quaternions: rotation of side b relative to side a of each ball joint, real part first, (n, balls, 4).
    """

    values: Array
    quaternions: Array


@dataclass(frozen=True)
class ComputedMotion:
    """A motion traced by continuation, in the coordinates of the equations to be certified.

    Attributes:
        path: the traced path.
        motion_laws: motion laws of the drivers.
        equations: the equations to be certified.
        low, high: ends of the traced range of the path parameter.
        end_message: reason why the path does not cover the whole requested range; empty if it does.
    """

    path: LoopPath
    motion_laws: MotionLaws
    equations: ClosureEquations
    low: float
    high: float
    end_message: str

    def driven(self, s: Array) -> tuple[Array, Array, Array]:
        """Return prescribed coordinates and two derivatives by the path parameter, (n, driven) each."""
        mechanism = self.path.loops.tree.mechanism
        value, first, second = (
            with_locked(mechanism, driven, order).T
            for order, driven in enumerate(self.motion_laws.along_path(s))
        )
        return value, first, second

    def driver_spread(self, centre: Array, half: Array) -> Array:
        """Return bounds of the drivers' deviation from the tangents of `driven` on segments, (n, driven)."""
        spread = np.zeros((len(centre), len(self.equations.driven)))
        laws = self.motion_laws
        if laws.crank:
            return spread
        per_rate = ball(1.0) / laws.rate
        at_centre = ball(centre) * per_rate
        over = Ball(at_centre.mid, (at_centre.rad + half * per_rate.magnitude) * OUTWARD)
        value, rate, _ = self.driven(centre)
        for driver, state in enumerate(laws.states):
            exact_value, exact_rate, _ = state_in_balls(state, at_centre)
            second = state_in_balls(state, over)[2] * per_rate * per_rate
            off = (exact_value - value[:, driver]).magnitude
            off = off + (exact_rate * per_rate - rate[:, driver]).magnitude * half
            spread[:, driver] = (off + 0.5 * second.magnitude * half**2) * OUTWARD
        return spread

    def configurations(self, s: Array) -> CentreConfigurations:
        """Return the computed configurations at path parameters in ascending order, (n,)."""
        tree, reduced = self.path.loops.tree, self.equations.tree
        q = self.path.interpolated(s)
        values, turns = q.values.copy(), q.turns
        if reduced is not tree:
            poses = link_poses(tree, q).by_link({name: tree.index[name] for name in reduced.index})
            read = TreeLoops(reduced, cuts_of(reduced), (), ()).read(poses)
            values, turns = np.unwrap(read.values, axis=1), read.turns
            shared = [name for name in reduced.index_of if name in tree.index_of]
            values[[reduced.index_of[name] for name in shared]] = q.values[[tree.index_of[n] for n in shared]]
        values[reduced.ball_indices] = 0.0
        ball_rotations = [rotation_quaternions(rotation) for rotation in turns]
        return CentreConfigurations(values.T, np.array(ball_rotations).reshape(-1, len(s), 4).swapaxes(0, 1))

    def with_independent_rows(self) -> "ComputedMotion":
        """Return the motion with as many equations as unknowns, selected for best conditioning at samples."""
        equations, unknown = self.equations, self.equations.unknown
        s = np.linspace(self.low, self.high, SAMPLES)
        samples = self.configurations(s)
        samples.values[:, equations.driven] = self.driven(s)[0]
        matrices = (rotation_matrices(rows) for rows in samples.quaternions.swapaxes(0, 1))
        turns = [ball(np.moveaxis(matrix, -1, 0)) for matrix in matrices]
        jacobians = equations.evaluate(ball(samples.values[..., None]), turns)[1].mid[..., unknown]
        choices = [np.sort(pivot_columns(jacobian.T)[0][: len(unknown)]) for jacobian in jacobians]
        values = [np.linalg.svd(jacobians[:, rows], compute_uv=False) for rows in choices]
        chosen = equations.kept[choices[int(np.argmax([value.min(initial=np.inf) for value in values]))]]
        return replace(self, equations=replace(equations, selected=tuple(chosen.tolist())))


def law_not_enclosed(laws: MotionLaws) -> str | None:
    """Return the first driver whose motion law interval arithmetic cannot enclose; None for none."""
    for name, state in laws.by_name.items():
        try:
            state_in_balls(state, Ball(np.zeros(1), np.ones(1)))
        except NOT_ENCLOSED:
            return name
    return None


def computed_motion(
    solver: KinematicSolver, between: tuple[float, float] | None, radii: Mapping[str, Array]
) -> ComputedMotion:
    """Return the motion of a mechanism over the traceable part of a range of its path parameter.

    Args:
        solver: solver of the mechanism.
        between: range of the path parameter; None for the whole range.
        radii: as in `ClosureEquations`.
    """
    if between is not None:
        solver = starting_at(solver, np.array(between))
    path = driven_path(solver.mechanism, solver.motion_laws, "smooth")
    message = ""
    ends: list[float] = []
    for end in between or _whole_range(solver, path):
        try:
            path.extend(end)
            ends.append(end)
        except AssemblyError as error:
            message = str(error)
            ends.append(path.end(1 if end > path.initial else -1))
    offsets = tuple(float(round(offset / REVOLUTION)) for offset in path.loops.turn_offsets)
    equations = loop_equations(path.loops.tree.mechanism, offsets, radii)
    return ComputedMotion(path, solver.motion_laws, equations, ends[0], ends[1], message)


def _whole_range(solver: KinematicSolver, path: LoopPath) -> tuple[float, float]:
    """Return the range of a motion: a period, or the reachable interval of the crank about its start."""
    start, period = path.initial, solver.period
    if not solver.motion_laws.crank:
        return 0.0, period
    with suppress(AssemblyError):
        path.extend(start + period)
        return start, start + period
    return start - period, start + period
