"""Closed forms up to 1e-12 rad from a dead centre.

    python validation/robustness/closed_form_at_dead_centres.py

Problem: a four-bar, slider-crank, RSSR and RRSRR with swinging cranks, 1e-1 to 1e-12 rad inside their dead
centres. Reference: the same intersection of circle and sphere in 50 digits (mpmath), at the crank angle as a
double; its error is below 1e-40. Errors have the unit condition x eps. The condition is the displacement of
the point, relative to the longest link, per relative change of the crank angle and of each length, summed,
by differences in 50 digits. Rounded inputs alone cause about one unit. The published form of the
unit vector: ../papers/published_form.py.
"""

import sys
from collections.abc import Callable, Sequence

import numpy as np
from mpmath import mp
from numpy.typing import NDArray

from mechsim import catalog
from mechsim.kinematics.solvers import KinematicSolver

Array = NDArray[np.float64]
Vector = Sequence[mp.mpf]
EPS = 2.0**-52
# largest allowed error in units of condition x eps; 0.34 measured
MAX_UNITS = 2.0
DIGITS = 50
DISTANCES = np.geomspace(1e-12, 1e-1, 23)
LINKAGES: dict[str, tuple[KinematicSolver, str]] = {
    "four_bar": (catalog.make("four_bar", rocker=0.035), "B"),
    "slider_crank": (catalog.make("slider_crank", rod=0.045), "B"),
    "rssr": (catalog.make("rssr", rocker=0.009), "P3"),
    "rrsrr": (catalog.make("rrsrr", link=0.055), "S"),
}


def dead_centre_at_zero_v3x() -> KinematicSolver:
    """Return the layout of a looper drive with a coupler that puts the dead centre at V3x = 0."""
    linkage = catalog.make(
        "rssr", crank=0.014, rocker=0.024, pivot=(0.039, -0.008, 0.004), gamma1=0.0, gamma2=0.0
    )
    crank_angle = np.arccos(linkage.pivot[1] / linkage.crank)
    height = linkage.crank * np.sin(crank_angle) - linkage.pivot[2]
    return linkage.with_parameters(coupler=float(np.hypot(height, linkage.pivot[0] - linkage.rocker)))


def exact_inputs(linkage: KinematicSolver) -> list[mp.mpf]:
    """Return the dimensions that the point depends on, without the crank angle."""
    if linkage.name == "four_bar":
        values = [linkage.ground, linkage.crank, linkage.coupler, linkage.rocker]
    elif linkage.name == "slider_crank":
        values = [linkage.crank, linkage.rod, linkage.offset]
    elif linkage.name == "rssr":
        values = [linkage.crank, linkage.coupler, linkage.rocker, *linkage.pivot]
        values += [linkage.gamma1, linkage.gamma2]
    else:
        assert linkage.name == "rrsrr"
        values = [linkage.crank, linkage.coupler, linkage.link, *linkage.pivot]
    return [mp.mpf(value) for value in values]


def driven_point(linkage: KinematicSolver, f: mp.mpf, values: list[mp.mpf]) -> tuple[Vector, mp.mpf]:
    """Return the driven point and the discriminant, zero at the dead centre, as mpmath numbers."""
    c, s = mp.cos(f), mp.sin(f)
    if linkage.name == "slider_crank":
        crank, rod, offset = values
        discriminant = rod**2 - (offset - crank * s) ** 2
        return [crank * c + linkage.branch * mp.sqrt(discriminant), offset, mp.mpf(0)], discriminant
    if linkage.name == "four_bar":
        ground, crank, coupler, rocker = values
        to_a = [crank * c - ground, crank * s, mp.mpf(0)]
        circle = [ground, mp.mpf(0), mp.mpf(0)], [mp.mpf(0), mp.mpf(0), mp.mpf(1)], rocker
        return circle_sphere_intersection(circle, to_a, coupler, linkage.branch)
    if linkage.name == "rssr":
        crank, coupler, rocker, *lengths = values
        pivot, (gamma1, gamma2) = lengths[:3], lengths[3:]
        # third column of TY(gamma1) TX(gamma2)
        axis = [mp.sin(gamma1) * mp.cos(gamma2), -mp.sin(gamma2), mp.cos(gamma1) * mp.cos(gamma2)]
        to_p2 = [-pivot[0], crank * c - pivot[1], crank * s - pivot[2]]
        return circle_sphere_intersection((pivot, axis, rocker), to_p2, coupler, linkage.branch)
    assert linkage.name == "rrsrr"
    crank, coupler, link, *pivot = values
    centre, hinge = [mp.mpf(0), crank * c, crank * s], [mp.mpf(0), s, -c]
    to_pivot = [p - q for p, q in zip(pivot, centre, strict=True)]
    return circle_sphere_intersection((centre, hinge, coupler), to_pivot, link, linkage.branch)


def circle_sphere_intersection(
    circle: tuple[Vector, Vector, mp.mpf], to_sphere: Vector, radius: mp.mpf, sign: int
) -> tuple[Vector, mp.mpf]:
    """Intersect a circle (centre, axis, radius) with a sphere; `sign` is that of p . (d x axis)."""
    centre, axis, circle_radius = circle
    height = sum(a * d for a, d in zip(axis, to_sphere, strict=True))
    in_plane = [d - height * a for a, d in zip(axis, to_sphere, strict=True)]
    squared = sum(d * d for d in in_plane)
    height_u = (squared + circle_radius**2 + height**2 - radius**2) / (2 * mp.sqrt(squared))
    discriminant = circle_radius**2 - height_u**2
    u = [d / mp.sqrt(squared) for d in in_plane]
    v = [u[1] * axis[2] - u[2] * axis[1], u[2] * axis[0] - u[0] * axis[2], u[0] * axis[1] - u[1] * axis[0]]
    height_v = sign * mp.sqrt(discriminant)
    return [o + height_u * a + height_v * b for o, a, b in zip(centre, u, v, strict=True)], discriminant


def angles_near(linkage: KinematicSolver, distances: Array) -> Array:
    """Return angles at these distances inside the upper limit of the crank, found with 50 digits."""
    _, high = linkage.crank_range().arcs[0]
    with mp.workdps(DIGITS):
        values = exact_inputs(linkage)
        end = mp.findroot(lambda f: mp.re(driven_point(linkage, f, values)[1]), (high - 1e-3, high))
        return np.array([float(end - mp.mpf(float(distance))) for distance in distances])


def exact(linkage: KinematicSolver, angle: float) -> tuple[list[mp.mpf], float]:
    """Return the driven point in 50 digits, and its condition."""
    with mp.workdps(DIGITS):
        f, values = mp.mpf(angle), exact_inputs(linkage)
        point = list(driven_point(linkage, f, values)[0])
        step = mp.mpf(10) ** -25

        def rate(factor: Callable[[int], mp.mpf]) -> float:
            other = driven_point(linkage, f * factor(-1), [x * factor(i) for i, x in enumerate(values)])[0]
            return float(mp.sqrt(sum(abs(a - b) ** 2 for a, b in zip(point, other, strict=True))) / step)

        condition = sum(
            rate(lambda k, i=i: 1 + step if k == i else mp.mpf(1)) for i in range(-1, len(values))
        )
        return point, condition / linkage.mechanism.characteristic_length


def errors(linkage: KinematicSolver, name: str, angles: Array) -> tuple[Array, Array]:
    """Return errors of the closed form relative to the longest link, and conditions, (n,) each."""
    positions = linkage.positions(angles)[name]
    references = [exact(linkage, float(angle)) for angle in angles]
    distances = [
        distance(position, point) for position, (point, _) in zip(positions, references, strict=True)
    ]
    return np.array(distances) / linkage.mechanism.characteristic_length, np.array(
        [condition for _, condition in references]
    )


def distance(position: Array, point: list[mp.mpf]) -> float:
    if not np.isfinite(position).all():
        return float("nan")
    with mp.workdps(DIGITS):
        return float(mp.sqrt(sum((mp.mpf(float(a)) - b) ** 2 for a, b in zip(position, point, strict=True))))


def main() -> int:
    linkages = LINKAGES | {"rssr, V3x = 0": (dead_centre_at_zero_v3x(), "P3")}
    current = {name: errors(*each, angles_near(each[0], DISTANCES)) for name, each in linkages.items()}
    columns = {name: error for name, (error, _) in current.items()}
    print("distance [rad]  " + "  ".join(columns))
    for i in range(0, len(DISTANCES), 2):
        row = "  ".join(f"{error[i]:{len(name)}.1e}" for name, error in columns.items())
        print(f"{DISTANCES[i]:14.1e}  {row}")
    print("worst error in units of condition x eps:")
    units = {name: float((error / condition).max() / EPS) for name, (error, condition) in current.items()}
    for name, largest in units.items():
        print(f"  {name}: {largest:.2g}")
    return 0 if max(units.values()) <= MAX_UNITS else 1


if __name__ == "__main__":
    sys.exit(main())
