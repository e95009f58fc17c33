"""Level "picture" of a scene: the links' shapes on the bodies that move, a floor, light and a camera."""

import mujoco
import numpy as np

from mechsim.model.link_poses import hinged_normals
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import Scene
from mechsim.pictures.render import scenery
from mechsim.shapes import camera as cameras
from mechsim.shapes import free_sides, link_shapes, rod_radius
from mechsim.shapes.extent import extent, travels
from mechsim.shapes.walls import backdrop, lowered, stands
from mechsim.simulation.closed_model import assembled
from mechsim.simulation.poses.sweep import swept

CAMERA = "view"
SIZE = (960, 720)
# sites stand for points and ends of joints; MuJoCo draws groups 0 to 2 unless told otherwise
SITE_GROUP = 3


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
    up = cameras.upright(mechanism)
    if not hinged_normals(mechanism):
        low, high, floor = lowered(low, high, up, 2.0 * radius)
        posts = stands(shapes[GROUND], up, floor, radius)
        shapes[GROUND].extend(posts)
        feet, widths = extent([(poses[GROUND], posts)])
        balls, radii = np.vstack([balls, feet]), np.append(radii, widths)
    camera = cameras.framed(*cameras.directions(mechanism, "iso"), balls, radii, SIZE)
    cell, middle = cameras.nice(camera.height / 9.0), (low + high) / 2.0
    wall = backdrop(mechanism, camera, up, low, high, cell)
    scenery.prepare(spec, camera, middle)
    scenery.add_light(spec, camera, middle, wall.normal, shadow=True)
    scenery.add_grid(spec, "grid", wall, cell, emission=0.25 * (1.0 - float(wall.normal @ camera.back)))
    scenery.add_camera(spec, CAMERA, camera)
    for link, body in bodies.items():
        for shape in shapes[link]:
            scenery.add_shape(spec, body, shape)
    for site in spec.sites:
        site.group, site.size = SITE_GROUP, [0.5 * radius] * 3
