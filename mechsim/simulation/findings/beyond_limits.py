"""Joints and tendons that stand beyond their limits where a scene starts."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.model.finding import NOWHERE, FilePlace, Finding
from mechsim.simulation.findings.inspected import Inspected, null_space
from mechsim.simulation.mjcf_reader.joint_types import DRIVABLE, SLIDE

# what digits of a file leave, in parts of the range
ROUNDING = 1e-6
# part of a freedom that is a motion of a joint, and no rounding
SIGNIFICANT = 1e-6


def outside_limits(scene: Inspected) -> Iterator[Finding]:
    """Yield the joints, balls and tendons that start beyond their range, or can never leave one place."""
    model = scene.model
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return
    joints = {joint.name: joint for joint in scene.read.spec.joints}
    free = np.abs(np.vstack([null_space(jacobian) for jacobian, _ in scene.sample_jacobians]))
    for j in np.flatnonzero(model.jnt_limited):
        kind, name, address = int(model.jnt_type[j]), str(model.joint(j).name), int(model.jnt_qposadr[j])
        value = float(scene.read.qpos[address])
        if kind not in DRIVABLE:  # a ball's limit is on how far it is turned
            value = 2.0 * float(np.arccos(min(1.0, abs(value))))
        unit = "m" if kind == SLIDE else "rad"
        location, (low, high) = scene.place(joints[name]), model.jnt_range[j]
        yield from _outside(f"joint {name}", name, value, (low, high), unit, location)
        dofs = slice(int(model.jnt_dofadr[j]), int(model.jnt_dofadr[j]) + (1 if kind in DRIVABLE else 3))
        if low == high and value == low and free[:, dofs].max(initial=0.0) > SIGNIFICANT:
            yield _immobile(name, float(low), unit, location)
    tendons = {tendon.name: tendon for tendon in scene.read.spec.tendons}
    for t in np.flatnonzero(model.tendon_limited):
        name, value = str(model.tendon(t).name), float(scene.started.ten_length[t])
        location = scene.place(tendons[name]) if name in tendons else NOWHERE
        low, high = model.tendon_range[t]
        yield from _outside(f"tendon {name}", name, value, (low, high), "m or rad", location)


def _immobile(name: str, limit: float, unit: str, location: FilePlace) -> Finding:
    return Finding(
        kind="limit",
        what=name,
        by=0.0,
        explains=0.0,
        message=f"joint {name} is limited to {limit:g} {unit} alone, "
        "and every motion of its loop breaks that",
        remedy='give it a range, or limited="false"',
        **location,
    )


def _outside(
    label: str, name: str, value: float, bounds: tuple[float, float], unit: str, location: FilePlace
) -> Iterator[Finding]:
    low, high = float(bounds[0]), float(bounds[1])
    excess = max(low - value, value - high)
    if excess > ROUNDING * max(1.0, high - low):
        yield Finding(
            kind="limit",
            what=name,
            by=excess,
            explains=0.0,
            message=f"{label} starts at {value:.6g} {unit}, {excess:.3g} "
            f"beyond its range, {low:.6g} to {high:.6g}",
            remedy="widen the range, or start from a keyframe within it",
            **location,
        )
