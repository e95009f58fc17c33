"""The problem that mechsim and its peers solve, and the errors of their solutions.

One revolution of the crank at constant speed; initial positions and velocities are consistent. Every link is
a steel rod, and there is no gravity.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim import catalog, dynamics, masses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, Inertia
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import LinkMotion, Motion

Array = NDArray[np.float64]
Positions = Mapping[str, Array]

REVOLUTION = 2.0 * np.pi
SPEED = 10.0 * REVOLUTION  # 600 rpm, in [rad/s]
NAMES = ("rssr", "four_bar")
# instants of a revolution at which steps are recorded: as many as the fewest steps
SAMPLES = 20


@dataclass(frozen=True)
class Hinge:
    """A revolute joint on the ground.

    Attributes:
        place: in the ground frame, (3,) in [m].
        frame: columns are the zero direction of the angle, the perpendicular direction and the axis, (3, 3).
        link_place: in the link's frame, (3,) in [m].
        link_frame: the same three directions in the link's frame, (3, 3).
        angle, rate: at the start, in [rad] and [rad/s].
    """

    position: Array
    frame: Array
    link_position: Array
    link_frame: Array
    angle: float
    rate: float

    def in_frame(self, local: Array) -> Array:
        """Return a point of the link in the joint's frame at angle zero, (3,) in [m]."""
        return self.link_frame.T @ (local - self.link_position)

    def path(self, local: Array, angle: Array) -> Array:
        """Return the positions of a point of the link at joint angles (n,); (n, 3) in [m]."""
        x, y, z = self.in_frame(local)
        cos, sin = np.cos(angle), np.sin(angle)
        rotated = np.stack([x * cos - y * sin, x * sin + y * cos, np.full_like(angle, z)], 1)
        return self.position + rotated @ self.frame.T


@dataclass(frozen=True)
class Problem:
    """A four-bar linkage, crank, coupler and rocker, with its crank turning at constant speed."""

    closed_form: KinematicSolver
    speed: float = SPEED

    @property
    def name(self) -> str:
        return self.closed_form.name

    @property
    def planar(self) -> bool:
        """Whether all joints are revolute, with parallel axes."""
        return all(joint.kind == "revolute" for joint in self.mechanism.joints)

    @cached_property
    def mechanism(self) -> Mechanism:
        return masses.with_inertia(self.closed_form.mechanism)

    @property
    def crank(self) -> float:
        """Length of the crank in [m], the characteristic length of position errors."""
        length = getattr(self.closed_form, "crank")  # noqa: B009 - not every closed form has one
        return float(length)

    @property
    def duration(self) -> float:
        return REVOLUTION / self.speed

    @property
    def start(self) -> float:
        return self.mechanism.start

    def angles(self, samples: int) -> Array:
        """Return the crank angles at which a revolution is compared, (samples + 1,), with both ends."""
        return self.start + np.linspace(0.0, REVOLUTION, samples + 1)

    @cached_property
    def initial_motion(self) -> Motion:
        """The motion at the initial instant: consistent positions and rates."""
        return self.closed_form.solve([self.start], self.speed)

    def link(self, name: str) -> LinkMotion:
        return self.initial_motion.links[name]

    def inertia(self, link: str) -> Inertia:
        result = next(item.inertia for item in self.mechanism.links if item.name == link)
        assert result is not None
        return result

    def joint(self, first_link: str, second_link: str) -> Joint:
        """Return the joint between two links, its end a on the first."""
        return next(j for j in self.mechanism.joints if (j.a.link, j.b.link) == (first_link, second_link))

    def hinge(self, link: str) -> Hinge:
        """Return the joint of the crank or the rocker with the ground."""
        joint, motion = self.joint(GROUND, link), self.initial_motion.joints[link]
        return Hinge(
            np.array(joint.a.point),
            joint.a.frame,
            np.array(joint.b.point),
            joint.b.frame,
            float(motion.value[0]),
            float(motion.rate[0]),
        )

    @property
    def coupler_ends(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Joints of the coupler: (point on crank, on coupler), (point on coupler, on rocker)."""
        first, second = self.joint("crank", "coupler"), self.joint("coupler", "rocker")
        return (np.array(first.a.point), np.array(first.b.point)), (
            np.array(second.a.point),
            np.array(second.b.point),
        )

    def torque(self, angles: Array) -> Array:
        """Return the drive torque at crank angles by the reduced equation of motion, (n,) in [N m]."""
        model = dynamics.dynamic_model(self.closed_form, mechanism=self.mechanism)
        return dynamics.prescribed(model, angles, self.speed).forces.torque

    def positions(self, crank: Array, rocker: Array) -> dict[str, Array]:
        """Return the positions of the tracked points at angles of crank and rocker, (n,).

        The line between the two ends of a planar coupler determines its points.
        """
        (at_crank, coupler_start), (coupler_end, at_rocker) = self.coupler_ends
        a, b = self.hinge("crank").path(at_crank, crank), self.hinge("rocker").path(at_rocker, rocker)
        result = {}
        for name, (link, local) in self.mechanism.points.items():
            if link == "coupler":
                result[name] = _coupler_point(a, b, coupler_start, coupler_end, np.array(local))
            else:
                result[name] = self.hinge(link).path(np.array(local), crank if link == "crank" else rocker)
        return result


@dataclass(frozen=True)
class Errors:
    """Largest errors of a motion.

    Attributes:
        position: of all tracked points at all instants, in units of the crank.
        rocker: of the angle of the rocker, in [rad].
    """

    position: float
    rocker: float


def make_problem(name: str, **dimensions: float) -> Problem:
    """Return a problem by its catalogue name, with the catalogue's dimensions where none are given."""
    return Problem(catalog.make(name, **dimensions))


def position_errors(problem: Problem, angles: Array, result: Positions) -> Errors:
    """Return the errors of tracked points (n, 3) against the closed form at given crank angles.

    The errors of an incomplete revolution, a missing point and a non-finite number are infinite.
    """
    exact = problem.closed_form.positions(angles)
    complete = all(name in result and np.shape(result[name]) == exact[name].shape for name in exact)
    if not complete or not all(np.isfinite(result[name]).all() for name in exact):
        return Errors(np.inf, np.inf)
    position = max(float(np.sqrt(((result[name] - exact[name]) ** 2).sum(1)).max()) for name in exact)
    difference = _rocker_angle(problem, result) - _rocker_angle(problem, exact)
    difference -= REVOLUTION * np.round(difference / REVOLUTION)
    return Errors(position / problem.crank, float(np.abs(difference).max()))


def torque_error(problem: Problem, angles: Array, result: Array | None) -> float:
    """Return the largest error of a drive torque (n,) relative to the largest torque; NaN without torque."""
    if result is None:
        return np.nan
    exact = problem.torque(angles)
    if result.shape != exact.shape or not np.isfinite(result).all():
        return np.inf
    return float(np.abs(result - exact).max() / np.abs(exact).max())


def _rocker_angle(problem: Problem, positions: Positions) -> Array:
    """Return the rocker's angle from the tracked point at its tip, (n,) in [rad]."""
    name = next(name for name, (link, _) in problem.mechanism.points.items() if link == "rocker")
    hinge = problem.hinge("rocker")
    components = (positions[name] - hinge.position) @ hinge.frame
    return np.arctan2(components[:, 1], components[:, 0])


def _coupler_point(a: Array, b: Array, coupler_start: Array, coupler_end: Array, local: Array) -> Array:
    """Return the positions of a point of a planar body from two of its points, (n, 3)."""
    ratio = complex(*(local - coupler_start)[:2]) / complex(*(coupler_end - coupler_start)[:2])
    line = b - a
    return a + ratio.real * line + ratio.imag * np.stack([-line[:, 1], line[:, 0], np.zeros(len(a))], 1)
