"""Backlash of joints in a TOML file: between a joint and its motor.

The motor moves parallel to the joint J as `J.motor`, a coordinate with the motor's inertia alone. A coupling
with backlash drives J. Motors, armatures and drivers of J act on `J.motor`.
"""

from collections.abc import Mapping
from typing import Any

from mechsim.errors import InputError
from mechsim.io.toml_links import MASSLESS
from mechsim.mechanism.joint_kinds import KINDS, kinds_that
from mechsim.mechanism.links import VIRTUAL_PREFIX


def with_backlash(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the contents of a file, whose keys are checked, with couplings in place of backlash in joints.

    Raises:
        InputError: for a joint without a motor, or with one that has no inertia.
    """
    joints, links = dict(document.get("joints", {})), dict(document.get("links", {}))
    couplings, forces = dict(document.get("couplings", {})), dict(document.get("forces", {}))
    motors = dict[str, str]()
    for name, joint in document.get("joints", {}).items():
        if "backlash" not in joint:
            continue
        motor, shaft = f"{name}.motor", f"{VIRTUAL_PREFIX}{name}.motor"
        kind = KINDS.get(joint["kind"])
        if kind is None or not kind.single:
            kinds = kinds_that(lambda kind: kind.single)
            raise InputError(
                f"backlash is given in {joint['kind']} joint {name!r}; give it in a {kinds} joint, or a "
                "coupling"
            )
        if name in couplings:
            raise InputError(f"joint {name!r} has backlash, and a coupling has its name; rename the coupling")
        joints[name] = {key: value for key, value in joint.items() if key != "backlash"}
        joints[motor] = {"kind": joint["kind"], "a": joint["a"], "b": {**joint["b"], "link": shaft}}
        links[shaft], motors[name] = MASSLESS, motor
        couplings[name] = {"driver": motor, "driven": name, "ratio": 1, "backlash": joint["backlash"]}
        forces |= _moved_forces(forces, name, motor)
    driven: dict[str, Any] = {"drivers": [motors.get(name, name) for name in document.get("drivers", [])]}
    for key in ("motion_laws", "start"):
        entries = document.get(key)
        driven[key] = (
            {motors.get(n, n): e for n, e in entries.items()} if isinstance(entries, dict) else entries
        )
    changed = {key: entry for key, entry in driven.items() if key in document}
    tables = {"joints": joints, "links": links, "couplings": couplings, "forces": forces}
    return {**document, **tables, **changed}


def _moved_forces(forces: Mapping[str, Any], joint: str, motor: str) -> dict[str, Any]:
    """Return the motors and armatures with those of a joint on the coordinate of its motor."""
    motors = {
        name: {**entry, "joint": motor} if entry.get("joint") == joint else entry
        for name, entry in forces.get("motors", {}).items()
    }
    armature = {motor if name == joint else name: value for name, value in forces.get("armature", {}).items()}
    if motor not in armature and not any(
        entry.get("joint") == motor and "rotor" in entry for entry in motors.values()
    ):
        raise InputError(
            f"joint {joint!r} has backlash to a motor without inertia; give `rotor` in one of forces.motors "
            f"with joint {joint!r}, or forces.armature.{joint}"
        )
    return {"motors": motors, "armature": armature}
