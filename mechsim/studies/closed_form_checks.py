"""What is true of a closed form before MuJoCo is asked: its loops close and its rates are theirs."""

import numpy as np

from mechsim.analytic import loops
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.links import Pose
from mechsim.model.motion import Motion, taken
from mechsim.verdict.checks import Verdict, check_of, checks_of, concluded, tolerances_of
from mechsim.verdict.quantities import QUANTITIES, motion_scales, reach_of, stroke_of
from mechsim.verdict.tolerances import EPS, Requested, Tolerance

# so near to a change point, in [rad], neither steps nor rates from the loops are looked at
KEPT_OFF = 0.05


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
    open_by, turned_by = loops.residual_norms(mechanism, poses, exact.angle)
    loop_rates = loops.rates(mechanism, poses, exact.angle, exact.speed, exact.acceleration)
    closed = Tolerance(8 * EPS * mechanism.size, "m", "8 ulp of the longest link")
    turned = Tolerance(32 * EPS, "rad", "8 ulp of a turn of 4 rad")
    checks = [
        check_of("loop", "", open_by, exact.angle, closed),
        check_of("axes and gears", "", turned_by, exact.angle, turned),
    ]
    scales = motion_scales(stroke_of(exact), float(np.abs(exact.speed).max()), reach_of(exact))
    for kind in ("velocity", "acceleration"):
        rows = (QUANTITIES[kind],)
        allowed = tolerances_of(rows, "closed form", scales, Requested())
        checks += checks_of(rows, loop_rates, exact, allowed, drive.conditioning(exact))
    return concluded(checks)
