"""Solvers of the catalogue: the motion in closed form at crank angles or times."""

from collections.abc import Mapping
from dataclasses import Field, dataclass, fields, replace
from typing import Any, Self

from numpy.typing import ArrayLike

from mechsim.analytic.formulas.formulas import (
    SELECTORS,
    Formulas,
    motion_in_chunks,
    parameters_from,
    require_closed,
    require_finite,
    unchecked,
)
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.path_instants import crank_angles, crank_rate, path_instants
from mechsim.analytic.solvers import AssemblyPoints
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import ChangePointPolicy, Motion
from mechsim.model.motion_laws import CRANK
from mechsim.model.quantity import AXES
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet


@dataclass(frozen=True, kw_only=True)
class ClosedForm(Formulas):
    """A catalogue mechanism with a driven crank and a closed form."""

    method = "closed form"
    own_start = True
    change_point = "smooth"

    @property
    def about(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return (type(self).__doc__ or "").splitlines()[0]

    @property
    def gear(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.declaration.gear

    @property
    def theories(self) -> frozenset[str]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.declaration.theories

    @property
    def selectors(self) -> dict[str, int | None]:
        return {name: getattr(self, name) for name in SELECTORS if hasattr(self, name)}

    @property
    def dimensions(self) -> dict[str, tuple[float, str]]:
        return {
            name: (float(number), parameter.metadata["unit"])
            for parameter in fields(self)
            if not _is_choice(parameter)
            for name, number in _components(parameter.name, getattr(self, parameter.name)).items()
        }

    @property
    def choices(self) -> tuple[str, ...]:
        return tuple(
            parameter.name
            for parameter in fields(self)
            if _is_choice(parameter) and not isinstance(parameter.default, str)
        )

    @property
    def parameter_rows(self) -> dict[str, tuple[Any, str, str]]:
        # the change-point policy comes last, since it is no dimension
        ordered = sorted(fields(self), key=lambda parameter: parameter.name == "change_point")
        rules = [(parameter.name, parameter.metadata) for parameter in ordered]
        return {name: (getattr(self, name), rule["unit"], rule["doc"]) for name, rule in rules}

    def with_mechanism(self, mechanism: Mechanism, **changes: Any) -> LoopForm:
        return LoopForm(mechanism, **changes)

    def with_dimensions(self, values: Mapping[str, float]) -> Self:
        return replace(self, **parameters_from(self, values))

    def described_with(self, values: Mapping[str, float]) -> Mechanism:
        return unchecked(self, parameters_from(self, values)).description

    def assembly_points(self, angle: float) -> list[AssemblyPoints]:
        """Return every real assembly mode at a crank angle."""
        return [
            (assembly.selectors, {name: point[0] for name, point in assembly.positions([angle]).items()})
            for assembly in self.assemblies(angle)
        ]

    def positions(
        self,
        angles: ArrayLike | None = None,
        change_point: ChangePointPolicy | None = None,
        *,
        t: ArrayLike | None = None,
        speed: float | None = None,
    ) -> dict[str, Array]:
        """Return the tracked points at crank angles, or at times: name -> (n, 3) in [m].

        `change_point`, `t`, `speed` and the assembly mode are as in `solve`.

        Raises:
            AssemblyError: where the loop cannot close; states the interval in which it can.
        """
        if t is not None or angles is None:
            angles = path_instants(self.mechanism, CRANK, angles, speed, 0.0, t).parameter
        angles = crank_angles(self.name, angles)
        solver = self.with_change_point(change_point).starting_at(angles)
        motion = motion_in_chunks(solver, angles, links=False)
        points = {name: point.position for name, point in motion.points.items()}
        require_closed(self, angles, points)
        return points

    def transmission_angle(self, angles: ArrayLike) -> Array:
        return self.transmission_at(crank_angles(self.name, angles), self.positions(angles))

    def solve_along(
        self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0, *, links: bool = True
    ) -> Motion:
        """Return the motion at crank angles, (n,) in [rad] in any order, in closed form.

        The sign of the assembly mode applies at the first crank angle, as in `starting_at`.

        Args:
            parameter: crank angles.
            rate: crank speed, scalar or (n,) in [rad/s].
            second: crank acceleration, scalar or (n,) in [rad/s2].
            links: False leaves out links and joints, which is faster.

        Raises:
            AssemblyError: where the loop cannot close; states the interval in which it can.

        Accuracy: loops close to 8 ulp of the longest link. Rates are exact derivatives of the formula of
            the pose; their relative error is a few ulp divided by the sine of the transmission angle.
        """
        angles = crank_angles(self.name, parameter)
        speed = crank_rate(self.name, "speed", rate, len(angles))
        crank = Jet(angles, speed, crank_rate(self.name, "acceleration", second, len(angles)))
        solver = self.starting_at(angles, float(speed[0]))
        motion = motion_in_chunks(solver, crank, links=links, origin=solver)
        self.check_finite(motion)
        return motion

    def dead_centres(self) -> tuple[float, ...]:
        arcs = self.crank_range()
        return () if arcs.full else tuple(end for arc in arcs.arcs for end in arc)

    @property
    def period(self) -> float:
        return REVOLUTION

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        """Return the mechanism in the assembly mode that its parameters select at the first crank angle.

        This matters only with change points, beyond which the sign of the mode differs. At a change point the
        sign applies right after it. The result keeps its assembly mode at all crank angles.

        Args:
            angles: crank angles in the order of the motion, (n,) in [rad].
            direction: sign of the crank's motion if all angles are equal.
        """
        crank_angles(self.name, angles)
        return self

    def check_finite(self, motion: Motion) -> None:
        """Raise AssemblyError where the closed form has no finite rates."""
        require_finite(self, motion)


def _is_choice(parameter: Field[Any]) -> bool:
    return "options" in parameter.metadata or isinstance(parameter.default, int)


def _components(name: str, value: Any) -> dict[str, float]:
    if isinstance(value, tuple):
        return {f"{name}.{axis}": number for axis, number in zip(AXES, value, strict=False)}
    return {name: value}
