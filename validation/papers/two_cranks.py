"""The warp knitter without its gears: two independently driven cranks, W = 2."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinematics.vector_method.triad import carried, flat, xyz
from mechsim.kinematics.vector_method.triad_path import Pivots, TriadPath
from mechsim.mechanism.joints import End
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet


def velocities(
    knitter: KinematicSolver, angle1: ArrayLike, angle2: ArrayLike, speed1: ArrayLike, speed2: ArrayLike
) -> dict[str, Array]:
    """Return velocities of the tracked points at independent angles and speeds of both cranks.

    Args:
        knitter: the mechanism; it selects the assembly mode.
        angle1: angle of crank 1 from +X, scalar or (n,) in [rad].
        angle2: angle of crank 2 from +X, likewise.
        speed1: speed of crank 1, scalar or (n,) in [rad/s].
        speed2: speed of crank 2, likewise.

    Returns:
        Tracked point -> (n, 3) in [m/s], by the loop equations. The assembly mode follows by rotating
        the geared cranks to `angle1`, then crank 2 alone, in the shorter direction, to `angle2`.

    Raises:
        AssemblyError: if crank 2 cannot rotate there.
    """
    arrays = np.broadcast_arrays(*np.atleast_1d(angle1, angle2, speed1, speed2))
    f1, f2, w1, w2 = (np.asarray(x, dtype=np.float64) for x in arrays)
    o2, e = complex(*knitter.pivot2), complex(*knitter.pivot_rocker)
    jet1, jet2 = (Jet(f, w, np.zeros_like(w)) for f, w in ((f1, w1), (f2, w2)))
    a, d = knitter.crank1 * np.exp(1j * jet1), o2 + knitter.crank2 * np.exp(1j * jet2)
    position, rotation = carried(*_poses(knitter, f1, f2), [a, d, e], knitter.closed_form.platform)
    b, c, k = (position + rotation * point for point in knitter.closed_form.platform)
    return {name: xyz(point.rate).T for name, point in zip("ABCDK", (a, b, c, d, k), strict=True)}


def one_crank_stopped(
    knitter: KinematicSolver, stopped: Literal["crank1", "crank2"], angle: float
) -> Mechanism:
    """Return the mechanism with one crank fixed and the other as driver, W = 1.

    Args:
        knitter: the mechanism; it selects the assembly mode.
        stopped: the crank that becomes part of the frame.
        angle: of crank 1 from +X in [rad], at which the gears determine both cranks; the initial guess is the
            configuration there.

    Source: Koshel and Koshel (docs/explanation/sources.md), the exchange of drivers, eqs (1)-(5).
    """
    links = knitter.solve([angle]).links
    stopped_pose = Pose(links[stopped].position[0], links[stopped].rotation[0])

    def end(side: End) -> End:
        if side.link != stopped:
            return side
        x, y, z = (float(value) for value in stopped_pose.point(side.point))
        return End(GROUND, (x, y, z))

    mechanism = knitter.mechanism
    driver = "crank2" if stopped == "crank1" else "crank"
    points = {
        name: (GROUND, end(End(link, local)).point) if link == stopped else (link, local)
        for name, (link, local) in mechanism.points.items()
    }
    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link.name != stopped),
        joints=tuple(
            replace(joint, a=end(joint.a), b=end(joint.b))
            for joint in mechanism.joints
            if {joint.a.link, joint.b.link} != {GROUND, stopped}
        ),
        driver=driver,
        points=points,
        gears=(),
        guess={n: Pose(m.position[0], m.rotation[0]) for n, m in links.items() if n != stopped},
        start=angle if driver == "crank" else knitter.gear_ratio * angle + knitter.phase,
    )


def _poses(knitter: KinematicSolver, f1: Array, f2: Array) -> tuple[Any, Any]:
    """Return position and rotation of the base link: the geared pose, then crank 2 rotated to f2."""
    geared = knitter.positions(f1)
    position = flat(geared["B"])
    rotation = (flat(geared["C"]) - position) / complex(*knitter.base_c)
    rotation = rotation / abs(rotation)
    geared2 = knitter.gear_ratio * f1 + knitter.phase
    remaining = (f2 - geared2 + np.pi) % (2.0 * np.pi) - np.pi
    for i in np.nonzero(remaining)[0]:
        a = knitter.crank1 * complex(np.exp(1j * f1[i]))
        centres = (a, complex(*knitter.pivot2), complex(*knitter.pivot_rocker))
        pivots = Pivots(centres, (0.0, knitter.crank2, 0.0), (0.0, 1.0, 0.0), (0.0, float(geared2[i]), 0.0))
        path = TriadPath(
            pivots, knitter.closed_form.platform, knitter.closed_form.sides, (position[i], rotation[i])
        )
        solution = path.poses(remaining[i : i + 1])
        if not np.isfinite(solution[0][0]):
            raise AssemblyError(
                f"{knitter.name}: at crank 1 {f1[i]:.6g} rad crank 2 cannot turn from {geared2[i]:.6g} "
                f"to {f2[i]:.6g} rad; choose angles closer to the geared ones"
            )
        position[i], rotation[i] = solution[0][0], solution[1][0]
    return position, rotation
