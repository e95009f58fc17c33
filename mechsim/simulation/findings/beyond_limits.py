"""Joints and tendons that stand beyond their limits where a scene starts."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.model.finding import Finding
from mechsim.simulation.findings.inspected import Inspected, line_of
from mechsim.simulation.mjcf_reader.kinds import DRIVABLE, SLIDE

# what digits of a file leave, in parts of the range
ROUNDED = 1e-6


def beyond(scene: Inspected) -> Iterator[Finding]:
    """Yield the joints, balls and tendons that start beyond their range."""
    model = scene.model
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return
    joints = {joint.name: joint for joint in scene.read.spec.joints}
    for j in np.flatnonzero(model.jnt_limited):
        kind, name, place = int(model.jnt_type[j]), model.joint(j).name, int(model.jnt_qposadr[j])
        if kind in DRIVABLE:
            value = float(scene.read.qpos[place])
        else:  # a ball's limit is on how far it is turned
            value = 2.0 * float(np.arccos(min(1.0, abs(float(scene.read.qpos[place])))))
        unit = "m" if kind == SLIDE else "rad"
        yield from _beyond(f"joint {name}", name, value, model.jnt_range[j], unit, line_of(joints[name]))
    tendons = {tendon.name: tendon for tendon in scene.read.spec.tendons}
    for t in np.flatnonzero(model.tendon_limited):
        name, value = model.tendon(t).name, float(scene.started.ten_length[t])
        line = line_of(tendons[name]) if name in tendons else None
        yield from _beyond(f"tendon {name}", name, value, model.tendon_range[t], "m or rad", line)


def _beyond(
    called: str, name: str, value: float, bounds: tuple[float, float], unit: str, line: int | None
) -> Iterator[Finding]:
    low, high = float(bounds[0]), float(bounds[1])
    by = max(low - value, value - high)
    if by > ROUNDED * max(1.0, high - low):
        yield Finding(
            kind="limit",
            what=name,
            by=by,
            explains=0.0,
            say=f"{called} starts at {value:.6g} {unit}, {by:.3g} beyond its range, {low:.6g} to {high:.6g}",
            remedy="widen the range, or start from a keyframe within it",
            line=line,
        )
