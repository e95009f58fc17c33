"""Differences of two records: functions of (computed, exact, subject) that return errors >= 0, (n,).

The subject is the name of a point, link, joint or pair of gears; it is empty for the whole record.
"""

from collections.abc import Callable, Iterable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.force_record import COMPONENTS, ForceRecord
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array, wrapped

Error = Callable[[Any, Any, str], Array | None]
Subjects = Callable[[Any, Any], Iterable[str]]

# fraction of the largest crank speed below which the crank is at rest: Coulomb friction has no direction
AT_REST = 1e-7


def lengths(vectors: Array) -> Array:
    """Return the lengths of vectors (n, k)."""
    return np.sqrt((vectors**2).sum(1))


def whole(computed: Any, exact: Any) -> tuple[str]:
    """Return one empty name: the whole record has one error."""
    return ("",)


def _every(field: str) -> Subjects:
    """Return a function for the names in a field of the exact record."""
    return lambda _, exact: getattr(exact, field)


def _determined(field: str) -> Subjects:
    """Return a function for the names in a field of the exact record whose forces are determined."""
    return lambda _, exact: [name for name in getattr(exact, field) if name not in exact.undetermined]


# tracked points, drivers under motion laws, joints that transmit forces; pairs of gears, couplings with teeth
points, drivers, reactions = _every("points"), _every("drivers"), _every("reactions")
gears, meshes = _determined("gears"), _determined("meshes")


def joints(computed: Motion, exact: Motion) -> Iterable[str]:
    """Return the joints of both records, without the crank."""
    return [name for name in exact.written_joints if name in computed.joints and name != "crank"]


def links(computed: Motion, exact: Motion) -> Iterable[str]:
    """Return the links of both records whose rotation is determined."""
    return [name for name in exact.links if name in computed.links and name not in exact.spinning]


def field_error(field: str) -> Error:
    """Return the error of a field (n,) of the records."""
    return lambda computed, exact, _: np.abs(getattr(computed, field) - getattr(exact, field))


def field_value(field: str) -> Error:
    """Return a field (n,) of the computed record as its own error; None if the method does not have it."""

    def error(computed: Any, exact: Any, _: str) -> Array | None:
        value = getattr(computed, field)
        return None if value is None else np.abs(value)

    return error


def of_points(kind: Literal["position", "velocity", "acceleration"]) -> Error:
    """Return the error of points."""

    def error(computed: Motion, exact: Motion, name: str) -> Array:
        return lengths(getattr(computed.points[name], kind) - getattr(exact.points[name], kind))

    return error


def of_joints(unit: Literal["rad", "m"]) -> Error:
    """Return the error of joint coordinates of a unit; angles differ by at most half a revolution."""

    def difference(computed: Motion, exact: Motion, name: str) -> Array | None:
        if exact.joints[name].unit != unit:
            return None
        error = computed.joints[name].value - exact.joints[name].value
        return np.abs(wrapped(error) if unit == "rad" else error)

    return difference


def orientation(computed: Motion, exact: Motion, name: str) -> Array:
    """Return the angle between the two orientations of a link, in [rad]."""
    rotation = np.swapaxes(exact.links[name].rotation, 1, 2) @ computed.links[name].rotation
    # the off-diagonal difference of a small rotation is twice the rotation vector
    vector = rotation[:, [2, 0, 1], [1, 2, 0]] - rotation[:, [1, 2, 0], [2, 0, 1]]
    cosine = 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0)
    return np.arctan2(0.5 * lengths(vector), cosine)


def drive_angle(computed: Motion, target: Motion, _: str) -> Array | None:
    """Return the error of the crank angle; None if the record has no times."""
    return None if computed.time is None else np.abs(computed.angle - target.angle)


def torque(computed: ForceRecord, exact: ForceRecord, _: str) -> Array:
    """Return the error of the drive torque; 0 where a crank with Coulomb friction stands still."""
    standing = exact.reversing & (np.abs(exact.speed) <= AT_REST * np.abs(exact.speed).max())
    return np.where(standing, 0.0, np.abs(computed.torque - exact.torque))


def of_reactions(kind: Literal["force", "moment"]) -> Error:
    """Return the error of the components of a force or moment that rigid links determine."""
    names = COMPONENTS[:3] if kind == "force" else COMPONENTS[3:]

    def error(computed: ForceRecord, exact: ForceRecord, name: str) -> Array | None:
        reference, own = exact.reactions[name], computed.reactions[name]
        if {*names} <= {*reference.undetermined} - {*reference.partly_undetermined}:
            return None
        force, moment = reference.project(own.force - reference.force, own.moment - reference.moment)
        return np.where(_discontinuous(exact), 0.0, lengths(force if kind == "force" else moment))

    return error


def drives(computed: ForceRecord, exact: ForceRecord) -> Iterable[str]:
    """Return the drivers under motion laws and the locked joints."""
    return [*exact.drives, *exact.locked]


def drive_effort(computed: ForceRecord, exact: ForceRecord, name: str) -> Array:
    """Return the error of the torque of a drive; a force is multiplied by the characteristic length."""
    own, reference = ({**record.drives, **record.locked}[name] for record in (computed, exact))
    return _along(own, reference, exact, name)


def gear_torque(computed: ForceRecord, exact: ForceRecord, name: str) -> Array:
    """Return the error of the torque of a coupling; a force is multiplied by the characteristic length."""
    return _along(computed.gears[name], exact.gears[name], exact, name)


def mesh_force(computed: ForceRecord, exact: ForceRecord, name: str) -> Array:
    """Return the error of the force at a pitch point."""
    return np.where(
        _discontinuous(exact), 0.0, lengths(computed.meshes[name].force - exact.meshes[name].force)
    )


def _along(computed: Array, reference: Array, exact: ForceRecord, name: str) -> Array:
    error = np.where(_discontinuous(exact), 0.0, np.abs(computed - reference))
    return error * exact.characteristic_length if name in exact.straight else error


def _discontinuous(exact: ForceRecord) -> NDArray[np.bool_]:
    """Return whether forces between links are discontinuous or unbounded, (n,)."""
    return exact.reversing | exact.unbounded
