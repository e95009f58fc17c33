"""Shapes, rods, arrows, grids, light and camera of a scene, without collisions or mass."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import hinged_normals
from mechsim.mechanism.moved_links import with_rods
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import prefixed
from mechsim.shapes import camera as cameras
from mechsim.shapes.body import extent, free_sides, rod_radius, travels
from mechsim.shapes.camera import Camera, Wall, backdrop, lowered, nice
from mechsim.shapes.joints import link_shapes
from mechsim.shapes.shape import Rgba, Shape, across_of
from mechsim.simulation.configurations import swept
from mechsim.simulation.state import quaternion

DECOR = int(mujoco.mjtCatBit.mjCAT_DECOR)

ARROW = mujoco.mjtGeom.mjGEOM_ARROW

UNITS = {"velocity": "m/s", "acceleration": "m/s²", "force": "N", "moment": "N m"}
COLOURS = {
    "velocity": (0.05, 0.25, 0.75, 1.0),
    "acceleration": (0.72, 0.05, 0.35, 1.0),
    "force": (0.10, 0.10, 0.10, 1.0),
    "moment": (0.42, 0.16, 0.60, 1.0),
}
# largest length of the longest arrow of a kind, relative to the mechanism's extent; the smallest is two
# fifths of it
MAX_ARROW = 0.34
# position of the second head of a moment's arrow, relative to its length
SECOND_HEAD = 0.84


@dataclass(frozen=True, slots=True)
class Arrows:
    """Arrows of one kind.

    Attributes:
        kind: "velocity", "acceleration", "force" or "moment".
        vectors: point or joint -> vectors frame by frame, (n, 3) in the kind's unit.
        largest: magnitude of the longest vector of the whole motion, in that unit.
        length: length of the scale arrow, a round number in [m].
        stands_for: number of units that this arrow represents.
    """

    kind: str
    vectors: Mapping[str, Array]
    largest: float
    length: float
    stands_for: float

    @property
    def scale(self) -> float:
        """Metres drawn for one unit."""
        return self.length / self.stands_for

    @property
    def legend(self) -> tuple[str, tuple[int, int, int]]:
        """Legend of the arrows, and their colour, 0 to 255."""
        red, green, blue, _ = (round(255.0 * channel) for channel in COLOURS[self.kind])
        if self.largest == 0.0:
            return f"{self.kind}: none", (red, green, blue)
        unit = UNITS[self.kind]
        scale_text = f"{prefixed(self.length, 'm')} = {prefixed(self.stands_for, unit)}"
        return f"{self.kind}: {scale_text}, at most {prefixed(self.largest, unit)}", (red, green, blue)

    def tips(self, starts: Mapping[str, Array]) -> Array:
        """Return the tips of the arrows in every frame, (k, 3) in [m]."""
        return np.vstack([starts[name] + self.scale * vector for name, vector in self.vectors.items()])

    def put(self, scene: mujoco.MjvScene, starts: Mapping[str, Array], frame: int, width: float) -> None:
        """Add the arrows of a frame to a scene, from their starts, as far as it has room."""
        for name, vectors in self.vectors.items():
            arrow, colour = self.scale * vectors[frame], COLOURS[self.kind]
            for share in (1.0, SECOND_HEAD) if self.kind == "moment" else (1.0,):
                put_arrow(scene, starts[name], share * arrow, width, colour)


def put_arrow(scene: mujoco.MjvScene, start: Array, arrow: Array, width: float, rgba: Rgba) -> None:
    """Add an arrow to a scene if it has room, and if the arrow is longer than twice its width."""
    if float(np.linalg.norm(arrow)) < 2.0 * width or scene.ngeom >= scene.maxgeom:
        return
    geom, colour = scene.geoms[scene.ngeom], np.array(rgba, dtype=np.float32)
    mujoco.mjv_initGeom(geom, ARROW, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
    # MuJoCo draws an arrow with half of the given length
    mujoco.mjv_connector(geom, ARROW, width, start, start + 2.0 * arrow)
    geom.specular, geom.emission, geom.category = 0.1, 0.3, DECOR
    scene.ngeom += 1


def arrows(kind: str, vectors: Mapping[str, Array], extent: float) -> Arrows:
    """Return arrows of a kind for a mechanism of an extent in [m], the longest with a readable length."""
    lengths = (np.sqrt((vector**2).sum(1)).max() for vector in vectors.values())
    largest, length = float(max(lengths, default=0.0)), nice(extent / 5.0)
    # the round number above: 1, 2 and 5 are the inverses of 1, 0.5 and 0.2
    least = largest * length / (MAX_ARROW * extent)
    return Arrows(kind, dict(vectors), largest, length, 1.0 / nice(1.0 / least) if least > 0.0 else 1.0)


BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
# share of the light that rods of a path reflect; they emit their colour: MuJoCo adds the light of the lamp of
# all rods at a pixel, so that a path that returns on itself would have another colour
REFLECTED = 0.05


@dataclass(frozen=True, slots=True)
class Chain:
    """Rods between the points of a path, as geoms of a scene.

    Attributes:
        centres: (k, 3) in [m].
        frames: rotation matrices row by row, (k, 9).
        sizes: half edges, (k, 3) in [m].
        rgba: colour, (4,).
    """

    centres: Array
    frames: Array
    sizes: Array
    rgba: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.centres)

    def put(self, scene: mujoco.MjvScene, start: int = 0, stop: int | None = None) -> None:
        """Add some of the rods to a scene, as far as it has room."""
        geoms, ngeom = scene.geoms, scene.ngeom
        stop = len(self) if stop is None else min(stop, len(self))
        stop = min(stop, start + scene.maxgeom - ngeom)
        dark = self.rgba * np.array([REFLECTED] * 3 + [1.0], dtype=np.float32)
        for i in range(start, stop):
            geom = geoms[ngeom]
            mujoco.mjv_initGeom(geom, BOX, self.sizes[i], self.centres[i], self.frames[i], dark)
            # decoration casts no shadow
            geom.specular, geom.emission, geom.category = 0.0, 1.0 / REFLECTED, DECOR
            ngeom += 1
        scene.ngeom = ngeom


def chain(path: Array, width: ArrayLike, rgba: ArrayLike) -> Chain:
    """Return the rods along a path, (m, 3), with a given width, or one for each rod, (m - 1,)."""
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = np.where(lengths[:, None] > 0.0, steps / np.maximum(lengths, 1e-300)[:, None], [1.0, 0.0, 0.0])
    least = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    x = np.cross(least, along)
    x /= np.linalg.norm(x, axis=1)[:, None]
    frames = np.stack([x, np.cross(along, x), along], axis=-1).reshape(-1, 9)
    widths = np.broadcast_to(np.asarray(width, dtype=np.float64), len(steps))
    # half a width at each end closes the outer side of a bend
    sizes = np.column_stack([widths, widths, lengths + 0.5 * widths]) / 2.0
    return Chain((path[:-1] + path[1:]) / 2.0, frames, sizes, np.asarray(rgba, dtype=np.float32))


# turns of a drawn spring, and chords of a turn
COILS, COIL_CHORDS = 8, 16


def coil(a: Array, b: Array, radius: float, width: float, rgba: ArrayLike) -> Chain:
    """Return the rods of a coil spring from a point to another, with straight ends."""
    along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-300)
    side = across_of(np.array([0.0, 0.0, 1.0]), along)
    angles = np.linspace(0.0, 2.0 * np.pi * COILS, COILS * COIL_CHORDS + 1)[:, None]
    circle = np.sin(angles) * np.cross(side, along) + np.cos(angles) * side
    path = a + (0.1 + 0.8 * angles / angles[-1]) * (b - a) + radius * circle
    return chain(np.vstack([a, a + 0.1 * (b - a), path, b - 0.1 * (b - a), b]), width, rgba)


def dashpot(a: Array, b: Array, radius: float, rgba: ArrayLike) -> Chain:
    """Return a damper between two points: a piston rod from a, and a cylinder about it that ends at b."""
    path = a + np.array([0.0, 0.45, 0.9, 1.0])[:, None] * (b - a)
    return chain(path, radius * np.array([0.8, 3.0, 0.8]), rgba)


GEOMS = {
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}
# colours of the background and of the lines of its grid, 0 to 1
PAPER = (0.955, 0.96, 0.97)
GRID_LINE = (0.76, 0.79, 0.83)
# names of the material of shapes, of the grid's texture and material, and of the camera
MATTE, GRID, CAMERA = "matte", "grid", "view"
# of MuJoCo's geoms that say nothing
GREY = (0.5, 0.5, 0.5, 1.0)
# fractions of white light: ambient, from the camera, from the lamp over its shoulder
AMBIENT, HEADLIGHT, LAMP = 0.42, 0.28, 0.30
# in [m], that the compiler lets a camera with parallel projection show: it takes it for an angle
HIGHEST = 179.0


def add_shape(spec: mujoco.MjSpec, body: mujoco.MjsBody, shape: Shape) -> None:
    """Add a shape to a body as a geom of material MATTE; see `add_surroundings`."""
    geom = body.add_geom(rgba=shape.rgba, material=MATTE)
    if shape.facets is None:
        geom.type, geom.pos, geom.quat = GEOMS[shape.kind], shape.centre, quaternion(shape.frame)
        geom.size = [*shape.half_sizes, 0.0, 0.0][:3]
    else:
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, f"facets{len(spec.meshes)}"
        # a sheet has no inside
        mesh = spec.add_mesh(name=geom.meshname, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        mesh.uservert = shape.facets.vertices.ravel()
        mesh.userface = shape.facets.faces.ravel()
    geom.contype = geom.conaffinity = 0
    geom.mass = 0.0


def add_surroundings(
    spec: mujoco.MjSpec, camera: Camera, wall: Wall, middle: Array, grid_step: float, *, shadow: bool
) -> None:
    """Add what all pictures have: material, camera, light, and a plane with grid lines.

    Args:
        spec: specification to extend.
        camera: with parallel projection; `set_height` gives one above `HIGHEST` its height.
        wall: the plane.
        middle: of the mechanism, (3,) in [m].
        grid_step: edge of a grid cell in [m].
        shadow: whether shadows fall on the wall.
    """
    _set_visual(spec, camera, middle)
    # a geom whose colour is MuJoCo's usual one takes that of its material: the same
    spec.add_material(name=MATTE, specular=0.25, shininess=0.4, rgba=GREY)
    # a distant lamp over the camera's shoulder
    towards = -(1.3 * wall.normal + 0.55 * camera.up - 0.5 * camera.right + 0.35 * camera.back)
    towards = towards / np.linalg.norm(towards)
    light = spec.worldbody.add_light(pos=middle - 2.0 * camera.height * towards, dir=towards)
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.diffuse, light.specular = [LAMP] * 3, [0.20] * 3
    light.castshadow = shadow
    view = spec.worldbody.add_camera(name=CAMERA, pos=camera.position)
    view.quat = quaternion(np.column_stack([camera.right, camera.up, camera.back]))
    view.proj = mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
    view.fovy = min(camera.height, HIGHEST)
    texture = spec.add_texture(name=GRID, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    texture.mark = mujoco.mjtMark.mjMARK_EDGE
    texture.rgb1 = texture.rgb2 = PAPER
    texture.markrgb = GRID_LINE
    texture.width = texture.height = 64
    material = spec.add_material(name=GRID, specular=0.0, shininess=0.0)
    textures = material.textures
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = GRID
    material.textures = textures
    material.texrepeat = [2.0 * half / grid_step for half in wall.half]
    # a slanted wall, on which less of the camera's light falls, looks as white as a frontal one
    material.emission = 0.25 * (1.0 - float(wall.normal @ camera.back))
    plane = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, pos=wall.point, material=GRID)
    plane.size = [*wall.half, 1.0]
    plane.quat = quaternion(wall.frame)
    plane.contype = plane.conaffinity = 0


def set_height(model: mujoco.MjModel, camera: Camera) -> None:
    """Give a compiled model's camera its height in [m], however high."""
    model.cam_fovy[model.camera(CAMERA).id] = camera.height


def _set_visual(spec: mujoco.MjSpec, camera: Camera, middle: Array) -> None:
    """Set the quality of drawing, the soft light from the camera, and distances."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.resolution
    spec.visual.quality.shadowsize = min(2048, 4 * max(camera.resolution))
    # details are small in the picture: fewer facets than MuJoCo's 28 and 16 look as round and draw faster
    spec.visual.quality.numslices = 20
    spec.visual.quality.numstacks = 8
    # under distant light a flat face has uniform brightness and needs no division
    spec.visual.quality.numquads = 1
    spec.visual.headlight.ambient = [AMBIENT] * 3
    spec.visual.headlight.diffuse = [HEADLIGHT] * 3
    spec.visual.headlight.specular = [0.05] * 3
    # the camera's distances are multiples of the extent
    spec.stat.extent = camera.height
    spec.stat.center = middle
    spec.visual.map.znear = 0.01
    spec.visual.map.zfar = 12.0
    # the box in which shadows fall is as deep as it is wide: a smaller one leaves specks on the floor
    spec.visual.map.shadowclip = 1.25 * float(np.hypot(1.0, camera.resolution[0] / camera.resolution[1]))


# default size of a picture in pixels
RESOLUTION = (960, 720)
# sites stand for points and ends of joints; MuJoCo draws groups 0 to 2 by default
SITE_GROUP = 3


def add_picture(spec: mujoco.MjSpec, mechanism: Mechanism) -> None:
    """Add to a model the elements of a picture, without effect on its physics.

    The camera "view" holds the mechanism at every crank angle.

    Args:
        spec: the model's specification, whose bodies are named like the links and have their frames.
        mechanism: what it models.
    """
    mechanism = with_rods(mechanism, {})[0]
    bodies = {GROUND: spec.worldbody, **{link.name: spec.body(link.name) for link in mechanism.links}}
    poses, radius = swept(mechanism), rod_radius(mechanism)
    shapes = link_shapes(mechanism, travels(mechanism, poses), free_sides(mechanism, poses))
    balls, radii = extent((poses[link], shapes[link]) for link in shapes)
    low, high = (balls - radii[:, None]).min(0), (balls + radii[:, None]).max(0)
    up = cameras.upright(mechanism)
    if not hinged_normals(mechanism):
        low, high, floor = lowered(low, high, up, 2.0 * radius)
        balls, radii = cameras.add_stands(shapes[GROUND], up, floor, radius, (balls, radii))
    camera = cameras.framed(*cameras.directions(mechanism, "iso"), balls, radii, RESOLUTION)
    grid_step, middle = cameras.nice(camera.height / 9.0), (low + high) / 2.0
    wall = backdrop(mechanism, camera, up, low, high, grid_step)
    add_surroundings(spec, camera, wall, middle, grid_step, shadow=True)
    # MuJoCo's viewer starts with its free camera
    view = spec.visual.global_
    view.azimuth, view.elevation = cameras.free_camera_angles(camera.back, camera.up)
    for link, body in bodies.items():
        for shape in shapes[link]:
            add_shape(spec, body, shape)
    for site in spec.sites:
        site.group, site.size = SITE_GROUP, [0.5 * radius] * 3
