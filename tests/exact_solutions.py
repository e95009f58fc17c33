"""Reference solutions with 50 digits and other formulas, for comparison with the closed forms.

Each function returns a tracked point's position and its first and second derivative by the crank
angle, as arrays of doubles rounded from 50 digits.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from mpmath import mp

Derivatives = tuple[np.ndarray, np.ndarray, np.ndarray]
DIGITS = 50


def rssr_p3_place(linkage: Any, angle: mp.mpf) -> list[mp.mpf]:
    """P3 by the swing t of the rocker: |P4 + r (x cos t + y sin t) - P2| = l is A cos t + B sin t = K."""
    g1, g2 = mp.mpf(linkage.gamma1), mp.mpf(linkage.gamma2)
    x = [mp.cos(g1), mp.mpf(0), -mp.sin(g1)]
    y = [mp.sin(g1) * mp.sin(g2), mp.cos(g2), mp.cos(g1) * mp.sin(g2)]
    pivot = [mp.mpf(value) for value in linkage.pivot]
    r, rod, c = mp.mpf(linkage.rocker), mp.mpf(linkage.coupler), mp.mpf(linkage.crank)
    d = [p - q for p, q in zip([0, c * mp.cos(angle), c * mp.sin(angle)], pivot, strict=True)]
    a, b = (2 * r * mp.fdot(d, u) for u in (x, y))
    k = mp.fdot(d, d) + r * r - rod * rod
    # the rocker lies ahead of P4P2 by less than half a turn where P4P3 . (P4P2 x axis) < 0
    t = mp.atan2(b, a) - linkage.branch * mp.acos(k / mp.hypot(a, b))
    return [p + r * (u * mp.cos(t) + v * mp.sin(t)) for p, u, v in zip(pivot, x, y, strict=True)]


def four_bar_b_place(linkage: Any, angle: mp.mpf) -> list[mp.mpf]:
    """B by the half-angle roots of Freudenstein's equation."""
    g, a = mp.mpf(linkage.ground), mp.mpf(linkage.crank)
    rod, r = mp.mpf(linkage.coupler), mp.mpf(linkage.rocker)
    ax, ay = a * mp.cos(angle) - g, a * mp.sin(angle)
    # p cos t + q sin t = k for the rocker angle t
    p, q, k = 2 * r * ax, 2 * r * ay, ax * ax + ay * ay + r * r - rod * rod
    root = mp.sqrt(p * p + q * q - k * k)
    t = min(
        (2 * mp.atan2(q + sign * root, p + k) for sign in (1, -1)),
        key=lambda t: -linkage.branch * r * (mp.cos(t) * ay - mp.sin(t) * ax),
    )
    return [g + r * mp.cos(t), r * mp.sin(t), mp.mpf(0)]


def slider_crank_b_place(linkage: Any, angle: mp.mpf) -> list[mp.mpf]:
    """B by Pythagoras."""
    crank, rod, offset = mp.mpf(linkage.crank), mp.mpf(linkage.rod), mp.mpf(linkage.offset)
    leg = mp.sqrt(rod**2 - (offset - crank * mp.sin(angle)) ** 2)
    return [crank * mp.cos(angle) + linkage.branch * leg, offset, mp.mpf(0)]


def unit_at_angles(v1: np.ndarray, v2: np.ndarray, angle1: float, angle2: float, sign: int) -> np.ndarray:
    """The unit vector at two angles, as a combination of V1, V2 and V1 x V2 found by elimination."""
    with mp.workdps(DIGITS):
        u1, u2 = (mp.matrix([mp.mpf(value) for value in v.tolist()]) for v in (v1, v2))
        u1, u2 = u1 / mp.norm(u1), u2 / mp.norm(u2)
        n = mp.matrix(
            [u1[1] * u2[2] - u1[2] * u2[1], u1[2] * u2[0] - u1[0] * u2[2], u1[0] * u2[1] - u1[1] * u2[0]]
        )
        rows = mp.matrix([list(u1), list(u2), list(n)])
        flat = mp.lu_solve(rows, mp.matrix([mp.cos(mp.mpf(angle1)), mp.cos(mp.mpf(angle2)), 0]))
        p = flat + sign * mp.sqrt(1 - mp.norm(flat) ** 2) / mp.norm(n) * n
        return np.array([float(value) for value in p])


def _derivatives(point: Callable[..., list[mp.mpf]], linkage: Any, f: float) -> Derivatives:
    """Return a point with its derivatives by the crank angle."""
    with mp.workdps(DIGITS):
        columns = [
            mp.taylor(lambda angle, i=i: point(linkage, angle)[i], mp.mpf(float(f)), 2) for i in range(3)
        ]
        taylor = np.array([[float(value) for value in column] for column in columns])
    return taylor[:, 0], taylor[:, 1], 2.0 * taylor[:, 2]


rssr_p3 = partial(_derivatives, rssr_p3_place)
four_bar_b = partial(_derivatives, four_bar_b_place)
slider_crank_b = partial(_derivatives, slider_crank_b_place)
