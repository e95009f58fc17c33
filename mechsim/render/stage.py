"""Stage: a mechanism as a MuJoCo model of shapes alone, put into any pose and framed by a camera.

Every link is a mocap body that carries geoms and nothing else, so drawing never touches the physics
of a run and the closed form is drawn in the same way.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism import GROUND, Mechanism, Pose
from mechsim.render import camera as cameras
from mechsim.render.look import Look
from mechsim.render.track import Track
from mechsim.shapes import HOUSING, Shape, free_sides, link_shapes, planar_normals, rod_radius

Array = NDArray[np.float64]

GEOMS = {
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}
PAPER = (0.955, 0.96, 0.97)
GRID_LINE = (0.76, 0.79, 0.83)
CAMERA = "view"
MATTE = "matte"


@dataclass(frozen=True, slots=True)
class Wall:
    """A plane with a grid on it.

    Attributes:
        point: its middle, (3,) in [m].
        normal: unit vector off it towards the mechanism, (3,).
        half: half its edges in [m], the first along `across`.
        across: unit vector along its first edge, (3,).
    """

    point: Array
    normal: Array
    half: tuple[float, float]
    across: Array


class Stage:
    """What is drawn: the model, its data, the camera, the grid.

    Attributes:
        camera: the camera, framed over the whole motion.
        model: shapes only; a mocap body per link and overlaid position.
        data: its state.
        cell: edge of a grid cell in [m].
        walls: planes with a grid.
        forward: whether the crank turns the positive way.
    """

    def __init__(self, mechanism: Mechanism, track: Track, look: Look):
        self.mechanism, self.track, self.look = mechanism, track, look
        self.radius = rod_radius(mechanism)
        self.forward = bool(track.angle[-1] >= track.angle[0])
        sliding = [j for j in mechanism.joints if j.kind in ("prismatic", "cylindrical")]
        travel = {joint.name: track.travel(joint) for joint in sliding}
        self.shapes = link_shapes(mechanism, travel, outward=self._free_sides())
        balls, radii = self._extent()
        self.low, self.high = (balls - radii[:, None]).min(0), (balls + radii[:, None]).max(0)
        if not planar_normals(mechanism):
            balls, radii = self._add_stands(balls, radii)
        back, up = cameras.directions(mechanism, look.camera)
        self._clear_walls()
        if look.projections:
            corners = np.array(np.meshgrid(*zip(self.low, self.high, strict=True))).reshape(3, -1).T
            balls, radii = np.vstack([balls, corners]), np.append(radii, np.zeros(len(corners)))
        self.camera = cameras.framed(back, up, balls, radii, look.size)
        self.cell = cameras.nice(self.camera.height / 9.0)
        self.walls = self._walls()
        self.model = self._spec().compile()
        self.data = mujoco.MjData(self.model)
        self._slots = {
            (name, copy): int(self.model.body(_body(name, copy)).mocapid[0])
            for name in track.poses
            if name != GROUND
            for copy in range(look.overlay)
        }

    def place(self, frame: int) -> None:
        """Put the links where they stand in a frame; overlaid positions where they always stand."""
        overlay = self.look.overlay
        # the last frame of a closed turn is the first again
        spread = len(self.track) - (1 if self.track.closed else 0)
        for (name, copy), slot in self._slots.items():
            at = frame if overlay == 1 else round(copy * spread / overlay) % len(self.track)
            pose = self.track.poses[name].at(at)
            self.data.mocap_pos[slot] = pose.position
            mujoco.mju_mat2Quat(self.data.mocap_quat[slot], pose.rotation.ravel())
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def thrown(self, path: Array, wall: Wall) -> Array:
        """Return a path thrown square on a wall, a hair's breadth in front of it."""
        height = (path - wall.point) @ wall.normal - 0.15 * self.radius
        return path - height[:, None] * wall.normal

    def _free_sides(self) -> dict[str, float]:
        """The side of every shaft that the links keep farther away from over the motion."""
        some = np.linspace(0, len(self.track) - 1, 24).astype(int)
        poses = {
            name: pose if pose.position.ndim == 1 else Pose(pose.position[some], pose.rotation[some])
            for name, pose in self.track.poses.items()
        }
        return free_sides(self.mechanism, poses)

    def _extent(self) -> tuple[Array, Array]:
        """Balls that hold all shapes over all frames: centres (k, 3) and radii (k,)."""
        step = max(1, len(self.track) // 180)
        centres, radii = [np.empty((0, 3))], [np.empty(0)]
        for link, shapes in self.shapes.items():
            pose = self.track.poses[link]
            poses = pose if pose.position.ndim == 1 else pose.at(slice(None, None, step))
            for points, radius in map(_bounds, shapes):
                for point in points:
                    placed = np.atleast_2d(poses.point(tuple(point)))
                    centres.append(placed)
                    radii.append(np.full(len(placed), radius))
        for path in self.track.paths.values():
            centres.append(path)
            radii.append(np.zeros(len(path)))
        return np.vstack(centres), np.concatenate(radii)

    def _add_stands(self, balls: Array, radii: Array) -> tuple[Array, Array]:
        """Carry every bearing by a post on the floor; return the balls with those of the posts."""
        floor = float(self.low[1]) - 2.0 * self.radius
        self.low[1] = floor
        stands: list[Shape] = []
        for shape in self.shapes[GROUND]:
            if shape.role == "bearing":
                x, y, z = shape.centre.tolist()
                foot = (x, floor + 0.8 * self.radius, z)
                stands.append(Shape("cylinder", (x, y, z), foot, (1.3 * self.radius,), HOUSING))
                stands.append(Shape("cylinder", foot, (x, floor, z), (3.2 * self.radius,), HOUSING))
        self.shapes[GROUND].extend(stands)
        for points, radius in map(_bounds, stands):
            balls, radii = np.vstack([balls, points]), np.append(radii, [radius] * len(points))
        return balls, radii

    def _clear_walls(self) -> None:
        """Keep walls clear of the mechanism, except where it stands on one."""
        clear = 2.0 * self.radius
        keep = self.low.copy()
        self.low = self.low - clear
        self.high = self.high + clear
        normals = planar_normals(self.mechanism)
        if normals:
            across = np.abs(normals[GROUND]) > 0.9
            self.low[across] = keep[across]
        else:
            self.low[1] = keep[1]

    def _walls(self) -> list[Wall]:
        """The backdrop, as large as the picture needs; with projections three planes of a corner."""
        back = self.camera.back
        if self.look.projections:
            middle, half = (self.low + self.high) / 2.0, (self.high - self.low) / 2.0
            walls = []
            for i, axis in enumerate(np.eye(3)):
                side = 1.0 if back[i] >= 0.0 else -1.0
                point = middle - side * half[i] * axis
                across = np.eye(3)[(i + 1) % 3]
                halves = float(half[(i + 1) % 3]), float(half[(i + 2) % 3])
                halves = halves if side > 0.0 else (halves[0], halves[1])
                walls.append(Wall(point, side * axis, halves, across))
            return walls
        normal = cameras.backdrop_axis(self.mechanism, back)
        centre = self.camera.position
        facing = float(normal @ back)
        lowest = np.where(normal < 0.0, self.high, self.low) @ np.abs(normal) * np.sign(normal.sum())
        point = centre - back * ((centre @ normal - lowest) / facing)
        # a whole number of cells off the origin, so that the grid can be read as a scale
        across = np.eye(3)[(int(np.argmax(np.abs(normal))) + 1) % 3]
        for edge in (across, np.cross(normal, across)):
            point = point + edge * (np.round(point @ edge / self.cell) * self.cell - point @ edge)
        reach = 0.75 * max(self.camera.height, self.camera.height * self.look.size[0] / self.look.size[1])
        cells = int(np.ceil(reach / facing / self.cell))
        return [Wall(point, normal, (cells * self.cell, cells * self.cell), across)]

    def _spec(self) -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        self._settings(spec)
        self._lights(spec)
        spec.add_material(name=MATTE, specular=0.25, shininess=0.4, rgba=(1.0, 1.0, 1.0, 1.0))
        if self.look.projections:
            self._paper(spec)
        for i, wall in enumerate(self.walls):
            self._grid(spec, wall, f"wall{i}")
        for shape in self.shapes[GROUND]:
            _geom(spec.worldbody, shape)
        for link in self.mechanism.links:
            for copy in range(self.look.overlay):
                body = spec.worldbody.add_body(name=_body(link.name, copy), mocap=True)
                for shape in self.shapes[link.name]:
                    _geom(body, shape)
        view = spec.worldbody.add_camera(name=CAMERA, pos=self.camera.position)
        view.quat = _quat(np.column_stack([self.camera.right, self.camera.up, self.camera.back]))
        view.proj = mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
        view.fovy = self.camera.height
        return spec

    def _settings(self, spec: mujoco.MjSpec) -> None:
        spec.visual.global_.offwidth, spec.visual.global_.offheight = self.look.size
        spec.visual.quality.shadowsize = 2048
        spec.visual.headlight.ambient = [0.42] * 3
        spec.visual.headlight.diffuse = [0.28] * 3
        spec.visual.headlight.specular = [0.05] * 3
        # the camera's distances are multiples of the extent
        spec.stat.extent = self.camera.height
        spec.stat.center = (self.low + self.high) / 2.0
        spec.visual.map.znear = 0.01
        spec.visual.map.zfar = 12.0
        # the box in which shadows fall is as deep as it is wide: a smaller one leaves specks on the floor
        spec.visual.map.shadowclip = 1.25 * float(np.hypot(1.0, self.look.size[0] / self.look.size[1]))

    def _lights(self, spec: mujoco.MjSpec) -> None:
        view = self.camera
        wall = self.walls[0].normal
        way = -(1.3 * wall + 0.55 * view.up - 0.5 * view.right + 0.35 * view.back)
        light = spec.worldbody.add_light(pos=(self.low + self.high) / 2.0 - 2.0 * view.height * _unit(way))
        light.dir = _unit(way)
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        light.diffuse, light.specular = [0.30] * 3, [0.20] * 3
        light.castshadow = self._stands_on_wall()

    def _stands_on_wall(self) -> bool:
        """Whether the backdrop carries the mechanism; on a wall far behind it a shadow only confuses."""
        normals = planar_normals(self.mechanism)
        if self.look.projections or self.look.overlay > 1:
            return False
        if normals:
            return abs(float(normals[GROUND] @ self.walls[0].normal)) > 0.9
        return self.look.camera == "iso"

    def _paper(self, spec: mujoco.MjSpec) -> None:
        """A plain sheet behind everything: MuJoCo's own background is black."""
        view = self.camera
        spec.add_material(name="paper", specular=0.0, shininess=0.0, emission=1.0, rgba=(*PAPER, 1.0))
        depth = 2.0 * view.height + 2.0 * float(np.linalg.norm(self.high - self.low))
        sheet = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, material="paper")
        sheet.pos = view.position - depth * view.back
        sheet.size = [4.0 * view.height, 4.0 * view.height, 1.0]
        sheet.quat = _quat(np.column_stack([view.right, view.up, view.back]))
        sheet.contype = sheet.conaffinity = 0

    def _grid(self, spec: mujoco.MjSpec, wall: Wall, name: str) -> None:
        texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
        texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture.mark = mujoco.mjtMark.mjMARK_EDGE
        texture.rgb1 = texture.rgb2 = PAPER
        texture.markrgb = GRID_LINE
        texture.width = texture.height = 64
        material = spec.add_material(name=name)
        textures = material.textures
        textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
        material.textures = textures
        material.texrepeat = [2.0 * half / self.cell for half in wall.half]
        material.specular, material.shininess = 0.0, 0.0
        # what a slanting plane misses of the camera's light, so that paper looks white from everywhere
        missed = 1.0 - float(wall.normal @ self.camera.back)
        material.emission = (0.5 if self.look.projections else 0.25) * missed
        plane = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, pos=wall.point, material=name)
        plane.size = [*wall.half, 1.0]
        plane.quat = _quat(np.column_stack([wall.across, np.cross(wall.normal, wall.across), wall.normal]))
        plane.contype = plane.conaffinity = 0


def _geom(body: mujoco.MjsBody, shape: Shape) -> None:
    sizes = [*shape.half_sizes, 0.0, 0.0][:3]
    geom = body.add_geom(
        type=GEOMS[shape.kind], pos=shape.centre, size=sizes, rgba=shape.rgba, material=MATTE
    )
    geom.quat = _quat(shape.frame)
    geom.contype = geom.conaffinity = 0
    geom.mass = 0.0


def _bounds(shape: Shape) -> tuple[Array, float]:
    return shape.bounds


def _body(link: str, copy: int) -> str:
    return f"{link}#{copy}"


def _quat(matrix: Array) -> Array:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(matrix).ravel())
    return quat


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
