"""Motion of a catalogue mechanism from the frames of its links, for chunks of crank angles."""

from collections.abc import Mapping, Sequence

import numpy as np

from mechsim.analytic.catalog.formulas import Formulas, Geometry
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.link_frames import GROUND_FRAME, LinkFrame
from mechsim.errors import AssemblyError
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion, Motion, Solver
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet, Values, constant_jet, values

# crank angles solved together: arrays of this length fit in the cache of a core
CHUNK = 8192


def chunks(count: int) -> list[slice]:
    """Return slices of consecutive crank angles."""
    return [slice(start, start + CHUNK) for start in range(0, count, CHUNK)]


def motion_at(
    formulas: Formulas, angle: Values, *, links: bool, joints: bool, origin: Solver | None = None
) -> Motion:
    """Return the motion at crank angles, NaN where the loop does not close; without rates if they have none.

    Parameters of the formulas may be arrays of many designs.
    """
    mechanism, n = formulas.described, len(values(angle))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        frames, geometry = _frames(formulas, angle, every=links or joints), formulas.geometry()
        points = {
            name: link_frames.point_motion(frames[mechanism.points[name][0]].point(local), n)
            for name, local in geometry.points.items()
        }
        moved = {
            link.name: link_frames.motion_of_frame(frames[link.name], n) for link in mechanism.links if links
        }
        coordinates = _joints(mechanism, geometry, angle, frames) if joints else {}
    crank = angle if isinstance(angle, Jet) else constant_jet(angle)
    return Motion(
        "closed form",
        crank.value,
        crank.rate,
        crank.second,
        points,
        moved,
        coordinates,
        spinning=formulas.spinning if links else frozenset(),
        origin=origin,
    )


def _frames(formulas: Formulas, angle: Values, *, every: bool) -> dict[str, LinkFrame]:
    """Return frames of links; unless of every link, only of those with tracked points."""
    carriers = {link for link, _ in formulas.described.points.values()}
    frames_by_link: dict[str, LinkFrame] = {GROUND: GROUND_FRAME}
    for name, frame in formulas.frames(angle):
        frames_by_link[name] = frame
        if not every and carriers <= frames_by_link.keys():
            break
    return frames_by_link


def _joints(
    mechanism: Mechanism, geometry: Geometry, angle: Values, frames: Mapping[str, LinkFrame]
) -> dict[str, JointMotion]:
    """Return the motion of joint coordinates; those of gears include the revolutions of the crank."""
    geared = {gear.driven: gear.ratio * angle + gear.phase for gear in mechanism.gears}
    crank_angles = {mechanism.crank.name: angle, **geared}
    motions: dict[str, JointMotion] = {}
    for joint in mechanism.joints:
        coordinates: Sequence[Values] = (
            [crank_angles[joint.name]]
            if joint.name in crank_angles
            else link_frames.joint_coordinates(
                joint, frames[joint.a.link], frames[joint.b.link], geometry.frames.get(joint.name)
            )
        )
        motions |= link_frames.motions_of_joint(joint, coordinates, len(values(angle)))
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
    rates = [point.acceleration for point in motion.points.values()]
    rates += [link.angular_acceleration for link in motion.links.values()]
    # they follow from the poses, and are finite only where these are
    if all(np.isfinite(rate).all() for rate in rates):
        return
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
