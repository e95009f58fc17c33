"""Links that collide where they are joined, and links that stand in each other where the scene starts."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.model.finding import Finding
from mechsim.numerics.arrays import Array
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.findings.swing import swing
from mechsim.simulation.mjcf.silence import quiet

# links this far in each other collide, in parts of the size
MIN_DEPTH = 1e-6
# every so many states of a motion are looked at
STATE_STRIDE = 10


def collisions(scene: Inspected) -> Iterator[Finding]:
    """Yield the pairs of links that touch though they are joined, or stand in each other at the start."""
    model, joined = scene.model, _joined(scene)
    motion = swing(scene)
    states = [scene.read.qpos, *([] if motion is None else motion.qpos[::STATE_STRIDE])]
    deepest: dict[tuple[int, int], tuple[float, tuple[int, int]]] = {}
    for number, qpos in enumerate(states):
        for pair, geoms, depth in _contacts(model, qpos):
            unintended = pair in joined or (number == 0 and 0 not in pair)
            if unintended and depth > MIN_DEPTH * scene.size and depth > deepest.get(pair, (0.0,))[0]:
                deepest[pair] = depth, geoms
    for pair, (depth, geoms) in deepest.items():
        yield _collision(scene, geoms, depth, joined=pair in joined)


def _collision(scene: Inspected, geoms: tuple[int, int], depth: float, *, joined: bool) -> Finding:
    model = scene.model
    first, second = (str(model.body(int(model.geom_bodyid[geom])).name) for geom in geoms)
    where = "collide where they are joined" if joined else "stand in each other where the scene starts"
    return Finding(
        kind="collision",
        what=f"{first}, {second}",
        by=depth,
        explains=0.0,
        message=f"{first} and {second} {where}: they are {depth:.2g} m deep in each other",
        remedy=f'<contact><exclude body1="{first}" body2="{second}"/></contact>, or smaller geoms',
        **scene.place(list(scene.read.spec.geoms)[geoms[0]]),
    )


def _joined(scene: Inspected) -> set[tuple[int, int]]:
    """Return the pairs of bodies that a joint or a loop joins, by the bodies that carry them."""
    model = scene.model
    carrier = model.body_weldid
    pairs = [(b, int(model.body_parentid[b])) for b in range(1, model.nbody) if carrier[b] == b]
    pairs += [(loop.bodies[0], loop.bodies[1]) for loop in scene.loops if loop.bodies]
    return {_pair(int(carrier[a]), int(carrier[b])) for a, b in pairs}


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _contacts(model: mujoco.MjModel, qpos: Array) -> Iterator[tuple[tuple[int, int], tuple[int, int], float]]:
    """Yield carriers, geoms and depth in [m] of the contacts at coordinates (nq,)."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    with quiet():
        mujoco.mj_fwdPosition(model, data)
    for contact in data.contact:
        geoms = int(contact.geom[0]), int(contact.geom[1])
        if min(geoms) < 0 or not np.isfinite(contact.dist):
            continue
        bodies = [int(model.body_weldid[model.geom_bodyid[geom]]) for geom in geoms]
        if bodies[0] != bodies[1]:
            yield _pair(*bodies), geoms, -float(contact.dist)
