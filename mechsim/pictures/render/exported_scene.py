"""Level "picture" of a scene: the links' shapes on the bodies that move, a floor, light and a camera."""

import mujoco
import numpy as np

from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import GROUND, IDENTITY, Mechanism, Pose
from mechsim.model.scene import Scene
from mechsim.pictures.render import scenery
from mechsim.shapes import camera as cameras
from mechsim.shapes import free_sides, link_shapes, planar_normals, rod_radius
from mechsim.shapes.extent import extent, travels
from mechsim.shapes.walls import backdrop, stands
from mechsim.simulation.closed_model import assembled, guessed
from mechsim.simulation.model_loops import ModelLoops

CAMERA = "view"
SIZE = (960, 720)
# sites stand for points and ends of joints; MuJoCo draws groups 0 to 2 unless told otherwise
SITE_GROUP = 3
# crank angles tried in a turn
STEPS = 48


def exported(mechanism: Mechanism, scene: Scene) -> mujoco.MjSpec:
    """Return the model of a mechanism, its loops closed, with its picture where the scene holds one.

    Raises:
        AssemblyError: if the loops do not close at the mechanism's start.
    """
    spec = assembled(mechanism, scene)
    if scene.holds("picture"):
        add_picture(spec, mechanism)
    return spec


def add_picture(spec: mujoco.MjSpec, mechanism: Mechanism) -> None:
    """Add to a model what a picture of it needs, and nothing that its physics could notice.

    The camera "view" holds the mechanism at every crank angle.

    Args:
        spec: the model's specification, whose bodies are named like the links and have their frames.
        mechanism: what it models.
    """
    bodies = {GROUND: spec.worldbody, **{link.name: spec.body(link.name) for link in mechanism.links}}
    poses, radius = swept(mechanism), rod_radius(mechanism)
    shapes = link_shapes(mechanism, travels(mechanism, poses), free_sides(mechanism, poses))
    balls, radii = extent((poses[link], shapes[link]) for link in shapes)
    low, high = (balls - radii[:, None]).min(0), (balls + radii[:, None]).max(0)
    if not planar_normals(mechanism):
        low[1] -= 2.0 * radius
        posts = stands(shapes[GROUND], float(low[1]), radius)
        shapes[GROUND].extend(posts)
        feet, widths = extent([(poses[GROUND], posts)])
        balls, radii = np.vstack([balls, feet]), np.append(radii, widths)
    camera = cameras.framed(*cameras.directions(mechanism, "iso"), balls, radii, SIZE)
    wall = backdrop(mechanism, camera, low, high, cell := cameras.nice(camera.height / 9.0))
    scenery.prepare(spec, camera, middle := (low + high) / 2.0)
    scenery.add_light(spec, camera, middle, wall.normal, shadow=True)
    scenery.add_grid(spec, "grid", wall, cell, emission=0.25 * (1.0 - float(wall.normal @ camera.back)))
    scenery.add_camera(spec, CAMERA, camera)
    for link, body in bodies.items():
        for shape in shapes[link]:
            scenery.add_shape(body, shape)
    for site in spec.sites:
        site.group, site.size = SITE_GROUP, [0.5 * radius] * 3


def swept(mechanism: Mechanism) -> dict[str, Pose]:
    """Return the poses of all links, ground included, over the turn or as far as the crank can go.

    Links other than the ground have as many poses as there are crank angles. Where the loops close
    nowhere, the one pose is the model's reference configuration.
    """
    loops, start = guessed(mechanism, Scene(level="pose"))
    ahead = _states(loops, start, 2.0 * np.pi / STEPS)
    states = ahead if len(ahead) >= STEPS else ahead + _states(loops, start, -2.0 * np.pi / STEPS)
    return {GROUND: IDENTITY, **_poses(mechanism, loops.model, states or [loops.model.qpos0])}


def _states(loops: ModelLoops, start: Array, step: float) -> list[Array]:
    """Closed states from a rough one on, the crank turning by a step each time; as far as it can."""
    states: list[Array] = []
    rough = start
    for _ in range(STEPS):
        try:
            closed = loops.close(rough[None])[0]
        except AssemblyError:
            break
        states.append(closed)
        rough = closed.copy()
        rough[loops.crank_place] += step
    return states


def _poses(mechanism: Mechanism, model: mujoco.MjModel, states: list[Array]) -> dict[str, Pose]:
    data = mujoco.MjData(model)
    names = [link.name for link in mechanism.links]
    places, rotations = np.empty((len(names), len(states), 3)), np.empty((len(names), len(states), 3, 3))
    for i, state in enumerate(states):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        for k, name in enumerate(names):
            places[k, i], rotations[k, i] = data.body(name).xpos, data.body(name).xmat.reshape(3, 3)
    return {name: Pose(places[k], rotations[k]) for k, name in enumerate(names)}
