"""Derivatives of a motion by dimensions, at the same values of the drivers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.derivatives.parameter_vector import GivenMechanism, numbers_of, with_numbers
from mechsim.analytic.loops.constraints import TreeLoops, cuts_of
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.motion import (
    driven_path,
    instants_of_laws,
    motion_along,
    motion_record,
    with_locked_values,
)
from mechsim.analytic.loops.oracle import crank_angles, crank_rate
from mechsim.analytic.loops.path import ContinuationPath
from mechsim.analytic.loops.path_rates import (
    ClosedChunk,
    Instants,
    LoopMotion,
    closed_chunks,
    merged,
    with_rates,
)
from mechsim.analytic.loops.tree import SpanningTree
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError, InputError
from mechsim.model.link_poses import split
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import STEP, change_of, stepped

# largest residual that a dimension may open in redundant loops, relative to the change of the loops
TORN = 1e-6


@dataclass(frozen=True, slots=True)
class MotionDerivatives:
    """A motion and its derivatives by dimensions.

    Attributes:
        motion: by loop equations.
        by: dimension -> derivatives of all that the motion holds, in its SI units per SI unit of the
            dimension: of places, rates and accelerations, the drivers held as they are.
    """

    motion: Motion
    by: Mapping[str, Motion]


@dataclass(frozen=True)
class Followed:
    """A motion that was followed once, from which those with other dimensions begin.

    Attributes:
        solver: what moves.
        mechanism: its mechanism, with masses where they count.
        path: of its assembly.
        instants: along it.
        chunks: the instants, closed.
        perturbed: the mechanism as numbers, where it is another than the path's own.
    """

    solver: KinematicSolver
    mechanism: Mechanism
    path: ContinuationPath
    instants: Instants
    chunks: Sequence[ClosedChunk]
    perturbed: GivenMechanism | None = None

    def motion(self) -> Motion:
        """Return the motion itself."""
        record = merged([(chunk.index, with_rates(self.path, chunk)) for chunk in self.chunks])
        return record_of(self.path, record, self.instants, self.perturbed, self.solver)

    def changed(self, name: str, derivative: Array | None) -> tuple[Mechanism, Motion]:
        """Return the mechanism and the motion whose imaginary parts are the changes by a dimension.

        Args:
            name: of the dimension.
            derivative: derivatives of the mechanism's numbers by it, (k,); None puts the drivers ahead.

        Raises:
            AssemblyError: where it alone would leave loops open that repeat each other.
        """
        nominal, ahead = numbers_of(self.mechanism), float(derivative is None)
        derivative = np.zeros(len(nominal)) if derivative is None else derivative
        if derivative.shape != nominal.shape or not np.isfinite(derivative).all():
            raise InputError(
                f"the change by {name!r} has shape {derivative.shape} or is not finite; the mechanism has "
                f"{len(nominal)} numbers: take what `changes` gives"
            )
        mechanism = with_numbers(self.mechanism, stepped(nominal, derivative))
        step = STEP * max(
            ahead, float(np.abs(derivative).max()) * min(1.0, 1.0 / mechanism.characteristic_length)
        )
        chunks = [
            (chunk.index, _changed(self.path, chunk, mechanism, name, step, ahead)) for chunk in self.chunks
        ]
        return mechanism, record_of(self.path, merged(chunks), self.instants, mechanism, self.solver)


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
        solver: what moves.
        change: dimension -> derivatives of the mechanism's numbers, as `changes` gives them; None for that
            by the drivers themselves, all of them ahead by as much.
        angles: path parameters, (n,) in [rad].
        speed: of it, scalar or (n,) in [rad/s].
        acceleration: of it, scalar or (n,) in [rad/s2].
        torn: whether dimensions that changed alone would tear the loops are left out without a word.

    Raises:
        AssemblyError: where the loops do not close, where two assemblies meet, for derivatives have no bound
            there, or where a dimension changed alone would leave loops open that repeat each other.

    Accuracy: about 1e-15 times the condition of the loops, as the rates have it.
    """
    return derivatives_along(
        followed_motion(solver, solver.mechanism, angles, speed, acceleration), change, torn=torn
    )


def derivatives_along(
    followed: Followed, change: Mapping[str, Array | None], *, torn: bool = False
) -> MotionDerivatives:
    """Return a motion that was followed already, and its derivatives; as `motion_derivatives`."""
    motions: dict[str, Motion] = {}
    for name, derivative in change.items():
        try:
            motions[name] = derivative_of(followed.changed(name, derivative)[1])
        except AssemblyError:
            if not torn:
                raise
    return MotionDerivatives(followed.motion(), motions)


def followed_motion(
    solver: KinematicSolver,
    mechanism: Mechanism,
    angles: ArrayLike,
    speed: ArrayLike,
    acceleration: ArrayLike,
) -> Followed:
    """Return a motion, followed by loop equations; parameters as of `motion_derivatives`.

    Raises:
        AssemblyError: where the loops do not close, or two assemblies meet.
    """
    angle = crank_angles(mechanism, angles)
    rates = [
        crank_rate(mechanism, what, value, len(angle))
        for what, value in (("speed", speed), ("acceleration", acceleration))
    ]
    path, instants = driven_instants(solver, angle, *rates)
    chunks = list(closed_chunks(path, instants))
    singular = path.near_change_point(angle)
    if singular.any():
        where = path.words.instant(float(angle[np.argmax(singular)]))
        raise AssemblyError(
            f"{solver.name}: at {where} two assemblies meet, and derivatives by dimensions have no bound; "
            "keep away from it"
        )
    return Followed(solver, mechanism, path, instants, chunks)


def driven_instants(
    solver: KinematicSolver, angle: Array, speed: Array, acceleration: Array
) -> tuple[ContinuationPath, Instants]:
    """Return the path of what moves, and instants along it."""
    motion_laws = solver.motion_laws
    path = driven_path(solver.mechanism, motion_laws, solver.change_point)
    if motion_laws.crank:
        path, _ = motion_along(path, angle, speed, acceleration)
    return path, with_locked_values(path.loops, instants_of_laws(motion_laws, angle, speed, acceleration))


def _changed(
    path: ContinuationPath,
    chunk: ClosedChunk,
    mechanism: GivenMechanism,
    name: str,
    step: float,
    ahead: float,
) -> LoopMotion:
    """Return the motion of some instants with complex numbers, their imaginary parts at most as in the input.

    Drivers are ahead by so many imaginary steps.
    """
    loops = with_mechanism(chunk.solver.loops, mechanism)
    solver = replace(chunk.solver, loops=loops)
    q = Coordinates(chunk.q.values.astype(complex), chunk.q.turns.astype(complex))
    for name_of_locked, value in mechanism.locked.items():
        q.values[loops.tree.index_of[name_of_locked]] += 1j * np.imag(value)
    for driver in mechanism.drivers:
        q.values[loops.tree.index_of[driver]] += 1j * STEP * ahead
    before = solver.linearise(q)
    q = loops.displaced(q, solver.step(before.matrix, before.rhs))
    linearised = solver.linearise(q)
    torn = np.abs(linearised.residual.imag).max(initial=0.0)
    opened = np.abs(before.residual.imag).max(initial=0.0)
    if not torn <= TORN * max(opened, step):
        raise AssemblyError(
            f"{mechanism.name}: changed alone, {name} leaves the loops open, for joints repeat what "
            "others hold (as out of the plane of a flat linkage); change what goes with it, too"
        )
    return with_rates(path, replace(chunk, solver=solver, q=q, linearised=linearised))


def with_mechanism(loops: TreeLoops, mechanism: GivenMechanism) -> TreeLoops:
    """Return the same loops of a mechanism with other numbers."""
    old = loops.tree
    parted = {joint.name for joint in old.original.joints if joint not in old.mechanism.joints}
    own = split(mechanism, parted) if parted else mechanism
    branches = tuple(replace(branch, joint=own.joint(branch.joint.name)) for branch in old.branches)
    tree = SpanningTree(own, mechanism, branches, tuple(own.joint(cut.name) for cut in old.cuts))
    return replace(loops, tree=tree, cuts=cuts_of(tree))


def record_of(
    path: ContinuationPath,
    moved: LoopMotion,
    instants: Instants,
    mechanism: GivenMechanism | None,
    solver: KinematicSolver,
) -> Motion:
    """Return a motion as a record; of a mechanism with other numbers, without its conditioning."""
    described = path.loops.tree.original if mechanism is None else mechanism
    record = motion_record(path, moved, instants.parameter, instants.speed, instants.acceleration, described)
    if mechanism is not None:
        record = replace(record, conditioning=None)
    motion_laws = solver.motion_laws
    return replace(record, time=motion_laws.time(instants.parameter), drivers=motion_laws.drivers)


def derivative_of(motion: Motion) -> Motion:
    """Return the changes that a motion carries, as a record alike: of places, rates and accelerations."""
    records = {name: _imaginary(getattr(motion, name)) for name in ("points", "links", "joints")}
    return replace(motion, conditioning=None, **records)


def _imaginary(record: Any) -> Any:
    """Return a record's imaginary parts per step; instants and what is no number as they are."""
    if isinstance(record, np.ndarray):
        return change_of(record) if np.iscomplexobj(record) else record
    if isinstance(record, Mapping):
        return {key: _imaginary(value) for key, value in record.items()}
    if is_dataclass(record) and not isinstance(record, type):
        return replace(
            record, **{item.name: _imaginary(getattr(record, item.name)) for item in fields(record)}
        )
    return record


# Newton steps at the most, the longest that is taken, one that ends them, and a gap that is none
STEPS, MAX_STEP, SHORT, CLOSED = 20, 0.5, 1e-10, 1e-10


@dataclass(frozen=True)
class NearbyMotion:
    """A motion that is solved, from which those of other dimensions are.

    Attributes:
        solver: what moves.
        path: of its assembly.
        instants: along it.
        chunks: closed there.
        reach: how far coordinates may move in all to another mechanism, in [rad] or fractions of the size.
    """

    solver: KinematicSolver
    path: ContinuationPath
    instants: Instants
    chunks: tuple[ClosedChunk, ...]
    reach: float = np.inf

    def motion_of(self, mechanism: Mechanism, ahead: float = 0.0) -> Motion:
        """Return the motion of a mechanism with the same links, joints and drivers but other dimensions.

        Its drivers may all be ahead, by so much in [rad] or [m], of where the record says. It is in the
        assembly into which this one goes over as its dimensions become the other ones.

        Raises:
            AssemblyError: where the loops do not close, or another assembly is too near to be distinguished.
        """
        return self.followed(mechanism, ahead).motion()

    def followed(self, mechanism: Mechanism, ahead: float = 0.0) -> Followed:
        """Return that motion as one from which others begin, and derivatives are taken; as `of`."""
        own = self.solver.mechanism
        target = with_numbers(own, numbers_of(mechanism))
        chunks = [self._closed(chunk, target, ahead) for chunk in self.chunks]
        return Followed(self.solver, mechanism, self.path, self.instants, chunks, target)

    def _closed(self, chunk: ClosedChunk, mechanism: GivenMechanism, ahead: float) -> ClosedChunk:
        loops = with_mechanism(chunk.solver.loops, mechanism)
        solver = replace(chunk.solver, loops=loops)
        side, q = np.sign(chunk.linearised.signed_distance), replace(chunk.q, values=chunk.q.values.copy())
        for name, value in mechanism.locked.items():
            q.values[loops.tree.index_of[name]] = value
        for driver in mechanism.drivers:
            q.values[loops.tree.index_of[driver]] += ahead
        linearised, displacement = solver.linearise(q), 0.0
        for _ in range(STEPS):
            step = solver.step(linearised.matrix, linearised.rhs)
            longest = float(np.abs(step).max(initial=0.0))
            displacement += longest
            if not (longest < MAX_STEP and displacement < self.reach):
                break
            q = loops.displaced(q, step)
            linearised = solver.linearise(q)
            if longest < SHORT:
                break
        gap = float(np.abs(linearised.residual).max(initial=0.0))
        if not gap <= CLOSED or (np.sign(linearised.signed_distance) != side).any():
            raise AssemblyError(
                f"{mechanism.name}: with these dimensions the loops do not close in this assembly at all of "
                "its instants; change them by less"
            )
        return replace(chunk, solver=solver, q=q, linearised=linearised)


def nearby_motion(
    solver: KinematicSolver,
    angles: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    reach: float = np.inf,
) -> NearbyMotion:
    """Return a motion from which others near it are solved, at path parameters.

    Others are no farther than `reach`, as `NearbyMotion` has it.

    Raises:
        AssemblyError: where the loops do not close, or where two assemblies meet.
    """
    solution = followed_motion(solver, solver.mechanism, angles, speed, acceleration)
    return NearbyMotion(solver, solution.path, solution.instants, tuple(solution.chunks), reach)
