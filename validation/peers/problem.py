"""The problem that mechsim and its peers all solve, and the check of what they return.

One turn of the crank at constant speed; the linkage starts closed and moving. Every link is a steel rod, and
there is no gravity.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim import catalog, dynamics, masses
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND, Inertia
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import LinkMotion, Motion

Array = NDArray[np.float64]
Places = Mapping[str, Array]

TURN = 2.0 * np.pi
SPEED = 10.0 * TURN  # 600 rpm
NAMES = ("rssr", "four_bar")
# instants of a turn at which steps are recorded: what the fewest steps give
SAMPLES = 20


@dataclass(frozen=True)
class Hinge:
    """A revolute joint on the ground.

    Attributes:
        place: in the ground frame, (3,) in [m].
        frame: its columns are where its angle is counted from, the direction across, and its axis, (3, 3).
        link_place: in the link's frame, (3,) in [m].
        link_frame: the same three directions in the link's frame, (3, 3).
        angle, rate: at the start, in [rad] and [rad/s].
    """

    place: Array
    frame: Array
    link_place: Array
    link_frame: Array
    angle: float
    rate: float

    def in_frame(self, local: Array) -> Array:
        """Return a point of the link as seen from the joint's frame at angle zero, (3,) in [m]."""
        return self.link_frame.T @ (local - self.link_place)

    def carried(self, local: Array, angle: Array) -> Array:
        """Return where the joint carries a point of its link at joint angles (n,); (n, 3) in [m]."""
        x, y, z = self.in_frame(local)
        cos, sin = np.cos(angle), np.sin(angle)
        turned = np.stack([x * cos - y * sin, x * sin + y * cos, np.full_like(angle, z)], 1)
        return self.place + turned @ self.frame.T


@dataclass(frozen=True)
class Problem:
    """A four-bar linkage, crank, coupler and rocker, with its crank turning at constant speed."""

    drive: ClosedForm
    speed: float = SPEED

    @property
    def name(self) -> str:
        return self.drive.name

    @property
    def planar(self) -> bool:
        """Whether all hinges are parallel, so that the pairs at the coupler are hinges too."""
        return all(joint.kind == "revolute" for joint in self.mechanism.joints)

    @cached_property
    def mechanism(self) -> Mechanism:
        return masses.with_inertia(self.drive.mechanism)

    @property
    def crank(self) -> float:
        """Length of the crank in [m], the characteristic length of place errors."""
        length = getattr(self.drive, "crank")  # noqa: B009 - not every drive has one
        return float(length)

    @property
    def duration(self) -> float:
        return TURN / self.speed

    @property
    def start(self) -> float:
        return self.mechanism.start

    def angles(self, samples: int) -> Array:
        """Return the crank angles at which a turn is looked at, (samples + 1,), both ends."""
        return self.start + np.linspace(0.0, TURN, samples + 1)

    @cached_property
    def initial(self) -> Motion:
        """The motion at the start, of one instant: consistent places and rates to begin from."""
        return self.drive.solve([self.start], self.speed)

    def link(self, name: str) -> LinkMotion:
        return self.initial.links[name]

    def inertia(self, link: str) -> Inertia:
        result = next(item.inertia for item in self.mechanism.links if item.name == link)
        assert result is not None
        return result

    def joint(self, item: str, other: str) -> Joint:
        """Return the joint between two links, its side a on the first."""
        return next(j for j in self.mechanism.joints if (j.a.link, j.b.link) == (item, other))

    def hinge(self, link: str) -> Hinge:
        """Return the joint of the crank or the rocker with the ground."""
        joint, moving = self.joint(GROUND, link), self.initial.joints[link]
        return Hinge(
            np.array(joint.a.point),
            joint.a.frame,
            np.array(joint.b.point),
            joint.b.frame,
            float(moving.value[0]),
            float(moving.rate[0]),
        )

    @property
    def tips(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Where the coupler meets crank and rocker: (on crank, on coupler), (on coupler, on rocker)."""
        first, second = self.joint("crank", "coupler"), self.joint("coupler", "rocker")
        return (np.array(first.a.point), np.array(first.b.point)), (
            np.array(second.a.point),
            np.array(second.b.point),
        )

    def torque(self, angles: Array) -> Array:
        """Return the drive torque at crank angles by the reduced equation of motion, (n,) in [N m]."""
        machine = dynamics.dynamic_model(self.drive, mechanism=self.mechanism)
        return dynamics.prescribed(machine, angles, self.speed).forces.torque

    def places(self, crank: Array, rocker: Array) -> dict[str, Array]:
        """Return the tracked points at angles of crank and rocker (n,), as joints of a solver give them.

        A point of a planar coupler is placed by the line between its two ends.
        """
        (at_crank, near), (far, at_rocker) = self.tips
        a, b = self.hinge("crank").carried(at_crank, crank), self.hinge("rocker").carried(at_rocker, rocker)
        result = {}
        for name, (link, local) in self.mechanism.points.items():
            if link == "coupler":
                result[name] = _on_line(a, b, near, far, np.array(local))
            else:
                result[name] = self.hinge(link).carried(np.array(local), crank if link == "crank" else rocker)
        return result


@dataclass(frozen=True)
class Errors:
    """How wrong a motion is.

    Attributes:
        place: the worst of all tracked points at all instants, in units of the crank.
        rocker: worst angle of the rocker in [rad].
    """

    place: float
    rocker: float


def problem(name: str, **dimensions: float) -> Problem:
    """Return a problem by its catalogue name, with the catalogue's dimensions where none are given."""
    return Problem(catalog.make(name, **dimensions))


def judge(asked: Problem, angles: Array, result: Places) -> Errors:
    """Return the errors of tracked points (n, 3) against the closed form at the crank angles asked for.

    A turn that ended early, a missing point or a number that is none is an infinite error.
    """
    exact = asked.drive.positions(angles)
    whole = all(name in result and np.shape(result[name]) == place.shape for name, place in exact.items())
    if not whole or not all(np.isfinite(result[name]).all() for name in exact):
        return Errors(np.inf, np.inf)
    place = max(float(np.sqrt(((result[name] - exact[name]) ** 2).sum(1)).max()) for name in exact)
    gap = _swing(asked, result) - _swing(asked, exact)
    gap -= TURN * np.round(gap / TURN)
    return Errors(place / asked.crank, float(np.abs(gap).max()))


def judge_torque(asked: Problem, angles: Array, result: Array | None) -> float:
    """Return the worst error of a drive torque (n,) in units of the largest; NaN where there is none."""
    if result is None:
        return np.nan
    exact = asked.torque(angles)
    if result.shape != exact.shape or not np.isfinite(result).all():
        return np.inf
    return float(np.abs(result - exact).max() / np.abs(exact).max())


def _swing(asked: Problem, places: Places) -> Array:
    """Return the rocker's angle from the tracked point at its tip, (n,) in [rad]."""
    name = next(name for name, (link, _) in asked.mechanism.points.items() if link == "rocker")
    hinge = asked.hinge("rocker")
    across = (places[name] - hinge.place) @ hinge.frame
    return np.arctan2(across[:, 1], across[:, 0])


def _on_line(a: Array, b: Array, near: Array, far: Array, local: Array) -> Array:
    """Return the places of a point of a planar body given by two of its points, (n, 3)."""
    turn = complex(*(local - near)[:2]) / complex(*(far - near)[:2])
    line = b - a
    return a + turn.real * line + turn.imag * np.stack([-line[:, 1], line[:, 0], np.zeros(len(a))], 1)
