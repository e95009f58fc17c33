"""A curve of assemblies as a motion at constant arc-length rate, for animations."""

import numpy as np

from mechsim.analytic.loops.joint_motion import point_on
from mechsim.analytic.loops.tree_motion import link_poses
from mechsim.model.links import GROUND, Pose
from mechsim.model.motion import LinkMotion, Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.interpolation import derivative
from mechsim.theory.continuation.assembly_curve import AssemblyCurve


def crank_path_length(curve: AssemblyCurve) -> float:
    """Return the path length of the crank angle along the whole curve, forwards and back, in [rad]."""
    stations = [0.0, *(point.arc for point in curve.crank_turns), curve.length]
    return float(np.abs(np.diff(curve.poses_at(stations).angle)).sum())


def even_motion(curve: AssemblyCurve, steps: int, duration: float) -> Motion:
    """Return the motion along a whole closed curve at constant arc-length rate; the last pose is the first.

    Args:
        curve: of assemblies.
        steps: number of time steps.
        duration: of the whole curve in [s].

    Accuracy: poses close the loops; rates, for arrows, to about 1e-8.
    """
    arc, rate = np.linspace(0.0, curve.length, steps + 1), curve.length / duration
    poses = curve.poses_at(arc)
    first, second = (_rates(curve, arc, order) * rate**order for order in (1, 2))
    links = {
        name: _link_motion(poses.poses[name], first[:, i], second[:, i])
        for name, i in curve.loops.loops.tree.links.items()
    }
    crank = [np.array([_crank_rate(curve, value, order) for value in arc.tolist()]) for order in (1, 2)]
    return Motion(
        source="loop equations",
        angle=poses.angle,
        speed=crank[0] * rate,
        acceleration=crank[1] * rate**2,
        points={
            name: point_on(links[link], local)
            for name, (link, local) in curve.mechanism.points.items()
            if link != GROUND
        },
        links=links,
        time=arc / rate,
    )


def _rates(curve: AssemblyCurve, arc: Array, order: int) -> Array:
    """Return derivatives by arc of the links' positions and rotations, (n, links, 12)."""
    tree, traced = curve.loops.loops.tree, curve.traced
    indices = np.array([traced.segment_index(value) for value in arc.tolist()])
    rates = np.empty((len(arc), len(tree.branches), 12))
    for i in np.unique(indices).tolist():
        segment, poses = traced.segments[i], link_poses(tree, traced.segments[i].coordinates)
        links, n = poses.position.shape[0], poses.position.shape[2]
        states = np.concatenate([poses.position, poses.rotation.reshape(links, 9, n)], 1)
        fit = derivative(segment.fitted(states.reshape(-1, n).T), order)
        scale = (2.0 / (segment.high - segment.low)) ** order
        rates[indices == i] = scale * segment.evaluate(fit, arc[indices == i]).reshape(-1, links, 12)
    return rates


def _crank_rate(curve: AssemblyCurve, arc: float, order: int) -> float:
    i = curve.traced.segment_index(arc)
    segment, column = curve.traced.segments[i], curve.joints.columns.index(curve.driver)
    fit = derivative(curve.joints.tables[i][:, [column]], order)
    return float(segment.evaluate(fit, np.array([arc]))[0, 0]) * (2.0 / (segment.high - segment.low)) ** order


def _link_motion(pose: Pose, first: Array, second: Array) -> LinkMotion:
    """Return the motion of a link from derivatives (n, 12) of its position and rotation."""
    transposed = pose.rotation.transpose(0, 2, 1)
    spin = first[:, 3:].reshape(-1, 3, 3) @ transposed
    changing = second[:, 3:].reshape(-1, 3, 3) @ transposed - spin @ spin
    vectors = [0.5 * (m - m.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]] for m in (spin, changing)]
    return LinkMotion(pose.position, pose.rotation, first[:, :3], vectors[0], second[:, :3], vectors[1])
