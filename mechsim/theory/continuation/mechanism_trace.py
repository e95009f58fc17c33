"""All curves of assemblies of a mechanism with one degree of freedom, from its guess and random starts."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.loops.loop_solver import loop_solver
from mechsim.analytic.loops.random_starts import poses_around_branch_point, random_poses, select
from mechsim.analytic.loops.tree_assembly import assembled
from mechsim.analytic.loops.tree_loops import TreeLoops
from mechsim.analytic.loops.tree_motion import Coordinates
from mechsim.analytic.loops.undetermined_joints import require_determined
from mechsim.errors import InputError, MobilityError
from mechsim.model.mechanism import Mechanism, described
from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array
from mechsim.theory.continuation.assembly_curve import AssemblyCurve
from mechsim.theory.continuation.curve_search import ON_CURVE, CurveSearch
from mechsim.theory.continuation.free_loops import FreeLoops, free_loops

# default number of random starts, default seed, and limit on the number
STARTS, SEED, MAX_STARTS = 300, 1, 100_000


@dataclass(frozen=True, slots=True)
class BranchPoint:
    """A pose at which curves of assemblies cross: from it the mechanism can continue along either.

    Attributes:
        angle: of the crank in [rad], on the first of the curves.
        locations: index of each curve that passes it, and its arc there; a curve may pass twice.
    """

    angle: float
    locations: tuple[tuple[int, float], ...]


@dataclass(frozen=True, slots=True)
class AssemblyTrace:
    """Every assembly of a mechanism, as closed curves.

    Attributes:
        mechanism: what was traced.
        curves: the first contains the mechanism's guess; the others by number of starts that ended on them.
        branch_points: where they cross each other or themselves.
        starts: number of random starts.
        closed: number of starts that converged to an assembly.
        seed: of the random numbers.
        left_out: assemblies that were not traced, and the reason; one sentence each.
    """

    mechanism: Mechanism
    curves: tuple[AssemblyCurve, ...]
    branch_points: tuple[BranchPoint, ...]
    starts: int
    closed: int
    seed: int
    left_out: tuple[str, ...] = ()

    __repr__ = short_repr


def _silent(message: str, fraction: float) -> None:
    pass


def trace(
    model: object,
    *,
    starts: int = STARTS,
    seed: int = SEED,
    progress: Callable[[str, float], None] = _silent,
) -> AssemblyTrace:
    """Trace every assembly of a mechanism with one degree of freedom, through all turning points.

    Assemblies form closed curves. If the crank rotates fully, a curve is one assembly over one revolution, or
    over as many as the gears need to repeat. If it only oscillates, a curve contains both assemblies between
    its dead centres. The first curve contains the mechanism's guess; the others are found from random starts
    and from branch points. A curve on which a fraction p of the starts ends is missed with probability
    (1 - p) to the power of the number of starts.

    Args:
        model: a mechanism, or a solver that has one.
        starts: number of random starts; 0 traces the curve of the guess and those connected to it.
        seed: of the random numbers: the same seed finds the same curves.
        progress: called with a description of the work and the fraction done, at least.

    Raises:
        InputError: unless starts and seed are whole numbers in range.
        AssemblyError: if the loops do not close at the guess, or its curve does not close: a slider or screw
            is unbounded, or the curve is longer than 3,000 segments.
        MobilityError: unless exactly one degree of freedom besides passive ones is undetermined.

    Source: arc-length continuation (Dragilev's method) as paper 002 uses it; here by predicted polynomials.
    """
    for name, value, most in (("starts", starts, MAX_STARTS), ("the seed", seed, 2**32)):
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"{name} of a trace: {value!r}; give a whole number from 0 to {most}")
    mechanism = described(model)
    loops, own = assembled(mechanism)
    require_determined(loop_solver(loops, own))
    # locked coordinates stay locked, drivers become free
    loops = replace(loops, driven=loops.driven[len(mechanism.drivers) :])
    free, initial = _starting_point(loops, own)
    search = CurveSearch(free, progress)
    search.add(initial, counted=False)
    search.trace(0)
    search.add_branches(0)
    closed = 0
    for finished, poses in random_poses(loops, own, starts, seed):
        search.add(poses, counted=True)
        closed += len(poses)
        progress(f"{finished} of {starts} random starts", finished / starts)
    search.trace_all()
    counts = search.counts()
    order = [0, *sorted(range(1, len(counts)), key=lambda i: -counts[i])]
    curves = tuple(replace(search.curves[i], starts_ended=counts[i]) for i in order)
    return AssemblyTrace(
        mechanism, curves, _merged_branch_points(curves), starts, closed, seed, tuple(search.left_out())
    )


def _starting_point(loops: TreeLoops, own: Coordinates) -> tuple[FreeLoops, Coordinates]:
    """Return the equations and a start for tracing: near the guess if that is a branch point."""
    try:
        return free_loops(loops, own), own
    except MobilityError:
        neighbours = poses_around_branch_point(loops, own)
        for i in range(len(neighbours)):
            neighbour = select(neighbours, np.array([i]))
            try:
                return free_loops(loops, neighbour), neighbour
            except MobilityError:
                continue
        raise


def _merged_branch_points(curves: tuple[AssemblyCurve, ...]) -> tuple[BranchPoint, ...]:
    """Return the branch points of all curves, each listed once."""
    features: list[Array] = []
    locations: list[list[tuple[int, float]]] = []
    for i, curve in enumerate(curves):
        for arc in curve.branch_points:
            segment = curve.traced.segments[curve.traced.segment_index(arc)]
            values = segment.evaluate(segment.feature_coefficients, np.array([arc]))[0]
            index = next(
                (k for k, other in enumerate(features) if np.abs(other - values).max() < ON_CURVE), None
            )
            if index is None:
                features.append(values)
                locations.append([(i, arc)])
            else:
                locations[index].append((i, arc))
    return tuple(
        BranchPoint(float(curves[passages[0][0]].poses_at(passages[0][1]).angle[0]), tuple(passages))
        for passages in locations
    )
