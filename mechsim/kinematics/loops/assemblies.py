"""All assemblies of a mechanism at driver positions, from random starts or from poses of its groups."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from mechsim.kinematics.loops.constraints import TreeLoops
from mechsim.kinematics.loops.kinematics import Coordinates, link_poses
from mechsim.kinematics.loops.mobility import undetermined_names
from mechsim.kinematics.loops.motion import spinning_links
from mechsim.kinematics.loops.path import LoopPath
from mechsim.kinematics.loops.start import all_closed, random_poses
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint, joint_coordinate
from mechsim.mechanism.limits import Ranges
from mechsim.mechanism.links import GROUND, IDENTITY, Pose, Vector
from mechsim.mechanism.motion import LinkMotion
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.loop_solver import loop_solver
from mechsim.numerics.rank import rank

# random starts in a batch; the search ends after two batches without another assembly, after MAX_BATCHES, or
# with so many assemblies: a row of n loops has up to 2**n
BATCH, MAX_BATCHES, ENOUGH = 128, 16, 200
# candidates that are closed together: the eight assemblies of Jansen's leg take 22 ms, and 30 ms alone each
TOGETHER = 8
# distance of points in characteristic lengths below which two assemblies are one: closed loops are accurate
# to 1e-12 over their conditioning
SAME_ASSEMBLY = 1e-6
# rounding of joint limits, in [rad] or [m]
LIMIT_TOLERANCE = 1e-9


def other_assemblies(
    path: LoopPath,
    parameter: float,
    ranges: Ranges,
    excluded: Sequence[Mapping[str, LinkMotion]],
    candidates: Sequence[Mapping[str, Pose]] | None = None,
) -> tuple[list[dict[str, Pose]], tuple[str, ...]]:
    """Return the link poses of the assemblies at a path parameter that are not excluded, and what else moves.

    Assemblies are distinct if a joint or a tracked point differs; the spin of a rod about its own axis does
    not count, nor do other revolutions of a nut on its screw or of a point on a closed curve. A configuration
    that moves while the drivers hold is one of a continuous family: it is not listed, but the sentences say
    what moves.

    Args:
        path: of one assembly.
        parameter: crank angle in [rad], or time multiplied by the rate of the motion laws.
        ranges: joint -> limits in [m] or [rad]; assemblies beyond them are left out.
        excluded: links of the excluded assemblies at this parameter, one instant each.
        candidates: link -> pose of every assembly; None searches from random starts.
    """
    loops, values = path.loops, path.start.values.copy()
    values[list(loops.driven)] = path.prescribed(np.array([parameter]))
    reference = replace(path.start, values=values)
    compared = list(_compared_points(path))
    excluded_poses = [
        {name: Pose(link.position.reshape(3), link.rotation.reshape(3, 3)) for name, link in links.items()}
        for links in excluded
    ]
    signatures = [_points(compared, links) for links in excluded_poses]
    screws = [joint for joint in loops.tree.original.joints if KINDS[joint.kind].helical]
    threads = _threads(screws, excluded_poses[0]) if excluded_poses else np.zeros(len(screws))
    others: list[dict[str, Pose]] = []
    families: dict[str, None] = {}

    def add(batch: Coordinates) -> None:
        for q, poses in _within(loops, batch, ranges):
            signature = _points(compared, poses)
            other_threads = excluded and np.abs(_threads(screws, poses) - threads).max(initial=0.0) > 0.5
            if not other_threads and all(
                np.abs(signature - previous).max() > SAME_ASSEMBLY * loops.tree.length
                for previous in signatures
            ):
                signatures.append(signature)
                regular = rank(loops.linearise(q)[1][:, loops.unknown, 0]) == len(loops.unknown)
                if moving := [] if regular else undetermined_names(loop_solver(loops, q)):
                    families[f"while the drivers hold, {', '.join(moving)} can move"] = None
                else:
                    others.append(poses)

    if candidates is not None:
        for first in range(0, len(candidates), TOGETHER):
            chosen = candidates[first : first + TOGETHER]
            add(all_closed(loops, loops.read(joined_poses(chosen))))
        return others, tuple(families)
    without_new = 0
    for seed in range(MAX_BATCHES):
        count = len(others)
        for _, batch in random_poses(loops, reference, BATCH, seed):
            add(batch)
        without_new = 0 if len(others) > count else without_new + 1
        if without_new == 2 or len(others) >= ENOUGH:
            break
    return others, tuple(families)


def joined_poses(poses: Sequence[Mapping[str, Pose]]) -> dict[str, Pose]:
    """Return n poses of every link together."""
    return {
        link: Pose(
            np.stack([each[link].position for each in poses]),
            np.stack([each[link].rotation for each in poses]),
        )
        for link in poses[0]
    }


def _within(
    loops: TreeLoops, q: Coordinates, ranges: Ranges
) -> Iterator[tuple[Coordinates, dict[str, Pose]]]:
    """Yield the configurations whose joints are in their ranges, in any revolution, and their link poses."""
    inside = np.ones(len(q), dtype=np.bool_)
    for name, (low, high) in ranges.items():
        if (index := loops.tree.index_of.get(name)) is None:
            continue
        value = q.values[index]
        if not loops.tree.slides[index]:
            least = low if low > -np.inf else high - REVOLUTION
            value = least + (value - least + LIMIT_TOLERANCE) % REVOLUTION - LIMIT_TOLERANCE
        inside &= (value > low - LIMIT_TOLERANCE) & (value < high + LIMIT_TOLERANCE)
    q = q.select(inside)
    poses = link_poses(loops.tree, q).by_link(loops.tree.links)
    for i, each in enumerate(q):
        yield each, {name: pose.select(i) for name, pose in poses.items()}


def _threads(screws: Sequence[Joint], links: Mapping[str, Pose]) -> Array:
    """Return the displacements of screws in revolutions, (k,)."""
    poses = {GROUND: IDENTITY, **links}
    pairs = [(joint, joint_coordinate(joint, poses[joint.a.link], poses[joint.b.link])) for joint in screws]
    return np.array([values[0] / joint.lead for joint, values in pairs])


def _compared_points(path: LoopPath) -> Iterator[tuple[str, Vector]]:
    """Yield joint points, and tracked points of links that do not spin: link and position in its frame."""
    tree, spinning = path.loops.tree, spinning_links(path.first)
    mechanism = tree.original
    for joint in mechanism.joints:
        if joint.name not in tree.closed_parameters:
            yield from ((end.link, end.point) for end in (joint.a, joint.b) if end.link != GROUND)
    for link, position in mechanism.points.values():
        if link != GROUND and link not in spinning:
            yield link, position


def _points(compared: Sequence[tuple[str, Vector]], links: Mapping[str, Pose]) -> Array:
    """Return the positions of points on links, (k, 3) in [m]."""
    return np.array([links[link].point(local) for link, local in compared])


def located(path: LoopPath, assemblies: Sequence[Mapping[str, Pose]]) -> list[dict[str, Array]]:
    """Return the tracked points of moving links in each assembly, (3,) in [m].

    Without tracked points, or if these do not distinguish the assemblies, joints between moving links do.
    """
    mechanism = path.loops.tree.original
    joints = {joint.name: (joint.a.link, joint.a.point) for joint in mechanism.joints}
    choices: list[list[dict[str, Array]]] = []
    for points in filter(None, (mechanism.points, joints)):
        moving = {name: point for name, point in points.items() if point[0] != GROUND}
        choices.append(
            [{name: own[link].point(x) for name, (link, x) in moving.items()} for own in assemblies]
        )
        pairs = combinations([np.array([*positions.values()]) for positions in choices[-1]], 2)
        apart = SAME_ASSEMBLY * mechanism.characteristic_length
        if all(np.abs(a - b).max(initial=0.0) > apart for a, b in pairs):
            return choices[-1]
    return choices[0]
