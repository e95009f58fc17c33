"""Certified tubes against 10,000 random configurations in 50 digits: every one must lie in its tube.

mpmath computes the exact configuration by triangles and by the distance between two balls, at random crank
angles of a four-bar, a slider-crank and an RSSR. Half of them have random dimensions within tolerances.
"""

import sys
import time

import mpmath
import numpy as np

import mechsim as ms
from mechsim.analytic.derivatives.dimensions import own_designs
from mechsim.studies.certify.certificate import proven_segments
from mechsim.studies.certify.computed_motion import computed_motion
from mechsim.studies.certify.toml_intervals import joint_radii

DIGITS = 50
COUNT = 10_000
# of dimensions, in [m]
TOLERANCE = 2e-5
NAMES = {
    "four_bar": ("ground", "crank", "coupler", "rocker"),
    "slider_crank": ("crank", "rod", "offset"),
    "rssr": ("crank", "coupler", "rocker"),
}


def four_bar(d, angle, branch):
    """Return the angles of the joints A and B."""
    crank = d["crank"] * mpmath.expj(angle)
    diagonal = d["ground"] - crank
    along = (abs(diagonal) ** 2 + d["coupler"] ** 2 - d["rocker"] ** 2) / (2 * abs(diagonal))
    across = branch * mpmath.sqrt(d["coupler"] ** 2 - along**2)
    coupler = diagonal / abs(diagonal) * mpmath.mpc(along, across)
    return {
        "A": mpmath.arg(coupler) - angle,
        "B": mpmath.arg(coupler - diagonal) - mpmath.arg(coupler),
    }


def slider_crank(d, angle, branch):
    """Return the angle of the joint A."""
    height = d["offset"] - d["crank"] * mpmath.sin(angle)
    rod = mpmath.mpc(branch * mpmath.sqrt(d["rod"] ** 2 - height**2), height)
    return {"A": mpmath.arg(rod) - angle}


def rssr(d, angle, branch):
    """Return the angle of the rocker, from the distance between its ball and that of the crank."""
    end = ms.catalog.make("rssr").mechanism.joint("rocker").a
    axis, zero = (mpmath.matrix(list(vector)) for vector in (end.axis, end.reference))
    axis /= mpmath.norm(axis)
    zero -= axis * mpmath.fdot(axis, zero)
    zero /= mpmath.norm(zero)
    across = mpmath.matrix([axis[i - 2] * zero[i - 1] - axis[i - 1] * zero[i - 2] for i in range(3)])
    pivot = mpmath.matrix(list(end.point))
    arm = mpmath.matrix([0, d["crank"] * mpmath.cos(angle), d["crank"] * mpmath.sin(angle)]) - pivot
    a, b = mpmath.fdot(arm, zero), mpmath.fdot(arm, across)
    c = (mpmath.fdot(arm, arm) + d["rocker"] ** 2 - d["coupler"] ** 2) / (2 * d["rocker"])
    return {"rocker": mpmath.atan2(b, a) + branch * mpmath.acos(c / mpmath.hypot(a, b))}


EXACT = {"four_bar": four_bar, "slider_crank": slider_crank, "rssr": rssr}


def fraction_of_tube(motion, segments, angle, exact):
    """Return the largest distance from the centre of the tube, relative to its half-width."""
    tree, unknown = motion.equations.tree, motion.equations.unknown.tolist()
    i = int(np.searchsorted(segments.high, float(angle)))
    worst = mpmath.mpf(0)
    for name, value in exact.items():
        k = unknown.index(tree.index_of[name])
        centre = mpmath.mpf(segments.values[i, unknown[k]]) + mpmath.mpf(segments.rate[i, k]) * (
            angle - mpmath.mpf(segments.centre[i])
        )
        difference = mpmath.fmod(value - centre + 3 * mpmath.pi, 2 * mpmath.pi) - mpmath.pi
        worst = max(worst, abs(difference) / mpmath.mpf(segments.enclosure[i, k]))
    return worst


def measure(name, tolerance, count, rng):
    """Return how many exact configurations lie in their tubes, and the largest fraction of a half-width."""
    solver = ms.catalog.make(name)
    designs = own_designs(solver)
    radii = joint_radii(designs, dict.fromkeys(NAMES[name], tolerance)) if tolerance else {}
    motion = computed_motion(solver, None, radii)
    segments, uncertified = proven_segments(motion)
    assert not uncertified, f"{name} is not certified within {tolerance}"
    exact = EXACT[name]
    start = {key: mpmath.mpf(float(getattr(solver, key))) for key in NAMES[name]}
    branch = min(
        (1, -1), key=lambda sign: fraction_of_tube(motion, segments, mpmath.mpf(1), exact(start, 1, sign))
    )
    inside, worst = 0, mpmath.mpf(0)
    for angle, *offsets in rng.uniform(0.0, 1.0, (count, 1 + len(start))):
        s = mpmath.mpf(angle * motion.high)
        d = {
            key: value + mpmath.mpf(tolerance) * mpmath.mpf(2.0 * offset - 1.0)
            for (key, value), offset in zip(start.items(), offsets, strict=True)
        }
        fraction = fraction_of_tube(motion, segments, s, exact(d, s, branch))
        inside, worst = inside + (fraction <= 1), max(worst, fraction)
    return inside, float(worst)


def main():
    rng, start, total = np.random.default_rng(20261123), time.perf_counter(), 0
    cases = [(name, tolerance) for name in NAMES for tolerance in (0.0, TOLERANCE)]
    counts = [COUNT // len(cases) + (i < COUNT % len(cases)) for i in range(len(cases))]
    with mpmath.workdps(DIGITS):
        for (name, tolerance), count in zip(cases, counts, strict=True):
            inside, worst = measure(name, tolerance, count, rng)
            total += inside
            print(f"{name:14s} within {tolerance:g} m: {inside} of {count} in the tube, {worst:.3f} of it")
    print(f"{total} of {COUNT} exact configurations lie in their tubes, {time.perf_counter() - start:.0f} s")
    return total != COUNT


if __name__ == "__main__":
    sys.exit(main())
