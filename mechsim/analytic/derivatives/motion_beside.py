"""Motions of mechanisms with other dimensions, reached by Newton's method from one that is solved already."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.derivatives.motion import Followed, followed_motion, with_mechanism
from mechsim.analytic.derivatives.numbers import GivenMechanism, numbers_of, with_numbers
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.continuation_path import ContinuationPath
from mechsim.analytic.loops.tree_rates import ClosedChunk, Instants
from mechsim.errors import AssemblyError
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion

# Newton steps at the most, the longest that is taken, one that ends them, and a gap that is none
STEPS, LONGEST, SHORT, CLOSED = 20, 0.5, 1e-10, 1e-10


@dataclass(frozen=True)
class MotionBeside:
    """A motion that is solved, from which those of other dimensions are.

    Attributes:
        form: what moves.
        path: of its assembly.
        instants: along it.
        parts: closed there.
        reach: how far coordinates may move in all to another mechanism, in [rad] or parts of the size.
    """

    form: Form
    path: ContinuationPath
    instants: Instants
    parts: tuple[ClosedChunk, ...]
    reach: float = np.inf

    def of(self, mechanism: Mechanism, ahead: float = 0.0) -> Motion:
        """Return the motion of a mechanism with the same links, joints and drivers but other dimensions.

        Its drivers may all be ahead, by so much in [rad] or [m], of where the record says. It is in the
        assembly into which this one goes over as its dimensions become the other ones.

        Raises:
            AssemblyError: where the loops do not close, or another assembly is too near to be told apart.
        """
        return self.followed(mechanism, ahead).motion()

    def followed(self, mechanism: Mechanism, ahead: float = 0.0) -> Followed:
        """Return that motion as one from which others begin, and derivatives are taken; as `of`."""
        own = self.form.mechanism
        given = with_numbers(own, numbers_of(mechanism))
        parts = [self._closed(part, given, ahead) for part in self.parts]
        return Followed(self.form, mechanism, self.path, self.instants, parts, given)

    def _closed(self, part: ClosedChunk, mechanism: GivenMechanism, ahead: float) -> ClosedChunk:
        loops = with_mechanism(part.solver.loops, mechanism)
        solver = replace(part.solver, loops=loops)
        side, at = np.sign(part.linearised.signed_distance), replace(part.q, values=part.q.values.copy())
        for held, value in mechanism.locked.items():
            at.values[loops.tree.index_of[held]] = value
        for driver in mechanism.drivers:
            at.values[loops.tree.index_of[driver]] += ahead
        found, gone = solver.linearise(at), 0.0
        for _ in range(STEPS):
            step = solver.step(found.matrix, found.rhs)
            longest = float(np.abs(step).max(initial=0.0))
            gone += longest
            if not (longest < LONGEST and gone < self.reach):
                break
            at = loops.displaced(at, step)
            found = solver.linearise(at)
            if longest < SHORT:
                break
        gap = float(np.abs(found.residual).max(initial=0.0))
        if not gap <= CLOSED or (np.sign(found.signed_distance) != side).any():
            raise AssemblyError(
                f"{mechanism.name}: with these dimensions the loops do not close in this assembly at all of "
                "its instants; change them by less"
            )
        return replace(part, solver=solver, q=at, linearised=found)


def motion_beside(
    form: Form,
    angles: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    reach: float = np.inf,
) -> MotionBeside:
    """Return a motion from which others near it are solved, at angles of the crank or of a clock.

    Others are no farther than `reach`, as `MotionBeside` has it.

    Raises:
        AssemblyError: where the loops do not close, or where two assemblies meet.
    """
    found = followed_motion(form, form.mechanism, angles, speed, acceleration)
    return MotionBeside(form, found.path, found.instants, tuple(found.parts), reach)
