"""A curve of assemblies as a motion of even pace, to be filmed."""

import numpy as np

from mechsim.analytic.closure.joint_motion import point_on
from mechsim.analytic.closure.tree_motion import link_poses
from mechsim.maths.arrays import Array
from mechsim.maths.polynomials import derivative
from mechsim.model.links import GROUND, Pose
from mechsim.model.motion import LinkMotion, Motion
from mechsim.theory.continuation.assembly_curve import AssemblyCurve


def crank_way(curve: AssemblyCurve) -> float:
    """Return the whole way of the crank in one round, to and fro, in [rad]."""
    stations = [0.0, *(one.arc for one in curve.crank_turns), curve.length]
    return float(np.abs(np.diff(curve.at(stations).angle)).sum())


def even_motion(curve: AssemblyCurve, steps: int, duration: float) -> Motion:
    """Return the way round a curve once, at an even pace of arc; the last instant shows the first again.

    Args:
        curve: of assemblies.
        steps: of time.
        duration: of one round in [s].

    Accuracy: poses close the loops; rates, for arrows, to about 1e-8.
    """
    arc, pace = np.linspace(0.0, curve.length, steps + 1), curve.length / duration
    found = curve.at(arc)
    first, second = (_rates(curve, arc, order) * pace**order for order in (1, 2))
    links = {
        name: _link_motion(found.poses[name], first[:, i], second[:, i])
        for name, i in curve.loops.loops.tree.links.items()
    }
    crank = [np.array([_crank_rate(curve, at, order) for at in arc.tolist()]) for order in (1, 2)]
    return Motion(
        source="loop equations",
        angle=found.angle,
        speed=crank[0] * pace,
        acceleration=crank[1] * pace**2,
        points={
            name: point_on(links[link], local)
            for name, (link, local) in curve.mechanism.points.items()
            if link != GROUND
        },
        links=links,
        time=arc / pace,
    )


def _rates(curve: AssemblyCurve, arc: Array, order: int) -> Array:
    """Return derivatives by the arc of the links' places and rotations, (n, links, 12)."""
    tree, walked = curve.loops.loops.tree, curve.walked
    of = np.array([walked.place(at) for at in arc.tolist()])
    found = np.empty((len(arc), len(tree.branches), 12))
    for i in np.unique(of).tolist():
        cell, here = walked.cells[i], link_poses(tree, walked.cells[i].closed)
        links, n = here.position.shape[0], here.position.shape[2]
        both = np.concatenate([here.position, here.rotation.reshape(links, 9, n)], 1)
        fit = derivative(cell.fitted(both.reshape(-1, n).T), order)
        scale = (2.0 / (cell.high - cell.low)) ** order
        found[of == i] = scale * cell.at(fit, arc[of == i]).reshape(-1, links, 12)
    return found


def _crank_rate(curve: AssemblyCurve, arc: float, order: int) -> float:
    i = curve.walked.place(arc)
    cell, column = curve.walked.cells[i], curve.joints.columns.index(curve.driver)
    fit = derivative(curve.joints.tables[i][:, [column]], order)
    return float(cell.at(fit, np.array([arc]))[0, 0]) * (2.0 / (cell.high - cell.low)) ** order


def _link_motion(pose: Pose, first: Array, second: Array) -> LinkMotion:
    """Return the motion of a link from rates (n, 12) of its place and rotation."""
    turn = pose.rotation.transpose(0, 2, 1)
    spin = first[:, 3:].reshape(-1, 3, 3) @ turn
    changing = second[:, 3:].reshape(-1, 3, 3) @ turn - spin @ spin
    vectors = [0.5 * (m - m.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]] for m in (spin, changing)]
    return LinkMotion(pose.position, pose.rotation, first[:, :3], vectors[0], second[:, :3], vectors[1])
