"""All assemblies of a planar mechanism, one Assur group after another, in closed form."""

import cmath
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.assur import AssurGroup, Decomposition, assur_groups, inner_drivers_locked
from mechsim.kinematics.mobility_count import Pairs, pinned, planar_pairs, plane_normal, rigid
from mechsim.kinematics.vector_method.triad import triad_modes
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import ROUNDING, Array

# shortest leg of a triad relative to its size: below it `triad_modes` may miss poses
MIN_LEG = 0.03
# discriminants of dyads within this of zero, relative to their terms, are zero by rounding
DISCRIMINANT_ROUNDING = 1e-14


# largest number of assemblies: each dyad of a chain doubles it
MAX_ASSEMBLIES = 64


class UnsolvedGroupError(InputError):
    """A group has no closed form here."""


class FamilyError(InputError):
    """The poses of a group are a continuous family, because two of its pins coincide or its slides align."""


@dataclass(frozen=True, slots=True)
class Displacement:
    """Planar displacement of a link from its reference pose: x -> rotation * x + shift, with complex x.

    Attributes:
        rotation: exp(i phi) for the rotation by phi.
        shift: translation in [m].
    """

    rotation: complex
    shift: complex

    def __call__(self, x: complex) -> complex:
        """Return the displaced position of a point of the link, in [m]."""
        return self.rotation * x + self.shift


AT_REFERENCE = Displacement(1.0, 0.0)
Placed = Mapping[str, Displacement]


def about(point: complex, image: complex, rotation: complex) -> Displacement:
    """Return the displacement that has a rotation and moves a point to its image."""
    return Displacement(rotation, image - rotation * point)


@dataclass(frozen=True, slots=True)
class PlanePair:
    """A pin or a slide in the reference pose.

    Attributes:
        links: the connected bodies.
        point: position of the pin, or of a point of the slide, in [m].
        direction: unit vector of the slide; None for a pin.
    """

    links: tuple[str, ...]
    point: complex
    direction: complex | None


@dataclass(frozen=True, slots=True)
class GroupAssemblies:
    """Every assembly of a planar mechanism at some driver positions.

    Attributes:
        poses: link -> pose of each isolated assembly.
        families: why further assemblies are continuous families, one sentence for each group.
        complete: whether there are no more than `MAX_ASSEMBLIES`.
    """

    poses: tuple[dict[str, Pose], ...]
    families: tuple[str, ...]
    complete: bool


@dataclass(frozen=True, slots=True)
class GroupChain:
    """A planar mechanism as its Assur groups.

    Attributes:
        mechanism: the mechanism.
        basis: right-handed basis whose third column is the normal of its plane, (3, 3).
        decomposition: its drivers and groups.
        pairs: its pins and slides.
        body: link -> first of the links that are fixed to it.
    """

    mechanism: Mechanism
    basis: Array
    decomposition: Decomposition
    pairs: Sequence[Pairs]
    body: Mapping[str, str]

    def assemblies(self, poses: Mapping[str, Pose]) -> GroupAssemblies:
        """Return every assembly at the driver positions of one, as `group_assemblies`."""
        basis, pairs = self.basis, list[PlanePair]()

        # the pairs of the mechanism in the plane, at the reference pose
        def flat(vector: Array) -> complex:
            return complex(*(basis[:, :2].T @ vector))

        for pair in self.pairs:
            end = self.mechanism.joint(pair.joints[0]).a
            pose = poses[end.link]
            direction = None if pair.hinge else flat(pose.rotation @ np.asarray(end.axis))
            pairs.append(PlanePair(pair.links, flat(pose.point(end.point)), direction))
        pairs_of: dict[str, dict[int, PlanePair]] = {}
        for i, plane_pair in enumerate(pairs):
            for link in plane_pair.links:
                pairs_of.setdefault(link, {})[i] = plane_pair
        placed: list[Placed] = [dict.fromkeys((GROUND, *self.decomposition.drivers), AT_REFERENCE)]
        families: dict[str, None] = {}
        complete = True
        for group in self.decomposition.groups:
            complete &= len(placed) <= MAX_ASSEMBLIES
            before, placed = placed[:MAX_ASSEMBLIES], []
            of_links = {i: pair for link in group.links for i, pair in pairs_of.get(link, {}).items()}
            own = [of_links[i] for i in sorted(of_links)]
            for start in before:
                try:
                    placed += [{**start, **added} for added in _solutions(group, own, start)]
                except FamilyError as error:
                    families[f"{', '.join(group.links)}: {error}"] = None
        isolated = tuple(
            {name: _displaced(pose, assembly[self.body[name]], basis) for name, pose in poses.items()}
            for assembly in placed[:MAX_ASSEMBLIES]
        )
        return GroupAssemblies(isolated, tuple(families), complete and len(placed) <= MAX_ASSEMBLIES)


def group_assemblies(mechanism: Mechanism, poses: Mapping[str, Pose]) -> GroupAssemblies:
    """Return every assembly of a planar mechanism at the driver positions of one of its assemblies.

    The drivers stay, and the Assur groups are solved one after another. A dyad has up to two poses: its pin
    is the intersection of two circles, a circle and a line, or two lines; its slide satisfies
    |Q2 - Q1| sin(gamma - alpha) = c. A class III triad with six pins has up to six, by its sextic.

    Args:
        mechanism: a planar mechanism.
        poses: link -> pose of one assembly, the ground included.

    Returns:
        The assemblies; joint limits are not considered.

    Raises:
        InputError: if the mechanism is spatial, its groups are undetermined, or a group is neither a dyad nor
            a triad with six pins.

    Accuracy: closure to 1e-13 of the mechanism's size, except next to dead centres, where two meet.

    Source: Artobolevskii, Theory of Mechanisms and Machines, classes II and III; `triad_modes`.
    """
    return group_chain(mechanism).assemblies(poses)


def group_chain(mechanism: Mechanism) -> GroupChain:
    """Return the Assur groups of a planar mechanism, which are those of each of its poses.

    Raises:
        InputError: if the mechanism is spatial, or its groups are undetermined.
    """
    mechanism = inner_drivers_locked(pinned(mechanism))
    normal = plane_normal(mechanism)
    if mechanism.contacts:
        raise UnsolvedGroupError("a curve or cam belongs to no Assur group")
    if mechanism.couplings:
        raise UnsolvedGroupError("racks and couplings belong to no Assur group")
    decomposition = assur_groups(mechanism)
    assert normal is not None
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))]).astype(np.float64)
    first /= np.linalg.norm(first)
    basis = np.array([first, np.cross(normal, first), normal], dtype=np.float64).T
    return GroupChain(mechanism, basis, decomposition, planar_pairs(mechanism), rigid(mechanism))


def _displaced(pose: Pose, displacement: Displacement, basis: Array) -> Pose:
    """Return a pose after a displacement in the plane."""
    c, s = displacement.rotation.real, displacement.rotation.imag
    rotation = basis @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ basis.T
    shift = basis[:, :2] @ np.array([displacement.shift.real, displacement.shift.imag])
    return Pose(rotation @ pose.position + shift, rotation @ pose.rotation)


def _solutions(group: AssurGroup, pairs: Sequence[PlanePair], placed: Placed) -> Iterator[Placed]:
    """Yield the displacements of the links of a group, for every pose of it."""
    own = set(group.links)
    inner = [pair for pair in pairs if len(own.intersection(pair.links)) > 1]
    outer = [
        (link, next(other for other in pair.links if other in placed), pair)
        for pair in pairs
        for link in own.intersection(pair.links)
        if len(own.intersection(pair.links)) == 1 and any(other in placed for other in pair.links)
    ]
    if len(own) == 2 and len(inner) == 1 and len(outer) == 2 and outer[0][0] != outer[1][0]:
        yield from _dyad(outer[0], outer[1], inner[0], placed)
    elif len(own) == 4 and len(inner) == len(outer) == 3:
        yield from _triad(group, inner, outer, placed)
    else:
        raise UnsolvedGroupError(f"{group}: it is neither a dyad nor a triad with six pins")


Outer = tuple[str, str, PlanePair]


def _dyad(first: Outer, second: Outer, inner: PlanePair, placed: Placed) -> Iterator[Placed]:
    """Yield the poses of a dyad of two links, each on a placed link, with a pair between them."""
    # a pin on a placed link comes first, so that there are five cases
    if first[2].direction is not None:
        first, second = second, first
    (link, base, pin), (other, other_base, guide) = first, second
    q1, q2 = placed[base](pin.point), placed[other_base](guide.point)
    rotation = placed[base].rotation, placed[other_base].rotation
    if inner.direction is not None:
        yield from _dyad_with_inner_slide(first, second, inner, placed)
    elif pin.direction is not None and guide.direction is not None:
        # two lines: M1 + s1 u1 = M2 + s2 u2
        u1, u2 = rotation[0] * pin.direction, rotation[1] * guide.direction
        start = placed[base](inner.point)
        gap = placed[other_base](inner.point) - start
        if (s := _crossing(gap, u1, u2)) is not None:
            image = start + u1 * s
            yield {
                link: about(inner.point, image, rotation[0]),
                other: about(inner.point, image, rotation[1]),
            }
    elif guide.direction is not None:
        # circle and line: |M + s u - Q1| = r
        u, start = rotation[1] * guide.direction, placed[other_base](inner.point) - q1
        foot = (start * u.conjugate()).real
        for s in _roots(foot * foot - abs(start) ** 2 + abs(inner.point - pin.point) ** 2, abs(start) ** 2):
            image = q1 + start + (s - foot) * u
            yield {
                link: about(pin.point, q1, (image - q1) / (inner.point - pin.point)),
                other: about(inner.point, image, rotation[1]),
            }
    else:
        # two circles about Q1 and Q2
        a, b, d = inner.point - pin.point, inner.point - guide.point, q2 - q1
        if abs(d) <= ROUNDING * abs(a):
            if abs(abs(a) - abs(b)) <= ROUNDING * abs(a):
                raise FamilyError("its outer pins coincide, so that it turns about them")
            return
        along = (abs(d) ** 2 + abs(a) ** 2 - abs(b) ** 2) / (2.0 * abs(d))
        for across in _roots(abs(a) ** 2 - along**2, abs(a) ** 2):
            image = q1 + (along + 1j * across) * d / abs(d)
            yield {
                link: about(pin.point, q1, (image - q1) / a),
                other: about(guide.point, q2, (image - q2) / b),
            }


def _dyad_with_inner_slide(first: Outer, second: Outer, inner: PlanePair, placed: Placed) -> Iterator[Placed]:
    """Yield the poses of a dyad whose links slide on each other, so that both rotate alike."""
    (link, base, pin), (other, other_base, guide) = first, second
    assert inner.direction is not None
    if pin.direction is not None:
        raise UnsolvedGroupError(f"{link}, {other}: three slides leave their angle undetermined")
    q1, q2 = placed[base](pin.point), placed[other_base](guide.point)
    if guide.direction is not None:
        # the guide gives the rotation; the other link slides along the guide until the inner slide fits
        rotation = placed[other_base].rotation
        u, d = rotation * guide.direction, rotation * inner.direction
        own = about(pin.point, q1, rotation)
        gap = placed[other_base](inner.point) - own(inner.point)
        if (s := _crossing(gap, u, d)) is not None:
            yield {link: own, other: Displacement(rotation, placed[other_base].shift - s * u)}
        return
    # |Q2 - Q1| sin(gamma - alpha) = c, with gamma the angle of Q2 - Q1 from the slide
    ahead = (q2 - q1) * inner.direction.conjugate()
    offset = _cross(inner.direction, guide.point - pin.point)
    if abs(ahead) <= ROUNDING * abs(guide.point - pin.point):
        if abs(offset) <= ROUNDING * abs(guide.point - pin.point):
            raise FamilyError("its outer pins coincide, so that it turns about them")
        return
    for along in _roots(abs(ahead) ** 2 - offset**2, abs(ahead) ** 2):
        rotation = ahead / (along + 1j * offset)
        yield {link: about(pin.point, q1, rotation), other: about(guide.point, q2, rotation)}


def _triad(
    group: AssurGroup, inner: Sequence[PlanePair], outer: Sequence[Outer], placed: Placed
) -> Iterator[Placed]:
    """Yield the poses of a link on three legs, all with pins."""
    common = set.intersection(*({*pair.links} for pair in inner)).intersection(group.links)
    legs = {link: (base, pair) for link, base, pair in outer}
    if (
        len(common) != 1
        or len(legs) != 3
        or any(p.direction is not None for p in (*inner, *(o[2] for o in outer)))
    ):
        raise UnsolvedGroupError(f"{group}: it is no link on three legs with pins")
    platform = common.pop()
    order = [next(link for link in pair.links if link in legs) for pair in inner]
    points, pins = [pair.point for pair in inner], [legs[link][1].point for link in order]
    images = [placed[legs[link][0]](pin) for link, pin in zip(order, pins, strict=True)]
    lengths = [abs(point - pin) for point, pin in zip(points, pins, strict=True)]
    if min(lengths) < MIN_LEG * max(*lengths, abs(images[1] - images[0]), abs(images[2] - images[0])):
        raise UnsolvedGroupError(f"{group}: its legs are too short for the sextic")
    for x, y, theta in triad_modes(_columns(images), _columns(points), lengths):
        if np.isfinite(theta):
            own = Displacement(cmath.exp(1j * theta), complex(x, y))
            moved = zip(order, points, pins, images, strict=True)
            yield {platform: own} | {
                link: about(pin, image, (own(point) - image) / (point - pin))
                for link, point, pin, image in moved
            }


def _columns(values: Sequence[complex]) -> Array:
    return np.array([[value.real, value.imag] for value in values])


def _roots(discriminant: float, scale: float) -> tuple[float, ...]:
    """Return the square roots of a discriminant: two, one at a dead centre, none if it is negative."""
    if discriminant < -DISCRIMINANT_ROUNDING * scale:
        return ()
    if discriminant <= DISCRIMINANT_ROUNDING * scale:
        return (0.0,)
    root = float(np.sqrt(discriminant))
    return (root, -root)


def _crossing(gap: complex, u: complex, v: complex) -> float | None:
    """Return s with s u - gap along v, for unit vectors; None if u and v are parallel and gap is not.

    Raises:
        FamilyError: if all three are parallel.
    """
    sine = _cross(u, v)
    if abs(sine) > ROUNDING:
        return _cross(gap, v) / sine
    if abs(_cross(gap, v)) <= ROUNDING * abs(gap):
        raise FamilyError("its slides are parallel, so that it moves along them")
    return None


def _cross(u: complex, v: complex) -> float:
    return (u.conjugate() * v).imag
