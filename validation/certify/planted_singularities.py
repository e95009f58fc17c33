"""Certificates of 1,000 mechanisms with a singularity planted in or next to their range: none may be false.

Four-bars, slider-cranks and spatial four-bars (RSSR) with random dimensions: dead centres inside the range
and at its end, and of the planar ones change points, each missed by 0 or 1e-6 to 1e-12 of a link or a radian.
Whether a range holds a singularity is decided in 50 digits on the same floating-point numbers: by triangles,
and by the distance between two balls. The certificate uses neither.
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
MISSES = (0.0, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
# half-width in [rad] of the range
HALF = 0.05


def four_bar(rng, miss, kind):
    """Return dimensions of a four-bar, and the crank angle at which coupler and rocker lie in line."""
    coupler, rocker, crank = rng.uniform(0.6, 1.4, 3)
    if kind == "change point":
        # flat where the crank lies along the frame
        ground = coupler + rocker - crank + rng.choice([-1.0, 1.0]) * miss
        return {"ground": ground, "coupler": coupler, "rocker": rocker, "crank": crank}, np.pi
    reach = coupler + rocker
    ground = rng.uniform(max(0.5, 1.05 * (reach - crank)), 0.95 * (reach + crank))
    cosine = (ground**2 + crank**2 - reach**2) / (2.0 * ground * crank)
    return {"ground": ground, "coupler": coupler, "rocker": rocker, "crank": crank}, float(np.arccos(cosine))


def slider_crank(rng, miss, kind):
    """Return dimensions of a slider-crank, and the crank angle at which its rod stands across the slide."""
    crank, offset = rng.uniform(0.6, 1.4), rng.uniform(0.0, 0.4)
    if kind == "change point":
        rod = crank + offset + rng.choice([-1.0, 1.0]) * miss
        return {"crank": crank, "rod": rod, "offset": offset}, -np.pi / 2
    rod = rng.uniform(0.5, 0.95) * (crank - offset)
    return {"crank": crank, "rod": rod, "offset": offset}, float(np.arcsin((offset + rod) / crank))


def tip_from_pivot(crank, pivot, axis, angle):
    """Return distances of the crank's ball from the rocker's axis and along it, in mpmath."""
    axis = mpmath.matrix(list(axis)) / mpmath.norm(mpmath.matrix(list(axis)))
    circle = [0, crank * mpmath.cos(angle), crank * mpmath.sin(angle)]
    tip = mpmath.matrix(circle) - mpmath.matrix(list(pivot))
    height = mpmath.fdot(tip, axis)
    return mpmath.norm(tip - height * axis), height


def rssr(rng, miss, kind):
    """Return dimensions of an RSSR, and the crank angle at which its coupler points at the rocker's axis."""
    crank, rocker, gamma1, gamma2 = rng.uniform(0.5, 0.8, 4)
    pivot = tuple(rng.uniform([0.8, -0.2, -0.2], [1.2, 0.2, 0.2]).tolist())
    angle = float(rng.uniform(0.4, 1.2))
    dimensions = {"crank": crank, "rocker": rocker, "pivot": pivot, "gamma1": gamma1, "gamma2": gamma2}
    axis = ms.catalog.make("rssr", **dimensions).description.joint("rocker").a.axis
    reach, height = (float(x) for x in tip_from_pivot(crank, pivot, axis, angle))
    return dimensions | {"coupler": float(np.hypot(reach + rocker, height))}, angle


def rssr_closes(dimensions, angle):
    """Return whether the rocker's ball can be as far from the crank's as the coupler is long."""
    axis = ms.catalog.make("rssr", **dimensions).description.joint("rocker").a.axis
    crank, rocker, coupler = (mpmath.mpf(float(dimensions[key])) for key in ("crank", "rocker", "coupler"))
    reach, height = tip_from_pivot(crank, dimensions["pivot"], axis, angle)
    return abs(reach**2 + height**2 + rocker**2 - coupler**2) < 2 * rocker * reach


def is_singular(name, dimensions, low, high):
    """Return whether the linkage is flat at an angle of the range, in 50 digits."""
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
            flat = [(d["coupler"] + d["rocker"]) ** 2, (d["coupler"] - d["rocker"]) ** 2]
        else:
            values = [d["crank"] * mpmath.sin(x) - d["offset"] for x in angles]
            flat = [d["rod"], -d["rod"]]
        return any(min(values) <= value <= max(values) for value in flat)


def plant(rng, index):
    """Return name, dimensions and range of a mechanism."""
    name, make = (("four_bar", four_bar), ("slider_crank", slider_crank), ("rssr", rssr))[index % 3]
    kind = ("change point", "dead centre", "end")[index // 3 % 3]
    if name == "rssr" and kind == "change point":
        kind = "end"
    miss = MISSES[index // 9 % len(MISSES)]
    dimensions, angle = make(rng, miss, kind)
    if kind == "end":
        # the range ends short of the dead centre or beyond it by the miss
        end = angle + rng.choice([-1.0, 1.0]) * miss
        return name, kind, dimensions, (angle - HALF, end)
    return name, kind, dimensions, (angle - HALF, angle + HALF)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    count = parser.parse_args().count
    rng = np.random.default_rng(20261123)
    table, false, start = Counter(), [], time.perf_counter()
    for index in range(count):
        name, kind, dimensions, between = plant(rng, index)
        singular = is_singular(name, dimensions, *between)
        try:
            proof = certified_motion(ms.catalog.make(name, **dimensions), between, {})
            certified = proof.certified
            located = bool(proof.singular) and all(np.isfinite(point.width) for point in proof.singular)
        except ms.InputError:
            certified = located = False
        outcome = "certified" if certified else "located" if located else "refused"
        table[kind, "singular" if singular else "near miss", outcome] += 1
        if certified and singular:
            false.append((name, dimensions, between))
    for key, number in sorted(table.items()):
        print(f"{key[0]:14s} {key[1]:10s} {key[2]:10s} {number}")
    print(f"{count} mechanisms, {len(false)} false certificates, {time.perf_counter() - start:.0f} s")
    for entry in false:
        print(*entry)
    return bool(false)


if __name__ == "__main__":
    sys.exit(main())
