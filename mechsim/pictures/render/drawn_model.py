"""A mechanism as a MuJoCo model of shapes alone, put into any pose and framed by a camera.

Every link is a mocap body that carries geoms and nothing else, so drawing never touches the physics
of a run and the closed form is drawn likewise.
"""

from dataclasses import replace

import mujoco
import numpy as np

from mechsim.model.link_poses import hinged_normals
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.pictures.render import scenery
from mechsim.pictures.render.arrows import Arrows, arrows
from mechsim.pictures.render.frame_poses import FramePoses, far_paths
from mechsim.pictures.render.ghost import Ghost
from mechsim.pictures.render.labels import foot
from mechsim.pictures.render.look import Look
from mechsim.shapes import Rgba, Shape, free_sides, link_shapes, rod_radius
from mechsim.shapes import camera as cameras
from mechsim.shapes.body import extent, travels
from mechsim.shapes.camera import Wall, backdrop, corner, lowered, stands
from mechsim.simulation.mjcf.compiling import plainly_compiled

CAMERA = "view"
GHOST: Rgba = (0.10, 0.11, 0.14, 0.5)
# parallel projection shows a thing at the same pixel however deep it lies: a ghost stands this many rod
# radii behind the solid links, so that it shows only where it differs; see also `overlays.BEFORE`
BEHIND = 1.5


class DrawnModel:
    """What is drawn: the model, its data, the camera, the grid.

    Attributes:
        camera: the camera, framed over the whole motion.
        model: shapes only; a mocap body per link and overlaid position, and per link of the ghost.
        data: its state.
        grid_step: edge of a grid cell in [m].
        walls: planes with a grid.
        forward: whether the crank turns in the positive direction.
        up: unit vector that points up, (3,).
        normals: of links that all move in one plane; None where they do not.
        arrows: arrows of each requested kind.
        distant: the paths that go far beyond the links, which are cut.
    """

    def __init__(self, mechanism: Mechanism, frames: FramePoses, look: Look, ghost: Ghost | None = None):
        self.mechanism, self.frames, self.look, self.ghost = mechanism, frames, look, ghost
        self.radius = rod_radius(mechanism)
        self.forward = bool(frames.angle[-1] >= frames.angle[0])
        self.shapes = self._shapes()
        balls, radii = self._extent()
        self.distant = far_paths(frames, balls, radii)
        self.frames = frames = self.distant.cut(frames)
        paths = [path for name, path in frames.paths.items() if name not in self.distant.names]
        balls = np.vstack([balls, *paths])
        radii = np.append(radii, np.zeros(len(balls) - len(radii)))
        self.low, self.high = (balls - radii[:, None]).min(0), (balls + radii[:, None]).max(0)
        self.up = cameras.upright(mechanism, look.up)
        self.normals = hinged_normals(mechanism)
        if not (self.normals or look.bodies):
            balls, radii = self._add_stands(balls, radii)
        self.arrows = self._arrows()
        for arrow_set in self.arrows:
            tips = arrow_set.tips(frames.starts)
            balls, radii = np.vstack([balls, tips]), np.append(radii, np.zeros(len(tips)))
        back, up = cameras.directions(mechanism, look.camera, look.up)
        self._clear_walls()
        if look.projections:
            corners = np.array(np.meshgrid(*zip(self.low, self.high, strict=True))).reshape(3, -1).T
            balls, radii = np.vstack([balls, corners]), np.append(radii, np.zeros(len(corners)))
        lines = bool(look.caption) + bool(self.distant.label) + (ghost is not None) + len(self.arrows)
        free = foot(look.size, lines) if look.notes else 0.0
        self.camera = cameras.framed(back, up, balls, radii, look.size, foot=free)
        self.grid_step = cameras.nice(self.camera.height / 9.0)
        self.walls = self._walls()
        self.model = plainly_compiled(self._spec())
        scenery.set_height(self.model, CAMERA, self.camera)
        self.data = mujoco.MjData(self.model)
        self._slots = {
            (link.name, copy): self._slot(_body(link.name, copy))
            for link in mechanism.links
            for copy in range(look.overlay)
        }
        self._ghost_slots = {name: self._slot(_ghost(name)) for name in (ghost.poses if ghost else ())}

    def show(self, frames: FramePoses, ghost: Ghost | None) -> None:
        """Take other frames of the same motion; camera and scales stay."""
        self.frames, self.ghost = self.distant.cut(frames), ghost
        self.arrows = [
            replace(arrow_set, vectors=self.frames.vectors[arrow_set.kind]) for arrow_set in self.arrows
        ]

    def set_frame(self, frame: int) -> None:
        """Put the links where they stand in a frame; overlaid positions where they always stand."""
        overlay = self.look.overlay
        # the last frame of a closed turn is the first again
        spread = len(self.frames) - (1 if self.frames.closed else 0)
        for (name, copy), slot in self._slots.items():
            index = frame if overlay == 1 else round(copy * spread / overlay) % len(self.frames)
            self._put(slot, self.frames.poses[name].select(index))
        for name, slot in self._ghost_slots.items():
            assert self.ghost is not None
            pose, deeper = self.ghost.poses[name].select(frame), BEHIND * self.radius * self.camera.back
            self._put(slot, Pose(pose.position - deeper, pose.rotation))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def missing_light(self, wall: Wall) -> float:
        """Return the light of its own that keeps a wall slanting from the camera as white as any."""
        if self.look.projections:
            lit, _ = scenery.brightness(self.camera, wall.normal, 0.0, self._facing.normal)
            return 0.97 - lit
        return 0.25 * (1.0 - float(wall.normal @ self.camera.back))

    def thrown(self, path: Array, wall: Wall) -> Array:
        """Return a path projected square on a wall, lifted off it by less than can be seen."""
        height = (path - wall.point) @ wall.normal - 0.15 * self.radius
        return path - height[:, None] * wall.normal

    def _shapes(self) -> dict[str, list[Shape]]:
        """The bodies of links that the look gives, else those drawn from the joints."""
        links = [GROUND, *(link.name for link in self.mechanism.links)]
        if self.look.bodies:
            return {link: list(self.look.bodies.get(link, ())) for link in links}
        return link_shapes(self.mechanism, travels(self.mechanism, self.frames.poses), self._free_sides())

    def _slot(self, body: str) -> int:
        return int(self.model.body(body).mocapid[0])

    def _put(self, slot: int, pose: Pose) -> None:
        self.data.mocap_pos[slot] = pose.position
        mujoco.mju_mat2Quat(self.data.mocap_quat[slot], pose.rotation.ravel())

    def _free_sides(self) -> dict[str, float]:
        """The side of every shaft that the links keep farther away from over the motion."""
        samples = np.linspace(0, len(self.frames) - 1, 24).astype(int)
        poses = {
            name: pose if pose.position.ndim == 1 else Pose(pose.position[samples], pose.rotation[samples])
            for name, pose in self.frames.poses.items()
        }
        return free_sides(self.mechanism, poses)

    def _arrows(self) -> list[Arrows]:
        extent = float((self.high - self.low).max())
        return [arrows(kind, self.frames.vectors.get(kind, {}), extent) for kind in self.look.arrows]

    def _extent(self) -> tuple[Array, Array]:
        """Balls that hold all shapes over all frames: centres (k, 3) and radii (k,)."""
        step = slice(None, None, max(1, len(self.frames) // 180))
        poses = [*self.frames.poses.items(), *(self.ghost.poses.items() if self.ghost else ())]
        return extent(
            (pose if pose.position.ndim == 1 else pose.select(step), self.shapes[link])
            for link, pose in poses
        )

    def _add_stands(self, balls: Array, radii: Array) -> tuple[Array, Array]:
        """Carry every bearing by a post on the floor; return the balls with those of the posts."""
        self.low, self.high, floor = lowered(self.low, self.high, self.up, 2.0 * self.radius)
        posts = stands(self.shapes[GROUND], self.up, floor, self.radius)
        self.shapes[GROUND].extend(posts)
        feet, widths = extent([(self.frames.poses[GROUND], posts)])
        return np.vstack([balls, feet]), np.append(radii, widths)

    def _clear_walls(self) -> None:
        """Keep walls clear of the mechanism, except where it stands on one."""
        clear = 2.0 * self.radius
        keep, top = self.low.copy(), self.high.copy()
        self.low = self.low - clear
        self.high = self.high + clear
        if self.normals:
            across = np.abs(self.normals[GROUND]) > 0.9
            self.low[across] = keep[across]
        else:
            self.low = np.where(self.up > 0.5, keep, self.low)
            self.high = np.where(self.up < -0.5, top, self.high)

    def _walls(self) -> list[Wall]:
        if self.look.projections:
            return corner(self.camera, self.low, self.high)
        return [backdrop(self.mechanism, self.camera, self.up, self.low, self.high, self.grid_step)]

    def _spec(self) -> mujoco.MjSpec:
        spec, look, middle = mujoco.MjSpec(), self.look, (self.low + self.high) / 2.0
        scenery.prepare(spec, self.camera, middle)
        scenery.add_light(spec, self.camera, middle, self._facing.normal, shadow=False)
        if look.projections:
            depth = 2.0 * self.camera.height + 2.0 * float(np.linalg.norm(self.high - self.low))
            scenery.add_sheet(spec, self.camera, depth)
        for i, wall in enumerate(self.walls):
            scenery.add_grid(spec, f"wall{i}", wall, self.grid_step, self.missing_light(wall))
        for shape in self.shapes[GROUND]:
            scenery.add_shape(spec, spec.worldbody, shape)
        for link in self.mechanism.links:
            for copy in range(look.overlay):
                body = spec.worldbody.add_body(name=_body(link.name, copy), mocap=True)
                for shape in self.shapes[link.name]:
                    scenery.add_shape(spec, body, shape)
        for name in self.ghost.poses if self.ghost else ():
            body = spec.worldbody.add_body(name=_ghost(name), mocap=True)
            for shape in self.shapes[name]:
                scenery.add_shape(spec, body, replace(shape, rgba=GHOST))
        scenery.add_camera(spec, CAMERA, self.camera)
        return spec

    @property
    def _facing(self) -> Wall:
        """The wall that the camera looks at most squarely; the lamp is set for it."""
        return max(self.walls, key=lambda wall: float(wall.normal @ self.camera.back))

    @property
    def stands_on_wall(self) -> bool:
        """Whether the backdrop carries the mechanism; on a wall far behind it a shadow only confuses."""
        if self.look.projections or self.look.overlay > 1:
            return False
        if self.normals:
            return abs(float(self.normals[GROUND] @ self.walls[0].normal)) > 0.9
        return self.look.camera == "iso"


def _body(link: str, copy: int) -> str:
    return f"{link}#{copy}"


def _ghost(link: str) -> str:
    return f"{link}#ghost"
