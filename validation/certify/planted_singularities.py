"""Certificates of 1,000 mechanisms with a singularity in or next to their range: none may be false.

Four-bars, slider-cranks and spatial four-bars (RSSR) with random dimensions: dead centres inside the range
and at its end, and change points of the planar ones. The distance from the singularity is 0 or 1e-6 to 1e-12
m or rad. The reference decides with 50 digits, on the same floating-point numbers, whether the range contains
a singularity: by triangles and by the distance between two balls. The certificate uses neither.
"""

import argparse
import sys
import time
from collections import Counter

import mpmath
import numpy as np

import mechsim as ms
from mechsim.studies.certify.certificate import certified_motion

DIGITS = 50
# distance from the singularity in [m] or [rad]
DISTANCES = (0.0, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
# half-width in [rad] of the range
HALF_WIDTH = 0.05


def four_bar(rng, distance, kind):
    """Return dimensions of a four-bar, and the crank angle at which coupler and rocker lie in line."""
    coupler, rocker, crank = rng.uniform(0.6, 1.4, 3)
    if kind == "change point":
        # all links in line at a crank angle of pi
        ground = coupler + rocker - crank + rng.choice([-1.0, 1.0]) * distance
        return {"ground": ground, "coupler": coupler, "rocker": rocker, "crank": crank}, np.pi
    reach = coupler + rocker
    ground = rng.uniform(max(0.5, 1.05 * (reach - crank)), 0.95 * (reach + crank))
    cosine = (ground**2 + crank**2 - reach**2) / (2.0 * ground * crank)
    return {"ground": ground, "coupler": coupler, "rocker": rocker, "crank": crank}, float(np.arccos(cosine))


def slider_crank(rng, distance, kind):
    """Return dimensions of a slider-crank, and the crank angle of its dead centre."""
    crank, offset = rng.uniform(0.6, 1.4), rng.uniform(0.0, 0.4)
    if kind == "change point":
        rod = crank + offset + rng.choice([-1.0, 1.0]) * distance
        return {"crank": crank, "rod": rod, "offset": offset}, -np.pi / 2
    rod = rng.uniform(0.5, 0.95) * (crank - offset)
    return {"crank": crank, "rod": rod, "offset": offset}, float(np.arcsin((offset + rod) / crank))


def crank_pin_from_pivot(crank, pivot, axis, angle):
    """Return the distance of the crank's ball from the rocker's axis, and its height along it."""
    axis = mpmath.matrix(list(axis)) / mpmath.norm(mpmath.matrix(list(axis)))
    circle = [0, crank * mpmath.cos(angle), crank * mpmath.sin(angle)]
    pin = mpmath.matrix(circle) - mpmath.matrix(list(pivot))
    height = mpmath.fdot(pin, axis)
    return mpmath.norm(pin - height * axis), height


def rssr(rng, distance, kind):
    """Return dimensions of an RSSR, and the crank angle at which its coupler intersects the rocker's axis."""
    crank, rocker, gamma1, gamma2 = rng.uniform(0.5, 0.8, 4)
    pivot = tuple(rng.uniform([0.8, -0.2, -0.2], [1.2, 0.2, 0.2]).tolist())
    angle = float(rng.uniform(0.4, 1.2))
    dimensions = {"crank": crank, "rocker": rocker, "pivot": pivot, "gamma1": gamma1, "gamma2": gamma2}
    axis = ms.catalog.make("rssr", **dimensions).description.joint("rocker").a.axis
    reach, height = (float(x) for x in crank_pin_from_pivot(crank, pivot, axis, angle))
    return dimensions | {"coupler": float(np.hypot(reach + rocker, height))}, angle


def rssr_closes(dimensions, angle):
    """Return whether the rocker's ball can reach the distance of the coupler from the crank's ball."""
    axis = ms.catalog.make("rssr", **dimensions).description.joint("rocker").a.axis
    crank, rocker, coupler = (mpmath.mpf(float(dimensions[key])) for key in ("crank", "rocker", "coupler"))
    reach, height = crank_pin_from_pivot(crank, dimensions["pivot"], axis, angle)
    return abs(reach**2 + height**2 + rocker**2 - coupler**2) < 2 * rocker * reach


def is_singular(name, dimensions, low, high):
    """Return whether the range contains a singular configuration, with 50 digits."""
    with mpmath.workdps(DIGITS):
        ends = [mpmath.mpf(low), mpmath.mpf(high)]
        if name == "rssr":
            return not all(rssr_closes(dimensions, angle) for angle in mpmath.linspace(*ends, 9))
        d = {key: mpmath.mpf(float(value)) for key, value in dimensions.items()}
        extremes = [k * mpmath.pi / 2 for k in range(-8, 9) if ends[0] <= k * mpmath.pi / 2 <= ends[1]]
        angles = [*ends, *extremes]
        if name == "four_bar":
            values = [
                d["ground"] ** 2 + d["crank"] ** 2 - 2 * d["ground"] * d["crank"] * mpmath.cos(x)
                for x in angles
            ]
            singular_values = [(d["coupler"] + d["rocker"]) ** 2, (d["coupler"] - d["rocker"]) ** 2]
        else:
            values = [d["crank"] * mpmath.sin(x) - d["offset"] for x in angles]
            singular_values = [d["rod"], -d["rod"]]
        return any(min(values) <= value <= max(values) for value in singular_values)


def planted_mechanism(rng, index):
    """Return name, dimensions and range of a mechanism."""
    name, make = (("four_bar", four_bar), ("slider_crank", slider_crank), ("rssr", rssr))[index % 3]
    kind = ("change point", "dead centre", "end")[index // 3 % 3]
    if name == "rssr" and kind == "change point":
        kind = "end"
    distance = DISTANCES[index // 9 % len(DISTANCES)]
    dimensions, angle = make(rng, distance, kind)
    if kind == "end":
        # the range ends before or beyond the dead centre
        end = angle + rng.choice([-1.0, 1.0]) * distance
        return name, kind, dimensions, (angle - HALF_WIDTH, end)
    return name, kind, dimensions, (angle - HALF_WIDTH, angle + HALF_WIDTH)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    count = parser.parse_args().count
    rng = np.random.default_rng(20261123)
    table, false_proofs, start = Counter(), [], time.perf_counter()
    for index in range(count):
        name, kind, dimensions, crank_range = planted_mechanism(rng, index)
        singular = is_singular(name, dimensions, *crank_range)
        try:
            proof = certified_motion(ms.catalog.make(name, **dimensions), crank_range, {})
            certified = proof.certified
            located = bool(proof.singular) and all(np.isfinite(point.width) for point in proof.singular)
        except ms.InputError:
            certified = located = False
        outcome = "certified" if certified else "located" if located else "rejected"
        table[kind, "singular" if singular else "near miss", outcome] += 1
        if certified and singular:
            false_proofs.append((name, dimensions, crank_range))
    for key, number in sorted(table.items()):
        print(f"{key[0]:14s} {key[1]:10s} {key[2]:10s} {number}")
    print(f"{count} mechanisms, {len(false_proofs)} false certificates, {time.perf_counter() - start:.0f} s")
    for entry in false_proofs:
        print(*entry)
    return bool(false_proofs)


if __name__ == "__main__":
    sys.exit(main())
