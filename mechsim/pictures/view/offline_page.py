"""The page: records as JSON, three.js, and a script for display."""

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache, partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim._version import __version__
from mechsim.errors import needs
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import hinged_normals
from mechsim.mechanism.moved_links import with_rods
from mechsim.numerics.arrays import Array
from mechsim.pictures.view.followers import Corners, followers
from mechsim.pictures.view.pose_grid import PoseGrid, Readout, View, quaternions
from mechsim.shapes import body
from mechsim.shapes import camera as cameras
from mechsim.shapes.joints import link_shapes
from mechsim.shapes.shape import Shape
from mechsim.shapes.springs import SpringEnds, spring_ends

TEMPLATES = Path(__file__).parent / "templates"
# number of poses from which the extent of a mechanism is determined
MAX_POSES = 360


def page(view: View, library: str = "") -> str:
    """Return the page as HTML text, self-contained.

    Args:
        view: contents of the page.
        library: file in the same folder with three.js; empty embeds it in the page.

    Raises:
        MissingToolError: where jinja2 is not installed.
    """
    return _template().render(
        title=view.title,
        version=__version__,
        facts=view.facts,
        # no text of a mechanism, in a string or a comment of a script, may end its enclosing element
        data=json.dumps(_data(view), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        three="" if library else three_js(),
        library=library,
        live=view.live.code.replace("</", "<\\/").replace("<!", "<\\!") if view.live else "",
    )


@cache
def _template() -> Any:
    """Return the template of a page, which is read once."""
    with needs("pictures"):
        import jinja2

    loader = jinja2.FileSystemLoader(TEMPLATES)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.get_template("view.html")


def three_js() -> str:
    """Return the text of three.js with what the page uses of it."""
    return (Path(__file__).parent / "three" / "three.min.js").read_text(encoding="utf-8")


def _data(view: View) -> dict[str, Any]:
    mechanism = view.mechanism
    drawn = with_rods(mechanism, {})[0]
    poses = _some_poses(drawn, view.grids)
    radius, planar = body.rod_radius(mechanism), hinged_normals(mechanism) is not None
    travel, sides = body.travels(mechanism, poses), body.free_sides(mechanism, poses)

    def shapes_of(design: Mechanism) -> dict[str, list[Shape]]:
        if view.bodies:
            return {link: list(view.bodies.get(link, ())) for link in poses}
        return link_shapes(design, travel, sides, view.forces, radius)

    shapes = shapes_of(mechanism)
    balls, radii = body.extent((poses[link], shapes[link]) for link in shapes)
    up = cameras.upright(mechanism, view.up)
    normal = cameras.directions(mechanism, "iso", view.up, view.angles)[0] if planar else up
    floor = float((balls @ normal - radii).min())
    stands = not (planar or view.bodies)
    if stands:
        floor -= 2.0 * radius
    stand = partial(cameras.add_stands, up=up, floor=floor, radius=radius, balls=(balls, radii))
    if stands:
        balls, radii = stand(shapes[GROUND])

    def corners(design: Mechanism) -> Iterator[Corners]:
        own = shapes_of(design)
        if stands:
            stand(own[GROUND])
        return _corners(own, spring_ends(design, view.forces))

    path = np.zeros((1, 3))
    if view.bodies or not shapes[GROUND]:
        path, (balls, radii) = body.followed(poses, shapes)
    colours, bodies = body.point_colours(mechanism), _bodies(shapes)
    springs = _springs(spring_ends(mechanism, view.forces))
    if view.live and view.live.data["dimensions"]:
        moved = chain(*bodies.values(), *(spring["ends"] for spring in springs))
        for each, follower in zip(moved, followers(view.live, corners, radius), strict=True):
            each["follow"] = follower
    return {
        "name": mechanism.name,
        "radius": radius,
        "bodies": bodies,
        "joints": _joints(mechanism),
        "points": [
            {"name": name, "link": link, "at": local, "colour": colours[name][:3]}
            for name, (link, local) in mechanism.points.items()
        ],
        "closures": [
            {"joint": name, "link": mechanism.joint(name).a.link, "at": mechanism.joint(name).a.point}
            for name in view.closures
        ],
        "springs": springs,
        "anchors": {link.name: drawn.ends(link.name)[0].point for link in drawn.links},
        "vertical": _short(up),
        "cameras": _cameras(view, balls, radii),
        "path": float(np.ptp(path, axis=0).max()),
        "middle": _short(np.mean([poses[link.name].position[0] for link in drawn.links], axis=0)),
        "floor": {"normal": _short(normal), "at": floor},
        "own_bodies": bool(view.bodies),
        **_at_rest(view.grids),
        "grids": [_grid(grid) for grid in view.grids],
        "live": view.live.data if view.live else None,
    }


def _corners(shapes: Mapping[str, Sequence[Shape]], springs: Iterable[SpringEnds]) -> Iterator[Corners]:
    for link, shape in ((link, shape) for link, own in shapes.items() for shape in own):
        yield link, (shape.frm, shape.to) if shape.facets is None else shape.facets.vertices, shape.sizes
    for a, b, _ in springs:
        yield from ((link, point, ()) for link, point in (a, b))


def _springs(ends: Iterable[SpringEnds]) -> list[dict[str, Any]]:
    return [
        {"ends": [{"link": link, "at": point} for link, point in (a, b)], "damper": damper}
        for a, b, damper in ends
    ]


def _some_poses(mechanism: Mechanism, grids: Sequence[PoseGrid]) -> dict[str, Pose]:
    """Return poses of every link over all grids, enough to determine the extent."""
    from scipy.spatial.transform import Rotation

    poses = {GROUND: IDENTITY}
    for link in mechanism.links:
        positions = np.concatenate([grid.position[link.name] for grid in grids])
        turns = np.concatenate([grid.quaternion[link.name] for grid in grids])
        step = max(1, len(positions) // MAX_POSES)
        positions, turns = positions[::step], turns[::step]
        poses[link.name] = Pose(positions, Rotation.from_quat(turns, scalar_first=True).as_matrix())
    return poses


def _bodies(shapes: Mapping[str, Sequence[Shape]]) -> dict[str, Any]:
    """Return link -> its solids."""
    # the orientations of all at once
    frames = [shape.frame for own in shapes.values() for shape in own]
    turns = iter(quaternions(np.reshape(frames, (-1, 3, 3))))
    return {
        link: [_solid(shape, axes) for shape, axes in zip(own, turns, strict=False)]
        for link, own in shapes.items()
    }


def _solid(shape: Shape, axes: Array) -> dict[str, Any]:
    """Return a solid, from its shape and the quaternion of its axes."""
    solid = {"kind": shape.kind}
    if shape.facets is not None:
        solid |= {"at": [0.0, 0.0, 0.0], "turn": [1.0, 0.0, 0.0, 0.0], "half": []}
        solid |= {"vertices": _packed(shape.facets.vertices), "faces": _packed(shape.facets.faces, "<u4")}
    else:
        solid |= {"at": _short(shape.centre), "turn": _short(axes)}
        solid |= {"half": _short(shape.half_sizes)}
    return solid | {"rgba": _short(shape.rgba, 3)}


def _joints(mechanism: Mechanism) -> list[dict[str, Any]]:
    labels = {name: label for name, (label, _) in body.fixed_pivots(mechanism).items()}
    return [
        {
            "name": joint.name,
            "label": labels.get(joint.name, ""),
            "link": joint.a.link,
            "at": joint.a.point,
            "axis": joint.a.axis if KINDS[joint.kind].units else None,
            "pivot": GROUND in joint.links,
            "driven": joint in mechanism.driven_joints,
        }
        for joint in mechanism.joints
    ]


def _cameras(view: View, balls: Array, radii: Array) -> list[dict[str, Any]]:
    """Return the view directions; the first is the default."""
    presets: list[dict[str, Any]] = []
    flat = hinged_normals(view.mechanism) is not None
    usual = {"iso": "straight on" if flat else "corner", "top": "top", "side": "side"}
    if not flat:
        usual["shaft"] = "along shaft"
    for preset, name in usual.items():
        back, up = cameras.directions(view.mechanism, preset, view.up, view.angles)
        framed = cameras.framed(back, up, balls, radii, (1, 1), border=0.0)
        across, over, depth = (
            cameras.span(balls @ axis, radii)[1] for axis in (np.cross(up, back), up, back)
        )
        centre = framed.position - back * (framed.height + depth / 2.0)
        axes = {"back": _short(back), "up": _short(up), "centre": _short(centre)}
        presets.append({"name": name, **axes, "width": across, "height": over, "depth": depth})
    return presets


def _at_rest(grids: Sequence[PoseGrid]) -> dict[str, Any]:
    """Return all links, and poses and read-outs of what is at rest in a grid: the same in all these grids."""
    poses = {link: (np.zeros((1, 3)), np.zeros((1, 4))) for grid in grids for link in grid.position}
    readouts: dict[str, dict[str, Any]] = {}
    for grid in grids:
        for link, position in grid.position.items():
            if len(position) == 1:
                poses[link] = position, grid.quaternion[link]
        for readout in grid.readouts if any(not _moves(readout) for readout in grid.readouts) else ():
            readouts.setdefault(readout.name, {})
            if not _moves(readout):
                readouts[readout.name] = _readout(readout)
    rest = np.concatenate([np.hstack(pose) for pose in poses.values()])
    return {"links": [*poses], "rest": _packed(rest), "readouts": [*readouts.values()]}


def _moves(readout: Readout) -> bool:
    return len(next(iter(readout.components.values()))) > 1


def _readout(readout: Readout) -> dict[str, Any]:
    values = _packed(np.stack(list(readout.components.values()), -1))
    return {"name": readout.name, "unit": readout.unit, "parts": list(readout.components), "values": values}


def _grid(grid: PoseGrid) -> dict[str, Any]:
    links, slider, shown = list(grid.position), grid.slider, None
    moving = [link for link in links if len(grid.position[link]) > 1]
    if ghost := grid.ghost:
        differences = _by_link(links, ghost.shift, ghost.rotation)
        shown = {"name": ghost.name, "nodes": _short(ghost.nodes, 15), "by": ghost.by, "values": differences}
    own = {"name": slider.name, "unit": slider.unit, "nodes": _short(slider.nodes, 15), "ring": slider.ring}
    landmarks = [asdict(landmark) for landmark in slider.landmarks]
    return {
        "name": grid.name,
        "note": grid.note,
        "sliders": [{**own, "start": slider.start, "marks": landmarks}],
        "moving": [links.index(link) for link in moving],
        "poses": _by_link(moving, grid.position, grid.quaternion),
        "readouts": [_readout(readout) for readout in grid.readouts if _moves(readout)],
        "ghost": shown,
    }


def _by_link(links: Sequence[str], positions: Mapping[str, Array], rotations: Mapping[str, Array]) -> str:
    """Return positions and rotations, (n, links, 6 or 7), as `_packed`."""
    return _packed(np.stack([np.hstack([positions[link], rotations[link]]) for link in links], -2))


def _packed(values: NDArray[Any], kind: str = "<f4") -> str:
    """Return numbers in base64: little-endian floats of 32 bits, 6e-8 of the value, or indices as "<u4"."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def _short(values: ArrayLike, digits: int = 9) -> list[float]:
    return [float(f"{value:.{digits}g}") for value in np.ravel(values).tolist()]
