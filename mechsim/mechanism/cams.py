"""Cams from motion laws: profile, pressure angle and radius of curvature.

In the cam's frame the follower moves clockwise around the cam, which rotates counterclockwise by the angle q:
a point P(q) of the follower draws the curve p = R(-q) P. With z the cam's axis its tangent is R(-q) t and the
change of the tangent R(-q) c,

    t = P' - z x P,    c = P'' - 2 z x P' - P,    1/rho = (c x t) / abs(t)**3

(Norton, *Cam Design and Manufacturing Handbook*, ch. 7). For a roller on a slide with the offset e the
pressure angle is tan(a) = (s' - e) / (sqrt(r0**2 - e**2) + s), for a flat face rho = r_b + s + s''.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.coupling_functions import PlainFunction
from mechsim.mechanism.expressions import Instruction
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.jets import Jet
from mechsim.numerics.peaks import peak

LawName = Literal["dwell", "cycloidal", "modified_sine", "polynomial_345"]
FollowerKind = Literal["knife", "roller", "flat"]
Motion = Literal["translating", "swinging"]
# largest difference of a law's ends relative to its scale, and of its angles from a revolution in [rad];
# least clearance against undercut
PERIODIC = 1e-9
# cam angles at which a cam is checked: every half degree, and those at which its law must repeat
CHECKED, PERIODS = 720, 8


def _modified_sine(u: Jet) -> Jet:
    """Sine accelerations of two frequencies that meet at u = 1/8 and 7/8 (Norton, sec. 3.6)."""
    ends = np.pi * u - np.sin(4.0 * np.pi * u) / 4.0
    middle = 2.0 + np.pi * u - 2.25 * np.sin(np.pi / 3.0 + 4.0 * np.pi / 3.0 * u)
    argument = np.real(u.value)
    entries = [
        np.select(
            [argument < 0.125, argument <= 0.875], [getattr(ends, entry), getattr(middle, entry)], after
        )
        for entry, after in (("value", ends.value + 4.0), ("rate", ends.rate), ("second", ends.second))
    ]
    return Jet(*entries) / (4.0 + np.pi)


# law of unit lift over unit length (VDI 2143; Norton, ch. 3)
LAWS: dict[LawName, Callable[[Jet], Jet]] = {
    "dwell": lambda u: 0.0 * u,
    "cycloidal": lambda u: u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi),
    "modified_sine": _modified_sine,
    "polynomial_345": lambda u: u * u * u * (10.0 - u * (15.0 - 6.0 * u)),
}


@dataclass(frozen=True)
class SegmentedLaw:
    """A law of a cam's angle q by rises, dwells and returns, repeated each revolution.

    Attributes:
        text: its name, for messages.
        kinds: law of each segment.
        ends: first angle of each segment and the last one, rising, in [rad].
        levels: lift at these angles.
    """

    NUMBERS: ClassVar[tuple[str, ...]] = ("ends", "levels")
    interval: ClassVar[tuple[float, float]] = (-np.pi, np.pi)

    text: str
    kinds: tuple[LawName, ...]
    ends: tuple[float, ...]
    levels: tuple[float, ...]

    def __call__(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the lift and its first two derivatives at angles (n,) in [rad]."""
        ends, levels = np.array(self.ends), np.array(self.levels)
        q = q - REVOLUTION * np.floor((np.real(q) - np.real(ends[0])) / REVOLUTION)
        # not below the first end, by the line above
        segment = np.searchsorted(np.real(ends[1:-1]), np.real(q), "right")
        width = (ends[1:] - ends[:-1])[segment]
        u = Jet((q - ends[segment]) / width, 1.0 / width, 0.0 * width)
        unit = np.empty((3, *q.shape), u.value.dtype)
        for i in {*segment.tolist()}:
            within = segment == i
            law = LAWS[self.kinds[i]](Jet(u.value[within], u.rate[within], u.second[within]))
            unit[:, within] = law.value, law.rate, law.second
        lift = (levels[1:] - levels[:-1])[segment]
        value, rate, second = (lift * entry for entry in unit)
        return levels[segment] + value, rate, second

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """Its evaluation."""
        return Instruction("variable", "q"), Instruction("segments", self, 1)


LiftLaw = PlainFunction | SegmentedLaw


@dataclass(frozen=True)
class Cam:
    """A cam and its follower, in [m] and [rad].

    At q = 0 a translating follower moves along y, at the offset along x; a swinging one has its pivot at
    x = centre_distance and swings with the lift away from the cam's centre.

    Attributes:
        name: of the cam, for messages.
        kind: knife (edge), roller, or flat (face).
        motion: translating, or swinging.
        base_radius: least radius of the profile at zero lift.
        law: lift as a function of the cam's angle.
        radius: of the roller.
        offset: of the follower's slide from the cam's centre; of a swinging face from the pivot.
        arm: from the pivot of a swinging follower to its roller.
        centre_distance: from the cam's centre to this pivot.
    """

    name: str
    kind: FollowerKind
    motion: Motion
    base_radius: float
    law: LiftLaw
    radius: float = 0.0
    offset: float = 0.0
    arm: float = 0.0
    centre_distance: float = 0.0

    def __post_init__(self) -> None:
        least = self.base_radius + self.radius
        if self.kind != "flat" and self.motion == "translating" and not abs(self.offset) < least:
            raise InputError(
                f"cam {self.name!r} has the offset {self.offset:g} m; give less than {least:g} m, the "
                "radius at which the follower starts"
            )
        d, other = self.centre_distance, self.offset if self.kind == "flat" else self.arm
        if self.motion == "swinging" and not (
            abs(least - other) < d if self.kind == "flat" else abs(d - other) < least < d + other
        ):
            raise InputError(
                f"cam {self.name!r} has a centre distance of {d:g} m, with which its follower does not reach "
                f"the base circle of {self.base_radius:g} m; change arm, offset or centre_distance"
            )
        self._require_periodic()
        self._require_no_undercut()

    @property
    def start(self) -> float:
        """Height of the slide, or angle of the arm or face from the line of centres, at zero lift."""
        least, d = self.base_radius + self.radius, self.centre_distance
        if self.motion == "swinging":
            if self.kind == "flat":
                return float(np.arcsin((self.base_radius - self.offset) / d))
            return float(np.arccos((d**2 + self.arm**2 - least**2) / (2.0 * d * self.arm)))
        return self.base_radius if self.kind == "flat" else float(np.sqrt(least**2 - self.offset**2))

    def contact(self, q: Array) -> "CamContact":
        """Return the contact at cam angles, (n,) in [rad]."""
        lift, rate, second = (entry + 0.0 * q for entry in self.law(np.asarray(q)))
        s = Jet(self.start + lift, rate, second)
        if self.kind == "flat":
            return self._flat_contact(q, s)
        if self.motion == "translating":
            x, y = Jet(self.offset + 0.0 * q, 0.0 * q, 0.0 * q), s
            along = np.array([0.0 * q, 1.0 + 0.0 * q])
        else:
            x, y = self.centre_distance - self.arm * np.cos(s), self.arm * np.sin(s)
            along = np.array([np.sin(s.value), np.cos(s.value)])
        point = np.array([x.value, y.value])
        tangent = np.array([x.rate + y.value, y.rate - x.value])
        change = np.array([x.second + 2.0 * y.rate - x.value, y.second - 2.0 * x.rate - y.value])
        length = np.hypot(*tangent)
        normal = np.array([-tangent[1], tangent[0]]) / length
        curvature = (change[0] * tangent[1] - change[1] * tangent[0]) / length**3
        angle = np.arctan2(along[0] * normal[1] - along[1] * normal[0], (along * normal).sum(0))
        with np.errstate(divide="ignore"):
            radius = 1.0 / curvature - self.radius
        return CamContact(
            q, lift, point, point - self.radius * normal, normal, angle, radius, 1.0 - self.radius * curvature
        )

    def lever(self, q: Array) -> Array:
        """Return the normal displacement of the contact per lift, (n,) in [1] or [m]."""
        contact = self.contact(q)
        lever = np.cos(contact.pressure_angle)
        if self.motion == "translating":
            return lever
        x, y = contact.pitch
        return lever * np.hypot(x - self.centre_distance, y)

    def _flat_contact(self, q: Array, s: Jet) -> "CamContact":
        zero = 0.0 * q
        if self.motion == "translating":
            radius = s.value + s.second
            point = np.array([s.rate, s.value])
            return CamContact(
                q, s.value - self.start, point, point, np.array([zero, zero + 1.0]), zero, radius, radius
            )
        d, (sine, cosine) = self.centre_distance, (np.sin(s.value), np.cos(s.value))
        normal, speed = np.array([sine, cosine]), 1.0 + s.rate
        along = d * cosine / speed
        pivot = np.array([d + zero, zero])
        point = pivot + self.offset * normal + along * np.array([-cosine, sine])
        # h + d2h/dpsi2 with the distance h of the face from the centre and its direction psi
        curvature = (d * cosine * s.second - d * sine * s.rate**2 * speed) / speed**3
        radius = d * sine + self.offset + curvature
        angle = np.arctan2(self.offset, along)
        return CamContact(
            q, s.value - self.start, point, point, normal, angle, radius, np.minimum(radius, speed)
        )

    def _require_periodic(self) -> None:
        q = np.linspace(0.0, REVOLUTION, PERIODS)
        first, last = (
            np.array([entry + 0.0 * q for entry in self.law(q + later)[:2]]) for later in (0.0, REVOLUTION)
        )
        scale = max(self.base_radius if self.motion == "translating" else 1.0, float(np.abs(first).max()))
        if not np.isfinite(first).all():
            undefined = q[~np.isfinite(first).all(0)][0]
            raise InputError(
                f"cam {self.name!r} has a law that is not finite at {undefined:.4g} rad; change it"
            )
        if not np.abs(last - first).max() <= PERIODIC * scale:
            worst = int(np.abs(last - first).max(0).argmax())
            raise InputError(
                f"cam {self.name!r} has a law that does not repeat after a revolution: lift and derivative "
                f"are {first[0, worst]:.6g}, {first[1, worst]:.6g} at {q[worst]:.4g} rad, a revolution later "
                f"{last[0, worst]:.6g}, {last[1, worst]:.6g}"
            )

    def _require_no_undercut(self) -> None:
        q, least = peak(lambda q: -self.contact(q).clearance, np.linspace(0.0, REVOLUTION, CHECKED + 1))
        if not -least > PERIODIC * (self.base_radius if self.kind == "flat" else 1.0):
            radius = self.contact(np.array([q])).curvature_radius[0]
            raise InputError(
                f"cam {self.name!r} is undercut at the cam angle {q:.4g} rad, where the radius of curvature "
                f"of its profile would be {radius:.4g} m; enlarge the base radius, take a smaller roller, "
                "or a gentler law"
            )


@dataclass(frozen=True)
class CamContact:
    """Contact of a cam with its follower at n cam angles.

    Attributes:
        angle: of the cam, (n,) in [rad].
        lift: (n,) in [m] or [rad].
        pitch: centre of the roller, or contact point, in the frame of the follower's guide, (2, n) in [m].
        point: contact point there, (2, n) in [m].
        normal: unit normal of the cam there, away from the cam, (2, n).
        pressure_angle: from the follower's motion to the normal, (n,) in [rad].
        curvature_radius: of the profile, positive where it is convex, (n,) in [m].
        clearance: 1 - roller radius / radius of curvature of the path of its centre; of a flat face the
            radius of curvature of the profile in [m]; not positive where the cam is undercut, (n,).
    """

    angle: Array
    lift: Array
    pitch: Array
    point: Array
    normal: Array
    pressure_angle: Array
    curvature_radius: Array
    clearance: Array

    def in_cam(self, point: Array) -> Array:
        """Return points (2, n) in the cam's frame."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array([c * point[0] + s * point[1], c * point[1] - s * point[0]])
