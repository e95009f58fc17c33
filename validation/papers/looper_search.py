"""Search for loopers whose C runs straighter than that of a given one, under the same conditions.

The line stands along Y (turning the whole linkage about the crank's shaft changes nothing but the crank
angle at which it is passed), and is followed by the C of the spatial linkage. For every trial rocker and
frame are found by least squares, reweighted a few times towards the best approximation; the best trial is
then synthesised exactly.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from looper_trials import BROKEN, Conditions, cost, trials_of
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from mechsim.analytic.catalog.looper import Looper
from mechsim.errors import InputError
from mechsim.theory.coupler_line import Synthesis, synthesize_looper

Array = NDArray[np.float64]

# a trial is only nearly the linkage it becomes: it must keep the conditions this part more strictly;
# how much is enough shows afterwards
SPARES = (0.002, 0.006, 0.012)


def straighter(
    length: float,
    base: Looper,
    conditions: Conditions | None = None,
    *,
    free_coupler: bool = False,
    seed: int = 1,
) -> Synthesis:
    """Return a looper whose spatial C follows a line along Y best, the place of the line being free.

    Args:
        length: of the straight part, in [m].
        base: gives crank, follower, depth of its axis, and, unless `free_coupler`, the coupler.
        conditions: to be kept; None takes those of the paper.
        free_coupler: search coupler, arm and arm angle too.
        seed: of the search, which gives the same answer every time.

    Raises:
        InputError: where no trial keeps the conditions.

    Accuracy: differential evolution finds no proven optimum; what it returns is checked and exact.
    """
    wanted = conditions or Conditions()
    most = wanted.longest / base.crank
    place = [(0.5, most), (1.0, most), (-1.5, 1.5)]
    regions = [place]
    if free_coupler:
        # short and long arms are two valleys; a search over both at once often misses the deeper one
        arms = [(2.0, most / 2.0), (most / 2.0, most)]
        regions = [[*place, (2.0, most), arm, (-np.pi, np.pi)] for arm in arms]
    kept = [result for bounds in regions if (result := _kept(length, base, wanted, bounds, seed)) is not None]
    if not kept:
        raise InputError(
            f"no looper was found that keeps the conditions with a straight part of {length:.6g} m; relax "
            "the stroke, the width, the clearance, the transmission angle or the longest link"
        )
    return min(kept, key=lambda item: item.deviation)


def _kept(
    length: float, base: Looper, wanted: Conditions, bounds: list[tuple[float, float]], seed: int
) -> Synthesis | None:
    """Return the best, over searches with each spare, that keeps the conditions; None if nothing does."""
    kept: list[Synthesis] = []
    for spare in SPARES:
        try:
            result = _searched(length, base, wanted, bounds, spare, seed)
        except InputError:
            # the trial turns back just before the end of the line
            continue
        if result is None:
            break
        if not broken(result, wanted):
            kept.append(result)
    return min(kept, key=lambda item: item.deviation, default=None)


def _searched(
    length: float,
    base: Looper,
    wanted: Conditions,
    bounds: list[tuple[float, float]],
    spare: float,
    seed: int,
) -> Synthesis | None:
    unit = base.crank

    def total(x: Array) -> Array:
        with np.errstate(all="ignore"):
            return cost(trials_of(x, base), length / unit, base, wanted, spare)

    best: Any = differential_evolution(
        total,
        bounds,
        popsize=20,
        maxiter=300,
        tol=1e-6,
        rng=seed,
        vectorized=True,
        updating="deferred",
        polish=False,
    )
    if not best.fun < BROKEN:
        return None
    trial = trials_of(best.x[:, None], base)
    start = replace(
        base,
        coupler=float(trial.coupler[0]) * unit,
        arm=float(trial.arm[0]) * unit,
        arm_angle=float(trial.arm_angle[0]),
        axis_y=float(trial.axis[0]) * unit,
    )
    through = (float(trial.line[0]) * unit, float(trial.middle[0]) * unit)
    return synthesize_looper(through, 0.0, length, start, equal_ripple=True, in_space=True)


def broken(result: Synthesis, wanted: Conditions) -> list[str]:
    """Return which conditions a linkage does not keep, by exact kinematics; empty if it keeps all."""
    design, faults = result.design, list[str]()
    if not design.crank_range().full:
        return ["full turning of the crank"]
    turn = np.linspace(0.0, 2.0 * np.pi, 3601)
    places = design.positions(turn)
    c, a, b = (places[name] for name in "CAB")
    x, y = c[:, 0], c[:, 1]
    stroke = float(np.ptp(y))
    if not wanted.stroke[0] <= stroke <= wanted.stroke[1]:
        faults.append(f"the stroke ({stroke:.6g} m)")
    if not np.ptp(x) >= wanted.width:
        faults.append(f"the width ({np.ptp(x):.6g} m)")
    middle = result.curve.mean(0)
    outward = np.sign((result.angles[-1] - result.angles[0]) * (result.curve[-1, 1] - result.curve[0, 1]))
    back = (np.gradient(y) * outward < 0.0) & (np.abs(y - middle[1]) <= 0.5 * wanted.needle)
    gap = float(np.abs(x[back] - middle[0]).min(initial=np.inf))
    if not gap >= wanted.clearance:
        faults.append(f"the clearance ({gap:.6g} m)")
    off = abs(float(y.min()) + 0.5 * stroke - design.axis_y)
    if not off <= wanted.centred:
        faults.append(f"the centring of the follower's axis ({off:.6g} m)")
    rod, arm = (b - a)[:, :2] / design.coupler, (b[:, :2] - design.pivot[:2, 0]) / design.rocker
    transmission = float(np.arcsin(np.abs(rod[:, 0] * arm[:, 1] - rod[:, 1] * arm[:, 0])).min())
    if not transmission >= wanted.transmission:
        faults.append(f"the transmission angle ({transmission:.6g} rad)")
    longest = max(design.coupler, design.arm, design.rocker, design.frame)
    if not longest <= wanted.longest:
        faults.append(f"the longest link ({longest:.6g} m)")
    return faults
