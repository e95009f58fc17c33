"""The body of a link: rods between the places where something happens, and how thick they are."""

from collections.abc import Iterable
from itertools import combinations

import numpy as np

from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
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
    """Yield pairs of places that a rod joins into one piece, none through a third place.

    These are all of two or three; of more a ring of the outer ones, with spokes to it from the innermost of
    those that lie inside; and what is apart then, by the shortest way.
    """
    every = sorted(combinations(range(len(places)), 2), key=lambda pair: _length(places, pair))
    pairs = [pair for pair in every if not _through(places, pair)]
    wanted = set(every if len(places) <= 3 else _ring_and_spokes(np.array(places)))
    piece = list(range(len(places)))
    kept = [pair for pair in pairs if pair in wanted]
    for n, (i, j) in enumerate((*kept, *pairs)):
        if n < len(kept) or piece[i] != piece[j]:
            yield places[i], places[j]
        piece = [piece[i] if one == piece[j] else one for one in piece]


def _ring_and_spokes(places: Array) -> Iterable[tuple[int, int]]:
    """Pairs of a ring around places in the plane that fits them best, and of spokes to the innermost."""
    flat = (places - places.mean(0)) @ np.linalg.svd(places - places.mean(0))[2][:2].T
    ring = _hull(flat)
    inside = [i for i in range(len(flat)) if i not in ring]
    hub = min(inside, key=lambda i: float(np.linalg.norm(flat[i])), default=None)
    for i, j in zip(ring, [*ring[1:], ring[0]], strict=True):
        yield min(i, j), max(i, j)
        if hub is not None:
            yield min(i, hub), max(i, hub)


def _hull(flat: Array) -> list[int]:
    """The places around all others in a plane, in their order; those on its sides count too."""
    slack = 1e-9 * float(np.ptp(flat, axis=0).max())
    order = [int(i) for i in np.lexsort((flat[:, 1], flat[:, 0]))]
    halves: list[list[int]] = []
    for way in (order, order[::-1]):
        half: list[int] = []
        for i in way:
            while len(half) > 1 and _beside(flat, half[-2], half[-1], i) < -slack:
                half.pop()
            half.append(i)
        halves.append(half[:-1])
    return list(dict.fromkeys(halves[0] + halves[1]))


def _beside(flat: Array, i: int, j: int, k: int) -> float:
    """How far place j lies to the right of the way from i to k, negative to the left."""
    way, off = flat[k] - flat[i], flat[j] - flat[i]
    return float(way[1] * off[0] - way[0] * off[1]) / max(float(np.hypot(*way)), 1e-300)


def _length(places: list[Array], pair: tuple[int, int]) -> float:
    return float(np.linalg.norm(places[pair[0]] - places[pair[1]]))


def _through(places: list[Array], pair: tuple[int, int]) -> bool:
    """Whether the way between two places leads through a third."""
    straight, (i, j) = _length(places, pair) * (1.0 + 1e-9), pair
    others = (k for k in range(len(places)) if k not in pair)
    return any(_length(places, (i, k)) + _length(places, (k, j)) < straight for k in others)
