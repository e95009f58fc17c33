"""Motion of a catalogue mechanism from the frames of its links, for chunks of crank angles."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.catalog.formulas import Formulas
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.link_frames import GROUND_FRAME, LinkFrame
from mechsim.errors import AssemblyError, InputError
from mechsim.model.links import GROUND
from mechsim.model.motion import JointMotion, Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet, Values

# crank angles solved together: arrays of this length fit in the cache of a core
CHUNK = 8192


def chunks(count: int) -> list[slice]:
    """Return slices of consecutive crank angles."""
    return [slice(start, start + CHUNK) for start in range(0, count, CHUNK)]


def checked_angles(name: str, angles: ArrayLike) -> Array:
    """Return crank angles as (n,) in [rad]; they may be text.

    Raises:
        InputError: unless they are a list of finite numbers.
    """
    angles = units.si_angles(angles, f"the crank angles of {name}")
    try:
        values = np.atleast_1d(np.asarray(angles, dtype=np.float64))
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all():
        raise InputError(
            f"{name}: crank angles must be a list of finite numbers, not of shape {values.shape} "
            "or with NaN; give angles in [rad]"
        )
    return values


def positions_at(formulas: Formulas, angles: Array) -> dict[str, Array]:
    """Return the tracked points at crank angles, (n, 3) each; NaN where the loop does not close."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        frames = _frames(formulas, angles, links=False)
        return {
            name: link_frames.rows(frames[link].point(local), len(angles))
            for name, (link, local) in formulas.described.points.items()
        }


def motion_at(formulas: Formulas, angle: Jet, *, links: bool) -> Motion:
    """Return the motion at crank angles, NaN where the loop does not close."""
    mechanism, n = formulas.described, len(angle.value)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        frames = _frames(formulas, angle, links=links)
        points = {
            name: link_frames.point_motion(frames[link].point(local), n)
            for name, (link, local) in mechanism.points.items()
        }
        motion = Motion("closed form", angle.value, angle.rate, angle.second, points)
        if not links:
            return motion
        moved = {link.name: link_frames.link_motion(frames[link.name], n) for link in mechanism.links}
        joints = _joints(formulas, angle, frames)
    return replace(motion, links=moved, joints=joints, spinning=formulas.spinning)


def _frames(formulas: Formulas, angle: Values, *, links: bool) -> dict[str, LinkFrame]:
    """Return frames of links; without `links`, only of those with tracked points."""
    carriers = {link for link, _ in formulas.described.points.values()}
    frames_by_link: dict[str, LinkFrame] = {}
    for name, frame in formulas.frames(angle):
        frames_by_link[name] = frame
        if not links and carriers <= frames_by_link.keys():
            break
    return frames_by_link


def _joints(formulas: Formulas, angle: Jet, frames: Mapping[str, LinkFrame]) -> dict[str, JointMotion]:
    """Return the motion of joint coordinates; those of gears include the revolutions of the crank."""
    mechanism = formulas.described
    frame_of = {**frames, GROUND: GROUND_FRAME}
    geared = {gear.driven: gear.ratio * angle + gear.phase for gear in mechanism.gears}
    crank_angles = {mechanism.crank.name: angle, **geared}
    motions: dict[str, JointMotion] = {}
    for joint in mechanism.joints:
        coordinates: Sequence[Values] = (
            [crank_angles[joint.name]]
            if joint.name in crank_angles
            else link_frames.joint_coordinates(joint, frame_of[joint.a.link], frame_of[joint.b.link])
        )
        motions |= link_frames.joint_motions(joint, coordinates, len(angle.value))
    return motions


def require_closed(formulas: Formulas, angles: Array, points: Mapping[str, Array]) -> None:
    """Raise AssemblyError where a closed form has no real position."""
    for position in points.values():
        if not np.isfinite(position).all():
            closed = np.isfinite(position).all(1)
            arcs = formulas.crank_range()
            where = f"its range is {arcs}" if arcs.arcs else "it cannot close at any crank angle"
            raise AssemblyError(
                f"{formulas.name}: the loop does not close at crank angle "
                f"{angles[np.argmin(closed)]:.6g} rad; {where}; "
                "change the dimensions or stay inside the range"
            )


def require_finite(formulas: Formulas, motion: Motion) -> None:
    """Raise AssemblyError where a closed form has no finite rates."""
    require_closed(formulas, motion.angle, {name: point.position for name, point in motion.points.items()})
    for point in motion.points.values():
        if not np.isfinite(point.acceleration).all():
            bounded = np.isfinite(point.acceleration).all(1)
            raise AssemblyError(
                f"{formulas.name}: crank angle {motion.angle[np.argmin(bounded)]:.6g} rad is a dead centre, "
                "where rates are unbounded; keep away from it"
            )
    for name, link in motion.links.items():
        finite = np.isfinite(link.rotation[:, 0]).all(1) & np.isfinite(link.angular_acceleration[:, 0])
        if not finite.all():
            raise AssemblyError(
                f"{formulas.name}: the orientation of link {name!r} is undetermined at crank angle "
                f"{motion.angle[np.argmin(finite)]:.6g} rad; change the angles of its guide"
            )
