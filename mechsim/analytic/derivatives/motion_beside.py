"""Motions of mechanisms with other dimensions, reached by Newton's method from one that is solved already."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.closure.assembly import crank_angles
from mechsim.analytic.closure.followed_path import FollowedPath
from mechsim.analytic.closure.motion import crank_rate
from mechsim.analytic.closure.tree_rates import (
    ClosedPart,
    Instants,
    LoopMotion,
    closed_parts,
    in_order,
    rated,
)
from mechsim.analytic.derivatives.motion import followed_form, record_of, with_mechanism
from mechsim.analytic.derivatives.numbers import GivenMechanism, numbers_of, with_numbers
from mechsim.analytic.forms import Form
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
    """

    form: Form
    path: FollowedPath
    instants: Instants
    parts: tuple[ClosedPart, ...]

    def of(self, mechanism: Mechanism) -> Motion:
        """Return the motion of a mechanism with the same links, joints and drivers but other dimensions.

        It is in the assembly into which this one goes over as its dimensions become the other ones.

        Raises:
            AssemblyError: where the loops do not close, or another assembly is too near to be told apart.
        """
        own = self.form.mechanism
        given = with_numbers(own, numbers_of(mechanism))
        moved = in_order([(part.index, self._moved(part, given)) for part in self.parts])
        return record_of(self.path, moved, self.instants, given, self.form)

    def _moved(self, part: ClosedPart, mechanism: GivenMechanism) -> LoopMotion:
        loops = with_mechanism(part.solver.loops, mechanism)
        solver = replace(part.solver, loops=loops)
        side, at = np.sign(part.loops.side()), replace(part.at, values=part.at.values.copy())
        for held, value in mechanism.holds.items():
            at.values[loops.tree.places[held]] = value
        found = solver.linearise(at)
        for _ in range(STEPS):
            step = solver.step(found.matrix, found.right)
            longest = float(np.abs(step).max(initial=0.0))
            if not longest < LONGEST:
                break
            at = loops.moved(at, step)
            found = solver.linearise(at)
            if longest < SHORT:
                break
        gap = float(np.abs(found.residual).max(initial=0.0))
        if not gap <= CLOSED or (np.sign(found.side()) != side).any():
            raise AssemblyError(
                f"{mechanism.name}: with these dimensions the loops do not close in this assembly at all of "
                "its instants; change them by less"
            )
        return rated(self.path, replace(part, solver=solver, at=at, loops=found))


def motion_beside(
    form: Form, angles: ArrayLike, speed: ArrayLike = 1.0, acceleration: ArrayLike = 0.0
) -> MotionBeside:
    """Return a motion from which others near it are solved, at angles of the crank or of a clock.

    Raises:
        AssemblyError: where the loops do not close, or where two assemblies meet.
    """
    angle = crank_angles(form.mechanism, angles)
    rates = [
        crank_rate(form.mechanism, what, value, len(angle))
        for what, value in (("speed", speed), ("acceleration", acceleration))
    ]
    path, instants = followed_form(form, angle, *rates)
    if path.blind(angle).any():
        raise AssemblyError(f"{form.name}: two assemblies meet on the motion; keep away from there")
    return MotionBeside(form, path, instants, tuple(closed_parts(path, instants)))
