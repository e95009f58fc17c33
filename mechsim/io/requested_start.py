"""The initial assembly that a user requests by values of joints."""

from collections.abc import Mapping

from mechsim import units
from mechsim.errors import InputError
from mechsim.io.toml_values import suggestion
from mechsim.kinematics.loops.start import with_requested_start
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import number


def started_near(
    mechanism: Mechanism, requested: Mapping[str, str | float], written: units.WrittenUnits = units.SI_UNITS
) -> Mechanism:
    """Return a mechanism in the assembly nearest to requested values of joints, as text or in SI.

    Raises:
        InputError: for an unknown joint, or a value that is no angle or length.
        AssemblyError: if the loops do not close.
    """
    if not requested:
        return mechanism
    values: dict[str, float] = {}
    for name, value in requested.items():
        if name not in mechanism.coordinates:
            hint = suggestion(name, mechanism.coordinates)
            raise InputError(f"{mechanism.name} has no coordinate {name!r} to start at{hint}")
        if isinstance(value, str):
            what, length = f"the start of {name}", mechanism.characteristic_length
            value = units.parse_coordinate(value, mechanism.unit(name), what, written, length=length)
        values[name] = number(value)
    return with_requested_start(mechanism, values)
