"""A mechanism as a MuJoCo model of shapes only, for any pose and with a camera.

Every link is a mocap body that carries geoms and nothing else, so drawing never touches the physics
of a run and the closed form is drawn likewise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mechsim.mechanism.links import GROUND, ORIGIN, VIRTUAL_PREFIX, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import hinged_normals
from mechsim.mechanism.moved_links import with_rods
from mechsim.pictures.render import scenery
from mechsim.pictures.render.frame_poses import FramePoses, Ghost
from mechsim.pictures.render.gltf import triangles
from mechsim.pictures.render.labels import foot
from mechsim.pictures.render.look import Look
from mechsim.pictures.render.scenery import CAMERA, GREY, arrows
from mechsim.shapes import camera as cameras
from mechsim.shapes.body import extent, followed, free_sides, link_colours, rod_radius, travels
from mechsim.shapes.camera import add_stands, backdrop, lowered
from mechsim.shapes.joints import link_shapes
from mechsim.shapes.shape import Kind, Rgba, Shape, TriangleMesh, vector
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.simulation.mjcf_reader.kinematic_tree import carriers, shifted
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel

SOLIDS: Mapping[int, Kind] = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
}
BALL, MESH = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID), int(mujoco.mjtGeom.mjGEOM_MESH)
# MuJoCo shows these groups of geoms by default; collision shapes lie in the others
SHOWN = 2
# meshes with more triangles are simplified
MAX_TRIANGLES = 60_000
# first step of the grid that merges vertices, relative to the extent of all bodies
FIRST_GRID_STEP = 1.0 / 400.0
# lighter colours are drawn as light as this: lit from the front they would look like the background
LIGHTEST, LIGHTNESS = 0.78, np.array([0.2126, 0.7152, 0.0722])


def drawn_as(solver: Any) -> dict[str, Any]:
    """Return the fields of `Drawn` of a model: its springs, and for MJCF its bodies, closures and camera."""
    read = solver.source
    bodies = file_bodies(read) if isinstance(read, MjcfModel) else None
    if bodies is None or not isinstance(read, MjcfModel):
        return {"forces": solver.forces}
    tree, view = {joint.name for joint in read.spec.joints}, read.spec.visual.global_
    closures = tuple(joint.name for joint in read.mechanism.joints if joint.name not in tree)
    angles = float(view.azimuth), float(view.elevation)
    return {"forces": solver.forces, "bodies": bodies, "closures": closures, "angles": angles}


def without_geoms(solver: Any, bodies: Mapping[str, Sequence[Shape]] | None) -> list[str]:
    """Return a sentence on the links of a file that pictures draw from their joints, or not at all."""
    if solver.source is None:
        return []
    if bodies is None:
        return [f"{solver.name}: no moving link has a geom in the file: links are drawn from their joints"]
    links = (link.name for link in solver.source.mechanism.links)
    names = ", ".join(name for name in links if not (bodies.get(name) or name.startswith(VIRTUAL_PREFIX)))
    return [f"{solver.name}: the file has no visible geom on {names}: not drawn"] if names else []


@quiet()
def file_bodies(read: MjcfModel) -> dict[str, list[Shape]] | None:
    """Return the bodies of a file's links, "ground" included; None if it draws nothing on them.

    Planes and height fields are left out. Materials give their colour, textures the mean of theirs.
    """
    model = plainly_compiled(read.spec.copy())
    carried = carriers(model)
    visible = [i for i in range(model.ngeom) if _colour(model, i)[3] > 0.0]
    shown = [i for i in visible if model.geom_group[i] <= SHOWN] or visible
    bodies: dict[str, list[Shape]] = {}
    for i in shown:
        carrier = carried[model.geom_bodyid[i]]
        shape = _shape(model, i, shifted(carrier.pose, model.geom_pos[i], model.geom_quat[i]))
        if shape is not None:
            bodies.setdefault(carrier.link, []).append(shape)
    moving = bodies.keys() & {link.name for link in read.mechanism.links}
    if all(shape.rgba == GREY for link in moving for shape in bodies[link]):
        # a file without colours: links differ as those without a file do
        for link, colour in link_colours(read.mechanism).items():
            bodies[link] = [replace(shape, rgba=colour) for shape in bodies.get(link, ())]
    return _few(bodies) if moving else None


def _shape(model: mujoco.MjModel, i: int, pose: Pose) -> Shape | None:
    kind, half_sizes, colour = int(model.geom_type[i]), model.geom_size[i], _colour(model, i)
    middle, along = pose.position, pose.rotation[:, 2]
    if kind in SOLIDS:
        half = {"sphere": 0.0, "box": half_sizes[2]}.get(SOLIDS[kind], half_sizes[1]) * along
        sizes = (float(half_sizes[0]), float(half_sizes[1]))[: 2 if SOLIDS[kind] == "box" else 1]
        ends = vector(middle, -half), vector(middle, half)
        return Shape(SOLIDS[kind], *ends, sizes, colour, vector(pose.rotation[:, 1]))
    if kind not in (MESH, BALL):
        return None
    facets = _mesh(model, i)
    placed = TriangleMesh(middle + facets.vertices @ pose.rotation.T, facets.faces)
    return Shape("facets", vector(middle), vector(middle), (0.0,), colour, facets=placed)


def _mesh(model: mujoco.MjModel, i: int) -> TriangleMesh:
    """Return the triangles of a geom that is a mesh or an ellipsoid."""
    if int(model.geom_type[i]) == BALL:
        ball, _, faces = triangles(Shape("sphere", ORIGIN, ORIGIN, (1.0,), GREY))
        half_axes = model.geom_size[i]
        # the points of a pole and of the first meridian are merged
        return TriangleMesh(ball * half_axes, faces.astype(np.int32)).coarser(1e-6 * float(half_axes.min()))
    mesh = int(model.geom_dataid[i])
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return TriangleMesh(
        np.array(model.mesh_vert[first : first + count], dtype=np.float64),
        np.array(model.mesh_face[face : face + faces]),
    )


def _colour(model: mujoco.MjModel, i: int) -> Rgba:
    material = int(model.geom_matid[i])
    rgba = np.array(model.geom_rgba[i] if material < 0 else model.mat_rgba[material], dtype=np.float64)
    if material >= 0:
        texture = int(model.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
        if texture >= 0:
            first, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
            count = int(model.tex_width[texture]) * int(model.tex_height[texture]) * channels
            texels = model.tex_data[first : first + count].reshape(-1, channels)
            rgba[:3] *= np.broadcast_to(texels.mean(0)[: min(3, channels)], 3) / 255.0
    rgba = np.clip(rgba, 0.0, 1.0)
    rgba[:3] *= min(1.0, LIGHTEST / max(float(LIGHTNESS @ rgba[:3]), LIGHTEST))
    red, green, blue, alpha = rgba.tolist()
    return (red, green, blue, alpha)


def _few(bodies: Mapping[str, Sequence[Shape]]) -> dict[str, list[Shape]]:
    """Return bodies with no more triangles than a page can hold, without small features."""
    every = [shape for shapes in bodies.values() for shape in shapes]
    grid_step = FIRST_GRID_STEP * max(
        (float(np.linalg.norm(np.ptp(shape.bounds[0], axis=0))) for shape in every), default=0.0
    )
    coarse = {id(shape): shape.facets for shape in every if shape.facets}
    while sum(len(facets.faces) for facets in coarse.values()) > MAX_TRIANGLES:
        coarse = {key: facets.coarser(grid_step) for key, facets in coarse.items()}
        grid_step *= 1.5
    made = {
        link: [replace(shape, facets=coarse.get(id(shape))) for shape in shapes]
        for link, shapes in bodies.items()
    }
    # MuJoCo rejects meshes without any volume
    return {
        link: [s for s in shapes if not s.facets or (len(s.facets.vertices) >= 4 and len(s.facets.faces))]
        for link, shapes in made.items()
    }


GHOST: Rgba = (0.10, 0.11, 0.14, 0.5)
# parallel projection does not show depth: a ghost lies this many rod radii behind the solid links, so that
# only its differences are visible; see also `overlays.BEFORE`
BEHIND = 1.5
# share of its own colour that the first of overlaid positions keeps
LIGHTEST_POSITION = 0.1


class DrawnModel:
    """The drawn model, its data, the camera and the grid.

    Attributes:
        camera: the camera, framed over the whole motion.
        model: shapes only; a mocap body per link and overlaid position, and per link of the ghost.
        data: its state.
        links: names of the moving links, and of the rods of distance joints.
        grid_step: edge of a grid cell in [m].
        wall: the plane with a grid.
        up: unit vector that points up, (3,).
        normals: normals of links that all move in one plane; None for others.
        arrows: arrows of each requested kind.
    """

    def __init__(self, mechanism: Mechanism, frames: FramePoses, look: Look, ghost: Ghost | None = None):
        self.mechanism, self.frames, self.look, self.ghost = mechanism, frames, look, ghost
        self.links = [link.name for link in with_rods(mechanism, {})[0].links]
        self.radius = rod_radius(mechanism)
        self.shapes = self._shapes()
        # balls that enclose all shapes over all frames
        step = slice(None, None, max(1, len(frames) // 180))
        poses = [*frames.poses.items(), *(ghost.poses.items() if ghost else ())]
        balls, radii = extent((pose.select(step), self.shapes[link]) for link, pose in poses)
        balls = np.vstack([balls, *frames.paths.values()])
        radii = np.append(radii, np.zeros(len(balls) - len(radii)))
        self.low, self.high = (balls - radii[:, None]).min(0), (balls + radii[:, None]).max(0)
        self.drift = np.zeros((len(frames), 3))
        if (look.bodies or not self.shapes[GROUND]) and look.overlay == 1:
            self.drift, own = followed(frames.poses, self.shapes)
            balls, radii = own if self.drift.any() else (balls, radii)
        self.up = cameras.upright(mechanism, look.up)
        self.normals = hinged_normals(mechanism)
        if not (self.normals or look.bodies):
            self.low, self.high, floor = lowered(self.low, self.high, self.up, 2.0 * self.radius)
            balls, radii = add_stands(self.shapes[GROUND], self.up, floor, self.radius, (balls, radii))
        reach = float(np.ptp(balls, axis=0).max() if self.drift.any() else (self.high - self.low).max())
        self.arrows = [arrows(kind, self.frames.vectors.get(kind, {}), reach) for kind in self.look.arrows]
        for arrow_set in self.arrows:
            tips = arrow_set.tips({name: start - self.drift for name, start in frames.starts.items()})
            balls, radii = np.vstack([balls, tips]), np.append(radii, np.zeros(len(tips)))
        back, up = cameras.directions(mechanism, look.camera, look.up, look.angles)
        # walls are clear of the mechanism, except a wall that supports it
        supports = np.abs(self.normals[GROUND]) > 0.9 if self.normals else self.up > 0.5
        hangs = (self.up < -0.5) & (self.normals is None)
        self.low = self.low - np.where(supports, 0.0, 2.0 * self.radius)
        self.high = self.high + np.where(hangs, 0.0, 2.0 * self.radius)
        lines = bool(look.caption) + (ghost is not None) + len(self.arrows)
        free = foot(look.size, lines) if look.notes else 0.0
        self.camera = cameras.framed(back, up, balls, radii, look.size, foot=free)
        self._start = self.camera.position
        self.grid_step = cameras.nice(self.camera.height / 9.0)
        path = float(np.ptp(self.drift, axis=0).max())
        self.wall = backdrop(mechanism, self.camera, self.up, self.low, self.high, self.grid_step, path)
        self.depth = self._depth_of_positions()
        behind = (look.overlay - 1) * self.depth * self.camera.back
        self.wall = replace(self.wall, point=self.wall.point - behind)
        self.model = plainly_compiled(self._spec())
        scenery.set_height(self.model, self.camera)
        self.data = mujoco.MjData(self.model)

    def show(self, frames: FramePoses, ghost: Ghost | None) -> None:
        """Use other frames of the same motion; camera and scales stay."""
        self.frames, self.ghost, self.drift = frames, ghost, np.zeros((len(frames), 3))
        self.arrows = [
            replace(arrow_set, vectors=self.frames.vectors[arrow_set.kind]) for arrow_set in self.arrows
        ]

    def frames_shown(self, frame: int) -> list[int]:
        """Return the frames that a picture shows together, in order; the last has its full colours."""
        overlay = self.look.overlay
        if overlay == 1:
            return [frame]
        # the last frame of a closed revolution equals the first
        spread = len(self.frames) - (1 if self.frames.closed else 0)
        return [round(copy * spread / overlay) % len(self.frames) for copy in range(overlay)]

    def set_frame(self, frame: int) -> None:
        """Set the links to the poses of a frame; overlaid positions do not move."""
        shown = self.frames_shown(frame)
        self.camera = replace(self.camera, position=self._start + self.drift[shown[-1]])
        # poses of the bodies of `_spec`, and how far behind the last position they are drawn
        posed = [
            (self.frames.poses[link].select(shown[copy]), (len(shown) - 1 - copy) * self.depth)
            for link in self.links
            for copy in range(len(shown))
        ]
        if self.ghost:
            posed += [(pose.select(frame), BEHIND * self.radius) for pose in self.ghost.poses.values()]
        for body, (pose, behind) in enumerate(posed):
            self.data.mocap_pos[body] = pose.position - behind * self.camera.back
            mujoco.mju_mat2Quat(self.data.mocap_quat[body], pose.rotation.ravel())
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self.data.cam_xpos[self.model.camera(CAMERA).id] = self.camera.position

    def _depth_of_positions(self) -> float:
        """The distance of an overlaid position behind the next one in [m], so that the last is in front.

        It is not visible along the view; where the view is slanted, positions stay where they are.
        """
        if self.look.overlay == 1 or float(self.wall.normal @ self.camera.back) < 1.0 - 1e-9:
            return 0.0
        levels = [
            float(point @ self.camera.back)
            for link in self.links
            for shape in self.shapes[link]
            for point in shape.bounds[0]
        ]
        return min(float(np.ptp(levels)) + 2.0 * self.radius, 4.0 * self.camera.height / self.look.overlay)

    def _shapes(self) -> dict[str, list[Shape]]:
        """The bodies of links that the look gives, else those drawn from the joints."""
        links = [GROUND, *self.links]
        if self.look.bodies:
            return {link: list(self.look.bodies.get(link, ())) for link in links}
        travel = travels(self.mechanism, self.frames.poses)
        samples = np.linspace(0, len(self.frames) - 1, 24).astype(int)
        poses = {name: pose.select(samples) for name, pose in self.frames.poses.items()}
        return link_shapes(self.mechanism, travel, free_sides(self.mechanism, poses), self.look.forces)

    def _spec(self) -> mujoco.MjSpec:
        """Return the model, with a mocap body for each link in each position, then for each of the ghost."""
        spec, look, middle = mujoco.MjSpec(), self.look, (self.low + self.high) / 2.0
        shadow = self.stands_on_wall
        scenery.add_surroundings(spec, self.camera, self.wall, middle, self.grid_step, shadow=shadow)
        # the floor lies below all of a fall
        spec.visual.map.zfar += 4.0 * float(np.abs(self.drift).max()) / self.camera.height
        for shape in self.shapes[GROUND]:
            scenery.add_shape(spec, spec.worldbody, shape)
        for link in self.links:
            for copy in range(look.overlay):
                body = spec.worldbody.add_body(mocap=True)
                for shape in self.shapes[link]:
                    colour = faded(shape.rgba, (copy + 1) / look.overlay)
                    scenery.add_shape(spec, body, replace(shape, rgba=colour))
        for name in self.ghost.poses if self.ghost else ():
            body = spec.worldbody.add_body(mocap=True)
            for shape in self.shapes[name]:
                scenery.add_shape(spec, body, replace(shape, rgba=GHOST))
        return spec

    @property
    def stands_on_wall(self) -> bool:
        """Whether the backdrop supports the mechanism; on a distant wall a shadow only confuses."""
        # a ghost would cast a second shadow
        if self.look.overlay > 1 or self.ghost or self.drift.any():
            return False
        if self.normals:
            return abs(float(self.normals[GROUND] @ self.wall.normal)) > 0.9
        return self.look.camera == "iso" and abs(float(self.up @ self.wall.normal)) > 0.9


def faded(rgba: Rgba, share: float) -> Rgba:
    """Return a colour mixed with that of the paper: lightest at share 0, itself at 1."""
    kept = LIGHTEST_POSITION + (1.0 - LIGHTEST_POSITION) * share
    r, g, b = (kept * own + (1.0 - kept) * paper for own, paper in zip(rgba, scenery.PAPER, strict=False))
    return (r, g, b, rgba[3])
