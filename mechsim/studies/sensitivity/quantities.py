"""Quantities by name: columns of motions and of efforts, or all those of a point, a joint, a force."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from mechsim.errors import InputError
from mechsim.model.efforts import COMPONENTS
from mechsim.model.mechanism import Mechanism

AXES = "xyz"
# columns that say when, or what was asked
GIVEN = frozenset({"time", "t", "angle", "speed", "acceleration"})
# what is asked for by a word before a joint's name
OF_JOINTS = {"force": COMPONENTS[:3], "moment": COMPONENTS[3:]}


def is_effort(name: str) -> bool:
    """Whether a column is of efforts, which need masses: a torque, a force, an energy."""
    ending = name.rpartition(".")[2]
    alone = ("torque", "inertia", "inertia_slope", "kinetic", "potential")
    return (
        name in alone
        or ending in COMPONENTS
        or name.startswith(("drive ", "hold ", "gear ", "mesh ", "power_", "torque:", "force:", "moment:"))
    )


def is_rate(name: str) -> bool:
    """Whether a column is a velocity or an acceleration of a point or a joint."""
    return name.rpartition(".")[2][:1] in ("v", "a") and not is_effort(name)


def columns_of(asked: Iterable[str], known: Sequence[str], mechanism: Mechanism) -> list[str]:
    """Return the columns that names stand for, in their order, each once.

    Args:
        asked: names of columns (P3.x, rocker.v, P3.fx, torque), of points (P3: its places; P3.v, P3.a), of
            joints (rocker: its coordinates), of what a joint transmits (force:P3, moment:P3).
        known: the columns there are.
        mechanism: whose.

    Raises:
        InputError: for a name that is none of these, or none at all.
    """
    there = [name for name in known if name not in GIVEN and name not in mechanism.drivers]
    alone = f"torque:{mechanism.crank.name}" if mechanism.has_crank else ""
    found: dict[str, None] = {}
    for name in asked:
        columns = _columns("torque" if name == alone else name, there)
        if not columns:
            raise InputError(f"{mechanism.name} has no quantity {name!r}{_nearest(name, there, mechanism)}")
        found |= dict.fromkeys(columns)
    if not found:
        raise InputError("no quantity is asked for; name some, as P3,rocker,torque")
    return list(found)


def _columns(name: str, known: Sequence[str]) -> list[str]:
    if name in known:
        return [name]
    word, colon, joint = name.partition(":")
    if colon and word in OF_JOINTS:
        return [one for one in (f"{joint}.{part}" for part in OF_JOINTS[word]) if one in known]
    if colon and word == "torque" and f"drive {joint}" in known:
        return [f"drive {joint}"]
    own, dot, order = name.rpartition(".")
    rates = [f"{own}.{order}{axis}" for axis in AXES] if dot and order in ("v", "a", "f", "m") else []
    places = [f"{name}.{axis}" for axis in AXES]
    coordinates = [f"{name}.q", *(f"{name}.q{i}" for i in range(6))]
    for columns in (rates, places, coordinates):
        if found := [one for one in columns if one in known]:
            return found
    return []


def _nearest(name: str, known: Sequence[str], mechanism: Mechanism) -> str:
    """Return the end of a refusal: what was probably meant, and what there is."""
    short = [*mechanism.points, *(joint.name for joint in mechanism.joints)]
    close = get_close_matches(name, [*short, *known], n=1)
    meant = f"; did you mean {close[0]!r}?" if close else ";"
    listed = ", ".join(dict.fromkeys(short))
    return f"{meant} known are points and joints ({listed}) and columns as P.x, J.v, torque"


def unit_of(name: str, mechanism: Mechanism) -> str:
    """Return the SI unit of a column."""
    own, _, ending = name.rpartition(".")
    if ending in COMPONENTS:
        return "N" if ending[0] == "f" else "N m"
    if ending and ending[-1] in AXES and own in mechanism.points:
        return {"": "m", "v": "m/s", "a": "m/s2"}[ending[:-1]]
    if ending[:1] in ("q", "v", "a") and own in {joint.name for joint in mechanism.joints}:
        joint = mechanism.joint(own)
        part = int(ending[1:] or 0)
        return mechanism.unit(joint.coordinates[part]) + {"q": "", "v": "/s", "a": "/s2"}[ending[0]]
    if name.startswith(("drive ", "hold ", "gear ")):
        return "N" if name.split(" ", 1)[1] in mechanism.straight else "N m"
    units = {"torque": "N m", "inertia": "kg m2", "inertia_slope": "kg m2/rad"}
    return units.get(name, "W" if name.startswith("power") else "J")
