"""Planar four-bar linkage with a coupler point: its dimensions and its closed form."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.base import Array, Detail, TwoBranchForm, angle, choice, length
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.vectors import Sign, circle_sphere, column, cross, dot
from mechsim.model.mechanism import EZ, GROUND, End, Joint, Link, Mechanism
from mechsim.model.motion import JointMotion, Motion


@dataclass(frozen=True, kw_only=True)
class FourBar(TwoBranchForm):
    """Planar four-bar O-A-B-O4 in the XY plane, O at the origin and O4 at (ground, 0).

    The crank angle counts from +X. The coupler point C is at `arm` from A, turned by `arm_angle`
    from AB. `branch` is the sign of O4B . (O4A x eZ): +1 if B lies left of the line from A to O4.
    """

    name: ClassVar[str] = "four_bar"

    ground: float = length(0.100, "distance of the pivots O, O4")
    crank: float = length(0.032, "length OA")
    coupler: float = length(0.091, "length AB")
    rocker: float = length(0.074, "length O4B")
    branch: Sign = choice(1, (1, -1), "assembly: sign of O4B . (O4A x eZ)")
    arm: float = length(0.058, "distance of the coupler point C from A")
    arm_angle: float = angle(np.deg2rad(31.0), "angle from AB to AC")

    @property
    def mechanism(self) -> Mechanism:
        guess, start = self.guess()
        tip = (self.crank, 0.0, 0.0)
        on_coupler, on_rocker = (self.coupler, 0.0, 0.0), (self.rocker, 0.0, 0.0)
        point = (self.arm * float(np.cos(self.arm_angle)), self.arm * float(np.sin(self.arm_angle)), 0.0)
        return Mechanism(
            name=self.name,
            links=(Link("crank"), Link("coupler", outline=(point,)), Link("rocker")),
            joints=(
                Joint("crank", "revolute", End(GROUND), End("crank")),
                Joint("A", "revolute", End("crank", tip), End("coupler")),
                Joint("B", "revolute", End("coupler", on_coupler), End("rocker", on_rocker)),
                Joint("rocker", "revolute", End(GROUND, (self.ground, 0.0, 0.0)), End("rocker")),
            ),
            driver="crank",
            points={"A": ("crank", tip), "B": ("rocker", on_rocker), "C": ("coupler", point)},
            guess=guess,
            start=start,
        )

    def margin(self, angles: ArrayLike) -> Array:
        """4 r2 d2 - (d2 + r2 - l2)2 for rocker r, coupler l and d = |O4A|."""
        to_crank = self._tip(np.asarray(angles)) - column((self.ground, 0.0, 0.0))
        reach2 = dot(to_crank, to_crank)
        return 4.0 * self.rocker**2 * reach2 - (reach2 + self.rocker**2 - self.coupler**2) ** 2

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        pivot = np.array([self.ground, 0.0, 0.0])
        normal = np.cross(points["A"] - pivot, np.asarray(EZ))
        return self.branch * ((points["B"] - pivot) * normal).sum(-1)

    def transmission_angle(self, angles: ArrayLike) -> Array:
        points = self.positions(angles)
        rod = (points["B"] - points["A"]) / self.coupler
        arm = (points["B"] - np.array([self.ground, 0.0, 0.0])) / self.rocker
        return np.arcsin(np.minimum(np.abs(np.cross(rod, arm)[:, 2]), 1.0))

    def _tip(self, angles: Array) -> Array:
        return self.crank * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])

    def _motion(self, angles: Array, speed: Array, acceleration: Array, detail: Detail) -> Motion:
        ez, pivot = column(EZ), column((self.ground, 0.0, 0.0))
        a = self._tip(angles)
        swing = circle_sphere(pivot, ez, self.rocker, a, self.coupler, self.branch)
        arm = self.rocker * swing
        b = pivot + arm
        ahead = (b - a) / self.coupler
        to_c = self.arm * (np.cos(self.arm_angle) * ahead + np.sin(self.arm_angle) * cross(ez, ahead))
        if detail == "places":
            points = {"A": link_frames.point(a), "B": link_frames.point(b), "C": link_frames.point(a + to_c)}
            return Motion("closed form", angles, speed, acceleration, points)

        tangent = cross(ez, a)
        a_v, a_a = speed * tangent, acceleration * tangent - speed**2 * a
        spin, pull = link_frames.rocker_rates(ez, arm, b - a, a_v, a_a)
        across = cross(ez, arm)
        b_v, b_a = spin * across, pull * across - spin**2 * arm
        # the coupler turns as B moves about A
        turning, turn_rate = link_frames.planar_turn(b - a, b_v - a_v, b_a - a_a)
        c_across = cross(ez, to_c)
        points = {
            "A": link_frames.point(a, a_v, a_a),
            "B": link_frames.point(b, b_v, b_a),
            "C": link_frames.point(
                a + to_c, a_v + turning * c_across, a_a + turn_rate * c_across - turning**2 * to_c
            ),
        }
        if detail == "rates":
            return Motion("closed form", angles, speed, acceleration, points)
        at_origin = link_frames.point(np.zeros_like(a))
        return Motion(
            "closed form",
            angles,
            speed,
            acceleration,
            points,
            links={
                "crank": link_frames.planar_link(at_origin, a / self.crank, speed, acceleration),
                "coupler": link_frames.planar_link(points["A"], ahead, turning, turn_rate),
                "rocker": link_frames.pinned_link(pivot, swing, ez, spin, pull),
            },
            joints={
                "crank": JointMotion(angles, speed, acceleration),
                "A": JointMotion(
                    np.arctan2(ahead[1], ahead[0]) - angles, turning - speed, turn_rate - acceleration
                ),
                "rocker": JointMotion(np.arctan2(swing[1], swing[0]), spin, pull),
            },
        )
