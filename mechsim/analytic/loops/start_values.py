"""Where a mechanism stands as it is put together: its poses and the values of its coordinates."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.analytic.loops.tree_assembly import assembled
from mechsim.analytic.loops.tree_motion import link_poses
from mechsim.errors import AssemblyError
from mechsim.model.joints import joint_coordinate
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism

# poses nearer to each other, in sizes and as matrices, are one
SAME = 1e-9


def with_closed_guess(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose guess is where it is put together, so that every road begins in one assembly.

    Turns of coupled joints that no pose tells are counted. It is itself where its guess is that already, or
    where its loops do not close.
    """
    try:
        poses, values = start_poses(mechanism)
    except AssemblyError:
        return mechanism
    size, counted = mechanism.size, _counted(mechanism, values)
    if (
        counted == mechanism.counted
        and mechanism.guess.keys() == poses.keys()
        and all(
            np.abs(pose.position - poses[name].position).max() < SAME * size
            and np.abs(pose.rotation - poses[name].rotation).max() < SAME
            for name, pose in mechanism.guess.items()
        )
    ):
        return mechanism
    return replace(mechanism, guess=poses, counted=counted)


def _counted(mechanism: Mechanism, values: Mapping[str, float]) -> dict[str, float]:
    """Return what a mechanism counts, and coupled angles beyond half a turn where whole turns matter."""
    counted = dict(mechanism.counted)
    for law in mechanism.laws:
        for name in law.coordinates if not law.turns else ():
            already_counted = name in counted or name in mechanism.drivers or name in mechanism.locked
            if not already_counted and mechanism.unit(name) == "rad" and abs(values[name]) > np.pi:
                counted[name] = values[name]
    return counted


def start_poses(mechanism: Mechanism) -> tuple[dict[str, Pose], dict[str, float]]:
    """Return the poses of the moving links, closed nearest to the guess, and all coordinates there.

    Returns:
        Link -> pose; coordinate -> value in [m] or [rad], turns counted where the mechanism counts them.

    Raises:
        AssemblyError: where the loops do not close.
    """
    loops, q = assembled(mechanism)
    tree = loops.tree
    tree_poses = link_poses(tree, q)
    poses = {
        name: Pose(tree_poses.position[i, :, 0].copy(), tree_poses.rotation[i, :, :, 0].copy())
        for name, i in tree.links.items()
    }
    everywhere = {GROUND: IDENTITY, **poses}
    values: dict[str, float] = {}
    for joint in mechanism.joints:
        read = np.atleast_1d(joint_coordinate(joint, everywhere[joint.a.link], everywhere[joint.b.link]))
        for name, value in zip(joint.coordinates, read.tolist(), strict=False):
            index = tree.index_of.get(name)
            values[name] = value if index is None else float(q.values[index, 0])
    return poses, values
