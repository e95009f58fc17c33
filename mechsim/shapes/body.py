"""The body of a link: rods between the places where something happens, and how thick they are."""

from collections.abc import Iterable
from itertools import combinations

import numpy as np

from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import Mechanism
from mechsim.shapes.shape import PALETTE, Rgba


def link_colours(mechanism: Mechanism) -> dict[str, Rgba]:
    """Return the colour of every moving link, in the order of the palette."""
    return {link.name: PALETTE[i % len(PALETTE)] for i, link in enumerate(mechanism.links)}


def point_colours(mechanism: Mechanism) -> dict[str, Rgba]:
    """Return the colour of every tracked point, the same in pictures, plots and pages."""
    # the brightest fades on white
    return {name: PALETTE[i % (len(PALETTE) - 1)] for i, name in enumerate(mechanism.points)}


def rod_radius(mechanism: Mechanism) -> float:
    """Return the radius of rods in [m]: a fixed part of the mechanism, less where a link is very short."""
    size = shortest = span(mechanism)
    for link in mechanism.links:
        for a, b in combinations(stations(mechanism, link.name), 2):
            shortest = min(shortest, float(np.linalg.norm(a - b)))
    return float(np.clip(0.2 * shortest, 0.010 * size, 0.022 * size))


def span(mechanism: Mechanism) -> float:
    """Return the longest distance between two places of one link, outline included, in [m].

    Raises:
        InputError: for a mechanism whose links are all mere points.
    """
    longest = mechanism.size
    for link in mechanism.links:
        for a, b in combinations(stations(mechanism, link.name), 2):
            longest = max(longest, float(np.linalg.norm(a - b)))
    if not longest > 0.0:
        raise InputError(f"{mechanism.name} has no length to draw; give its links joints or outline points")
    return longest


def stations(mechanism: Mechanism, link: str) -> list[Array]:
    """Return the places of a link that its body joins up: joints, outline, tracked points; no place twice."""
    outline = next((one.outline for one in mechanism.links if one.name == link), ())
    tracked = [local for owner, local in mechanism.points.values() if owner == link]
    places: list[Array] = []
    for point in [*(end.point for end in mechanism.ends(link)), *outline, *tracked]:
        place = np.asarray(point)
        near = 1e-9 * max(mechanism.size, float(np.linalg.norm(place)))
        if all(float(np.linalg.norm(place - known)) > near for known in places):
            places.append(place)
    return places


def edges(places: list[Array]) -> Iterable[tuple[Array, Array]]:
    """Yield pairs of places that a rod joins: all of two or three, a ring of more, none through a third."""
    if len(places) <= 3:
        pairs = list(combinations(range(len(places)), 2))
    else:
        ring = _ring(np.array(places))
        pairs = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    for i, j in pairs:
        a, b = places[i], places[j]
        others = (places[k] for k in range(len(places)) if k not in (i, j))
        if not any(_between(other, a, b) for other in others):
            yield a, b


def _ring(places: Array) -> list[int]:
    """The order of places around their middle, in the plane that fits them best."""
    flat = places - places.mean(0)
    axes = np.linalg.svd(flat)[2]
    return [int(i) for i in np.argsort(np.arctan2(flat @ axes[1], flat @ axes[0]))]


def _between(place: Array, a: Array, b: Array) -> bool:
    detour = float(np.linalg.norm(place - a) + np.linalg.norm(place - b))
    return detour < float(np.linalg.norm(a - b)) * (1.0 + 1e-9)
