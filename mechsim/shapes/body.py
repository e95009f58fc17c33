"""The body of a link: rods between its points, the space they occupy, and layers of planar links."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import combinations, pairwise, permutations

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint, joint_coordinate
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.links import IDENTITY as GROUND_POSE
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import hinged_normals
from mechsim.numerics.arrays import Array
from mechsim.shapes.shape import HOUSING, PALETTE, STEEL, Kind, Rgba, Shape, vector


def fixed_links(mechanism: Mechanism) -> set[str]:
    """Return the links that are fixed to the frame."""
    fixed = (joint.links for joint in mechanism.joints if not KINDS[joint.kind].dof and GROUND in joint.links)
    return {link for links in fixed for link in links} - {GROUND}


def link_colours(mechanism: Mechanism) -> dict[str, Rgba]:
    """Return the colour of every link, in the order of the palette; of the frame for what is fixed to it."""
    of_frame = dict.fromkeys(fixed_links(mechanism), HOUSING)
    return {link.name: PALETTE[i % len(PALETTE)] for i, link in enumerate(mechanism.links)} | of_frame


def point_colours(mechanism: Mechanism) -> dict[str, Rgba]:
    """Return the colour of every tracked point, the same in pictures, plots and pages."""
    # the brightest colour is too pale on white
    return {name: PALETTE[i % (len(PALETTE) - 1)] for i, name in enumerate(mechanism.points)}


def fixed_pivots(mechanism: Mechanism) -> dict[str, tuple[str, End]]:
    """Return joint -> its label and its end on the frame, of joints that pivot there and rods from it.

    A label differs from the names of tracked points, which may be elsewhere.
    """
    return {
        joint.name: (f"joint {joint.name}" if joint.name in mechanism.points else joint.name, end)
        for joint in mechanism.joints
        for end in (joint.a, joint.b)
        if end.link == GROUND and (KINDS[joint.kind].pivot or (KINDS[joint.kind].rod and end is joint.a))
    }


def rod_radius(mechanism: Mechanism) -> float:
    """Return the radius of rods in [m]: a fixed fraction of the span, smaller if a link is very short."""
    length = shortest = span(mechanism)
    for link in mechanism.links:
        for a, b in combinations(stations(mechanism, link.name), 2):
            shortest = min(shortest, float(np.linalg.norm(a - b)))
    return float(np.clip(0.2 * shortest, 0.010 * length, 0.022 * length))


def span(mechanism: Mechanism) -> float:
    """Return the longest distance between two points of one link, with its outline, in [m].

    Raises:
        InputError: for a mechanism whose links are all single points.
    """
    longest = mechanism.characteristic_length
    for link in mechanism.links:
        points = np.array([*stations(mechanism, link.name), *link.outline])
        longest = max(longest, float(np.linalg.norm(points[:, None] - points, axis=-1).max()))
    if not longest > 0.0:
        raise InputError(f"{mechanism.name} has no length to draw; give its links joints or outline points")
    return longest


def stations(mechanism: Mechanism, link: str) -> list[Array]:
    """Return the distinct points that the body of a link connects: joints, tracked points, outline.

    The corners of a polygon are none of them.
    """
    rods = (row.outline for row in mechanism.links if row.name == link and not row.polygon)
    outline = next(rods, ())
    tracked = [local for owner, local in mechanism.points.values() if owner == link]
    positions: list[Array] = []
    for point in [*(end.point for end in mechanism.ends(link)), *outline, *tracked]:
        position = np.asarray(point)
        tolerance = 1e-9 * max(mechanism.characteristic_length, float(np.linalg.norm(position)))
        if all(float(np.linalg.norm(position - other)) > tolerance for other in positions):
            positions.append(position)
    return positions


def edges(points: list[Array]) -> Iterable[tuple[Array, Array]]:
    """Yield pairs of points whose rods connect all points, none through a third point.

    Two or three points are all connected. More points form a ring of the outer ones, with spokes from the
    innermost of the points inside. Points that are still separate are connected by the shortest rods.
    """
    length = {
        (i, j): float(np.linalg.norm(points[i] - points[j])) for i, j in permutations(range(len(points)), 2)
    }
    every = sorted(combinations(range(len(points)), 2), key=length.__getitem__)
    pairs = [
        (i, j)
        for i, j in every
        if not any(
            length[i, k] + length[k, j] < length[i, j] * (1.0 + 1e-9)
            for k in range(len(points))
            if k not in (i, j)
        )
    ]
    preferred = set(every if len(points) <= 3 else _ring_and_spokes(np.array(points)))
    piece = list(range(len(points)))
    kept = [pair for pair in pairs if pair in preferred]
    for n, (i, j) in enumerate((*kept, *pairs)):
        if n < len(kept) or piece[i] != piece[j]:
            yield points[i], points[j]
        piece = [piece[i] if label == piece[j] else label for label in piece]


def _ring_and_spokes(points: Array) -> Iterable[tuple[int, int]]:
    """Yield the pairs of a ring around points in their plane of best fit, and of spokes to the innermost."""
    flat = (points - points.mean(0)) @ np.linalg.svd(points - points.mean(0))[2][:2].T
    ring = hull(flat)
    inside = [i for i in range(len(flat)) if i not in ring]
    hub = min(inside, key=lambda i: float(np.linalg.norm(flat[i])), default=None)
    for i, j in zip(ring, [*ring[1:], ring[0]], strict=True):
        yield min(i, j), max(i, j)
        if hub is not None:
            yield min(i, hub), max(i, hub)


def hull(flat: Array) -> list[int]:
    """Return the convex hull of points in a plane, in order, with the points on its sides."""
    slack = 1e-9 * float(np.ptp(flat, axis=0).max())
    order = [int(i) for i in np.lexsort((flat[:, 1], flat[:, 0]))]
    halves: list[list[int]] = []
    for sequence in (order, order[::-1]):
        half: list[int] = []
        for i in sequence:
            while len(half) > 1 and _offset_to_the_right(flat, half[-2], half[-1], i) < -slack:
                half.pop()
            half.append(i)
        halves.append(half[:-1])
    return list(dict.fromkeys(halves[0] + halves[1]))


def _offset_to_the_right(flat: Array, i: int, j: int, k: int) -> float:
    """Return the distance of point j to the right of the line from i to k, negative to the left."""
    direction, off = flat[k] - flat[i], flat[j] - flat[i]
    return float(direction[1] * off[0] - direction[0] * off[1]) / max(float(np.hypot(*direction)), 1e-300)


def extent(drawn: Iterable[tuple[Pose, Sequence[Shape]]]) -> tuple[Array, Array]:
    """Return balls that contain links in all their poses: centres (k, 3) and radii (k,) in [m].

    Args:
        drawn: pose or poses of a link, and its shapes.
    """
    centres, radii = [np.empty((0, 3))], [np.empty(0)]
    for poses, shapes in drawn:
        for shape in shapes:
            points, radius = shape.bounds
            for point in points:
                placed = np.atleast_2d(poses.point(tuple(point)))
                centres.append(placed)
                radii.append(np.full(len(placed), radius))
    return np.vstack(centres), np.concatenate(radii)


# a machine that moves this many times its length over all of its poses falls or flies
FOLLOWED = 2.0


def followed(
    poses: Mapping[str, Pose], shapes: Mapping[str, Sequence[Shape]]
) -> tuple[Array, tuple[Array, Array]]:
    """Return the path of a camera that follows a machine, from its start, and the balls of `extent` about it.

    The path, (n, 3) in [m], is 0 unless the machine falls or flies.
    """
    moving = {link: pose for link, pose in poses.items() if link != GROUND}
    path = np.mean([pose.position for pose in moving.values()], axis=0)
    path = path - path[0]
    own = extent((Pose(pose.position - path, pose.rotation), shapes[link]) for link, pose in moving.items())
    whole = extent((pose, shapes[link]) for link, pose in poses.items())
    flies = FOLLOWED * float(np.ptp(own[0], axis=0).max()) < float(np.ptp(whole[0], axis=0).max())
    return path * flies, own if flies else whole


def travels(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, tuple[float, float]]:
    """Return the smallest and largest displacement of every joint that slides along or across its axis."""
    displacements: dict[str, tuple[float, float]] = {}
    for joint in mechanism.joints:
        if 0 < len(KINDS[joint.kind].slides) < 3:
            along = displacement(joint, poses[joint.a.link], poses[joint.b.link])
            displacements[joint.name] = float(along.min()), float(along.max())
    return displacements


def displacement(joint: Joint, pose_a: Pose, pose_b: Pose) -> Array:
    """Return the displacement of a joint along its axis, or across it in any direction, (...,) in [m]."""
    coordinate = joint_coordinate(joint, pose_a, pose_b)
    slides = len(KINDS[joint.kind].slides)
    return coordinate[..., 0] if slides < 2 else np.linalg.norm(coordinate[..., :slides], axis=-1)


def free_sides(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, float]:
    """Return the side of every ground joint on which a shaft and its bearing are farthest from all rods.

    Args:
        mechanism: the mechanism.
        poses: link -> pose or poses; other links are ignored.

    Returns:
        Joint -> +1 or -1, along the axis of its end on the ground.
    """
    radius, share = rod_radius(mechanism), np.linspace(0.0, 1.0, 9)[:, None]
    reach = 9.0 * radius
    rods = {
        link.name: np.array([a + share * (b - a) for a, b in edges(stations(mechanism, link.name))])
        for link in mechanism.links
        if link.name in poses
    }
    names, balls = [*rods], [_ball(poses[link], rod) for link, rod in rods.items()]
    centres = np.array([centre for centre, _ in balls]).reshape(-1, 3)
    radii = np.array([ball[1] for ball in balls])
    sides: dict[str, float] = {}
    for joint in mechanism.joints:
        for ground, moving in ((joint.a, joint.b), (joint.b, joint.a)):
            if not KINDS[joint.kind].pivot or KINDS[joint.kind].ball or ground.link != GROUND:
                continue
            gaps, placed = dict[float, float](), dict[str, Array]()
            for side in (-1.0, 1.0):
                along = np.linspace(0.25, 1.0, 5)[:, None] * reach * side
                shaft = np.asarray(ground.point) + along * np.asarray(ground.axis)
                # the nearest links first; none of those beyond the smallest distance so far can be nearer
                others = [i for i, link in enumerate(names) if link != moving.link]
                least = np.linalg.norm(centres[others, None] - shaft, axis=2).min(1) - radii[others]
                smallest = np.inf
                for i in np.argsort(least):
                    if least[i] > smallest:
                        break
                    link = names[others[i]]
                    if link not in placed:
                        placed[link] = _placed(poses[link], rods[link])
                    smallest = min(smallest, _gap(shaft, placed[link]))
                gaps[side] = smallest if others else 0.0
            middle = np.array([end.point for end in mechanism.ends(GROUND)]).mean(0)
            inward = float((middle - np.asarray(ground.point)) @ np.asarray(ground.axis))
            # a clear difference decides; else the shaft points away from the mechanism
            away = 1.0 if inward < -reach / 90.0 else -1.0
            clear = abs(gaps[1.0] - gaps[-1.0]) > 2.0 * radius
            sides[joint.name] = max(gaps, key=gaps.__getitem__) if clear else away
    return sides


def _ball(pose: Pose, rods: Array) -> tuple[Array, float]:
    """Return centre (3,) and radius of a ball about rods in all poses of their link."""
    local = rods.reshape(-1, 3) if rods.size else np.zeros((1, 3))
    centres = np.atleast_2d(pose.position + pose.rotation @ local.mean(0))
    middle = centres.mean(0)
    own, moved = (np.linalg.norm(each - each.mean(0), axis=1).max() for each in (local, centres))
    return middle, float(own + moved) * (1.0 + 1e-9)


def _placed(pose: Pose, rods: Array) -> Array:
    """Return the points of rods in all poses of their link, (3, n)."""
    local = rods.reshape(-1, 3) if rods.size else np.zeros((1, 3))
    rotation, position = np.atleast_3d(pose.rotation).reshape(-1, 3, 3), pose.position.reshape(-1, 1, 3)
    moved = position + local @ np.swapaxes(rotation, -1, -2)
    return np.ascontiguousarray(moved.reshape(-1, 3).T)


def _gap(points: Array, others: Array) -> float:
    """Return the smallest distance between points, (k, 3), and others, (3, n)."""
    squares = sum((own[:, None] - other) ** 2 for own, other in zip(points.T, others, strict=True))
    return float(np.sqrt(np.min(squares)))


def planar_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return the normal of the plane of motion in each link's frame, or None unless the links can be flat.

    The mechanism must be planar, as in `model.link_poses`, and all joints of a flat link must lie in one
    plane.
    """
    if not all(KINDS[joint.kind].aligned for joint in mechanism.joints):
        return None
    normals, length = hinged_normals(mechanism), span(mechanism)
    for link, normal in (normals or {}).items():
        heights = [float(normal @ end.point) for end in mechanism.ends(link)]
        if heights and max(heights) - min(heights) > 1e-9 * length:
            return None
    return normals


def layers_of(mechanism: Mechanism) -> dict[str, float]:
    """Return layers of a planar mechanism; links with a common joint or pin lie in different ones."""
    # link -> point of each of its joint ends, and the end on the other link
    pairs: dict[str, list[tuple[Array, End]]] = {name: [] for name in mechanism.link_names}
    for joint in mechanism.joints:
        pairs[joint.a.link].append((np.asarray(joint.a.point), joint.b))
        pairs[joint.b.link].append((np.asarray(joint.b.point), joint.a))
    layers: dict[str, int] = {}
    for link in mechanism.links:
        joined = [other for _, other in pairs[link.name]]
        adjacent = {end.link for end in joined}
        # links on the same pin of a third one
        for pin in joined:
            points = np.array([point for point, _ in pairs[pin.link]])
            same = (np.abs(points - pin.point) <= 1e-9).all(1)
            adjacent |= {pairs[pin.link][i][1].link for i in np.flatnonzero(same)}
        used = {layers[name] for name in adjacent if name in layers}
        layers[link.name] = next(i for i in range(len(used) + 1) if i not in used)
    middle = max(layers.values(), default=0) / 2.0
    return {link: layer - middle for link, layer in layers.items()}


class Canvas:
    """The drawing of all links.

    Attributes:
        mechanism: the mechanism.
        travel: joint -> smallest and largest displacement in [m], if known; see `displacement`.
        outward: joint -> side of its shaft.
        r: radius of rods in [m].
        colours: link -> colour.
        normals: link -> normal of its plane of motion; None for a spatial mechanism.
        out: link -> its shapes so far.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        travel: dict[str, tuple[float, float]],
        outward: dict[str, float],
        radius: float | None = None,
    ):
        self.mechanism = mechanism
        self.travel = travel
        self.outward = outward
        self.r = rod_radius(mechanism) if radius is None else radius
        self.colours = link_colours(mechanism)
        self.normals = planar_normals(mechanism)
        self.layers = layers_of(mechanism) if self.normals else {}
        self.out: dict[str, list[Shape]] = {GROUND: [], **{link.name: [] for link in mechanism.links}}

    def add(self, link: str, kind: Kind, frm: ArrayLike, to: ArrayLike, radius: float, rgba: Rgba) -> None:
        """Draw a round solid between two points of a link, once."""
        shape = Shape(kind, vector(frm), vector(to), (radius,), rgba)
        # joints of a link at one point have the same eye
        if link == GROUND or shape not in self.out[link]:
            self.out[link].append(shape)

    def disc(self, link: str, end: End, low: float, high: float, radius: float, rgba: Rgba) -> None:
        """Draw a cylinder about a joint's axis, between two heights over the joint's point."""
        point, axis = np.asarray(end.point), np.asarray(end.axis)
        self.add(link, "cylinder", point + low * axis, point + high * axis, radius, rgba)

    def upright(self, end: End) -> End:
        """Return a joint's end with its axis along the normal of a planar link; in space the end."""
        return replace(end, axis=vector(self.normals[end.link])) if self.normals else end

    def bearing(self, end: End, low: float, high: float) -> None:
        """Draw a bearing on the ground between two heights over a joint's point."""
        self.disc(GROUND, end, low, high, 2.2 * self.r, HOUSING)
        self.carry()

    def shaft(self, joint: Joint, end: End) -> None:
        """Draw a shaft at a joint's end on the ground, and the bearing to which it leads."""
        away = self.outward.get(joint.name, -1.0)
        low, high = sorted((-2.2 * self.r * away, 9.0 * self.r * away))
        self.disc(GROUND, end, low, high, 1.1 * self.r, STEEL)
        low, high = sorted((4.2 * self.r * away, 7.8 * self.r * away))
        self.bearing(end, low, high)

    def bar(
        self,
        link: str,
        frm: ArrayLike,
        to: ArrayLike,
        sizes: tuple[float, float],
        rgba: Rgba,
        thickness: ArrayLike,
    ) -> None:
        """Draw a box between two points, of half a width, half a thickness and the direction of this."""
        self.out[link].append(Shape("box", vector(frm), vector(to), sizes, rgba, vector(thickness)))

    def carry(self, link: str = GROUND) -> None:
        """Mark the last shape as carried by a post if it is on the ground."""
        if link == GROUND:
            self.out[GROUND][-1] = replace(self.out[GROUND][-1], role="bearing")

    def join(self, link: str, points: Sequence[ArrayLike]) -> None:
        """Draw a rod of a link through points."""
        for frm, to in pairwise(points):
            if float(np.linalg.norm(np.subtract(to, frm))) > 0.1 * self.r:
                self.add(link, "capsule", frm, to, self.r, self.colours[link])

    def height(self, link: str) -> float:
        """Return the middle of a planar link's layer, along its normal."""
        return 1.6 * self.r * self.layers.get(link, 0.0)

    def lift_of(self, link: str) -> Array:
        """Return the middle of a planar link's layer as a vector in its frame, (3,)."""
        return self.height(link) * self.normals[link] if self.normals else np.zeros(3)

    def level(self, link: str) -> float:
        """Return the middle of a planar link's layer along its normal; for the ground its mounting plate."""
        return self.back if link == GROUND else self.height(link)

    @cached_property
    def back(self) -> float:
        """Position of the mounting plate of a planar mechanism along the ground's normal."""
        lowest = min(self.height(link.name) for link in self.mechanism.links)
        return lowest - (5.0 if self.mechanism.gears or self.mechanism.couplings else 2.6) * self.r

    def lift(self, end: End) -> Array:
        """Return a planar link's layer as a vector in its frame; the ground has that of its neighbour."""
        if not self.normals:
            return np.zeros(3)
        guided = end.link
        if end.link == GROUND:
            joint = next(j for j in self.mechanism.joints if end in (j.a, j.b))
            guided = joint.b.link if joint.a is end else joint.a.link
        return self.height(guided) * self.normals[end.link]

    def thickness(self, end: End) -> Array:
        """Return the thickness direction of the slider or rail at a joint."""
        return self.normals[end.link] if self.normals else end.frame[:, 1]

    def travel_of(self, joint: Joint) -> tuple[float, float]:
        """Return the smallest and largest displacement of a joint, known or bounded by the crank's reach."""
        if joint.name in self.travel:
            return self.travel[joint.name]
        guess = {GROUND: GROUND_POSE, **self.mechanism.guess}
        current = 0.0
        if joint.a.link in guess and joint.b.link in guess:
            current = float(displacement(joint, guess[joint.a.link], guess[joint.b.link]))
        driver = (*self.mechanism.driven_joints, *self.mechanism.joints)[0].b
        arms = [vector(end.point) for end in self.mechanism.ends(driver.link)]
        reach = 2.0 * max(float(np.linalg.norm(np.subtract(arm, driver.point))) for arm in arms)
        return current - reach, current + reach
