"""RSSR: spatial four-bar crank-rocker, its dimensions and its closed form."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.formulas import (
    EX,
    EY,
    ORIGIN,
    Array,
    LinkFrame,
    TwoBranchForm,
    Values,
    circle_sphere,
    column,
    cross,
    dot,
    norm,
    rotate,
    rotation,
    rotation_product,
    unit_at_angles,
)
from mechsim.mechanism.links import vector

# parameters that have no effect without a guide
GUIDE_PARAMETERS = ("psi1", "psi2", "beta1", "beta2", "guide_branch")


class Rssr(TwoBranchForm):
    """Spatial four-bar with two revolute and two ball joints."""

    @cached_property
    def rocker_frame(self) -> Array:
        """Frame at P4 whose third column is the rocker axis, (3, 3). Paper 000, eqs (8), (9)."""
        return rotation_product(rotation("y", self.gamma1), rotation("x", self.gamma2))

    def variants(self) -> dict[str, Self]:
        return {} if self.guide else {"guided": self.with_parameters(guide=True)}

    def discriminant(self, angles: ArrayLike) -> Array:
        """4 r2 d2 - (d2 + h2 + r2 - l2)2; rocker r, coupler l, P4P2 with d across and h along the axis."""
        to_crank = self.crank * self._radial(np.asarray(angles)) - column(self.pivot)
        height = dot(to_crank, column(self.rocker_frame[:, 2]))
        reach2 = dot(to_crank, to_crank) - height**2
        side = reach2 + height**2 + self.rocker**2 - self.coupler**2
        return 4.0 * self.rocker**2 * reach2 - side**2

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        pivot = np.asarray(self.pivot)
        normal = np.cross(points["P2"] - pivot, self.rocker_frame[:, 2])
        return self.branch * ((points["P3"] - pivot) * normal).sum(-1)

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        p2, p3 = points["P2"].T, points["P3"].T
        arm = (p3 - column(self.pivot)) / self.rocker
        along = dot((p3 - p2) / self.coupler, cross(column(self.rocker_frame[:, 2]), arm))
        return np.arcsin(np.minimum(np.abs(along), 1.0))

    @property
    def array_parameters(self) -> frozenset[str]:  # pyright: ignore[reportIncompatibleVariableOverride]
        always = ("crank", "coupler", "rocker", "pivot", "gamma1", "gamma2", "branch")
        return frozenset(always if self.guide else (*always, *GUIDE_PARAMETERS))

    @property
    def spinning(self) -> frozenset[str]:
        return frozenset() if self.guide else frozenset({"coupler"})

    def _radial(self, angle: Values) -> Any:
        """Direction of the crank, (3, n). Paper 000, eqs (4)-(6)."""
        return rotate(column(EY), column(EX), angle)

    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """P3 lies on the rocker's circle about P4 and on the sphere about P2."""
        pivot, axis = column(self.pivot), column(self.rocker_frame[:, 2])
        crank = LinkFrame(column(ORIGIN), x=column(EX), y=self._radial(angle))
        p2 = crank.point((0.0, self.crank, 0.0))
        swing = circle_sphere(pivot, axis, self.rocker, p2, self.coupler, self.branch, self.across(angle))
        yield "crank", crank
        yield "rocker", LinkFrame(pivot, x=swing, z=axis)
        along = (p2 - (pivot + self.rocker * swing)) / self.coupler
        yield "coupler", LinkFrame(p2, x=along, y=self._side(crank, along))

    def _side(self, crank: LinkFrame, along: Values) -> Any:
        """Return the coupler's y axis, (3, n), from its x axis. Paper 000, eqs (27)-(30).

        Without a guide it is undetermined; the usual guide (default angles) then defines it.
        """
        if not self.guide:
            normal = cross(crank.direction((-1.0, 0.0, 0.0)), along)
            return self.guide_branch * cross(normal, along) / norm(normal)
        pin = crank.direction(vector(self._pin_at_zero))
        guide = unit_at_angles(pin, along, self.beta1, self.beta2, self.guide_branch)
        return cross(guide, along) / np.sin(self.beta2)

    @cached_property
    def _pin_at_zero(self) -> Array:
        """The pin's direction in the crank's frame, (3,). Paper 000, eq. (28)."""
        return rotation("z", self.psi1) @ rotation("x", self.psi2) @ np.asarray(EY)
