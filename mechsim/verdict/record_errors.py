"""How far apart two records are: functions of (found, exact, subject) that give sizes of errors, (n,).

A subject is the name of a point, link, joint or pair of gears; empty where the whole is compared.
"""

from collections.abc import Callable, Iterable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mechsim.model.force_record import COMPONENTS, ForceRecord
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array

Error = Callable[[Any, Any, str], Array | None]
Subjects = Callable[[Any, Any], Iterable[str]]

# of the fastest: at less speed the crank stands, and dry friction has no direction
STANDING = 1e-7


def lengths(vectors: Array) -> Array:
    """Return the lengths of vectors (n, k)."""
    return np.sqrt((vectors**2).sum(1))


def whole(found: Any, exact: Any) -> tuple[str]:
    """Return one empty name: there is one error of the whole record."""
    return ("",)


def points(found: Motion, exact: Motion) -> Iterable[str]:
    """Return the tracked points."""
    return exact.points


def joints(found: Motion, exact: Motion) -> Iterable[str]:
    """Return the joints both know but the crank, at whose angles they are compared."""
    return [name for name in exact.joints if name in found.joints and name != "crank"]


def drivers(found: Motion, exact: Motion) -> Iterable[str]:
    """Return the drivers under programs."""
    return exact.drivers


def links(found: Motion, exact: Motion) -> Iterable[str]:
    """Return the links both know whose spin is determined."""
    return [name for name in exact.links if name in found.links and name not in exact.spinning]


def reactions(found: ForceRecord, exact: ForceRecord) -> Iterable[str]:
    """Return the joints that transmit forces."""
    return exact.reactions


def gears(found: ForceRecord, exact: ForceRecord) -> Iterable[str]:
    """Return the pairs of gears whose torque is determined."""
    return [name for name in exact.gears if name not in exact.undetermined]


def of(field: str) -> Error:
    """Return the error of a field (n,) of the records."""
    return lambda found, exact, _: np.abs(getattr(found, field) - getattr(exact, field))


def alone(field: str) -> Error:
    """Return a field (n,) of what was found as the error it is; None where the road does not know it."""

    def error(found: Any, exact: Any, _: str) -> Array | None:
        value = getattr(found, field)
        return None if value is None else np.abs(value)

    return error


def of_points(kind: Literal["position", "velocity", "acceleration"]) -> Error:
    """Return the error of points."""

    def error(found: Motion, exact: Motion, name: str) -> Array:
        return lengths(getattr(found.points[name], kind) - getattr(exact.points[name], kind))

    return error


def of_joints(unit: Literal["rad", "m"]) -> Error:
    """Return the error of the coordinates of joints in a unit, of angles by the shorter way round."""

    def error(found: Motion, exact: Motion, name: str) -> Array | None:
        if exact.joints[name].unit != unit:
            return None
        gap, turn = found.joints[name].value - exact.joints[name].value, 2.0 * np.pi
        return np.abs(gap - turn * np.round(gap / turn) if unit == "rad" else gap)

    return error


def orientation(found: Motion, exact: Motion, name: str) -> Array:
    """Return by what angle a link is turned, in [rad]."""
    turned = np.swapaxes(exact.links[name].rotation, 1, 2) @ found.links[name].rotation
    # for a small turn the off-diagonal difference is twice its vector
    vector = turned[:, [2, 0, 1], [1, 2, 0]] - turned[:, [1, 2, 0], [2, 0, 1]]
    cosine = 0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0)
    return np.arctan2(0.5 * lengths(vector), cosine)


def drive_angle(found: Motion, wanted: Motion, _: str) -> Array | None:
    """Return how far the crank is from where it should be; None where there is no time."""
    return None if found.time is None else np.abs(found.angle - wanted.angle)


def torque(found: ForceRecord, exact: ForceRecord, _: str) -> Array:
    """Return the error of the drive torque but where a crank with dry friction stands."""
    standing = exact.reversing & (np.abs(exact.speed) <= STANDING * np.abs(exact.speed).max())
    return np.where(standing, 0.0, np.abs(found.torque - exact.torque))


def of_reactions(kind: Literal["force", "moment"]) -> Error:
    """Return the error of forces or moments in what rigid links determine of them."""
    names = COMPONENTS[:3] if kind == "force" else COMPONENTS[3:]

    def error(found: ForceRecord, exact: ForceRecord, name: str) -> Array | None:
        one, other = exact.reactions[name], found.reactions[name]
        if {*names} <= {*one.undetermined} - {*one.partly_undetermined}:
            return None
        gaps = one.project(other.force - one.force, other.moment - one.moment)
        gap = gaps[0] if kind == "force" else gaps[1]
        return np.where(_untold(exact), 0.0, lengths(gap))

    return error


def drives(found: ForceRecord, exact: ForceRecord) -> Iterable[str]:
    """Return the drivers that programs move, and holds."""
    return [*exact.drives, *exact.locked]


def drive_effort(found: ForceRecord, exact: ForceRecord, name: str) -> Array:
    """Return the error of the torque of one drive, of a force times the size."""
    own, true = ({**one.drives, **one.locked}[name] for one in (found, exact))
    return _along(own, true, exact, name)


def gear_torque(found: ForceRecord, exact: ForceRecord, name: str) -> Array:
    """Return the error of the torque between two gears, of a force between racks times the size."""
    return _along(found.gears[name], exact.gears[name], exact, name)


def meshes(found: ForceRecord, exact: ForceRecord) -> Iterable[str]:
    """Return the couplings with teeth whose force is determined."""
    return [name for name in exact.meshes if name not in exact.undetermined]


def mesh_force(found: ForceRecord, exact: ForceRecord, name: str) -> Array:
    """Return the error of the force at a pitch point."""
    return np.where(_untold(exact), 0.0, lengths(found.meshes[name].force - exact.meshes[name].force))


def _along(found: Array, true: Array, exact: ForceRecord, name: str) -> Array:
    error = np.where(_untold(exact), 0.0, np.abs(found - true))
    return error * exact.size if name in exact.straight else error


def _untold(exact: ForceRecord) -> NDArray[np.bool_]:
    """Return where forces between links jump, or grow beyond all bounds, (n,)."""
    return exact.reversing | exact.unbounded
