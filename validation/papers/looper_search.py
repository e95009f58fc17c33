"""Search for loopers whose point C follows a straighter line than a given one, under the same conditions.

The line is parallel to Y, without loss of generality: rotating the linkage about the shaft only shifts the
crank angle. C of the spatial linkage follows it. Reweighted least squares determine rocker and frame of each
trial; the best trial is then synthesised exactly.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from looper_trials import PENALTY, Conditions, cost, trials_of
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from mechsim.analytic.catalog.looper import Looper
from mechsim.errors import InputError
from mechsim.theory.coupler_line import Synthesis, synthesize_looper

Array = NDArray[np.float64]

DEFAULT_CONDITIONS = Conditions()
# margins of the conditions in trials, relative; the final linkage differs slightly from its trial
MARGINS = (0.002, 0.006, 0.012)


def straighter_looper(
    length: float,
    base: Looper,
    conditions: Conditions = DEFAULT_CONDITIONS,
    *,
    free_coupler: bool = False,
    seed: int = 1,
) -> Synthesis:
    """Return a looper whose spatial C best follows a line along Y; the position of the line is free.

    Args:
        length: of the straight part, in [m].
        base: determines crank, follower, depth of its axis, and the coupler unless `free_coupler`.
        conditions: to satisfy; by default those of the paper.
        free_coupler: search coupler, arm and arm angle too.
        seed: of the search, whose result is reproducible.

    Raises:
        InputError: if no trial satisfies the conditions.

    Accuracy: the result is exact kinematics and satisfies the conditions; no optimum is proven.
    """
    longest = conditions.longest / base.crank
    line_bounds = [(0.5, longest), (1.0, longest), (-1.5, 1.5)]
    regions = [line_bounds]
    if free_coupler:
        # short and long arms have separate minima; one search over both often misses the lower one
        arms = [(2.0, longest / 2.0), (longest / 2.0, longest)]
        regions = [[*line_bounds, (2.0, longest), arm, (-np.pi, np.pi)] for arm in arms]
    valid = [
        result
        for bounds in regions
        if (result := _best_valid(length, base, conditions, bounds, seed)) is not None
    ]
    if not valid:
        raise InputError(
            f"no looper satisfies the conditions with a straight part of {length:.6g} m; relax "
            "the stroke, the width, the clearance, the transmission angle or the longest link"
        )
    return min(valid, key=lambda item: item.deviation)


def _best_valid(
    length: float, base: Looper, conditions: Conditions, bounds: list[tuple[float, float]], seed: int
) -> Synthesis | None:
    """Return the best valid result over searches with each margin; None if there is none."""
    valid: list[Synthesis] = []
    for clearance in MARGINS:
        try:
            result = _search_result(length, base, conditions, bounds, clearance, seed)
        except InputError:
            # the path of the trial turns back just before the end of the line
            continue
        if result is None:
            break
        if not violated_conditions(result, conditions):
            valid.append(result)
    return min(valid, key=lambda item: item.deviation, default=None)


def _search_result(
    length: float,
    base: Looper,
    conditions: Conditions,
    bounds: list[tuple[float, float]],
    clearance: float,
    seed: int,
) -> Synthesis | None:
    crank = base.crank

    def total_cost(x: Array) -> Array:
        with np.errstate(all="ignore"):
            return cost(trials_of(x, base), length / crank, base, conditions, clearance)

    best: Any = differential_evolution(
        total_cost,
        bounds,
        popsize=20,
        maxiter=300,
        tol=1e-6,
        rng=seed,
        vectorized=True,
        updating="deferred",
        polish=False,
    )
    if not best.fun < PENALTY:
        return None
    trial = trials_of(best.x[:, None], base)
    start = replace(
        base,
        coupler=float(trial.coupler[0]) * crank,
        arm=float(trial.arm[0]) * crank,
        arm_angle=float(trial.arm_angle[0]),
        axis_y=float(trial.axis[0]) * crank,
    )
    point = (float(trial.line[0]) * crank, float(trial.middle[0]) * crank)
    return synthesize_looper(point, 0.0, length, start, equal_ripple=True, in_space=True)


def violated_conditions(result: Synthesis, conditions: Conditions) -> list[str]:
    """Return the conditions that a linkage violates by exact kinematics; empty if it satisfies all."""
    design, violations = result.design, list[str]()
    if not design.crank_range().full:
        return ["full turning of the crank"]
    angles = np.linspace(0.0, 2.0 * np.pi, 3601)
    positions = design.positions(angles)
    c, a, b = (positions[name] for name in "CAB")
    x, y = c[:, 0], c[:, 1]
    stroke = float(np.ptp(y))
    if not conditions.stroke[0] <= stroke <= conditions.stroke[1]:
        violations.append(f"the stroke ({stroke:.6g} m)")
    if not np.ptp(x) >= conditions.width:
        violations.append(f"the width ({np.ptp(x):.6g} m)")
    middle = result.curve.mean(0)
    outward = np.sign((result.angles[-1] - result.angles[0]) * (result.curve[-1, 1] - result.curve[0, 1]))
    returning = (np.gradient(y) * outward < 0.0) & (np.abs(y - middle[1]) <= 0.5 * conditions.needle)
    distance = float(np.abs(x[returning] - middle[0]).min(initial=np.inf))
    if not distance >= conditions.clearance:
        violations.append(f"the clearance ({distance:.6g} m)")
    offset = abs(float(y.min()) + 0.5 * stroke - design.axis_y)
    if not offset <= conditions.centred:
        violations.append(f"the centring of the follower's axis ({offset:.6g} m)")
    rod, arm = (b - a)[:, :2] / design.coupler, (b[:, :2] - design.pivot[:2, 0]) / design.rocker
    transmission = float(np.arcsin(np.abs(rod[:, 0] * arm[:, 1] - rod[:, 1] * arm[:, 0])).min())
    if not transmission >= conditions.transmission:
        violations.append(f"the transmission angle ({transmission:.6g} rad)")
    longest = max(design.coupler, design.arm, design.rocker, design.frame)
    if not longest <= conditions.longest:
        violations.append(f"the longest link ({longest:.6g} m)")
    return violations
