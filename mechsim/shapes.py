"""Which shapes a link is drawn with, from its joints alone: rods, eyes, pins, balls, rails, bearings, gears.

Sizes follow from the size of the mechanism, so that a needle drive of millimetres and a press of
metres look alike. Nothing here is physics: the shapes carry no mass and meet nothing.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError
from mechsim.mechanism import GROUND, End, Gear, Joint, Mechanism, Pose, Vector, joint_coordinate
from mechsim.mechanism import IDENTITY as GROUND_POSE

Array = NDArray[np.float64]
Rgba = tuple[float, float, float, float]
Kind = Literal["capsule", "cylinder", "sphere", "box"]
Role = Literal["body", "bearing"]

# Okabe and Ito's colours, which stay apart for colour-blind eyes; the brightest last, as it fades on white
PALETTE: tuple[Rgba, ...] = (
    (0.835, 0.369, 0.000, 1.0),
    (0.000, 0.447, 0.698, 1.0),
    (0.000, 0.620, 0.451, 1.0),
    (0.902, 0.624, 0.000, 1.0),
    (0.800, 0.475, 0.655, 1.0),
    (0.337, 0.706, 0.914, 1.0),
    (0.941, 0.894, 0.259, 1.0),
)
STEEL: Rgba = (0.33, 0.35, 0.38, 1.0)
HOUSING: Rgba = (0.62, 0.64, 0.67, 1.0)


@dataclass(frozen=True, slots=True)
class Shape:
    """One solid in a link's own frame ("ground": in the world's).

    Attributes:
        kind: capsule, cylinder and box reach from `frm` to `to`; a sphere sits at `frm`.
        frm: start point in [m].
        to: end point in [m]; equal to `frm` for a sphere.
        size: (radius,), or for a box (half width, half thickness) in [m].
        rgba: colour, each part 0 to 1.
        thickness: of a box, the direction of its thickness.
        role: "bearing" for what a stand can carry, else "body".
    """

    kind: Kind
    frm: Vector
    to: Vector
    size: tuple[float, ...]
    rgba: Rgba
    thickness: Vector = (0.0, 0.0, 1.0)
    role: Role = "body"

    @property
    def centre(self) -> Array:
        """The middle, (3,) in [m]."""
        return (np.asarray(self.frm) + np.asarray(self.to)) / 2.0

    @property
    def half_sizes(self) -> tuple[float, ...]:
        """The sizes as MuJoCo orders them, in [m]."""
        if self.kind == "sphere":
            return self.size
        return (*self.size, float(np.linalg.norm(np.subtract(self.to, self.frm))) / 2.0)

    @property
    def frame(self) -> Array:
        """Axes in the link's frame as columns: width, thickness, from `frm` to `to`; (3, 3)."""
        along = np.subtract(self.to, self.frm)
        length = np.linalg.norm(along)
        if not length > 0.0:
            return np.eye(3)
        along = along / length
        thick = _across(np.asarray(self.thickness), along)
        return np.column_stack([np.cross(thick, along), thick, along])

    @property
    def bounds(self) -> tuple[Array, float]:
        """Points whose balls of the returned radius hold the shape, (k, 3) and [m]."""
        if self.kind != "box":
            return np.array([self.frm, self.to]), self.size[0]
        corners = np.array(np.meshgrid(*((-h, h) for h in self.half_sizes))).reshape(3, -1)
        return self.centre + (self.frame @ corners).T, 0.0

    def moved(self, by: ArrayLike) -> "Shape":
        """Return the shape shifted by a vector."""
        return replace(self, frm=_vector(self.frm, by), to=_vector(self.to, by))


def link_colours(mechanism: Mechanism) -> dict[str, Rgba]:
    """Return the colour of every moving link, in the order of the palette."""
    return {link.name: PALETTE[i % len(PALETTE)] for i, link in enumerate(mechanism.links)}


def rod_radius(mechanism: Mechanism) -> float:
    """Return the radius of rods in [m]: a fixed part of the mechanism, less where a link is very short."""
    size = shortest = span(mechanism)
    for link in mechanism.links:
        for a, b in combinations(_stations(mechanism, link.name), 2):
            shortest = min(shortest, float(np.linalg.norm(a - b)))
    return float(np.clip(0.2 * shortest, 0.010 * size, 0.022 * size))


def span(mechanism: Mechanism) -> float:
    """Return the longest distance between two places of one link, outline included, in [m].

    Raises:
        InputError: for a mechanism whose links are all mere points.
    """
    longest = mechanism.size
    for link in mechanism.links:
        for a, b in combinations(_stations(mechanism, link.name), 2):
            longest = max(longest, float(np.linalg.norm(a - b)))
    if not longest > 0.0:
        raise InputError(f"{mechanism.name} has no length to draw; give its links joints or outline points")
    return longest


def link_shapes(
    mechanism: Mechanism,
    travel: Mapping[str, tuple[float, float]] | None = None,
    outward: Mapping[str, float] | None = None,
) -> dict[str, list[Shape]]:
    """Return the shapes of every link, "ground" included.

    Args:
        mechanism: what to draw.
        travel: joint -> least and greatest way along its axis in [m], where it is known from a
            motion; else sliding joints get rails long enough for any motion from the guess.
        outward: joint -> which way its shaft leads along its axis to a bearing, +1 or -1; see
            `free_sides`. Else the side that is free in the guess.
    """
    if outward is None:
        outward = free_sides(mechanism, {GROUND: GROUND_POSE, **mechanism.guess})
    return _Drawer(mechanism, dict(travel or {}), dict(outward)).shapes()


def free_sides(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, float]:
    """Return the side of every ground joint where a shaft and its bearing are least in the way.

    Args:
        mechanism: whose joints.
        poses: link -> pose or poses; links left out do not count.

    Returns:
        Joint -> +1 or -1, along the axis of its end on the ground.
    """
    reach, share = 9.0 * rod_radius(mechanism), np.linspace(0.0, 1.0, 9)[:, None]
    rods = {
        link.name: np.array([a + share * (b - a) for a, b in _edges(_stations(mechanism, link.name))])
        for link in mechanism.links
        if link.name in poses
    }
    sides: dict[str, float] = {}
    for joint in mechanism.joints:
        for ground, moving in ((joint.a, joint.b), (joint.b, joint.a)):
            if joint.kind != "revolute" or ground.link != GROUND:
                continue
            gaps = {}
            for side in (-1.0, 1.0):
                along = np.linspace(0.25, 1.0, 5)[:, None] * reach * side
                shaft = np.asarray(ground.point) + along * np.asarray(ground.axis)
                gaps[side] = min(
                    (_gap(shaft, poses[link], rod) for link, rod in rods.items() if link != moving.link),
                    default=0.0,
                )
            inward = float((_middle(mechanism) - np.asarray(ground.point)) @ np.asarray(ground.axis))
            # a clear difference decides; else the shaft leads off the mechanism
            clear = abs(gaps[1.0] - gaps[-1.0]) > 2.0 * rod_radius(mechanism)
            sides[joint.name] = (
                max(gaps, key=gaps.__getitem__) if clear else (1.0 if inward < -reach / 90.0 else -1.0)
            )
    return sides


def _gap(places: Array, pose: Pose, rods: Array) -> float:
    """The least distance between places, (k, 3), and points of rods in all poses of their link."""
    local = rods.reshape(-1, 3)
    if not len(local):
        local = np.zeros((1, 3))
    rotation, position = np.atleast_3d(pose.rotation).reshape(-1, 3, 3), pose.position.reshape(-1, 1, 3)
    moved = (position + local @ np.swapaxes(rotation, -1, -2)).reshape(-1, 1, 3)
    return float(np.sqrt(((moved - places) ** 2).sum(-1)).min())


def _middle(mechanism: Mechanism) -> Array:
    """The middle of all joints on the ground."""
    return np.array([end.point for end in mechanism.ends(GROUND)]).mean(0)


def planar_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return the normal of the plane of motion in each link's frame, or None for a spatial mechanism."""
    normals: dict[str, Array] = {GROUND: np.asarray(mechanism.joint(mechanism.driver).a.axis)}
    if any(joint.kind not in ("revolute", "prismatic") for joint in mechanism.joints):
        return None
    for _ in mechanism.links:
        for joint in mechanism.joints:
            for here, there in ((joint.a, joint.b), (joint.b, joint.a)):
                if here.link in normals and there.link not in normals:
                    # a direction has the same parts in both joint frames, but for the turn about the axis
                    parts = here.frame.T @ normals[here.link]
                    if joint.kind == "prismatic" or abs(parts[2]) > 1.0 - 1e-9:
                        normals[there.link] = there.frame @ parts
    for joint in mechanism.joints:
        for end in (joint.a, joint.b):
            if end.link not in normals:
                return None
            tilt = abs(float(normals[end.link] @ np.asarray(end.axis)))
            if abs(tilt - (joint.kind == "revolute")) > 1e-9:
                return None
    for link, normal in normals.items():
        heights = [float(normal @ np.asarray(end.point)) for end in mechanism.ends(link)]
        if heights and max(heights) - min(heights) > 1e-9 * span(mechanism):
            return None
    return normals


class _Drawer:
    def __init__(
        self, mechanism: Mechanism, travel: dict[str, tuple[float, float]], outward: dict[str, float]
    ):
        self.mechanism = mechanism
        self.travel = travel
        self.outward = outward
        self.r = rod_radius(mechanism)
        self.colours = link_colours(mechanism)
        self.normals = planar_normals(mechanism)
        self.layers = _layers(mechanism) if self.normals else {}
        self.out: dict[str, list[Shape]] = {GROUND: [], **{link.name: [] for link in mechanism.links}}

    def shapes(self) -> dict[str, list[Shape]]:
        for link in self.mechanism.links:
            self._body(link.name)
        for joint in self.mechanism.joints:
            draw = {
                "revolute": self._flat_revolute if self.normals else self._revolute,
                "prismatic": self._slide,
                "cylindrical": self._sleeve,
                "universal": self._cross,
                "spherical": self._ball,
            }[joint.kind]
            draw(joint)
        for gear in self.mechanism.gears:
            self._gear_pair(gear)
        return self.out

    def _add(self, link: str, kind: Kind, frm: ArrayLike, to: ArrayLike, size: float, rgba: Rgba) -> None:
        self.out[link].append(Shape(kind, _vector(frm), _vector(to), (size,), rgba))

    def _disc(self, link: str, end: End, low: float, high: float, radius: float, rgba: Rgba) -> None:
        """A cylinder about a joint's axis, between two heights over the joint's point."""
        point, axis = np.asarray(end.point), np.asarray(end.axis)
        self._add(link, "cylinder", point + low * axis, point + high * axis, radius, rgba)

    def _bearing(self, end: End, low: float, high: float) -> None:
        self._disc(GROUND, end, low, high, 2.2 * self.r, HOUSING)
        self.out[GROUND][-1] = replace(self.out[GROUND][-1], role="bearing")

    def _height(self, link: str) -> float:
        """The middle of a planar link's layer, along its normal."""
        return 1.6 * self.r * self.layers.get(link, 0.0)

    @property
    def _back(self) -> float:
        """Where the mounting plate of a planar mechanism stands, along the ground's normal."""
        lowest = min(self._height(link.name) for link in self.mechanism.links)
        return lowest - (5.0 if self.mechanism.gears else 2.6) * self.r

    def _body(self, link: str) -> None:
        """Rods between the places of a link where something happens, an eye where no joint is."""
        places, colour = _stations(self.mechanism, link), self.colours[link]
        lift = self._height(link) * self.normals[link] if self.normals else np.zeros(3)
        for a, b in _edges(places):
            if self.normals:
                width, thick = 1.15 * self.r, 0.5 * self.r
                normal = _vector(self.normals[link])
                bar = Shape("box", _vector(a, lift), _vector(b, lift), (width, thick), colour, normal)
                self.out[link].append(bar)
            else:
                self._add(link, "capsule", a, b, self.r, colour)
        joints = [np.asarray(end.point) for end in self.mechanism.ends(link)]
        for place in places:
            if min(float(np.linalg.norm(place - joint)) for joint in joints) > 0.1 * self.r:
                self._add(link, "sphere", place + lift, place + lift, 1.5 * self.r, colour)

    def _flat_revolute(self, joint: Joint) -> None:
        """Two eyes in their layers and the pin through both; on the ground a boss on the plate."""
        assert self.normals
        heights = [self._height(end.link) for end in (joint.a, joint.b) if end.link != GROUND]
        thick, top = 0.62 * self.r, max(heights) + 1.0 * self.r
        for end in (joint.a, joint.b):
            if end.link != GROUND:
                upright = _upright(end, self.normals[end.link])
                at = self._height(end.link)
                self._disc(end.link, upright, at - thick, at + thick, 1.9 * self.r, self.colours[end.link])
        grounded = [end for end in (joint.a, joint.b) if end.link == GROUND]
        if grounded:
            post = _upright(grounded[0], self.normals[GROUND])
            self._disc(GROUND, post, self._back, min(heights) - 1.2 * thick, 2.4 * self.r, HOUSING)
            self._disc(GROUND, post, self._back, top, 0.9 * self.r, STEEL)
        else:
            pin = _upright(joint.a, self.normals[joint.a.link])
            self._disc(joint.a.link, pin, min(heights) - 1.0 * self.r, top, 0.9 * self.r, STEEL)

    def _revolute(self, joint: Joint) -> None:
        """A hub and a shaft into a bearing on the ground; between moving links a fork and an eye."""
        r = self.r
        for ground, link in ((joint.a, joint.b), (joint.b, joint.a)):
            if ground.link == GROUND:
                self._disc(link.link, link, -1.6 * r, 1.6 * r, 2.0 * r, self.colours[link.link])
                away = self.outward.get(joint.name, -1.0)
                low, high = sorted((-2.2 * r * away, 9.0 * r * away))
                self._disc(GROUND, ground, low, high, 1.1 * r, STEEL)
                low, high = sorted((4.2 * r * away, 7.8 * r * away))
                self._bearing(ground, low, high)
                return
        a, b = joint.a, joint.b
        self._disc(b.link, b, -1.1 * r, 1.1 * r, 1.9 * r, self.colours[b.link])
        for low, high in ((-2.0 * r, -1.2 * r), (1.2 * r, 2.0 * r)):
            self._disc(a.link, a, low, high, 1.9 * r, self.colours[a.link])
        self._disc(a.link, a, -2.5 * r, 2.5 * r, 0.9 * r, STEEL)

    def _ball(self, joint: Joint) -> None:
        """A steel ball on the first link, a collar of the second around it."""
        place = joint.a.point
        self._add(joint.a.link, "sphere", place, place, 2.0 * self.r, STEEL)
        rod = self._rod_direction(joint.b)
        if rod is not None:
            at = np.asarray(joint.b.point)
            ends = at + 1.0 * self.r * rod, at + 2.6 * self.r * rod
            self._add(joint.b.link, "cylinder", *ends, 1.8 * self.r, self.colours[joint.b.link])

    def _cross(self, joint: Joint) -> None:
        """The two crossing pins of a universal joint, each on its own link."""
        r = self.r
        self._disc(joint.a.link, joint.a, -2.8 * r, 2.8 * r, 1.0 * r, STEEL)
        self._disc(joint.b.link, joint.b, -2.4 * r, 2.4 * r, 1.3 * r, self.colours[joint.b.link])
        self._add(joint.a.link, "sphere", joint.a.point, joint.a.point, 1.6 * r, STEEL)

    def _slide(self, joint: Joint) -> None:
        """A block on a rail that is as long as the way it goes."""
        r = self.r
        low, high = self._way(joint)
        rail, block = joint.a, joint.b
        thick = self._thickness(rail)
        at = np.asarray(rail.point) - 1.9 * r * thick + self._lift(rail)
        axis = np.asarray(rail.axis)
        ends = at + (low - 4.0 * r) * axis, at + (high + 4.0 * r) * axis
        colour = STEEL if rail.link == GROUND else self.colours[rail.link]
        shape = Shape("box", _vector(ends[0]), _vector(ends[1]), (1.4 * r, 0.6 * r), colour, _vector(thick))
        self.out[rail.link].append(shape)
        if rail.link == GROUND and self.normals:
            self._feet(shape, thick)
        thick = self._thickness(block)
        at, axis = np.asarray(block.point) + self._lift(block), np.asarray(block.axis)
        ends = at - 3.0 * r * axis, at + 3.0 * r * axis
        colour = STEEL if block.link == GROUND else self.colours[block.link]
        size = (2.2 * r, 1.2 * r)
        self.out[block.link].append(
            Shape("box", _vector(ends[0]), _vector(ends[1]), size, colour, _vector(thick))
        )

    def _feet(self, rail: Shape, thick: Array) -> None:
        """Two feet that carry a rail on the mounting plate."""
        for end, inward in ((rail.frm, rail.to), (rail.to, rail.frm)):
            way = np.subtract(inward, end)
            at = np.asarray(end) + 2.0 * self.r * way / np.linalg.norm(way)
            plate = at + thick * (self._back - float(at @ thick))
            self._add(GROUND, "cylinder", at, plate, 1.3 * self.r, HOUSING)

    def _sleeve(self, joint: Joint) -> None:
        """A shaft on one link as long as the way along it, a sleeve on the other."""
        r = self.r
        low, high = self._way(joint)
        colour = STEEL if joint.a.link == GROUND else self.colours[joint.a.link]
        self._disc(joint.a.link, joint.a, low - 8.0 * r, high + 8.0 * r, 1.0 * r, colour)
        if joint.a.link == GROUND:
            for low_end in (low - 8.0 * r, high + 5.6 * r):
                self._bearing(joint.a, low_end, low_end + 2.4 * r)
        colour = HOUSING if joint.b.link == GROUND else self.colours[joint.b.link]
        self._disc(joint.b.link, joint.b, -3.0 * r, 3.0 * r, 1.9 * r, colour)

    def _lift(self, end: End) -> Array:
        """The layer of a planar link as a vector in its frame; the ground takes that of what it guides."""
        if not self.normals:
            return np.zeros(3)
        guided = end.link
        if end.link == GROUND:
            joint = next(j for j in self.mechanism.joints if end in (j.a, j.b))
            guided = joint.b.link if joint.a is end else joint.a.link
        return self._height(guided) * self.normals[end.link]

    def _thickness(self, end: End) -> Array:
        return self.normals[end.link] if self.normals else end.frame[:, 1]

    def _way(self, joint: Joint) -> tuple[float, float]:
        """The least and greatest way of a sliding joint, known or bounded by what the crank can do."""
        if joint.name in self.travel:
            return self.travel[joint.name]
        guess = {GROUND: GROUND_POSE, **self.mechanism.guess}
        here = 0.0
        if joint.a.link in guess and joint.b.link in guess:
            here = float(joint_coordinate(joint, guess[joint.a.link], guess[joint.b.link])[..., 0])
        driver = self.mechanism.joint(self.mechanism.driver).b
        arms = [_vector(end.point) for end in self.mechanism.ends(driver.link)]
        reach = 2.0 * max(float(np.linalg.norm(np.subtract(arm, driver.point))) for arm in arms)
        return here - reach, here + reach

    def _rod_direction(self, end: End) -> Array | None:
        """The direction from a joint to the rest of its link, None where the link is only that place."""
        rest = np.array(_stations(self.mechanism, end.link)) - np.asarray(end.point)
        way = rest.sum(0)
        length = float(np.linalg.norm(way))
        return way / length if length > 0.1 * self.r else None

    def _gear_pair(self, gear: Gear) -> None:
        """Two toothed discs that mesh outside, behind the links, between shafts that stand parallel."""
        first, second = self.mechanism.joint(gear.driver), self.mechanism.joint(gear.driven)
        across = np.subtract(second.a.point, first.a.point)
        axis = np.asarray(first.a.axis)
        across = across - axis * (across @ axis)
        distance = float(np.linalg.norm(across))
        parallel = float(axis @ np.asarray(second.a.axis)) > 1.0 - 1e-9
        grounded = first.a.link == second.a.link == GROUND
        if not (grounded and parallel and gear.ratio < 0.0 and distance > 0.0):
            return
        fast = 1.0 / (1.0 + abs(gear.ratio))  # the driven gear's part of the distance
        teeth = max(18, round(18 / abs(gear.ratio)))
        counts = max(18, round(teeth * abs(gear.ratio))), teeth
        angles = [_angle_in(joint.a, sign * across) for joint, sign in ((first, 1.0), (second, -1.0))]
        self._gear(first.b, distance * (1.0 - fast), counts[0], angles[0])
        # at driver angle zero a gap of the driven gear meets a tooth of the driver
        turned = angles[1] - gear.phase + np.pi / counts[1]
        self._gear(second.b, distance * fast, counts[1], turned)

    def _gear(self, end: End, radius: float, teeth: int, first: float) -> None:
        """A toothed disc whose first tooth stands at an angle from the joint's mark."""
        colour = _pale(self.colours[end.link])
        low = (self._back if self.normals else -4.5 * self.r) + 1.0 * self.r
        depth = 0.7 * np.pi * radius / teeth
        upright = _upright(end, self.normals[end.link]) if self.normals else end
        self._disc(end.link, upright, low, low + 1.2 * self.r, radius - depth, colour)
        centre = np.asarray(end.point) + (low + 0.6 * self.r) * np.asarray(upright.axis)
        for angle in first + 2.0 * np.pi * np.arange(teeth) / teeth:
            out = end.frame @ np.array([np.cos(angle), np.sin(angle), 0.0])
            ends = centre + (radius - 1.3 * depth) * out, centre + (radius + 0.8 * depth) * out
            # a shade thinner than the disc, so that the faces do not fight where they overlap
            size = (0.42 * np.pi * radius / teeth, 0.57 * self.r)
            self.out[end.link].append(
                Shape("box", _vector(ends[0]), _vector(ends[1]), size, colour, upright.axis)
            )


def _stations(mechanism: Mechanism, link: str) -> list[Array]:
    """Places of a link that its body joins up: joints, outline, tracked points; no place twice."""
    outline = next((one.outline for one in mechanism.links if one.name == link), ())
    tracked = [local for owner, local in mechanism.points.values() if owner == link]
    places: list[Array] = []
    for point in [*(end.point for end in mechanism.ends(link)), *outline, *tracked]:
        place = np.asarray(point)
        near = 1e-9 * max(mechanism.size, float(np.linalg.norm(place)))
        if all(float(np.linalg.norm(place - known)) > near for known in places):
            places.append(place)
    return places


def _edges(places: list[Array]) -> Iterable[tuple[Array, Array]]:
    """Pairs of places that a rod joins: every pair of two or three, a ring of more; none through a third."""
    if len(places) <= 3:
        pairs = list(combinations(range(len(places)), 2))
    else:
        ring = _ring(np.array(places))
        pairs = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    for i, j in pairs:
        a, b = places[i], places[j]
        others = (places[k] for k in range(len(places)) if k not in (i, j))
        if not any(_between(other, a, b) for other in others):
            yield a, b


def _ring(places: Array) -> list[int]:
    """The order of places around their middle, in the plane that fits them best."""
    flat = places - places.mean(0)
    axes = np.linalg.svd(flat)[2]
    return [int(i) for i in np.argsort(np.arctan2(flat @ axes[1], flat @ axes[0]))]


def _between(place: Array, a: Array, b: Array) -> bool:
    way = float(np.linalg.norm(place - a) + np.linalg.norm(place - b))
    return way < float(np.linalg.norm(a - b)) * (1.0 + 1e-9)


def _layers(mechanism: Mechanism) -> dict[str, float]:
    """Layers of a planar mechanism such that links which share a joint lie in different ones."""
    layers: dict[str, int] = {}
    for link in mechanism.links:
        near = {
            layers[other.link]
            for joint in mechanism.joints
            for here, other in ((joint.a, joint.b), (joint.b, joint.a))
            if here.link == link.name and other.link in layers
        }
        layers[link.name] = next(i for i in range(len(near) + 1) if i not in near)
    middle = max(layers.values(), default=0) / 2.0
    return {link: layer - middle for link, layer in layers.items()}


def _upright(end: End, normal: Array) -> End:
    """The end with its axis along the plane's normal."""
    return replace(end, axis=_vector(normal))


def _angle_in(end: End, direction: Array) -> float:
    """The angle of a direction about a joint's axis, from its mark."""
    x, y, _ = end.frame.T @ direction
    return float(np.arctan2(y, x))


def _across(direction: Array, axis: Array) -> Array:
    """The unit part of a direction across an axis, or any such unit vector."""
    for candidate in (direction, *np.eye(3)):
        across = candidate - axis * (candidate @ axis)
        length = float(np.linalg.norm(across))
        if length > 1e-6:
            return across / length
    raise AssertionError("three coordinate axes cannot all lie along one axis")


def _pale(colour: Rgba) -> Rgba:
    r, g, b, a = colour
    return (0.62 + 0.38 * r, 0.62 + 0.38 * g, 0.62 + 0.38 * b, a)


def _vector(point: ArrayLike, by: ArrayLike = 0.0) -> Vector:
    x, y, z = (np.asarray(point, dtype=np.float64) + np.asarray(by)).tolist()
    return (x, y, z)
