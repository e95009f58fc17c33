"""RSSR: spatial four-bar crank-rocker, its dimensions and its closed form."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.formulas import Declaration, Geometry, angle, choice, length, position
from mechsim.analytic.catalog.two_branch import TwoBranchForm
from mechsim.analytic.vector_method.link_frames import LinkFrame
from mechsim.analytic.vector_method.vectors import (
    Sign,
    circle_sphere,
    column,
    cross,
    dot,
    norm,
    rotation,
    spun,
    turned_twice,
    unit_at_angles,
)
from mechsim.model.joints import End, Joint
from mechsim.model.links import EX, EY, EZ, GROUND, ORIGIN, Link, vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Values

# parameters that have no effect without a guide
GUIDE_PARAMETERS = ("psi1", "psi2", "beta1", "beta2", "guide_branch")


@dataclass(frozen=True, kw_only=True)
class Rssr(TwoBranchForm):
    """Spatial four-bar with two revolute and two ball joints.

    The crank P1P2 rotates about X at the origin, with its angle measured from Y; the rocker P4P3 rotates
    about the axis TY(gamma1) TX(gamma2) eZ through P4, perpendicular to it. `branch` is the sign of P4P3 .
    (P4P2 x axis).

    With `guide`, the spherical pair at P2 becomes a universal joint: a pin on the crank, along TZ(psi1)
    TX(psi2) eY at crank angle zero, keeps the angle beta1 to a direction of the coupler that has the angle
    beta2 to the rod; `guide_branch` is the sign of direction . (pin x rod). The rocker's motion is the same;
    only the coupler's rotation about its line is then determined.

    Source: paper 000; defaults from papers.md section 1.
    """

    declaration = Declaration(
        "rssr",
        array_parameters=frozenset(("crank", "coupler", "rocker", "pivot", "gamma1", "gamma2", "branch")),
    )

    crank: float = length(0.013, "length P1P2")
    coupler: float = length(0.046, "length P2P3")
    rocker: float = length(0.027, "length P4P3")
    pivot: tuple[float, float, float] = position((0.043, -0.010, -0.024), "rocker pivot P4")
    gamma1: float = angle(np.deg2rad(20.0), "turn of the rocker axis about Y")
    gamma2: float = angle(np.deg2rad(30.0), "turn of the rocker axis about the turned X")
    branch: Sign = choice(-1, (1, -1), "assembly: sign of P4P3 . (P4P2 x axis)")
    guide: bool = choice(False, (False, True), "whether a guide stops the coupler's spin")
    psi1: float = angle(np.pi / 2, "turn of the pin about Z")
    psi2: float = angle(0.0, "turn of the pin about X")
    beta1: float = angle(np.pi / 2, "angle between pin and guide direction")
    beta2: float = angle(np.pi / 2, "angle between rod and guide direction")
    guide_branch: Sign = choice(1, (1, -1), "assembly of the guide")

    @cached_property
    def rocker_frame(self) -> Array:
        """Frame at P4 whose third column is the rocker axis, (3, 3). Paper 000, eqs (8), (9)."""
        return turned_twice(rotation("y", self.gamma1), rotation("x", self.gamma2))

    @property
    def description(self) -> Mechanism:
        x, _, z = (vector(column) for column in self.rocker_frame.T)
        joints = self.geometry().joints
        (tip, _), (on_coupler, on_rocker), (pivot, _) = (joints[name] for name in ("P2", "P3", "rocker"))
        if self.guide:
            pin = End("crank", tip, axis=vector(self._pin_at_zero))
            guide = End("coupler", axis=(float(np.cos(self.beta2)), 0.0, float(np.sin(self.beta2))))
            at_crank = Joint("P2", "universal", pin, guide, cross_angle=self.beta1)
        else:
            at_crank = Joint("P2", "spherical", End("crank", tip), End("coupler"))
        at_rocker = (End("coupler", on_coupler), End("rocker", on_rocker))
        return Mechanism(
            name=self.name,
            links=(Link("crank"), Link("coupler"), Link("rocker")),
            joints=(
                Joint(
                    "crank",
                    "revolute",
                    End(GROUND, axis=EX, reference=EY),
                    End("crank", axis=EX, reference=EY),
                ),
                at_crank,
                Joint("P3", "spherical", *at_rocker),
                Joint("rocker", "revolute", End(GROUND, pivot, z, x), End("rocker", axis=EZ, reference=EX)),
            ),
            driver="crank",
            points={"P2": ("crank", tip), "P3": ("rocker", on_rocker)},
        )

    def variants(self) -> dict[str, Self]:
        return {} if self.guide else {"guided": replace(self, guide=True)}

    def geometry(self) -> Geometry:
        tip, end = (0.0, self.crank, 0.0), (self.rocker, 0.0, 0.0)
        return Geometry(
            points={"P2": tip, "P3": end},
            joints={
                "P2": (tip, ORIGIN),
                "P3": ((-self.coupler, 0.0, 0.0), end),
                "rocker": (self.pivot, ORIGIN),
            },
            frames={"rocker": self.rocker_frame},
        )

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
    def array_parameters(self) -> frozenset[str]:
        without_guide = frozenset() if self.guide else frozenset(GUIDE_PARAMETERS)
        return super().array_parameters | without_guide

    @property
    def spinning(self) -> frozenset[str]:
        return frozenset() if self.guide else frozenset({"coupler"})

    def _radial(self, angle: Values) -> Any:
        """Direction of the crank, (3, n). Paper 000, eqs (4)-(6)."""
        return spun(column(EY), column(EX), angle)

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
