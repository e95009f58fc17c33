"""The couplings of a TOML file: gears, racks and polynomials, told by their keys."""

from collections.abc import Mapping
from typing import Any

from mechsim.model.couplings import Coupling, Gear
from mechsim.model.joint_kinds import KINDS
from mechsim.model.mechanism import Mechanism
from mechsim.model.meshes import mesh_of
from mechsim.numerics.angles import TURN
from mechsim.subjects.key_types import Number
from mechsim.subjects.toml_drivers import FileCoordinates
from mechsim.subjects.toml_source import KeyPath, TomlSource
from mechsim.units import Unit

Side = str | dict[str, float]

# what tells a kind of coupling, and the keys that go with it
_KEYS_OF_KIND = {
    "ratio": ("phase", "pressure_angle"),
    "radius": ("phase", "pressure_angle"),
    "travel": ("phase", "pressure_angle"),
    "coefficients": ("zeros", "turns", "pressure_angle"),
}


def couplings_of(
    coordinates: FileCoordinates, read: Mapping[str, Any]
) -> tuple[tuple[Gear, ...], tuple[Coupling, ...]]:
    """Return the gears between revolute joints, and all other couplings."""
    gears: list[Gear] = []
    others: list[Coupling] = []
    for name, table in read.get("couplings", {}).items():
        path: KeyPath = ("couplings", name)
        with coordinates.values.source.error_context(path):
            made = _coupling(coordinates, name, table, path)
        if isinstance(made, Gear):
            gears.append(made)
        else:
            others.append(made)
    return tuple(gears), tuple(others)


def require_pitch_points(source: TomlSource, mechanism: Mechanism, read: Mapping[str, Any]) -> None:
    """Refuse a pressure angle of couplings whose geometry gives teeth no place."""
    for name, table in read.get("couplings", {}).items():
        if not table.get("pressure_angle"):
            continue
        sides = table["driven"], table.get("driver", {})
        law = next(law for law in mechanism.laws if (law.left, law.right) == sides)
        if mesh_of(mechanism, law) is None:
            reason = (
                "is of teeth, and this coupling has no pitch point; couple two hinges whose axes are "
                "parallel or meet, or a hinge and a slide across it, on the same link, or take it out"
            )
            raise source.error(("couplings", name, "pressure_angle"), reason)


def _coupling(
    coordinates: FileCoordinates, name: str, table: Mapping[str, Any], path: KeyPath
) -> Gear | Coupling:
    source = coordinates.values.source
    kind_keys = [key for key in _KEYS_OF_KIND if key in table]
    if len(kind_keys) != 1:
        has = " and ".join(kind_keys) or "none"
        reason = (
            f"has {has} of ratio (a gear), radius or travel (a rack), coefficients (a polynomial); give one"
        )
        raise source.error(path, reason)
    for key in table:
        if key not in ("driver", "driven", kind_keys[0], *_KEYS_OF_KIND[kind_keys[0]]):
            raise source.error((*path, key), f"does not go with {kind_keys[0]!r}; take it out")
    for side in ("driver", "driven"):
        side_value = table.get(side, {})
        for coordinate in (side_value,) if isinstance(side_value, str) else side_value:
            coordinates.require(coordinate, (*path, side))
    teeth = table.get("pressure_angle")
    if kind_keys[0] == "coefficients":
        return _polynomial(coordinates, name, table, path, teeth)
    driver, driven = (_single_coordinate(coordinates, table, side, path) for side in ("driver", "driven"))
    phase = coordinates.value(driven, table.get("phase", 0.0), (*path, "phase"))
    units = coordinates.units[driver], coordinates.units[driven]
    if kind_keys[0] == "ratio":
        if units[0] != units[1]:
            raise source.error(path, "is between a turn and a displacement; give radius or travel")
        if KINDS[coordinates.kinds[driver]].hinge and KINDS[coordinates.kinds[driven]].hinge:
            return Gear(driver, driven, table["ratio"], phase, teeth or 0.0)
        turns = units[0] == "rad"
        return Coupling(name, driven, driver, (phase, table["ratio"]), turns=turns, pressure_angle=teeth)
    if units[0] == units[1]:
        raise source.error(path, "is a rack between two of a kind; give a turn and a displacement")
    radius = table["radius"] if kind_keys[0] == "radius" else table["travel"] / TURN
    if radius == 0.0:
        raise source.error((*path, kind_keys[0]), "is 0; give a length, negative for the other sense")
    ratio = radius if units[0] == "rad" else 1.0 / radius
    return Coupling(name, driven, driver, (phase, ratio), pressure_angle=teeth or 0.0)


def _single_coordinate(
    coordinates: FileCoordinates, table: Mapping[str, Any], side: str, path: KeyPath
) -> str:
    """Return the one coordinate of a side."""
    value = table.get(side)
    if value is None:
        raise coordinates.values.source.error(path, f"has no {side!r}; name a coordinate")
    if not isinstance(value, str):
        reason = "is no single coordinate; name one, or give coefficients, which couple sums"
        raise coordinates.values.source.error((*path, side), reason)
    return value


def _polynomial(
    coordinates: FileCoordinates, name: str, table: Mapping[str, Any], path: KeyPath, teeth: float | None
) -> Coupling:
    values = coordinates.values
    driven: Side = table["driven"]
    driver: Side = table.get("driver", {})
    left, right = (_unit_factor(coordinates, side) for side in (driven, driver))
    coefficients: list[float] = []
    for power, written in enumerate(table["coefficients"]):
        entry_path = (*path, "coefficients", power)
        if power == 0 and isinstance(driven, str):
            coefficients.append(coordinates.value(driven, written, entry_path))
        else:
            coefficients.append(values.plain_number(written, entry_path) * (left / right**power))
    zeros = [
        _zero(coordinates, side, written, (*path, "zeros", i))
        for i, (side, written) in enumerate(
            zip((driven, driver), table.get("zeros", (0.0, 0.0)), strict=True)
        )
    ]
    pair, turns = (zeros[0], zeros[1]), table.get("turns", False)
    return Coupling(name, driven, driver, tuple(coefficients), pair, turns, teeth)


def _zero(coordinates: FileCoordinates, side: Side, written: Any, path: KeyPath) -> float:
    if isinstance(side, str):
        return coordinates.value(side, written, path)
    units: list[Unit] = [coordinates.units[name] for name in side]
    return coordinates.values.checked(Number(units[0] if units else "m", ""), written, path)


def _unit_factor(coordinates: FileCoordinates, side: Side) -> float:
    """Return what a bare number of a side counts in SI; a sum of lengths and angles is in SI."""
    factors = {coordinates.unit_in_si(name) for name in ((side,) if isinstance(side, str) else side)}
    return factors.pop() if len(factors) == 1 else 1.0
