"""Laws that hold for the motion of any mechanism, shared by tests."""

import numpy as np
from strategies import CLOSED, EPS, longest

from mechsim import loops
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.links import Pose
from mechsim.model.motion import Motion


def agrees_with_loop_equations(drive: ClosedForm, motion: Motion, slack: float = 1.0) -> None:
    """Assert that links close the loops and that points, links and joints move as the loops ask."""
    mechanism = drive.mechanism
    poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
    open_by, turned_by = loops.residual_norms(mechanism, poses, motion.angle)
    assert open_by.max() <= slack * CLOSED * longest(drive)
    assert turned_by.max() <= slack * 32 * EPS
    exact = loops.rates(mechanism, poses, motion.angle, motion.speed, motion.acceleration)
    assert motion.joints.keys() == exact.joints.keys()
    square = float((motion.speed**2).max())
    for kind in ("points", "links", "joints"):
        for name, measured in getattr(motion, kind).items():
            expected = getattr(exact, kind)[name]
            for part in measured.__dataclass_fields__:
                if part in ("unit", "index") or (name in motion.spinning and "angular" in part):
                    continue
                gap = getattr(measured, part) - getattr(expected, part)
                if part == "value" and measured.unit == "rad":
                    gap = gap - 2.0 * np.pi * np.round(gap / (2.0 * np.pi))
                angle = "angular" in part or part == "rotation" or getattr(measured, "unit", "m") == "rad"
                unit = 1.0 if angle else longest(drive)
                if part in ("position", "rotation", "value"):
                    assert np.abs(gap).max() <= 1e-13 * unit, (kind, name, part)
                else:
                    scale = max(np.abs(getattr(expected, part)).max(), square * unit)
                    assert np.abs(gap).max() <= 1e-10 * scale, (kind, name, part)
