"""Joints and tendons outside their limits at the start, and links that collide."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.mechanism.finding import Finding
from mechsim.numerics.arrays import Array
from mechsim.simulation.equality_rows import coincident_frames
from mechsim.simulation.findings.inspected import Element, Inspected, driver_swing, null_space
from mechsim.simulation.state import SCALAR, SLIDE, is_disabled

# rounding error of values in a file, as a fraction of the range
ROUNDING = 1e-6
# component of a unit free direction above which a joint moves
SIGNIFICANT = 1e-6


def outside_limits_at_start(scene: Inspected) -> Iterator[Finding]:
    """Yield joints and tendons that start outside their range, and joints whose range is a single value."""
    model = scene.model
    if is_disabled(model, mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return
    free = np.abs(np.vstack([null_space(jacobian) for jacobian, _ in scene.sample_jacobians]))
    for j in np.flatnonzero(model.jnt_limited):
        kind, name, address = int(model.jnt_type[j]), str(model.joint(j).name), int(model.jnt_qposadr[j])
        value = float(scene.read.qpos[address])
        if kind not in SCALAR:  # the limit of a ball joint applies to its rotation angle
            value = 2.0 * float(np.arccos(min(1.0, abs(value))))
        unit = "m" if kind == SLIDE else "rad"
        joint, (low, high) = scene.read.spec.joint(name), model.jnt_range[j]
        yield from _outside(scene, f"joint {name}", joint, value, model.jnt_range[j], unit)
        dofs = slice(int(model.jnt_dofadr[j]), int(model.jnt_dofadr[j]) + (1 if kind in SCALAR else 3))
        moves = free[:, dofs].max(initial=0.0) > SIGNIFICANT
        if low == high and value == low and moves and np.abs(scene.generic[0][:, dofs]).any():
            what = f"has {float(low):g} {unit} as its only position, which every motion of its loop leaves"
            remedy = 'give it a range, or limited="false"'
            yield scene.finding("limit", joint, 0.0, f"joint {name} {what}", remedy)
    for t in np.flatnonzero(model.tendon_limited):
        name, value = str(model.tendon(t).name), float(scene.started.ten_length[t])
        tendon = scene.read.spec.tendon(name) if name else None
        yield from _outside(scene, f"tendon {name}", tendon, value, model.tendon_range[t], "m or rad")


def _outside(
    scene: Inspected, label: str, element: Element | None, value: float, bounds: Array, unit: str
) -> Iterator[Finding]:
    low, high = bounds.tolist()
    excess = max(low - value, value - high)
    if excess > ROUNDING * max(1.0, high - low):
        beyond = f"{excess:.3g} beyond its range, {low:.6g} to {high:.6g}"
        message = f"{label} starts at {value:.6g} {unit}, {beyond}"
        yield scene.finding("limit", element, excess, message, "widen the range, or start within it")


# smallest penetration depth of a collision, as a fraction of the characteristic length
MIN_DEPTH = 1e-6
# number of states from one collision check of a motion to the next
STATE_INTERVAL = 10


def collisions(scene: Inspected) -> Iterator[Finding]:
    """Yield pairs of joined links that collide, and pairs of other moving links that overlap at the start."""
    data = mujoco.MjData(contact_model(scene))
    joined, motion = _joined(scene), driver_swing(scene)
    states = [scene.read.qpos, *([] if motion is None else motion.qpos[::STATE_INTERVAL])]
    deepest: dict[tuple[int, int], tuple[float, tuple[int, int]]] = {}
    for number, qpos in enumerate(states):
        for pair, geoms, depth in _contacts(data, qpos):
            unintended = pair in joined or (number == 0 and 0 not in pair)
            if unintended and depth > MIN_DEPTH * scene.length and depth > deepest.get(pair, (0.0,))[0]:
                deepest[pair] = depth, geoms
    model, elements = data.model, list(scene.read.spec.geoms)
    for pair, (depth, geoms) in deepest.items():
        first, second = (str(model.body(int(model.geom_bodyid[geom])).name) for geom in geoms)
        where = "are joined and collide" if pair in joined else "overlap at the start"
        message = f"{first} and {second} {where}: they penetrate by {depth:.2g} m"
        remedy = f'<contact><exclude body1="{first}" body2="{second}"/></contact>, or smaller geoms'
        # geoms that the compiler discards have no index
        element = elements[geoms[0]] if len(elements) == model.ngeom else None
        yield scene.finding("collision", element, depth, message, remedy, f"{first}, {second}")


def contact_model(scene: Inspected) -> mujoco.MjModel:
    """Return the model with the geometry of the file."""
    return scene.model if scene.read.with_meshes is None else scene.read.with_meshes


def _joined(scene: Inspected) -> set[tuple[int, int]]:
    """Return the pairs of bodies that a joint or a loop connects; each body stands for its rigid group."""
    model = scene.model
    carrier = model.body_weldid
    pairs = [(b, int(model.body_parentid[b])) for b in range(1, model.nbody) if carrier[b] == b]
    pairs += [coincident_frames(model, loop.number)[0] for loop in scene.loops if loop.closes]
    joined = np.sort(carrier[np.array(pairs, dtype=np.intp).reshape(-1, 2)], axis=1)
    return {(a, b) for a, b in joined.tolist()}


def _contacts(data: mujoco.MjData, qpos: Array) -> Iterator[tuple[tuple[int, int], tuple[int, int], float]]:
    """Yield bodies, geoms and penetration depth in [m] of the contacts at coordinates (nq,)."""
    model = data.model
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(model, data)
    for contact in data.contact:
        geoms = int(contact.geom[0]), int(contact.geom[1])
        if min(geoms) < 0 or not np.isfinite(contact.dist):
            continue
        a, b = sorted(int(model.body_weldid[model.geom_bodyid[geom]]) for geom in geoms)
        if a != b:
            yield (a, b), geoms, -float(contact.dist)
