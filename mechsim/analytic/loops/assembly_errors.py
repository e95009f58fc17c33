"""Closing loops nearest to a guess, and the message where they do not close."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.loops.constraints import LoopSystem, TreeLoops
from mechsim.analytic.loops.kinematics import Coordinates, link_poses
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import least_norm

# largest residual of closed loops, in radians and characteristic lengths
CLOSED = 1e-12
# by which part of a gap its loop moves that does not move that way at all; how far away another pose is,
# in [rad] and characteristic lengths; and the smallest component of a gap that is reported
IMMOBILE, OTHER_POSE, MIN_COMPONENT = 1e-6, 0.3, 1e-3
# Newton's method from a guess: no step rotates a joint by more than 0.5 rad
ASSEMBLY = NewtonSettings(
    max_iterations=60, tolerance=4.0 * float(np.finfo(np.float64).eps), rounding=CLOSED, max_step=0.5
)


def close_nearest(loops: TreeLoops, q: Coordinates) -> tuple[Coordinates, Array]:
    """Return configurations in which the loops close nearest to n given ones, and their residuals, (n,).

    Prescribed coordinates do not change. Residuals are in radians and characteristic lengths.
    """
    result = newton(LoopSystem(loops, loops.unknown), q, ASSEMBLY, least_norm)
    return result.q, result.residual


def assembly_failure(loops: TreeLoops, initial: Coordinates, final: Coordinates, remaining: float) -> str:
    """Return the message that gives the residual, and the driver positions at which the loops would close.

    Args:
        loops: of the mechanism.
        initial: coordinates from which they were to be closed.
        final: those in which they were left.
        remaining: by which they then stood open, in parts of the size.
    """
    mechanism = loops.tree.mechanism
    text = (
        f"{mechanism.name}: the loops do not close at {_stands(loops, final)}: a gap of {remaining:.3g} "
        f"of the longest link is left after {ASSEMBLY.max_iterations} Newton steps"
    )
    undriven = replace(loops, driven=loops.driven[len(mechanism.drivers) :])
    solution, violation = close_nearest(undriven, initial)
    if violation[0] < CLOSED:
        near_by = f"from the guess they close at {_stands(loops, solution)}"
        return f"{text}; {near_by}: start there, or change the dimensions"
    if across := _across(undriven, solution):
        return f"{text}, for {across}; move one of its points by that"
    return (
        f"{text}, and from the guess {_widest(undriven, solution)} stays open wherever the drivers "
        "stand; change the dimensions, where the drivers start, or the guess"
    )


def _stands(loops: TreeLoops, q: Coordinates) -> str:
    tree = loops.tree
    indices = {name: tree.index_of[name] for name in tree.mechanism.drivers}
    return ", ".join(
        f"{name} = {q.values[index, 0]:.6g} {'m' if tree.slides[index] else 'rad'}"
        for name, index in indices.items()
    )


def _across(loops: TreeLoops, q: Coordinates) -> str:
    """Return the joint with the largest gap that its loop cannot change, and the gap; empty for none."""
    residual, jacobian, _ = loops.linearise(q)
    # not in this pose alone, as all ways but one of a linkage that is stretched
    displaced = loops.displaced(
        q, OTHER_POSE * (1.0 + 0.3 * np.arange(loops.tree.count))[:, None] / loops.tree.count
    )
    jacobians = np.concatenate([jacobian, loops.linearise(displaced)[1]], -1)
    poses, first, largest, text = link_poses(loops.tree, q), 0, CLOSED, ""
    for cut in loops.cuts:
        rows = slice(first, first + len(cut.lengths))
        first += cut.rows
        gap = residual[rows, 0]
        violation = float(np.linalg.norm(gap))
        if (
            violation > largest
            and np.abs(np.tensordot(gap, jacobians[rows], 1)).max(initial=0.0) < IMMOBILE * violation
        ):
            displacement = cut.frames(poses)[1][:, cut.lengths, 0] @ gap * cut.length
            along = ", ".join(
                f"{component:.3g}"
                for component in np.where(
                    np.abs(displacement) < MIN_COMPONENT * np.abs(displacement).max(), 0.0, displacement
                )
            )
            largest, text = (
                violation,
                f"{cut.joint.name} stays open by ({along}) m, where nothing in its loop moves",
            )
    return text


def _widest(loops: TreeLoops, q: Coordinates) -> str:
    """Return the joint or coupling with the largest residual."""
    residual = np.abs(loops.linearise(q)[0][:, 0])
    names = [cut.joint.name for cut in loops.cuts for _ in range(cut.rows)]
    names += [row.coupling.name for row in loops.couplings]
    return names[int(residual.argmax())]
