"""Where a mechanism stands as it is put together: its poses and the values of its coordinates."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.closure.tree_assembly import assembled
from mechsim.analytic.closure.tree_motion import placed
from mechsim.errors import AssemblyError
from mechsim.model.mechanism import GROUND, IDENTITY, Mechanism, Pose, joint_coordinate

# poses nearer to each other, in sizes and as matrices, are one
SAME = 1e-9


def with_closed_guess(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose guess is where it is put together, so that every road begins in one assembly.

    It is itself where its guess is that already, or where its loops do not close.
    """
    try:
        poses = start_poses(mechanism)[0]
    except AssemblyError:
        return mechanism
    size = mechanism.size
    if mechanism.guess.keys() == poses.keys() and all(
        np.abs(pose.position - poses[name].position).max() < SAME * size
        and np.abs(pose.rotation - poses[name].rotation).max() < SAME
        for name, pose in mechanism.guess.items()
    ):
        return mechanism
    return replace(mechanism, guess=poses)


def start_poses(mechanism: Mechanism) -> tuple[dict[str, Pose], dict[str, float]]:
    """Return the poses of the moving links, closed nearest to the guess, and all coordinates there.

    Returns:
        Link -> pose; coordinate -> value in [m] or [rad], turns counted where the mechanism counts them.

    Raises:
        AssemblyError: where the loops do not close.
    """
    loops, at = assembled(mechanism)
    tree = loops.tree
    here = placed(tree, at)
    poses = {
        name: Pose(here.position[i, :, 0].copy(), here.rotation[i, :, :, 0].copy())
        for name, i in tree.links.items()
    }
    everywhere = {GROUND: IDENTITY, **poses}
    values: dict[str, float] = {}
    for joint in mechanism.joints:
        read = np.atleast_1d(joint_coordinate(joint, everywhere[joint.a.link], everywhere[joint.b.link]))
        for name, value in zip(joint.coordinates, read.tolist(), strict=False):
            place = tree.places.get(name)
            values[name] = value if place is None else float(at.values[place, 0])
    return poses, values
