"""Four-bars whose bars come to lie on each other, and where their joints are by half angles."""

import mpmath
import numpy as np

from mechsim import catalog

NAMES = ("ground", "crank", "coupler", "rocker")


def named(lengths):
    return dict(zip(NAMES, lengths, strict=True))


def flat_linkages(many=12, seed=5):
    """Shortest and longest link are as long as the other two: one or two poses lie flat."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < many:
        ground, crank, coupler = rng.uniform(0.03, 0.15, 3)
        kind = len(found) % 3
        rocker = (ground + crank - coupler, coupler + abs(ground - crank), crank)[kind]
        if kind == 2:
            coupler = ground
        lengths = (ground, crank, coupler, rocker)
        if min(lengths) > 0.01 and catalog.make("four_bar", **named(lengths)).crank_range().full:
            found.append(lengths)
    return found


def smooth_b(lengths, angle, sign):
    """B by half angles, whose product is the root that changes sign as the linkage passes a flat pose."""
    ground, crank, coupler, rocker = (mpmath.mpf(length) for length in lengths)
    a = crank * mpmath.expj(angle)
    arm = ground - a
    square = abs(arm) ** 2
    outer = (coupler + rocker) ** 2 - (ground + crank) ** 2
    inner = (ground - crank) ** 2 - (coupler - rocker) ** 2
    reach = 2 * mpmath.sqrt(ground * crank)
    tiny = mpmath.mpf(10) ** -15
    first = reach * mpmath.cos(angle / 2)
    second = reach * mpmath.sin(angle / 2)
    if abs(outer) > tiny:
        first = mpmath.sqrt(first**2 + outer)
    if abs(inner) > tiny:
        second = mpmath.sqrt(second**2 + inner)
    along = (square + coupler**2 - rocker**2) / 2
    return a + arm / square * (along + mpmath.mpc(0, 1) * sign * first * second / 2)


def worst(exact, found):
    """Return the farthest distance of (n, 3) points from exact ones in the plane."""
    return max(float(abs(z - complex(*p[:2]))) for z, p in zip(exact, found, strict=True))
