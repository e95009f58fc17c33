"""Freedoms left once the crank is held: which links move, and about what."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mechsim.analytic.loops import equations
from mechsim.model.links import GROUND, Pose, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.theory.structure.twist import NOTHING, Twist, joints_of, motion_words


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """A freedom that the crank does not take.

    Attributes:
        links: what moves.
        idle: whether it changes nothing wanted: no tracked point moves, and where a link on the frame
            takes part, no joint is carried along either (a wheel or rod that spins in place).
        text: what moves how, in words.
    """

    links: tuple[str, ...]
    idle: bool
    text: str

    def __str__(self) -> str:
        return f"{'idle freedom' if self.idle else 'freedom not driven'}: {self.text}"


def free_motions(mechanism: Mechanism, poses: Mapping[str, Pose], count: int) -> tuple[FreeMotion, ...]:
    """Name the freedoms left with the crank held.

    The null space of the loop Jacobian is split so that each freedom moves as few links as it can.

    Args:
        mechanism: the mechanism.
        poses: moving link -> one pose that closes the loops, arrays with a leading axis of length 1.
        count: how many such freedoms there are (`closure.Freedom.passive`).
    """
    if count == 0:
        return ()
    names = [link.name for link in mechanism.links]
    length = mechanism.size
    columns = np.tile([length] * 3 + [1.0] * 3, len(names))
    jacobian = equations(mechanism, poses, 0.0).jacobian[0] * columns
    jacobian /= np.linalg.norm(jacobian, axis=1, keepdims=True)
    space = np.linalg.svd(jacobian)[2][-count:].T  # (6 links, count)
    motions: list[FreeMotion] = []
    for vector in _localised(space, len(names)):
        components = vector.reshape(-1, 6)
        moving = np.linalg.norm(components, axis=1) > NOTHING * np.linalg.norm(components)
        twists: dict[str, Twist] = {}
        for name, component in zip(names, components, strict=True):
            if moving[names.index(name)]:
                shift = np.asarray(np.cross(component[3:], poses[name].position[0]), dtype=np.float64)
                twists[name] = Twist(length * component[:3] - shift, component[3:])
        motions.append(_named(mechanism, poses, twists))
    return tuple(motions)


def _localised(space: Array, links: int) -> Iterable[Array]:
    """Yield a basis of a space of twists, (6 links, k), whose vectors move few links each."""
    basis = np.zeros((space.shape[1], 0))
    for count in range(1, links + 1):
        for chosen in combinations(range(links), count):
            outside = np.ones(links, dtype=bool)
            outside[list(chosen)] = False
            rows = space[np.repeat(outside, 6)]
            inside = _null_space(np.vstack([rows, basis.T]))
            for i in range(inside.shape[1]):
                basis = np.column_stack([basis, inside[:, i]])
                yield space @ inside[:, i]
            if basis.shape[1] == space.shape[1]:
                return


def _null_space(matrix: Array) -> Array:
    if matrix.shape[0] == 0:
        return np.eye(matrix.shape[1])
    _, values, right = np.linalg.svd(matrix)
    return right[int((values > NOTHING).sum()) :].T


def _named(mechanism: Mechanism, poses: Mapping[str, Pose], twists: Mapping[str, Twist]) -> FreeMotion:
    still = NOTHING * mechanism.size

    def moves(link: str, local: Vector) -> bool:
        position = poses[link].point(local)[0]
        return float(np.linalg.norm(twists[link].velocity_at(position))) > still

    moved = [
        point for point, (link, local) in mechanism.points.items() if link in twists and moves(link, local)
    ]
    ends = [end for joint in mechanism.joints for end in (joint.a, joint.b) if end.link in twists]
    on_frame = any(GROUND in (joint.a.link, joint.b.link) for joint in joints_of(mechanism, set(twists)))
    felt = on_frame and any(moves(end.link, end.point) for end in ends)
    words = _words(mechanism, poses, twists) + (f", which moves {', '.join(moved)}" if moved else "")
    return FreeMotion(tuple(twists), not moved and not felt, words)


def _words(mechanism: Mechanism, poses: Mapping[str, Pose], twists: Mapping[str, Twist]) -> str:
    """Say how each rigid body moves; what no joint names goes with the ones that joints do name."""
    phrases: list[str] = []
    carried: list[str] = []
    for body in _rigid_bodies(twists, mechanism.size):
        motion = motion_words(mechanism, poses, body, twists[body[0]])
        if motion:
            phrases.append(f"{' and '.join(body)} {motion}")
        else:
            carried += body
    if not phrases:
        return f"{' and '.join(carried)} {'moves' if len(carried) == 1 else 'move'}"
    return ", ".join(phrases) + (f", carrying {' and '.join(carried)}" if carried else "")


def _rigid_bodies(twists: Mapping[str, Twist], length: float) -> list[tuple[str, ...]]:
    """Put links together that move as one."""
    bodies: list[list[str]] = []
    for name, twist in twists.items():
        for body in bodies:
            first = twists[body[0]]
            gap = np.concatenate([(twist.velocity - first.velocity) / length, twist.spin - first.spin])
            if np.linalg.norm(gap) <= NOTHING:
                body.append(name)
                break
        else:
            bodies.append([name])
    return [tuple(body) for body in bodies]
