"""The couplings of a TOML file: gears, racks and polynomials, told by their keys."""

from collections.abc import Mapping
from typing import Any

from mechsim.maths.angles import TURN
from mechsim.model.couplings import Coupling, Gear
from mechsim.model.joint_kinds import KINDS
from mechsim.model.mechanism import Mechanism
from mechsim.model.meshes import mesh_of
from mechsim.subjects.key_kinds import Number
from mechsim.subjects.toml_drivers import FileCoordinates
from mechsim.subjects.toml_source import KeyPath, TomlSource
from mechsim.units import Unit

Side = str | dict[str, float]

# what tells a kind of coupling, and the keys that go with it
_TOLD = {
    "ratio": ("phase", "pressure_angle"),
    "radius": ("phase", "pressure_angle"),
    "travel": ("phase", "pressure_angle"),
    "coefficients": ("zeros", "turns", "pressure_angle"),
}


def couplings_of(
    of: FileCoordinates, read: Mapping[str, Any]
) -> tuple[tuple[Gear, ...], tuple[Coupling, ...]]:
    """Return the gears between revolute joints, and all other couplings."""
    gears: list[Gear] = []
    others: list[Coupling] = []
    for name, one in read.get("couplings", {}).items():
        path: KeyPath = ("couplings", name)
        with of.values.source.about(path):
            made = _coupling(of, name, one, path)
        if isinstance(made, Gear):
            gears.append(made)
        else:
            others.append(made)
    return tuple(gears), tuple(others)


def require_pitch_points(source: TomlSource, mechanism: Mechanism, read: Mapping[str, Any]) -> None:
    """Refuse a pressure angle of couplings whose geometry gives teeth no place."""
    for name, one in read.get("couplings", {}).items():
        if not one.get("pressure_angle"):
            continue
        sides = one["driven"], one.get("driver", {})
        law = next(law for law in mechanism.laws if (law.left, law.right) == sides)
        if mesh_of(mechanism, law) is None:
            why = (
                "is of teeth, and this coupling has no pitch point; couple two hinges whose axes are "
                "parallel or meet, or a hinge and a slide across it, on the same link, or take it out"
            )
            raise source.refusal(("couplings", name, "pressure_angle"), why)


def _coupling(of: FileCoordinates, name: str, one: Mapping[str, Any], path: KeyPath) -> Gear | Coupling:
    source = of.values.source
    told = [key for key in _TOLD if key in one]
    if len(told) != 1:
        has = " and ".join(told) or "none"
        why = f"has {has} of ratio (a gear), radius or travel (a rack), coefficients (a polynomial); give one"
        raise source.refusal(path, why)
    for key in one:
        if key not in ("driver", "driven", told[0], *_TOLD[told[0]]):
            raise source.refusal((*path, key), f"does not go with {told[0]!r}; take it out")
    for side in ("driver", "driven"):
        given = one.get(side, {})
        for coordinate in (given,) if isinstance(given, str) else given:
            of.require(coordinate, (*path, side))
    teeth = one.get("pressure_angle")
    if told[0] == "coefficients":
        return _polynomial(of, name, one, path, teeth)
    driver, driven = (_alone(of, one, side, path) for side in ("driver", "driven"))
    phase = of.value(driven, one.get("phase", 0.0), (*path, "phase"))
    units = of.units[driver], of.units[driven]
    if told[0] == "ratio":
        if units[0] != units[1]:
            raise source.refusal(path, "is between a turn and a displacement; give radius or travel")
        if KINDS[of.kinds[driver]].hinge and KINDS[of.kinds[driven]].hinge:
            return Gear(driver, driven, one["ratio"], phase, teeth or 0.0)
        turns = units[0] == "rad"
        return Coupling(name, driven, driver, (phase, one["ratio"]), turns=turns, pressure_angle=teeth)
    if units[0] == units[1]:
        raise source.refusal(path, "is a rack between two of a kind; give a turn and a displacement")
    radius = one["radius"] if told[0] == "radius" else one["travel"] / TURN
    if radius == 0.0:
        raise source.refusal((*path, told[0]), "is 0; give a length, negative for the other sense")
    slope = radius if units[0] == "rad" else 1.0 / radius
    return Coupling(name, driven, driver, (phase, slope), pressure_angle=teeth or 0.0)


def _alone(of: FileCoordinates, one: Mapping[str, Any], side: str, path: KeyPath) -> str:
    """Return the one coordinate of a side."""
    given = one.get(side)
    if given is None:
        raise of.values.source.refusal(path, f"has no {side!r}; name a coordinate")
    if not isinstance(given, str):
        why = "is no single coordinate; name one, or give coefficients, which couple sums"
        raise of.values.source.refusal((*path, side), why)
    return given


def _polynomial(
    of: FileCoordinates, name: str, one: Mapping[str, Any], path: KeyPath, teeth: float | None
) -> Coupling:
    values = of.values
    driven: Side = one["driven"]
    driver: Side = one.get("driver", {})
    left, right = (_counted_in(of, side) for side in (driven, driver))
    coefficients: list[float] = []
    for power, written in enumerate(one["coefficients"]):
        place = (*path, "coefficients", power)
        if power == 0 and isinstance(driven, str):
            coefficients.append(of.value(driven, written, place))
        else:
            coefficients.append(values.bare(written, place) * (left / right**power))
    zeros = [
        _zero(of, side, written, (*path, "zeros", i))
        for i, (side, written) in enumerate(zip((driven, driver), one.get("zeros", (0.0, 0.0)), strict=True))
    ]
    pair, turns = (zeros[0], zeros[1]), one.get("turns", False)
    return Coupling(name, driven, driver, tuple(coefficients), pair, turns, teeth)


def _zero(of: FileCoordinates, side: Side, written: Any, path: KeyPath) -> float:
    if isinstance(side, str):
        return of.value(side, written, path)
    units: list[Unit] = [of.units[name] for name in side]
    return of.values.checked(Number(units[0] if units else "m", ""), written, path)


def _counted_in(of: FileCoordinates, side: Side) -> float:
    """Return what a bare number of a side counts in SI; a sum of lengths and angles is in SI."""
    counts = {of.unit_in_si(name) for name in ((side,) if isinstance(side, str) else side)}
    return counts.pop() if len(counts) == 1 else 1.0
