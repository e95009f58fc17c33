"""Joints and tendons that stand beyond their limits where a scene starts."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.model.finding import NOWHERE, FilePlace, Finding
from mechsim.simulation.findings.inspected import Inspected, null_space
from mechsim.simulation.mjcf_reader.kinds import DRIVABLE, SLIDE

# what digits of a file leave, in parts of the range
ROUNDED = 1e-6
# part of a freedom that is a motion of a joint, and no rounding
MOVES = 1e-6


def beyond(scene: Inspected) -> Iterator[Finding]:
    """Yield the joints, balls and tendons that start beyond their range, or can never leave one place."""
    model = scene.model
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return
    joints = {joint.name: joint for joint in scene.read.spec.joints}
    free = np.abs(np.vstack([null_space(slope) for slope, _ in scene.slopes]))
    for j in np.flatnonzero(model.jnt_limited):
        kind, name, place = int(model.jnt_type[j]), str(model.joint(j).name), int(model.jnt_qposadr[j])
        value = float(scene.read.qpos[place])
        if kind not in DRIVABLE:  # a ball's limit is on how far it is turned
            value = 2.0 * float(np.arccos(min(1.0, abs(value))))
        unit = "m" if kind == SLIDE else "rad"
        where, (low, high) = scene.place(joints[name]), model.jnt_range[j]
        yield from _beyond(f"joint {name}", name, value, (low, high), unit, where)
        dofs = slice(int(model.jnt_dofadr[j]), int(model.jnt_dofadr[j]) + (1 if kind in DRIVABLE else 3))
        if low == high and value == low and free[:, dofs].max(initial=0.0) > MOVES:
            yield _shut(name, float(low), unit, where)
    tendons = {tendon.name: tendon for tendon in scene.read.spec.tendons}
    for t in np.flatnonzero(model.tendon_limited):
        name, value = str(model.tendon(t).name), float(scene.started.ten_length[t])
        where = scene.place(tendons[name]) if name in tendons else NOWHERE
        low, high = model.tendon_range[t]
        yield from _beyond(f"tendon {name}", name, value, (low, high), "m or rad", where)


def _shut(name: str, at: float, unit: str, where: FilePlace) -> Finding:
    return Finding(
        kind="limit",
        what=name,
        by=0.0,
        explains=0.0,
        say=f"joint {name} is limited to {at:g} {unit} alone, and every motion of its loop breaks that",
        remedy='give it a range, or limited="false"',
        **where,
    )


def _beyond(
    called: str, name: str, value: float, bounds: tuple[float, float], unit: str, where: FilePlace
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
            **where,
        )
