"""The search for all curves of assemblies: sampled poses, and the curves on which they lie."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.numerical_rank import significant
from mechsim.analytic.loops.random_starts import poses_around_branch_point, select
from mechsim.analytic.loops.tree_motion import Coordinates
from mechsim.errors import AssemblyError, MobilityError
from mechsim.numerics.arrays import Array
from mechsim.theory.continuation.assembly_curve import AssemblyCurve
from mechsim.theory.continuation.free_loops import FreeLoops
from mechsim.theory.continuation.segments import trace_curve

# distance of features below which a pose lies on a curve
ON_CURVE = 1e-7
# singular values below this fraction of the largest count as zero at a pose from a random start
RANK_TOLERANCE = 1e-5
# number of failed curves after which the search stops
MAX_FAILED = 3


class CurveSearch:
    """Sampled poses, and the curves on which they lie.

    Attributes:
        loops: of the mechanism.
        progress: called with a description of the work and the fraction done, at least.
    """

    def __init__(self, loops: FreeLoops, progress: Callable[[str, float], None]):
        self.loops, self.progress = loops, progress
        self.curves: list[AssemblyCurve] = []
        self.poses: list[Coordinates] = []
        self.curve_index = np.empty(0, dtype=np.intp)
        self.counted = np.empty(0, dtype=np.bool_)
        self.features: Array = np.empty((0, 3 * len(loops.features.links)))
        self.singular_values = np.empty(0)
        self.dofs = np.empty(0, dtype=np.intp)
        self.failed: list[str] = []

    def add(self, poses: Coordinates, *, counted: bool) -> None:
        """Add poses to the search."""
        if not len(poses):
            return
        _, jacobian, placed = self.loops.loops.linearise(poses)
        by_unknowns = jacobian[:, self.loops.loops.unknown].transpose(2, 0, 1)
        values = np.linalg.svd(by_unknowns, compute_uv=False)
        rank = significant(values, RANK_TOLERANCE).sum(1)
        self.poses += [select(poses, np.array([i])) for i in range(len(poses))]
        self.features = np.concatenate([self.features, self.loops.features.values(placed)])
        self.singular_values = np.concatenate([self.singular_values, self.loops.singular_value(jacobian)])
        self.dofs = np.concatenate([self.dofs, 1 + self.loops.rank - rank])
        self.counted = np.concatenate([self.counted, np.full(len(poses), counted)])
        self.curve_index = np.concatenate([self.curve_index, np.full(len(poses), -1)])
        for i, curve in enumerate(self.curves):
            self._assign(i, curve)

    def trace(self, start: int) -> None:
        """Trace the curve through a pose."""
        which = len(self.curves) + 1

        def report(segments: int, limit: int) -> None:
            self.progress(f"component {which}, segment {segments} of at most {limit:,}", segments / limit)

        curve = AssemblyCurve(self.loops, trace_curve(self.loops, self.poses[start], progress=report))
        self.curves.append(curve)
        self.curve_index[start] = len(self.curves) - 1
        self._assign(len(self.curves) - 1, curve)

    def add_branches(self, index: int) -> None:
        """Add poses on the branches that leave the branch points of a curve."""
        curve = self.curves[index]
        for arc in curve.branch_points:
            segment = curve.traced.segments[curve.traced.segment_index(arc)]
            coordinates = self.loops.unflat(segment.evaluate(segment.coefficients, np.array([arc])))
            self.add(poses_around_branch_point(self.loops.loops, coordinates), counted=False)

    def trace_all(self) -> None:
        """Trace curves until every pose that can move lies on one."""
        while len(self.failed) < MAX_FAILED:
            waiting = np.flatnonzero((self.curve_index == -1) & (self.dofs == 1))
            if not len(waiting):
                return
            best = int(waiting[np.argmax(self.singular_values[waiting])])
            try:
                self.trace(best)
            except (AssemblyError, MobilityError) as error:
                self.curve_index[best] = -2
                self.failed.append(str(error))
                continue
            self.add_branches(len(self.curves) - 1)

    def counts(self) -> list[int]:
        """Return how many counted poses lie on each curve."""
        return [int((self.counted & (self.curve_index == i)).sum()) for i in range(len(self.curves))]

    def left_out(self) -> list[str]:
        """Return one sentence for each group of assemblies that was not traced."""
        messages = [f"not traced: {reason}" for reason in self.failed]
        lost = self.counted & (self.curve_index < 0)
        for what, which in (
            ("in poses that cannot move", self.dofs < 1),
            ("where more than one degree of freedom is undetermined", self.dofs > 1),
            ("on curves that were not traced", self.dofs == 1),
        ):
            if count := int((lost & which).sum()):
                messages.append(f"{count} of {int(self.counted.sum())} assemblies found were {what}")
        return messages

    def _assign(self, index: int, curve: AssemblyCurve) -> None:
        waiting = np.flatnonzero(self.curve_index == -1)
        if len(waiting):
            self.curve_index[waiting[lie_on(curve, self.features[waiting])]] = index


def lie_on(curve: AssemblyCurve, features: Array) -> NDArray[np.bool_]:
    """Return which of n poses, given by their features, lie on a curve, (n,)."""
    arcs = np.concatenate([segment.nodes for segment in curve.traced.segments])
    node_features = np.concatenate(
        [segment.evaluate(segment.feature_coefficients, segment.nodes) for segment in curve.traced.segments]
    )
    on, spacing = np.zeros(len(features), dtype=np.bool_), (np.diff(arcs, append=curve.length) ** 2).max()
    for i, pose in enumerate(features):
        distances = ((node_features - pose) ** 2).sum(1)
        # where a curve nearly crosses itself, several local minima are candidates
        for k in np.flatnonzero((distances <= np.roll(distances, 1)) & (distances <= np.roll(distances, -1))):
            if distances[k] < spacing and _distance(curve, float(arcs[k]), pose) < ON_CURVE:
                on[i] = True
                break
    return on


def _distance(curve: AssemblyCurve, arc: float, features: Array) -> float:
    """Return the distance of a pose's features from a curve near an arc."""
    distance = np.inf
    for _ in range(6):
        arc %= curve.length
        segment = curve.traced.segments[curve.traced.segment_index(arc)]
        position = np.array([arc])
        gap = features - segment.evaluate(segment.feature_coefficients, position)[0]
        distance = float(np.abs(gap).max())
        derivative = segment.evaluate(segment.feature_derivatives, position)[0]
        step = float(gap @ derivative) / float(derivative @ derivative)
        # converged: the step no longer changes the distance
        if abs(step) < 0.1 * ON_CURVE:
            break
        arc += step
    return distance
