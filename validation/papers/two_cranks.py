"""The warp knitter without its gears: both cranks driven on their own, W = 2."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.warp_knitter import WarpKnitter
from mechsim.analytic.vector_method.triad import carried, flat, xyz
from mechsim.analytic.vector_method.triad_path import Pivots, TriadPath
from mechsim.errors import AssemblyError
from mechsim.model.joints import End
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet


def velocities(
    drive: WarpKnitter, angle1: ArrayLike, angle2: ArrayLike, speed1: ArrayLike, speed2: ArrayLike
) -> dict[str, Array]:
    """Return velocities of the tracked points, both cranks at angles and speeds of their own.

    Args:
        drive: the mechanism; says which assembly is meant.
        angle1: angle of crank 1 from +X, scalar or (n,) in [rad].
        angle2: angle of crank 2 from +X, likewise.
        speed1: speed of crank 1, scalar or (n,) in [rad/s].
        speed2: speed of crank 2, likewise.

    Returns:
        Tracked point -> (n, 3) in [m/s], by the loop equations. The assembly is the one got by turning
        the geared cranks to `angle1`, then crank 2 alone, in the shorter sense, to `angle2`.

    Raises:
        AssemblyError: where crank 2 cannot be turned so.
    """
    given = np.broadcast_arrays(*np.atleast_1d(angle1, angle2, speed1, speed2))
    f1, f2, w1, w2 = (np.asarray(x, dtype=np.float64) for x in given)
    o2, e = complex(*drive.pivot2), complex(*drive.pivot_rocker)
    turned1, turned2 = (Jet(f, w, np.zeros_like(w)) for f, w in ((f1, w1), (f2, w2)))
    a, d = drive.crank1 * np.exp(1j * turned1), o2 + drive.crank2 * np.exp(1j * turned2)
    place, turn = carried(*_poses(drive, f1, f2), [a, d, e], drive.platform)
    b, c, k = (place + turn * point for point in drive.platform)
    return {name: xyz(point.rate).T for name, point in zip("ABCDK", (a, b, c, d, k), strict=True)}


def one_crank_stopped(drive: WarpKnitter, stopped: Literal["crank1", "crank2"], angle: float) -> Mechanism:
    """Return the mechanism with one crank stopped virtually and the other driving, W = 1.

    Args:
        drive: the mechanism; says which assembly is meant.
        stopped: the crank that becomes part of the frame.
        angle: of crank 1 from +X in [rad], where both cranks stand as the gears put them; the guess is
            there, at the driving crank's own angle.

    Source: paper 003, the exchange of drivers, eqs (1)-(5).
    """
    links = drive.solve([angle]).links
    held = Pose(links[stopped].position[0], links[stopped].rotation[0])

    def end(side: End) -> End:
        if side.link != stopped:
            return side
        x, y, z = (float(value) for value in held.point(side.point))
        return End(GROUND, (x, y, z))

    whole = drive.mechanism
    driver = "crank2" if stopped == "crank1" else "crank"
    points = {
        name: (GROUND, end(End(link, local)).point) if link == stopped else (link, local)
        for name, (link, local) in whole.points.items()
    }
    return replace(
        whole,
        links=tuple(link for link in whole.links if link.name != stopped),
        joints=tuple(
            replace(joint, a=end(joint.a), b=end(joint.b))
            for joint in whole.joints
            if {joint.a.link, joint.b.link} != {GROUND, stopped}
        ),
        driver=driver,
        points=points,
        gears=(),
        guess={n: Pose(m.position[0], m.rotation[0]) for n, m in links.items() if n != stopped},
        start=angle if driver == "crank" else drive.gear_ratio * angle + drive.phase,
    )


def _poses(drive: WarpKnitter, f1: Array, f2: Array) -> tuple[Any, Any]:
    """Return place and turn of the base link: the geared pose, then crank 2 turned alone to f2."""
    geared = drive.positions(f1)
    place = flat(geared["B"])
    turn = (flat(geared["C"]) - place) / complex(*drive.base_c)
    turn = turn / abs(turn)
    from_ = drive.gear_ratio * f1 + drive.phase
    rest = (f2 - from_ + np.pi) % (2.0 * np.pi) - np.pi
    for i in np.nonzero(rest)[0]:
        a = drive.crank1 * complex(np.exp(1j * f1[i]))
        centres = (a, complex(*drive.pivot2), complex(*drive.pivot_rocker))
        pivots = Pivots(centres, (0.0, drive.crank2, 0.0), (0.0, 1.0, 0.0), (0.0, float(from_[i]), 0.0))
        path = TriadPath(pivots, drive.platform, drive.sides, (place[i], turn[i]))
        there = path.poses(rest[i : i + 1])
        if not np.isfinite(there[0][0]):
            raise AssemblyError(
                f"{drive.name}: with crank 1 at {f1[i]:.6g} rad crank 2 cannot turn from {from_[i]:.6g} "
                f"to {f2[i]:.6g} rad; choose angles nearer the geared ones"
            )
        place[i], turn[i] = there[0][0], there[1][0]
    return place, turn
