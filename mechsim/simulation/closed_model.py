"""A mechanism's model with its loops closed."""

import mujoco

from mechsim.model.mechanism import Mechanism, Pose
from mechsim.model.scene import Scene
from mechsim.simulation.mjcf import compiled, generate, quiet
from mechsim.simulation.model_loops import ModelLoops


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
    loops = ModelLoops(model)
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
