"""Free stepping where couplings bend: MuJoCo's constraints ask for the bend too.

MuJoCo's constraint of a coupling y = p(x) asks for an acceleration by how far it stands open, and leaves
p'' x'^2 out. At every stage of every step it is told of another opening, by which it asks for that as well.
"""

from collections.abc import Generator
from contextlib import contextmanager

import mujoco
import numpy as np

from mechsim.simulation.model_loops import ModelLoops

EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)


def bends(loops: ModelLoops) -> bool:
    """Say whether the loops of a model have couplings that bend."""
    return any(one.nonlinear for one in loops.couplings)


@contextmanager
def bending(loops: ModelLoops) -> Generator[None]:
    """Let couplings bend while steps are taken one by one, and whatever acted before again afterwards."""
    before = mujoco.get_mjcb_passive()
    bent, rows = [one for one in loops.couplings if one.nonlinear], list[int]()

    # MuJoCo calls it once openings are known, before it asks for accelerations by them
    def opened(_: mujoco.MjModel, data: mujoco.MjData) -> None:
        if not rows:
            held = np.where(data.efc_type == EQUALITY, data.efc_id, -1).tolist()
            rows.extend(held.index(one.equality) for one in bent)
        qpos, qvel = data.qpos[None], data.qvel[None]
        for one, row in zip(bent, rows, strict=True):
            stiffness, _, impedance, _ = data.efc_KBIP[row]
            data.efc_pos[row] -= float(one.velocity_product(qpos, qvel)[0]) / (stiffness * impedance)

    mujoco.set_mjcb_passive(opened if bent else before)
    try:
        yield
    finally:
        mujoco.set_mjcb_passive(before)
