"""RSSR: spatial four-bar crank-rocker, its dimensions and its closed form."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.base import Array, Detail, TwoBranchForm, angle, choice, length, place
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.vectors import (
    Sign,
    circle_sphere,
    column,
    cross,
    dot,
    rotation,
    unit_at_angles,
)
from mechsim.model.mechanism import EX, EY, EZ, GROUND, End, Joint, Link, Mechanism
from mechsim.model.motion import JointMotion, Motion


@dataclass(frozen=True, kw_only=True)
class Rssr(TwoBranchForm):
    """Spatial four-bar with two revolute and two spherical pairs.

    The crank P1P2 turns about X at the origin, its angle counted from Y; the rocker P4P3 swings about
    the axis TY(gamma1) TX(gamma2) eZ through P4, at right angles to it. `branch` is the sign of
    P4P3 . (P4P2 x axis).

    With `guide` on, the spherical pair at P2 becomes a universal joint: a pin on the crank, along
    TZ(psi1) TX(psi2) eY when the crank is at zero, slides at angle beta1 to a direction of the coupler
    that makes beta2 with the rod; `guide_branch` is the sign of direction . (pin x rod). The rocker
    moves the same either way; only the coupler's spin is then defined.

    Source: paper 000; defaults from papers.md section 1.
    """

    name: ClassVar[str] = "rssr"

    crank: float = length(0.013, "length P1P2")
    coupler: float = length(0.046, "length P2P3")
    rocker: float = length(0.027, "length P4P3")
    pivot: tuple[float, float, float] = place((0.043, -0.010, -0.024), "rocker pivot P4")
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
        return rotation("y", self.gamma1) @ rotation("x", self.gamma2)

    @property
    def mechanism(self) -> Mechanism:
        x, _, z = (link_frames.vector(column) for column in self.rocker_frame.T)
        if self.guide:
            pin = End("crank", (0.0, self.crank, 0.0), axis=link_frames.vector(self._pin_at_zero))
            guide = End("coupler", axis=(float(np.cos(self.beta2)), 0.0, float(np.sin(self.beta2))))
            at_crank = Joint("P2", "universal", pin, guide, cross_angle=self.beta1)
        else:
            at_crank = Joint("P2", "spherical", End("crank", (0.0, self.crank, 0.0)), End("coupler"))
        at_rocker = (End("coupler", (-self.coupler, 0.0, 0.0)), End("rocker", (self.rocker, 0.0, 0.0)))
        guess, start = self.guess()
        return Mechanism(
            name=self.name,
            links=(Link("crank"), Link("coupler"), Link("rocker")),
            joints=(
                Joint("crank", "revolute", End(GROUND, axis=EX, mark=EY), End("crank", axis=EX, mark=EY)),
                at_crank,
                Joint("P3", "spherical", *at_rocker),
                Joint("rocker", "revolute", End(GROUND, self.pivot, z, x), End("rocker", axis=EZ, mark=EX)),
            ),
            driver="crank",
            points={"P2": ("crank", (0.0, self.crank, 0.0)), "P3": ("rocker", (self.rocker, 0.0, 0.0))},
            guess=guess,
            start=start,
        )

    def variants(self) -> dict[str, Self]:
        return {} if self.guide else {"guided": replace(self, guide=True)}

    def margin(self, angles: ArrayLike) -> Array:
        """4 r2 d2 - (d2 + h2 + r2 - l2)2; rocker r, coupler l, P4P2 with parts d across, h along the axis."""
        to_crank = self._crank_pin(np.asarray(angles)) - column(self.pivot)
        height = dot(to_crank, column(self.rocker_frame[:, 2]))
        reach2 = dot(to_crank, to_crank) - height**2
        side = reach2 + height**2 + self.rocker**2 - self.coupler**2
        return 4.0 * self.rocker**2 * reach2 - side**2

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        pivot = np.asarray(self.pivot)
        normal = np.cross(points["P2"] - pivot, self.rocker_frame[:, 2])
        return self.branch * ((points["P3"] - pivot) * normal).sum(-1)

    def transmission_angle(self, angles: ArrayLike) -> Array:
        points = self.positions(angles)
        arm = (points["P3"] - np.asarray(self.pivot)) / self.rocker
        rod = (points["P3"] - points["P2"]) / self.coupler
        along = (rod * np.cross(self.rocker_frame[:, 2], arm)).sum(-1)
        return np.arcsin(np.minimum(np.abs(along), 1.0))

    def _crank_pin(self, f: Array) -> Array:
        """P2, (3, n). Paper 000, eqs (4)-(6)."""
        return np.stack([np.zeros_like(f), self.crank * np.cos(f), self.crank * np.sin(f)])

    def _motion(self, angles: Array, speed: Array, acceleration: Array, detail: Detail) -> Motion:
        pivot, axis = column(self.pivot), column(self.rocker_frame[:, 2])
        p2 = self._crank_pin(angles)
        arm = self.rocker * circle_sphere(pivot, axis, self.rocker, p2, self.coupler, self.branch)
        p3 = pivot + arm
        if detail == "places":
            points = {"P2": link_frames.point(p2), "P3": link_frames.point(p3)}
            return Motion("closed form", angles, speed, acceleration, points)

        tangent = np.stack([np.zeros_like(angles), -p2[2], p2[1]])
        p2_v, p2_a = speed * tangent, acceleration * tangent - speed**2 * p2
        spin, pull = link_frames.rocker_rates(axis, arm, p3 - p2, p2_v, p2_a)
        across = cross(axis, arm)
        p3_v, p3_a = spin * across, pull * across - spin**2 * arm
        points = {"P2": link_frames.point(p2, p2_v, p2_a), "P3": link_frames.point(p3, p3_v, p3_a)}
        if detail == "rates":
            return Motion("closed form", angles, speed, acceleration, points)

        swing = np.arctan2(
            dot(arm, column(self.rocker_frame[:, 1])), dot(arm, column(self.rocker_frame[:, 0]))
        )
        ex, crank_ahead = column(EX), p2 / self.crank
        crank = link_frames.link(
            link_frames.point(np.zeros_like(p2)),
            (ex, crank_ahead, tangent / self.crank),
            speed * ex,
            acceleration * ex,
        )
        ahead, turned, pulled = self._coupler(
            crank_ahead,
            (p2 - p3) / self.coupler,
            (p2_v - p3_v) / self.coupler,
            (p2_a - p3_a) / self.coupler,
            speed,
            acceleration,
        )
        return Motion(
            "closed form",
            angles,
            speed,
            acceleration,
            points,
            links={
                "crank": crank,
                "coupler": link_frames.link(points["P2"], ahead, turned, pulled),
                "rocker": link_frames.pinned_link(pivot, arm / self.rocker, axis, spin, pull),
            },
            joints={
                "crank": JointMotion(angles, speed, acceleration),
                "rocker": JointMotion(swing, spin, pull),
            },
            spinning=frozenset() if self.guide else frozenset({"coupler"}),
        )

    def _coupler(
        self, crank_ahead: Array, x: Array, x_v: Array, x_a: Array, speed: Array, acceleration: Array
    ) -> tuple[tuple[Array, Array, Array], Array, Array]:
        """Return the coupler's axes, angular velocity and acceleration. Paper 000, eqs (27)-(30).

        Without a guide the spin is nobody's: the usual guide (all four angles as a rule) defines it.
        """
        guided, ex = self.guide, column(EX)
        pin_x, pin_y, pin_z = self._pin_at_zero if guided else (-1.0, 0.0, 0.0)
        beta1, beta2 = (self.beta1, self.beta2) if guided else (np.pi / 2, np.pi / 2)
        pin = pin_x * ex + pin_y * crank_ahead + pin_z * cross(ex, crank_ahead)
        guide = unit_at_angles(pin, x, beta1, beta2, self.guide_branch)
        y = cross(guide, x) / np.sin(beta2)
        spins = speed * ex, acceleration * ex
        return (x, y, cross(x, y)), *link_frames.guided_spin(x, x_v, x_a, pin, guide, *spins)

    @cached_property
    def _pin_at_zero(self) -> Array:
        """The pin's direction in the crank's frame, (3,). Paper 000, eq. (28)."""
        return rotation("z", self.psi1) @ rotation("x", self.psi2) @ np.asarray(EY)
