"""MuJoCo models of mechanisms: generated from dimensions, assembled by the model itself, exported."""

import mujoco

from mechsim.mechanism import Mechanism, Pose
from mechsim.mjcf.compiled import compiled
from mechsim.mjcf.generate import generate
from mechsim.mjcf.loops import Loops
from mechsim.mjcf.quiet import quiet
from mechsim.mjcf.text import to_xml
from mechsim.scene import Scene

__all__ = ["Loops", "assembled", "compiled", "generate", "quiet", "to_xml"]


@quiet()
def assembled(mechanism: Mechanism, scene: Scene) -> mujoco.MjSpec:
    """Return the model of a mechanism with its loops closed in the reference configuration.

    The crank stands at the mechanism's `start`. The model solves its own assembly, from the guess
    that says which assembly is meant; lengths come from the description alone.

    Raises:
        AssemblyError: if the loops do not close there.
    """
    rough = generate(mechanism, scene, mechanism.guess)
    model = compiled(rough)
    loops = Loops(model)
    start = model.qpos0.copy()
    start[loops.crank_place] = mechanism.start
    closed = loops.close(start[None])
    data = mujoco.MjData(model)
    data.qpos[:] = closed[0]
    mujoco.mj_kinematics(model, data)
    poses = {
        link.name: Pose(data.body(link.name).xpos.copy(), data.body(link.name).xmat.reshape(3, 3).copy())
        for link in mechanism.links
    }
    return generate(mechanism, scene, poses)
