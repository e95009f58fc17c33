"""What is true of a motion before MuJoCo is asked: the loops close, and a formula says the same."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mechsim.analytic import closure
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import Pose
from mechsim.model.motion import Motion, taken
from mechsim.studies.motion_source import programs_of
from mechsim.verdict.checks import Verdict, allowances, check_of, checks_of, concluded
from mechsim.verdict.quantities import QUANTITIES, motion_scales, reach_of, stroke_of
from mechsim.verdict.tolerances import EPS, Asked, Tolerance

# so near to a change point, in [rad], neither steps nor rates from the loops are looked at
KEPT_OFF = 0.05
# of a formula, in eps of the reach: two ways to the same place differ by rounding alone
FORMULA, MEASURED = 512, 8


# crank angles (n,) in [rad], or driver -> its coordinate (n,) in [rad] or [m] -> point -> (n, 3) in [m]
Formula = Callable[[Any], Mapping[str, Array]]


def drivers_of(motion: Motion, drive: Form) -> Array | dict[str, Array]:
    """Return what a formula is asked at: the angles of the crank, or the coordinates of several drivers."""
    programs = programs_of(drive)
    if programs is None:
        return motion.angle
    return dict(zip(programs.drivers, programs.by_clock(motion.angle)[0], strict=True))


def against_formula(exact: Motion, formula: Formula, drive: Form) -> Verdict:
    """Check the user's own formula by the places that the loop equations give."""
    why = f"another formula: rounding, {FORMULA} eps of the reach, measured {MEASURED} in the gallery"
    allowed = Tolerance(FORMULA * EPS * reach_of(exact), "m", why, power=1)
    conditioning = drive.conditioning(exact)
    checks = [
        check_of(
            "position",
            name,
            np.linalg.norm(place - exact.points[name].position, axis=1),
            exact.angle,
            allowed,
            conditioning,
        )
        for name, place in formula(drivers_of(exact, drive)).items()
    ]
    return concluded(checks)


def against_loops(drive: ClosedForm, exact: Motion) -> Verdict:
    """Check the closed form by the loop equations, which know nothing of it."""
    mechanism = drive.mechanism
    poses = {name: Pose(link.position, link.rotation) for name, link in exact.links.items()}
    points = np.array(drive.change_points())
    if len(points):
        # at a change point the loops give no rates; there the poses' road is asked
        off = np.abs(np.exp(1j * exact.angle[:, None]) - np.exp(1j * points)).min(1) > KEPT_OFF
        exact = taken(exact, off)
        poses = {name: pose.at(off) for name, pose in poses.items()}
    open_by, turned_by = closure.residual_norms(mechanism, poses, exact.angle)
    loops = closure.rates(mechanism, poses, exact.angle, exact.speed, exact.acceleration)
    closed = Tolerance(8 * EPS * mechanism.size, "m", "8 ulp of the longest link")
    turned = Tolerance(32 * EPS, "rad", "8 ulp of a turn of 4 rad")
    checks = [
        check_of("loop", "", open_by, exact.angle, closed),
        check_of("axes and gears", "", turned_by, exact.angle, turned),
    ]
    scales = motion_scales(stroke_of(exact), float(np.abs(exact.speed).max()), reach_of(exact))
    for kind in ("velocity", "acceleration"):
        rows = (QUANTITIES[kind],)
        allowed = allowances(rows, "closed form", scales, Asked())
        checks += checks_of(rows, loops, exact, allowed, drive.conditioning(exact))
    return concluded(checks)
