"""Linkages with change points, and positions of four-bars by half angles."""

import mpmath
import numpy as np

from mechsim import catalog

REVOLUTION = 2.0 * np.pi
NAMES = ("ground", "crank", "coupler", "rocker")


def named(lengths):
    return dict(zip(NAMES, lengths, strict=True))


def change_point_lengths(many=12, seed=5):
    """Return lengths whose shortest and longest sum to the others: one or two change points."""
    rng = np.random.default_rng(seed)
    result = []
    while len(result) < many:
        ground, crank, coupler = rng.uniform(0.03, 0.15, 3)
        kind = len(result) % 3
        rocker = (ground + crank - coupler, coupler + abs(ground - crank), crank)[kind]
        if kind == 2:
            coupler = ground
        lengths = (ground, crank, coupler, rocker)
        if min(lengths) > 0.01 and catalog.make("four_bar", **named(lengths)).crank_range().full:
            result.append(lengths)
    return result


def smooth_b(lengths, angle, sign):
    """Return B by half angles, whose product changes sign at a change point."""
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


def worst(exact, result):
    """Return the farthest distance of (n, 3) points from exact ones in the plane."""
    return max(float(abs(z - complex(*p[:2]))) for z, p in zip(exact, result, strict=True))


# length of an RRSRR's link whose sphere just touches the torus, in [m]: the largest for which the least
# discriminant over the crank angles is positive, by bisection to the last bit
TOUCHING_LINK = 0.05233105012119288
CHANGE_POINT_LINKAGES = {
    "parallelogram": catalog.make("four_bar", ground=0.1, crank=0.045, coupler=0.1, rocker=0.045, branch=-1),
    "kite": catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.04, rocker=0.1),
    "kite about its frame": catalog.make("four_bar", ground=0.05, crank=0.05, coupler=0.1, rocker=0.1),
    "rhombus": catalog.make("four_bar", ground=0.1, crank=0.1, coupler=0.1, rocker=0.1, branch=-1),
    "equal rod and crank": catalog.make("slider_crank", crank=0.05, rod=0.05, offset=0.0),
    "offset slide": catalog.make("slider_crank", crank=0.05, rod=0.06, offset=0.01),
    "planar rssr": catalog.make(
        "rssr", crank=0.04, coupler=0.1, rocker=0.04, pivot=(0.0, -0.1, 0.0), gamma1=np.pi / 2, gamma2=0.0
    ),
    "tangent rrsrr": catalog.make("rrsrr", link=TOUCHING_LINK),
}
# where A coincides with O4 the coupler is undetermined, and a branch ends
WITH_BRANCHES = [which for which in CHANGE_POINT_LINKAGES if which not in ("kite about its frame", "rhombus")]
