"""Masses of the links of a mechanism and their sources."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.mechanism.links import Inertia, Link, Rods, Vector, combine, rows, vector
from mechsim.mechanism.mechanism import Mechanism, described
from mechsim.numerics.arrays import HUGE, Array, distinct, number

Source = Literal["given", "rod", "zero"]
# largest number of link names in a line of text; of more links it states the number
MAX_NAMES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkMass:
    """The mass of a link and its source.

    Attributes:
        link: name of the link.
        mass: in [kg].
        source: "given" in the file or object; "rod", computed from round rods between its joints, because
            no inertia is given; "zero" if a file gives this link a mass of zero but others more (in MuJoCo a
            negligible mass replaces the zero).
        length: total length of the rods in [m]; None unless the source is "rod".
        diameter: diameter of the rods in [m]; None unless the source is "rod".
        density: density of the rods in [kg/m3]; None unless the source is "rod".
        disc: radius of the disc of a cam in [m]; 0 without one, None unless the source is "rod".
    """

    link: str
    mass: float
    source: Source
    length: float | None = None
    diameter: float | None = None
    density: float | None = None
    disc: float | None = None

    @property
    def text(self) -> str:
        """The source in words."""
        if self.source != "rod":
            return "given" if self.source == "given" else "zero in the file"
        return (
            f"computed: {_material(self.density)} rods, length {self.length:.6g} m, "
            f"diameter {self.diameter:.6g} m"
        ) + (f", and a disc of radius {self.disc:.6g} m" if self.disc else "")


def masses_of(mechanism: Mechanism) -> tuple[LinkMass, ...]:
    """Return the masses of links that have an inertia, without virtual bodies."""
    masses: list[LinkMass] = []
    for link in mechanism.links:
        if (inertia := link.inertia) and link.is_body:
            massless = inertia.negligible or inertia.mass == 0.0
            source: Source = "rod" if inertia.rods else "zero" if massless else "given"
            rods = asdict(inertia.rods) if inertia.rods else {}
            masses.append(LinkMass(link=link.name, mass=inertia.mass, source=source, **rods))
    return tuple(masses)


def summary(masses: Sequence[LinkMass]) -> str:
    """Return in one line the masses in use and their sources; empty without links."""
    phrases: list[str] = []
    for source in ("given", "rod", "zero"):
        group = [mass for mass in masses if mass.source == source]
        if not group:
            continue
        named = ", ".join(mass.link for mass in group)
        if len(group) > MAX_NAMES:
            named = f"{len(group)} of {len(masses)} links"
        if len(group) == len(masses) > MAX_NAMES:
            named = f"all {len(masses)} links"
        rod, discs = group[0], [mass.link for mass in group if mass.disc]
        total = f"{sum(mass.mass for mass in group):.4g} kg"
        if source == "rod":
            disc = f", of {', '.join(discs)} a disc" if discs else ""
            phrases.append(
                f"{named} computed as round {_material(rod.density)} rods of diameter {rod.diameter:.4g} m"
                f"{disc}, {total}, because no inertia is given"
            )
        else:
            phrases.append(f"{named} given, {total}" if source == "given" else f"{named} zero in the file")
    return f"masses: {'; '.join(phrases)}" if phrases else ""


def _material(density: float | None) -> str:
    return "steel" if density == STEEL else f"{density:.6g} kg/m3"


# density of steel in [kg/m3]
STEEL = 7850.0
# default diameter of the rods, relative to the characteristic length
RELATIVE_DIAMETER = 0.05
# length of the pin that replaces a link whose points coincide, such as a slider, in diameters
PIN_LENGTH = 2.0
# diameter of a slender rod relative to its length: a moment about its own axis of zero is not allowed
SLENDERNESS = 1e-3


def round_rod(start: Vector, end: Vector, density: float = STEEL, diameter: float = 0.01) -> Inertia:
    """Return the inertia of a uniform round rod between two points of a link's frame.

    m = rho pi d2/4 l; along the rod m d2/8, across it m (l2/12 + d2/16).

    Args:
        start: centre of one end, in [m].
        end: centre of the other end, in [m].
        density: density in [kg/m3].
        diameter: diameter in [m].
    """
    _positive("density of a rod", density, "kg/m3")
    _positive("diameter of a rod", diameter, "m")
    mass = density * np.pi * diameter**2 / 4.0 * _length(start, end)
    length2 = _length(start, end) ** 2
    return _rod(start, end, mass, mass * diameter**2 / 8.0, mass * (length2 / 12.0 + diameter**2 / 16.0))


def slender_rod(start: Vector, end: Vector, mass: float) -> Inertia:
    """Return the inertia of a uniform thin rod between two points of a link's frame, with a mass in [kg].

    The moment across the rod is exactly m l2/12; that along it is that of a rod with a diameter of l/1000.
    """
    _positive("mass of a slender rod", mass, "kg")
    length2 = _length(start, end) ** 2
    return _rod(start, end, mass, mass * length2 * SLENDERNESS**2 / 8.0, mass * length2 / 12.0)


def with_inertia(mechanism: Mechanism, density: float = STEEL, diameter: float | None = None) -> Mechanism:
    """Return the mechanism with an inertia on every link.

    A link consists of the straight rods of least total length that connect its joint points and outline;
    overlaps at their ends count twice. If these are a single point, its tracked points count too, as those of
    a pendulum; without any it is a pin along its first joint's axis. A cam is also a disc of its base radius,
    as thick as this pin is long.

    Args:
        mechanism: the mechanism.
        density: density of the rods in [kg/m3].
        diameter: diameter of the rods in [m]; the default is 0.05 of the characteristic length.
    """
    mechanism = described(mechanism)
    _positive("density of the rods", density, "kg/m3")
    rod_diameter = RELATIVE_DIAMETER * mechanism.characteristic_length if diameter is None else diameter
    if any(link.inertia is None for link in mechanism.links):
        _positive("diameter of the rods", rod_diameter, "m")
    links = tuple(
        link if link.inertia else replace(link, inertia=_link_inertia(mechanism, link, density, rod_diameter))
        for link in mechanism.links
    )
    return replace(mechanism, links=links)


def _link_inertia(mechanism: Mechanism, link: Link, density: float, diameter: float) -> Inertia:
    ends = mechanism.ends(link.name)
    length = PIN_LENGTH * diameter
    discs = [
        (mechanism.joint(joint).a, contact.base_radius)
        for joint, contact in mechanism.contacts.items()
        if contact.carrier == link.name and contact.base_radius
    ]
    corners, gap = [*(end.point for end in ends), *link.outline], 1e-9 * mechanism.characteristic_length
    points = distinct(corners, gap)
    if len(points) == 1:
        tracked = [point for carrier, point in mechanism.points.values() if carrier == link.name]
        points = distinct([*corners, *tracked], gap)
    rods = [(vector(points[i]), vector(points[j])) for i, j in _spanning_tree(np.array(points))]
    if len(points) == 1:
        rods = [_pin(points[0], ends[0].axis if ends else (0.0, 0.0, 1.0), length)]
    solids = [round_rod(a, b, density, diameter) for a, b in rods]
    solids += [round_rod(*_pin(end.point, end.axis, length), density, 2.0 * radius) for end, radius in discs]
    whole = solids[0] if len(solids) == 1 else combine(solids)
    total, disc = sum(_length(a, b) for a, b in rods), max((radius for _, radius in discs), default=0.0)
    return replace(whole, rods=Rods(total, diameter, density, disc))


def _pin(point: ArrayLike, axis: ArrayLike, length: float) -> tuple[Vector, Vector]:
    """Return the ends of a pin along an axis, with its centre at a point."""
    centre, arm = np.asarray(point), 0.5 * length * np.asarray(axis)
    return vector(centre - arm), vector(centre + arm)


def _rod(start: Vector, end: Vector, mass: float, along: float, across: float) -> Inertia:
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    line = (b - a) / _length(start, end)
    moments = across * np.eye(3) + (along - across) * np.outer(line, line)
    return Inertia(mass, vector((a + b) / 2.0), rows(moments))


def _spanning_tree(points: Array) -> list[tuple[int, int]]:
    """Return pairs of points that connect all points with the least total length (Prim)."""
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    joined, pairs = [0], []
    while len(joined) < len(points):
        rest = [i for i in range(len(points)) if i not in joined]
        pair = min(((i, j) for i in joined for j in rest), key=lambda pair: (gaps[pair], pair))
        pairs.append(pair)
        joined.append(pair[1])
    return pairs


def _length(start: Vector, end: Vector) -> float:
    length = float(np.linalg.norm(np.asarray(end) - np.asarray(start)))
    if not 0.0 < length < np.inf:
        raise InputError(
            f"a rod from {start} to {end} m has length {length}; give two finite, distinct points"
        )
    return length


def _positive(what: str, value: float, unit: str) -> None:
    if not 0.0 < number(value) < HUGE:
        raise InputError(f"{what} is {value} {unit}; give a finite number above 0, below {HUGE:g}")
