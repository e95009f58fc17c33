"""Derivatives of a motion by dimensions, at the same driver positions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError, InputError
from mechsim.kinematics.derivatives.dimensions import GivenMechanism, numbers_of, with_numbers
from mechsim.kinematics.loops.constraints import TreeLoops, cuts_of
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinematics.loops.motion import (
    driven_path,
    instants_of_laws,
    motion_along,
    motion_record,
    with_locked_values,
)
from mechsim.kinematics.loops.path import (
    ClosedChunk,
    Instants,
    LoopMotion,
    LoopPath,
    closed_chunks,
    merged,
    with_rates,
)
from mechsim.kinematics.loops.tree import SpanningTree
from mechsim.kinematics.path_instants import crank_motion
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.link_poses import split_joints
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion, mapped
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import STEP, change_of, stepped

# largest residual in redundant loops that a dimension may cause, relative to the change of the loops
INCONSISTENT = 1e-6


@dataclass(frozen=True, slots=True)
class MotionDerivatives:
    """A motion and its derivatives by dimensions.

    Attributes:
        motion: the motion by loop equations.
        by: dimension -> derivatives of positions, rates and accelerations at fixed driver positions, in SI
            per SI unit of the dimension.
    """

    motion: Motion
    by: Mapping[str, Motion]


@dataclass(frozen=True)
class TracedMotion:
    """A solved motion, the starting point for motions with other dimensions.

    Attributes:
        solver: the solver.
        mechanism: its mechanism, with masses if needed.
        path: continuation path of its assembly mode.
        instants: instants along the path.
        chunks: the instants in chunks, with solved configurations.
        perturbed: the mechanism as numbers, if it differs from that of the path.
    """

    solver: KinematicSolver
    mechanism: Mechanism
    path: LoopPath
    instants: Instants
    chunks: Sequence[ClosedChunk]
    perturbed: GivenMechanism | None = None

    def motion(self) -> Motion:
        """Return the motion itself."""
        chunks = [(chunk.index, with_rates(self.path, chunk)) for chunk in self.chunks]
        return self._record(merged(chunks), self.perturbed)

    def _record(self, moved: LoopMotion, mechanism: GivenMechanism | None) -> Motion:
        """Return a motion as a record, without conditioning if the mechanism has other numbers."""
        instants, laws, conditioning = self.instants, self.solver.motion_laws, None
        described = self.path.loops.tree.original if mechanism is None else mechanism
        record = motion_record(self.path, moved, instants, described)
        if mechanism is None:
            conditioning = record.conditioning
        time = laws.time(instants.parameter)
        return replace(record, conditioning=conditioning, time=time, drivers=laws.drivers)

    def changed(self, name: str, derivative: Array | None) -> tuple[Mechanism, Motion]:
        """Return the mechanism and the motion with the changes by a dimension as imaginary parts.

        Args:
            name: name of the dimension.
            derivative: derivatives of the mechanism's numbers by it, (k,); None changes the driver positions.

        Raises:
            AssemblyError: if the dimension alone makes redundant loop equations inconsistent.
        """
        nominal, ahead = numbers_of(self.mechanism), float(derivative is None)
        derivative = np.zeros(len(nominal)) if derivative is None else derivative
        if derivative.shape != nominal.shape or not np.isfinite(derivative).all():
            raise InputError(
                f"the change by {name!r} has shape {derivative.shape} or is not finite; the mechanism has "
                f"{len(nominal)} numbers: use the result of `changes`"
            )
        mechanism = with_numbers(self.mechanism, stepped(nominal, derivative))
        step = STEP * max(
            ahead, float(np.abs(derivative).max()) * min(1.0, 1.0 / mechanism.characteristic_length)
        )

        def changed(chunk: ClosedChunk) -> LoopMotion:
            """Return the motion of a chunk in complex numbers, with imaginary parts at most as in the input.

            Driver positions are increased by `ahead` imaginary steps.
            """
            loops = with_mechanism(chunk.solver.loops, mechanism)
            reference, q = (
                Coordinates(own.values.astype(complex), own.turns.astype(complex))
                for own in (chunk.solver.reference, chunk.q)
            )
            solver = replace(chunk.solver, loops=loops, reference=reference)
            steps = dict.fromkeys(mechanism.drivers, STEP * ahead)
            steps |= {locked: np.imag(value) for locked, value in mechanism.locked.items()}
            for coordinate, change in steps.items():
                q.values[loops.tree.index_of[coordinate]] += 1j * change
            before = solver.linearise(q)
            q = loops.displaced(q, solver.whole_step(-before.solution(before.rhs)))
            linearised = solver.linearise(q)
            torn = np.abs(linearised.residual.imag).max(initial=0.0)
            residual_change = np.abs(before.residual.imag).max(initial=0.0)
            if not torn <= INCONSISTENT * max(residual_change, step):
                raise AssemblyError(
                    f"{mechanism.name}: {name} alone makes redundant loop equations inconsistent (as a tilt "
                    "out of the plane of a planar linkage does); change the related dimensions, too"
                )
            moved = replace(chunk, solver=solver, q=q, linearised=linearised)
            return with_rates(self.path, moved, conditioned=False)

        chunks = [(chunk.index, changed(chunk)) for chunk in self.chunks]
        return mechanism, self._record(merged(chunks), mechanism)

    def with_dimensions(
        self, mechanism: Mechanism, ahead: float = 0.0, reach: float = np.inf
    ) -> "TracedMotion":
        """Return the motion of a mechanism with the same links, joints and drivers but other dimensions.

        Its assembly mode is that reached by a continuous change of the dimensions.

        Args:
            mechanism: the mechanism.
            ahead: increase of the driver positions, in [rad] or [m].
            reach: largest total displacement of coordinates, in [rad] or characteristic lengths.

        Raises:
            AssemblyError: where the loops do not close, or another assembly mode is too near to distinguish.
        """
        target = with_numbers(self.solver.mechanism, numbers_of(mechanism))
        chunks = [_closed(chunk, target, ahead, reach) for chunk in self.chunks]
        return replace(self, mechanism=mechanism, chunks=chunks, perturbed=target)


def motion_derivatives(
    solver: KinematicSolver,
    change: Mapping[str, Array | None],
    angles: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    torn: bool = False,
) -> MotionDerivatives:
    """Return a motion and its exact derivatives by dimensions, by the loop equations.

    Args:
        solver: the solver.
        change: dimension -> derivatives of the mechanism's numbers, from `changes`; None for the derivative
            by the driver positions, all changed equally.
        angles: path parameters, (n,) in [rad].
        speed: rate of the path parameter, scalar or (n,) in [rad/s].
        acceleration: its second derivative, scalar or (n,) in [rad/s2].
        torn: whether dimensions that alone make redundant loop equations inconsistent are left out silently.

    Raises:
        AssemblyError: where the loops do not close, at change points, where derivatives are unbounded, or if
            a dimension alone makes redundant loop equations inconsistent.

    Accuracy: about 1e-15 times the condition number of the loops.
    """
    return derivatives_along(followed_motion(solver, angles, speed, acceleration), change, torn=torn)


def derivatives_along(
    followed: TracedMotion, change: Mapping[str, Array | None], *, torn: bool = False
) -> MotionDerivatives:
    """Return a solved motion and its derivatives; as `motion_derivatives`."""
    motions: dict[str, Motion] = {}
    for name, derivative in change.items():
        try:
            motions[name] = derivative_of(followed.changed(name, derivative)[1])
        except AssemblyError:
            if not torn:
                raise
    return MotionDerivatives(followed.motion(), motions)


def followed_motion(
    solver: KinematicSolver, angles: ArrayLike, speed: ArrayLike = 1.0, acceleration: ArrayLike = 0.0
) -> TracedMotion:
    """Return a motion by loop equations; parameters as in `motion_derivatives`.

    Raises:
        AssemblyError: where the loops do not close, or at a change point.
    """
    angle, *rates = crank_motion(solver.name, angles, speed, acceleration)
    motion_laws = solver.motion_laws
    path = driven_path(solver.mechanism, motion_laws, solver.change_point)
    if motion_laws.crank:
        path, _ = motion_along(path, angle, *rates)
    instants = with_locked_values(path.loops, instants_of_laws(motion_laws, angle, *rates))
    chunks = list(closed_chunks(path, instants))
    singular = path.near_change_point(angle)
    if singular.any():
        where = path.words.instant(float(angle[np.argmax(singular)]))
        raise AssemblyError(
            f"{solver.name}: {where} is a change point, where derivatives by dimensions are unbounded; "
            "keep away from it"
        )
    return TracedMotion(solver, solver.mechanism, path, instants, chunks)


def with_mechanism(loops: TreeLoops, mechanism: GivenMechanism) -> TreeLoops:
    """Return the loops for a mechanism with other numbers."""
    old = loops.tree
    parted = {joint.name for joint in old.original.joints if joint not in old.mechanism.joints}
    own = split_joints(mechanism, parted) if parted else mechanism
    joints = {joint.name: joint for joint in own.joints}
    branches = (
        replace(branch, joint=joint, ends=joint.sides)
        for branch in old.branches
        for joint in [joints[branch.joint.name]]
    )
    tree = SpanningTree(own, mechanism, tuple(branches), tuple(joints[cut.name] for cut in old.cuts))
    return replace(loops, tree=tree, cuts=cuts_of(tree))


def derivative_of(motion: Motion) -> Motion:
    """Return the derivatives in a complex motion as a record of positions, rates and accelerations."""

    def derivative(array: Array) -> Array:
        return change_of(array) if np.iscomplexobj(array) else array

    return replace(mapped(derivative, motion), conditioning=None)


# Newton's method: largest number of steps, largest step, step that ends it, residual of a solution
MAX_STEPS, MAX_STEP, LAST_STEP, SOLVED = 20, 0.5, 1e-10, 1e-10


def _closed(chunk: ClosedChunk, mechanism: GivenMechanism, ahead: float, reach: float) -> ClosedChunk:
    """Return the configurations of a mechanism with other dimensions, by Newton's method."""
    loops = with_mechanism(chunk.solver.loops, mechanism)
    solver = replace(chunk.solver, loops=loops)
    side, q = np.sign(chunk.linearised.signed_distance), replace(chunk.q, values=chunk.q.values.copy())
    for name, value in mechanism.locked.items():
        q.values[loops.tree.index_of[name]] = value
    for driver in mechanism.drivers:
        q.values[loops.tree.index_of[driver]] += ahead
    linearised, displacement = solver.linearise(q), 0.0
    for _ in range(MAX_STEPS):
        step = solver.step(linearised.matrix, linearised.rhs)
        longest = float(np.abs(step).max(initial=0.0))
        displacement += longest
        if not (longest < MAX_STEP and displacement < reach):
            break
        q = loops.displaced(q, step)
        linearised = solver.linearise(q)
        if longest < LAST_STEP:
            break
    gap = float(np.abs(linearised.residual).max(initial=0.0))
    if not gap <= SOLVED or (np.sign(linearised.signed_distance) != side).any():
        raise AssemblyError(
            f"{mechanism.name}: with these dimensions the loops do not close in this assembly mode at "
            "all instants; use smaller changes"
        )
    return replace(chunk, solver=solver, q=q, linearised=linearised)
