"""Two-crank six-link mechanism of a warp-knitting machine: its dimensions and its closed form."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.catalog.base import Array, ClosedForm, Detail, angle, length, number, place
from mechsim.analytic.vector_method import link_frames, triad_assemblies
from mechsim.analytic.vector_method.plane import cross, flat, xyz
from mechsim.analytic.vector_method.triad_legs import determinant, leg_vectors, moments, rates
from mechsim.analytic.vector_method.triad_path import Pivots, TriadPath
from mechsim.analytic.vector_method.trig_arcs import Arcs
from mechsim.errors import InputError
from mechsim.model.mechanism import GROUND, End, Gear, Joint, Link, Mechanism, Pose
from mechsim.model.motion import JointMotion, LinkMotion, Motion, PointMotion

# gears have hardly more teeth than this
MOST_TEETH = 1000
# joint -> the links it joins, the one nearer the frame first
JOINED = {
    "crank": (GROUND, "crank1"),
    "crank2": (GROUND, "crank2"),
    "A": ("crank1", "rod3"),
    "B": ("rod3", "base"),
    "D": ("crank2", "rod5"),
    "C": ("rod5", "base"),
    "K": ("base", "rocker"),
    "rocker": (GROUND, "rocker"),
}
# turns of crank 1 tried before a gear that never brings both cranks round is called free to turn
TURNS_TRIED = 100

# an assembly is followed turn by turn of crank 2: beyond this a turn of crank 1 takes minutes
MOST_RATIO = 1000.0


@dataclass(frozen=True, kw_only=True)
class WarpKnitter(ClosedForm):
    """Cranks O1A and O2D, rods AB and CD, ternary base link BCK, rocker KE, in the XY plane.

    Crank 1 turns about the origin, its angle counted from +X; gears turn crank 2 by `gear_ratio`
    times that, from `phase`. Links 3, 4, 5, 6 are an Assur group of class III: up to six assemblies.
    They are numbered from 1 at crank angle 0, by rising angle of the base link (of its frame, in
    which B is the origin) in [0, 2 pi); `assembly` is followed from there as the crank turns.

    Source: paper 003; defaults from papers.md section 3.
    """

    name: ClassVar[str] = "warp_knitter"

    crank1: float = length(0.009, "length O1A")
    crank2: float = length(0.006, "length O2D")
    rod3: float = length(0.074, "length AB")
    rod5: float = length(0.049, "length DC")
    rocker: float = length(0.035, "length EK")
    pivot2: tuple[float, float] = place((0.055, 0.023), "pivot O2 of crank 2")
    pivot_rocker: tuple[float, float] = place((-0.003, 0.079), "rocker pivot E")
    base_c: tuple[float, float] = place((0.042, 0.0), "C in the frame of the base link, B being its origin")
    base_k: tuple[float, float] = place((0.003, 0.024), "K in the frame of the base link")
    phase: float = angle(math.radians(75.0), "angle of crank 2 where crank 1 is at zero")
    gear_ratio: float = number(-2.0, "turns of crank 2 per turn of crank 1")
    assembly: int = number(2, "number of the assembly at crank angle 0, by rising angle of the base link")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gear_ratio == 0.0:
            raise InputError(f"{self.name}: gear_ratio is 0; give the turns of crank 2 per turn of crank 1")
        if not 1.0 / MOST_RATIO <= abs(self.gear_ratio) <= MOST_RATIO:
            raise InputError(
                f"{self.name}: gear_ratio is {self.gear_ratio}; "
                f"give one from 1/{MOST_RATIO:g} to {MOST_RATIO:g}, of either sign"
            )
        if self.assembly != int(self.assembly):
            raise InputError(f"{self.name}: assembly is {self.assembly}; give a whole number")
        object.__setattr__(self, "assembly", int(self.assembly))
        count = len(self._at_zero)
        # where none exists the dimensions are to blame, which solving says
        if self.assembly < 1 or 0 < count < self.assembly:
            raise InputError(
                f"{self.name}: assembly is {self.assembly}, but at crank angle 0 there are {count}; "
                f"give a number from 1 to {max(count, 1)}"
            )

    @property
    def mechanism(self) -> Mechanism:
        guess, start = self.guess()
        return description(self, guess, start)

    @property
    def two_degrees_of_freedom(self) -> Mechanism:
        """The mechanism without its gears: both cranks are free, W = 2."""
        return replace(self.mechanism, gears=())

    @property
    def sides(self) -> tuple[float, float, float]:
        """Lengths of the three legs of the triad: rod 3, rod 5, rocker, in [m]."""
        return self.rod3, self.rod5, self.rocker

    @property
    def platform(self) -> tuple[complex, complex, complex]:
        """B, C, K in the frame of the base link, in [m]."""
        return 0j, complex(*self.base_c), complex(*self.base_k)

    @property
    def pivots(self) -> Pivots:
        """Where A, D and E go as crank 1 turns."""
        return Pivots(
            (0j, complex(*self.pivot2), complex(*self.pivot_rocker)),
            (self.crank1, self.crank2, 0.0),
            (1.0, self.gear_ratio, 0.0),
            (0.0, self.phase, 0.0),
        )

    def guess(self) -> tuple[dict[str, Pose], float]:
        """Return link poses at crank angle 0, where assemblies are numbered; none if it cannot stand."""
        if self._path is None:
            return {}, 0.0
        links = self._motion(np.zeros(1), np.zeros(1), np.zeros(1), "links").links
        return {name: Pose(link.position[0], link.rotation[0]) for name, link in links.items()}, 0.0

    def crank_range(self) -> Arcs:
        """Return the arc of crank angle that this assembly reaches from crank angle 0.

        An arc shorter than a turn begins in [-pi, pi), as for any drive, where the cranks come round
        with every turn of crank 1. Else it contains 0: a triad may go round into another assembly and
        meet its dead centre more than a turn later. Where the cranks never come round, 100 turns
        either way count as a full turn.

        Accuracy: 1e-12 rad.
        """
        if self._path is None:
            return Arcs(False, ())
        if self._path.round() is not None:
            return Arcs(True, ((-np.pi, np.pi),))
        far = 2.0 * np.pi * TURNS_TRIED
        low, high = self._path.end(-1, -far), self._path.end(1, far)
        if low is None and high is None:
            return Arcs(True, ((-np.pi, np.pi),))
        low, high = -far if low is None else low, far if high is None else high
        if period_of(self.gear_ratio) == 2.0 * np.pi > high - low:
            shift = 2.0 * np.pi * np.floor((low + np.pi) / (2.0 * np.pi))
            low, high = float(low - shift), float(high - shift)
        return Arcs(False, ((low, high),))

    def assemblies(self, angle: float) -> Sequence[Self]:
        """Return the mechanism in each assembly that is carried from crank angle 0 to this one."""
        return [drive for drive in self._family if drive._reaches(angle)]

    def assembly_points(self, angle: float) -> list[tuple[dict[str, int | None], dict[str, Array]]]:
        """Return every real assembly at a crank angle; its number is None if none at angle 0 leads to it."""
        numbered = [(drive.assembly, drive.positions([angle])) for drive in self.assemblies(angle)]
        known = [(n, {name: p[0] for name, p in points.items()}) for n, points in numbered]
        found: list[tuple[dict[str, int | None], dict[str, Array]]] = []
        for pose in self._assemblies_at(self.pivots.at(angle)):
            points = self._points(np.array([angle]), np.array([pose[0]]), np.array([pose[1]]))
            here = {name: link_frames.point(p).position[0] for name, p in points.items()}
            gaps = [max(float(np.abs(here[name] - other[name]).max()) for name in here) for _, other in known]
            near = int(np.argmin(gaps)) if gaps else None
            matched = near is not None and gaps[near] < 1e-6 * self._longest
            found.append(({"assembly": known[near][0] if matched and near is not None else None}, here))
        return found

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the triad's determinant over that of this assembly at crank angle 0, (n,).

        It cannot change sign without passing a dead centre. Among six assemblies three share it.
        """
        a, b, c, d, k = (flat(points[name]) for name in "ABCDK")
        legs = [b - a, c - d, k - complex(*self.pivot_rocker)]
        value = determinant(legs, [0.0, cross(c - b, legs[1]), cross(k - b, legs[2])])
        return value / self._nominal_determinant

    def transmission_angle(self, angles: ArrayLike) -> Array:
        """Return the angle between the rocker and the force on it, (n,) in [rad], 0 to pi/2.

        Rods 3 and 5 carry only pull and push, so the base link presses on K along the line from K to
        where the lines of the two rods meet. Zero is a pose in which the triad locks.
        """
        points = self.positions(angles)
        a, b, c, d, k = (flat(points[name]) for name in "ABCDK")
        e3, e5 = (b - a) / self.rod3, (c - d) / self.rod5
        e6 = (k - complex(*self.pivot_rocker)) / self.rocker
        force = cross(c - k, e5) * e3 - cross(b - k, e3) * e5
        size = np.maximum(abs(force), np.finfo(np.float64).tiny)
        return np.arcsin(np.minimum(abs(cross(force, e6)) / size, 1.0))

    def _motion(self, angles: Array, speed: Array, acceleration: Array, detail: Detail) -> Motion:
        if self._path is None:
            place = turn = np.full(angles.shape, np.nan + 0j)
        else:
            place, turn = self._path.poses(angles)
        points = self._points(angles, place, turn)
        if detail == "places":
            still = {name: link_frames.point(point) for name, point in points.items()}
            return Motion("closed form", angles, speed, acceleration, still)
        a, _, _, d, _ = (point[0] + 1j * point[1] for point in points.values())
        e, ratio = complex(*self.pivot_rocker), self.gear_ratio
        vectors = leg_vectors(place, turn, [a, d, e], self.platform)
        arm2 = d - complex(*self.pivot2)
        a_v, d_v = 1j * speed * a, 1j * ratio * speed * arm2
        a_a = (1j * acceleration - speed**2) * a
        d_a = (1j * ratio * acceleration - (ratio * speed) ** 2) * arm2
        still = np.zeros_like(a)
        v, spin, pull_at, pull = rates(turn, vectors, self.platform, (a_v, d_v, still), (a_a, d_a, still))
        arms = [turn * point for point in self.platform]
        on_base = [(v + 1j * spin * arm, pull_at + (1j * pull - spin**2) * arm) for arm in arms]
        moves = [(a_v, a_a), on_base[0], on_base[1], (d_v, d_a), on_base[2]]
        motions = {
            name: link_frames.point(point, xyz(velocity), xyz(rate))
            for (name, point), (velocity, rate) in zip(points.items(), moves, strict=True)
        }
        if detail == "rates":
            return Motion("closed form", angles, speed, acceleration, motions)
        links, joints = link_motions(self, angles, speed, acceleration, motions, turn, spin, pull)
        return Motion("closed form", angles, speed, acceleration, motions, links, joints)

    def _points(self, angles: Array, place: Any, turn: Any) -> dict[str, Array]:
        """Return A, B, C, D, K for a pose of the base link, (3, n) each."""
        a, d, _ = self.pivots.at_all(angles)
        b, c, k = (place + turn * point for point in self.platform)
        return {name: xyz(point) for name, point in zip("ABCDK", (a, b, c, d, k), strict=True)}

    def _assemblies_at(self, pivots: list[complex]) -> list[tuple[complex, complex]]:
        """Return place and turn of the base link in every assembly, by rising angle."""
        moved, fixed = ([(z.real, z.imag) for z in points] for points in (pivots, self.platform))
        poses = triad_assemblies.assemblies(moved, fixed, self.sides)
        return [(complex(x, y), complex(np.exp(1j * t))) for x, y, t in poses[np.isfinite(poses[:, 2])]]

    @cached_property
    def _at_zero(self) -> list[tuple[complex, complex]]:
        return self._assemblies_at(self.pivots.at(0.0))

    @cached_property
    def _family(self) -> list[Self]:
        """This mechanism in every assembly of crank angle 0; kept, for each knows its way."""
        numbers = range(1, 1 + len(self._at_zero))
        return [self if n == self.assembly else replace(self, assembly=n) for n in numbers]

    @cached_property
    def _path(self) -> TriadPath | None:
        if not self._at_zero:
            return None
        period = period_of(self.gear_ratio)
        return TriadPath(self.pivots, self.platform, self.sides, self._at_zero[self.assembly - 1], period)

    @cached_property
    def _nominal_determinant(self) -> float:
        place, turn = self._at_zero[self.assembly - 1] if self._at_zero else (0j, 1.0 + 0j)
        vectors = leg_vectors(place, turn, self.pivots.at(0.0), self.platform)
        return determinant(vectors, moments(vectors, turn, self.platform))

    @cached_property
    def angles_at_zero(self) -> dict[str, float]:
        """Angles of the links that are no cranks at crank angle 0, in [rad]."""
        place, turn = self._at_zero[self.assembly - 1] if self._at_zero else (0j, 1.0 + 0j)
        vectors = leg_vectors(place, turn, self.pivots.at(0.0), self.platform)
        names = ("rod3", "rod5", "rocker", "base")
        return {name: float(np.angle(v)) for name, v in zip(names, [*vectors, turn], strict=True)}

    @property
    def _longest(self) -> float:
        return max(*self.sides, *(abs(point) for point in self.platform))

    def _reaches(self, angle: float) -> bool:
        return self._path is not None and bool(np.isfinite(self._path.poses(np.array([angle]))[0][0]))


def description(drive: WarpKnitter, guess: Mapping[str, Pose], start: float) -> Mechanism:
    """Return the mechanism of a warp knitter: six links, eight revolute joints and the gears.

    Frames: cranks and rocker at their pivots, rods at their cranks, x along the link; the base link
    at B as its parameters say.
    """

    def in_plane(x: float, y: float = 0.0) -> tuple[float, float, float]:
        return float(x), float(y), 0.0

    places = {
        ("crank2", GROUND): in_plane(*drive.pivot2),
        ("rocker", GROUND): in_plane(*drive.pivot_rocker),
        ("A", "crank1"): in_plane(drive.crank1),
        ("D", "crank2"): in_plane(drive.crank2),
        ("B", "rod3"): in_plane(drive.rod3),
        ("C", "rod5"): in_plane(drive.rod5),
        ("C", "base"): in_plane(*drive.base_c),
        ("K", "base"): in_plane(*drive.base_k),
        ("K", "rocker"): in_plane(drive.rocker),
    }

    def end(joint: str, link: str) -> End:
        return End(link, places.get((joint, link), in_plane(0.0)))

    points = {"A": "crank1", "B": "base", "C": "base", "D": "crank2", "K": "base"}
    return Mechanism(
        name=drive.name,
        links=tuple(Link(name) for name in ("crank1", "crank2", "rod3", "rod5", "base", "rocker")),
        joints=tuple(Joint(name, "revolute", end(name, a), end(name, b)) for name, (a, b) in JOINED.items()),
        driver="crank",
        points={name: (link, places.get((name, link), in_plane(0.0))) for name, link in points.items()},
        gears=(Gear("crank", "crank2", drive.gear_ratio, drive.phase),),
        guess=guess,
        start=start,
    )


def link_motions(
    drive: WarpKnitter,
    angles: Array,
    speed: Array,
    acceleration: Array,
    points: Mapping[str, PointMotion],
    turn: NDArray[np.complex128],
    spin: Array,
    pull: Array,
) -> tuple[dict[str, LinkMotion], dict[str, JointMotion]]:
    """Return the motions of links and joints, given those of the points and of the base link.

    Angles of cranks are not wrapped; those of the other links are counted within half a turn of
    where they stand at crank angle 0, so that links that only rock never jump.
    """
    still = np.zeros((3, len(angles)))
    fixed = {
        name: link_frames.point(still + np.array([[x], [y], [0.0]]))
        for name, (x, y) in {"O1": (0.0, 0.0), "O2": drive.pivot2, "E": drive.pivot_rocker}.items()
    }
    places = {**points, **fixed}
    ratio = drive.gear_ratio
    turned: dict[str, tuple[Array, Array, Array]] = {
        "crank1": (angles, speed, acceleration),
        "crank2": (ratio * angles + drive.phase, ratio * speed, ratio * acceleration),
    }
    links: dict[str, LinkMotion] = {}
    bars = {
        "crank1": ("O1", "A", drive.crank1),
        "crank2": ("O2", "D", drive.crank2),
        "rod3": ("A", "B", drive.rod3),
        "rod5": ("D", "C", drive.rod5),
        "rocker": ("E", "K", drive.rocker),
    }
    for name, (near, far, size) in bars.items():
        a, b = places[near], places[far]
        rod, rod_v = (b.position - a.position).T, (b.velocity - a.velocity).T
        if name not in turned:
            rates = link_frames.planar_turn(rod, rod_v, (b.acceleration - a.acceleration).T)
            turned[name] = np.arctan2(rod[1], rod[0]), *rates
        links[name] = link_frames.planar_link(a, rod / size, *turned[name][1:])
    turned["base"] = np.angle(turn), spin, pull
    ahead = np.stack([turn.real, turn.imag, still[0]])
    links["base"] = link_frames.planar_link(points["B"], ahead, spin, pull)
    order = ("crank1", "crank2", "rod3", "rod5", "base", "rocker")
    return {name: links[name] for name in order}, _joint_motions(drive, turned)


def _joint_motions(
    drive: WarpKnitter, turned: dict[str, tuple[Array, Array, Array]]
) -> dict[str, JointMotion]:
    counted = dict(turned)
    for name, zero in drive.angles_at_zero.items():
        value, rate, pull = turned[name]
        counted[name] = zero + (value - zero + np.pi) % (2.0 * np.pi) - np.pi, rate, pull
    nothing = np.zeros_like(turned["base"][0])
    counted[GROUND] = nothing, nothing, nothing

    def relative(a: str, b: str) -> JointMotion:
        value, rate, pull = (there - here for here, there in zip(counted[a], counted[b], strict=True))
        return JointMotion(value, rate, pull)

    return {joint: relative(a, b) for joint, (a, b) in JOINED.items()}


def period_of(ratio: float) -> float | None:
    """Return the crank angle in [rad] after which both cranks stand as before; None if no gear does so."""
    teeth = Fraction(ratio).limit_denominator(MOST_TEETH)
    if abs(float(teeth) - ratio) > 4.0 * np.finfo(np.float64).eps * abs(ratio):
        return None
    return 2.0 * np.pi * teeth.denominator
