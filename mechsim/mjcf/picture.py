"""Level "picture" of a scene: the links' shapes on the bodies that move, a floor, light and a camera."""

from collections.abc import Mapping

import mujoco
import numpy as np

from mechsim.mechanism import GROUND, Mechanism
from mechsim.mjcf import scenery
from mechsim.mjcf.swept import swept
from mechsim.shapes import camera as cameras
from mechsim.shapes import free_sides, link_shapes, planar_normals, rod_radius
from mechsim.shapes.extent import extent, travels
from mechsim.shapes.walls import backdrop, stands

CAMERA = "view"
SIZE = (960, 720)
# sites stand for points and ends of joints; MuJoCo draws groups 0 to 2 unless told otherwise
SITE_GROUP = 3


def add_picture(spec: mujoco.MjSpec, mechanism: Mechanism, bodies: Mapping[str, mujoco.MjsBody]) -> None:
    """Add to a model what a picture of it needs, and nothing that its physics could notice.

    The camera "view" holds the mechanism at every crank angle.

    Args:
        spec: the model's specification.
        mechanism: what it models.
        bodies: link -> body, ground included, whose frames are the links'.
    """
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
