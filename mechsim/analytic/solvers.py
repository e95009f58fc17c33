"""Solvers of mechanisms: closed forms of the catalogue, and loop equations of any mechanism."""

from collections.abc import Mapping
from typing import Protocol, Self

from numpy.typing import ArrayLike

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.vector_method.trig_polynomial import Arcs
from mechsim.errors import InputError
from mechsim.model.forces import Forces
from mechsim.model.limits import Ranges
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import ChangePointPolicy, Motion
from mechsim.model.motion_laws import MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.units import WrittenUnits


class KinematicSolver(Protocol):
    """Solver of the motion of a mechanism in one assembly mode: `ClosedForm` or `LoopForm`.

    The path parameter is the crank angle in [rad], or under motion laws the time multiplied by their rate.
    """

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        ...

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with a guess that selects the assembly mode."""
        ...

    @property
    def motion_laws(self) -> MotionLaws:
        """Motion laws of the drivers; `CRANK` for a crank at any speed."""
        ...

    @property
    def forces(self) -> Forces | None:
        """Forces of the description; None if it defines none."""
        ...

    @property
    def formula(self) -> str:
        """FILE.py:FUNCTION of the user's own model; empty if there is none."""
        ...

    @property
    def ranges(self) -> Ranges:
        """Joint -> limits of its coordinate, in [m] or [rad]."""
        ...

    @property
    def written(self) -> WrittenUnits:
        """Units that its file declares."""
        ...

    @property
    def change_point(self) -> ChangePointPolicy:
        """Policy at change points."""
        ...

    @property
    def period(self) -> float:
        """Path parameter after which the configuration repeats."""
        ...

    def solve(
        self,
        angles: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        acceleration: ArrayLike = 0.0,
        *,
        t: ArrayLike | None = None,
    ) -> Motion:
        """Return the motion at crank angles, or at times."""
        ...

    def solve_along(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion at values of the path parameter, (n,), with its rates."""
        ...

    def solve_as(self, driven: Motion) -> Motion:
        """Return the motion at the driver positions of another motion."""
        ...

    def positions(
        self, angles: ArrayLike | None = None, *, t: ArrayLike | None = None, speed: float | None = None
    ) -> dict[str, Array]:
        """Return the tracked points at crank angles, or at times: name -> (n, 3) in [m]."""
        ...

    def crank_range(self) -> Arcs:
        """Return the intervals of crank angle in which the loops close in this assembly mode."""
        ...

    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles at which the motion must reverse, in [rad]."""
        ...

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles of change points, at which two assembly modes meet, in [-pi, pi) rad."""
        ...

    def assembly_points(self, angle: float) -> list[tuple[dict[str, int | None], dict[str, Array]]]:
        """Return the selectors and tracked points of each assembly mode at a crank angle."""
        ...

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that is positive in this assembly mode, (n,)."""
        ...

    def starting_at(self, angles: ArrayLike, direction: float = 1.0, /) -> Self:
        """Return the solver of the assembly mode selected at the first crank angle."""
        ...

    def with_change_point(self, policy: ChangePointPolicy, /) -> Self:
        """Return the solver with another policy at change points."""
        ...


def closed_form(solver: KinematicSolver, what: str) -> ClosedForm:
    """Return a solver as a catalogue mechanism.

    Args:
        solver: the solver.
        what: the requested result, for the message.

    Raises:
        InputError: for a solver that is no catalogue mechanism.
    """
    if isinstance(solver, ClosedForm):
        return solver
    raise InputError(
        f"{what} needs a mechanism of the catalogue, and {solver.name!r} is not in it; "
        "`mechsim list` names them"
    )
