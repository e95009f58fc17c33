"""All curves of assemblies of a mechanism with one freedom, from its own pose and from random starts."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.closure.loop_solver import loop_solver
from mechsim.analytic.closure.random_starts import poses_around_branch_point, random_poses, select
from mechsim.analytic.closure.tree_assembly import assembled
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.analytic.closure.undetermined_joints import require_determined
from mechsim.errors import InputError, MobilityError
from mechsim.maths.arrays import Array
from mechsim.model.display import short_repr
from mechsim.model.mechanism import Mechanism, described
from mechsim.theory.continuation.assembly_curve import AssemblyCurve
from mechsim.theory.continuation.curve_search import ON_CURVE, CurveSearch
from mechsim.theory.continuation.free_loops import FreeLoops, free_loops

# how many random starts are taken, and which
STARTS, SEED, MOST_STARTS = 300, 1, 100_000


@dataclass(frozen=True, slots=True)
class CurveMeeting:
    """A pose at which curves of assemblies meet: from there the mechanism could go on along either.

    Attributes:
        angle: of the crank in [rad], as the first of the curves counts it.
        places: index of each curve that passes it and its arc there; a curve may pass twice.
    """

    angle: float
    places: tuple[tuple[int, float], ...]


@dataclass(frozen=True, slots=True)
class AssemblyTrace:
    """Every assembly of a mechanism, as closed curves.

    Attributes:
        mechanism: what was traced.
        curves: the first is the mechanism's own; the others by how many starts ended on them.
        meetings: where they cross each other or themselves.
        starts: how many random starts there were.
        closed: how many of them ended in an assembly.
        seed: of the random numbers.
        left_out: what was found and not traced, and why; one sentence each.
    """

    mechanism: Mechanism
    curves: tuple[AssemblyCurve, ...]
    meetings: tuple[CurveMeeting, ...]
    starts: int
    closed: int
    seed: int
    left_out: tuple[str, ...] = ()

    __repr__ = short_repr


def _silent(done: str, part: float) -> None:
    pass


def trace(
    model: object,
    *,
    starts: int = STARTS,
    seed: int = SEED,
    tick: Callable[[str, float], None] = _silent,
) -> AssemblyTrace:
    """Trace every assembly of a mechanism with one freedom, through the turning points of all coordinates.

    Assemblies form closed curves: where the crank turns fully, a curve is one assembly over one turn (or
    as many as it takes until gears repeat); where it only swings, a curve holds both assemblies between
    its dead centres. The first curve goes through the mechanism's own guess; the others are found from
    random starts, and from the places where curves meet. A curve on which a part p of the starts ends is
    missed with probability (1 - p) to the power of the starts.

    Args:
        model: a mechanism, or a form that has one.
        starts: how many random starts; 0 traces the mechanism's own curve and what meets it.
        seed: of the random numbers: the same seed finds the same curves.
        tick: is told what is being done, and which part of that is done at the least.

    Raises:
        InputError: for starts or a seed that are no whole numbers in range.
        AssemblyError: if the loops do not close at the guess, or its curve does not: where it runs off by a
            slide, winds up a screw, or is longer than 3,000 cells.
        MobilityError: unless exactly one freedom is open, beside idle ones.

    Source: arc-length continuation (Dragilev's method) as paper 002 uses it; here by predicted polynomials.
    """
    for name, value, most in (("starts", starts, MOST_STARTS), ("the seed", seed, 2**32)):
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"{name} of a trace: {value!r}; give a whole number from 0 to {most}")
    mechanism = described(model)
    loops, own = assembled(mechanism)
    require_determined(loop_solver(loops, own))
    # holds stay, drivers are let go
    loops = replace(loops, driven=loops.driven[len(mechanism.drivers) :])
    free, begin = _ready(loops, own)
    search = CurveSearch(free, tick)
    search.take(begin, counted=False)
    search.walk(0)
    search.beside(0)
    closed = 0
    for done, some in random_poses(loops, own, starts, seed):
        search.take(some, counted=True)
        closed += len(some)
        tick(f"{done} of {starts} random starts", done / starts)
    search.walk_all()
    counts = search.counts()
    order = [0, *sorted(range(1, len(counts)), key=lambda i: -counts[i])]
    curves = tuple(replace(search.curves[i], found=counts[i]) for i in order)
    return AssemblyTrace(mechanism, curves, _met(curves), starts, closed, seed, tuple(search.left_out()))


def _ready(loops: TreeLoops, own: Coordinates) -> tuple[FreeLoops, Coordinates]:
    """Return the loops ready to walk along, and where to begin: beside the guess if assemblies meet there."""
    try:
        return free_loops(loops, own), own
    except MobilityError:
        near = poses_around_branch_point(loops, own)
        for i in range(len(near)):
            one = select(near, np.array([i]))
            try:
                return free_loops(loops, one), one
            except MobilityError:
                continue
        raise


def _met(curves: tuple[AssemblyCurve, ...]) -> tuple[CurveMeeting, ...]:
    """Return the places where curves meet."""
    marks: list[Array] = []
    places: list[list[tuple[int, float]]] = []
    for i, curve in enumerate(curves):
        for arc in curve.meetings:
            cell = curve.walked.cells[curve.walked.place(arc)]
            here = cell.at(cell.marks, np.array([arc]))[0]
            known = next((k for k, one in enumerate(marks) if np.abs(one - here).max() < ON_CURVE), None)
            if known is None:
                marks.append(here)
                places.append([(i, arc)])
            else:
                places[known].append((i, arc))
    return tuple(CurveMeeting(float(curves[of[0][0]].at(of[0][1]).angle[0]), tuple(of)) for of in places)
