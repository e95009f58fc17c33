"""The published unit vector at two angles (Dvorzhak (2016), eqs 10-21): lost digits and changed assemblies.

    python validation/papers/published_form.py

Problem: the looper layout of docs/explanation/sources.md (rocker axis along Z), whose V3 = P4P2 x axis has an
X-component that changes sign twice a turn. Reference: the same vector with 50 digits by mpmath, from
the defining equations p.V1 = |V1| cos a1, p.V2 = |V2| cos a2, |p| = 1; its own error is below 1e-16.
"""

import sys

import numpy as np
from mpmath import mp
from numpy.typing import ArrayLike, NDArray

from mechsim import catalog
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinematics.vector_method.vectors import Sign, column, cross, dot, norm, unit_at_angles

Array = NDArray[np.float64]
LOOPER = catalog.make(
    "rssr", crank=0.014, coupler=0.048, rocker=0.024, pivot=(0.039, -0.008, 0.004), gamma1=0.0, gamma2=0.0
)


def unit_at_angles_published(v1: Array, v2: Array, angle1: ArrayLike, angle2: ArrayLike, sign: Sign) -> Array:
    """Return the unit vector at two angles by the published form.

    It divides by the X-component of v1 x v2, and its `sign` is the sign of a root in p_X. It loses digits
    where that component is small, and selects the other assembly mode where it is negative.

    Source: Dvorzhak (2016, docs/explanation/sources.md), eqs (10)-(21), verbatim.
    """
    v3 = cross(v1, v2)
    q1, q2 = norm(v1) * np.cos(angle1), norm(v2) * np.cos(angle2)
    b1 = q1 * v2[2] - q2 * v1[2]
    b2 = q2 * v1[1] - q1 * v2[1]
    half = v3[1] * b1 + v3[2] * b2
    v3v3 = dot(v3, v3)
    root = np.sqrt(half * half - v3v3 * (b1 * b1 + b2 * b2 - v3[0] * v3[0]))
    x = (-half + sign * root) / v3v3
    return np.stack([x, (v3[1] * x + b1) / v3[0], (v3[2] * x + b2) / v3[0]])


def triangle_angle(l1: ArrayLike, l2: ArrayLike, l3: ArrayLike) -> Array:
    """Return the angle between sides `l1` and `l2` of a triangle whose third side is `l3`, in [rad].

    NaN if the three lengths form no triangle.

    Accuracy: Kahan's form, relative error of a few ulp even for needle-like triangles, where the
    arc cosine of the published form loses half the digits.

    Source: Dvorzhak (2016, docs/explanation/sources.md), eq. (23) (Tcos).
    """
    l1, l2, l3 = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (l1, l2, l3)))
    a, b = np.maximum(l1, l2), np.minimum(l1, l2)
    mu = np.where(b >= l3, l3 - (a - b), b - (a - l3))
    product = ((a - b) + l3) * mu
    denominator = (a + (b + l3)) * ((a - l3) + b)
    possible = (product >= 0.0) & (denominator >= 0.0)
    ratio = np.where(possible, product, 0.0), np.where(possible, denominator, 1.0)
    return np.where(possible, 2.0 * np.arctan2(np.sqrt(ratio[0]), np.sqrt(ratio[1])), np.nan)


def vectors_and_angle(rssr: KinematicSolver, f: Array) -> tuple[Array, Array, Array]:
    """Return P4P2, (3, n), the rocker axis, (3, 1), and the angle between rocker and P4P2, (n,)."""
    p2 = rssr.crank * np.stack([np.zeros_like(f), np.cos(f), np.sin(f)])
    to_crank = p2 - column(rssr.pivot)
    distance = np.sqrt((to_crank**2).sum(0))
    return (
        to_crank,
        column(rssr.closed_form.rocker_frame[:, 2]),
        triangle_angle(distance, rssr.rocker, rssr.coupler),
    )


def fifty_digit_vector(v1: Array, v2: Array, angle1: float, angle2: float, sign: Sign) -> list[mp.mpf]:
    """Return p by solving p.u1, p.u2 and p.n from the defining equations; n = u1 x u2, sign that of p.n."""
    with mp.workdps(50):
        u1, u2 = (mp.matrix([mp.mpf(float(x)) for x in v]) for v in (v1, v2))
        u1, u2 = u1 / mp.norm(u1), u2 / mp.norm(u2)
        n = [u1[1] * u2[2] - u1[2] * u2[1], u1[2] * u2[0] - u1[0] * u2[2], u1[0] * u2[1] - u1[1] * u2[0]]
        in_plane = mp.lu_solve(
            mp.matrix([list(u1), list(u2), n]), mp.matrix([mp.cos(mp.mpf(angle1)), mp.cos(mp.mpf(angle2)), 0])
        )
        n = mp.matrix(n)
        return list(in_plane + sign * mp.sqrt(1 - mp.norm(in_plane) ** 2) / mp.norm(n) * n)


def errors_near_zero(distances: Array, rssr: KinematicSolver = LOOPER) -> tuple[Array, Array]:
    """Return the errors of the published and the valid form at distances from V3x = 0, in [rad], (n,) each.

    The published root loses digits with the distance and is then divided by it: two digits per decade.
    A non-finite result counts as an error of 1. The better sign of the published form is compared.
    """
    zero = np.arccos(rssr.pivot[1] / rssr.crank)
    published, valid = np.empty_like(distances), np.empty_like(distances)
    for i, distance in enumerate(distances):
        v1, axis, angle = vectors_and_angle(rssr, np.array([zero + distance]))
        v2, across = axis[:, 0], np.pi / 2
        exact = fifty_digit_vector(v1[:, 0], v2, float(angle[0]), across, rssr.branch)

        def error(p: Array, exact: list[mp.mpf] = exact) -> float:
            if not np.isfinite(p).all():
                return 1.0
            return float(mp.sqrt(sum((mp.mpf(float(a)) - b) ** 2 for a, b in zip(p, exact, strict=True))))

        with np.errstate(all="ignore"):
            both = [unit_at_angles_published(v1, axis, angle, across, sign)[:, 0] for sign in (1, -1)]
        published[i] = min(1.0, *(error(p) for p in both))
        valid[i] = error(unit_at_angles(v1, axis, angle, across, rssr.branch)[:, 0])
    return published, valid


def assemblies_over_a_turn(angles: Array, rssr: KinematicSolver = LOOPER) -> tuple[Array, Array]:
    """Return the assembly mode, +1 or -1, that W = +1 selects in either form, (n,) each."""
    v1, axis, angle = vectors_and_angle(rssr, angles)
    normal = cross(v1, np.broadcast_to(axis, v1.shape))
    methods = (unit_at_angles_published, unit_at_angles)
    published, valid = (np.sign((f(v1, axis, angle, np.pi / 2, 1) * normal).sum(0)) for f in methods)
    return published, valid


def mode_changes(assemblies: Array) -> int:
    """Return the number of changes of the assembly mode over a revolution."""
    return int((assemblies != np.roll(assemblies, 1)).sum())


def main() -> int:
    distances = np.geomspace(1e-15, 1e-1, 43)
    published, valid = errors_near_zero(distances)
    print("crank angle from V3x = 0 [rad]   published form   valid form")
    for row in zip(distances[::6], published[::6], valid[::6], strict=True):
        print("{:30.1e}   {:14.1e}   {:10.1e}".format(*row))

    angles = np.linspace(0.0, 2 * np.pi, 720, endpoint=False) + 1e-3
    published_modes, modes = assemblies_over_a_turn(angles)
    changes = mode_changes(published_modes), mode_changes(modes)
    print(f"changes of assembly mode in a revolution: published form {changes[0]}, valid form {changes[1]}")
    passed = valid.max() <= 4e-16 and changes == (2, 0)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
