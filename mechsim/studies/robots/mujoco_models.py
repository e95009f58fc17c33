"""Compiled MuJoCo models of anything that `load` takes, and coordinates of their joints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import mujoco

from mechsim.errors import InputError, MechsimError
from mechsim.io.mjcf_source import read_mjcf
from mechsim.io.model_source import Prescription
from mechsim.io.mujoco_inputs import mujoco_input, printed
from mechsim.kinematics.loops.rounded_geometry import corrected
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import Finding
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_configurations import keyframe
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf.joints import CRANK, limit_joints, rename_crank
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.units import Unit, si


@dataclass(frozen=True)
class StartedModel:
    """A compiled model, and the assembly in which `load` starts it.

    Attributes:
        model: the compiled model.
        initial: the assembly, (nq,); None for that of the model's reference.
        notes: a line for each part that was not read, was corrected, or starts elsewhere.
    """

    model: mujoco.MjModel
    initial: Array | None
    notes: Sequence[str]


def started_model(
    model: Any,
    set: Mapping[str, str | float] | None = None,
    loops: str | PathLike[str] | None = None,
    key: str | None = None,
    start: Mapping[str, str | float] | None = None,
) -> StartedModel:
    """Return a compiled model in the assembly in which `load` starts it; one that is started is unchanged.

    An object of MuJoCo that cannot be read starts at its reference, or a keyframe.
    """
    if isinstance(model, StartedModel):
        return model
    own = mujoco_input(model, loops)
    if own is None:
        from mechsim.io.readers import load

        solver = load(model, set, start=start, key=key, still=True)
        spec, unlimited = spec_and_unlimited(solver)
        limits = [f"the limits of {name} are left out, since a loop is cut there" for name in unlimited]
        return StartedModel(compiled(spec), None, [*solver.facts, *limits])
    if set:
        raise InputError(f"{model}: a MuJoCo model has no parameters; leave out --set")
    notes = list[str]()
    if isinstance(model, mujoco.MjModel) and loops is None:
        compiled_model = model
    else:
        parsed = parse_file(own)
        compiled_model, notes = compiled(parsed.spec), printed(parsed.unread)
    try:
        read = read_mjcf(own, Prescription(key=key, start=start or {}, still=True))
    except MechsimError:
        if start:
            raise
        return StartedModel(compiled_model, keyframe(compiled_model, key), notes)
    return StartedModel(compiled_model, read.source.qpos, read.facts)


def mujoco_spec(
    model: Any, set: Mapping[str, str | float] | None = None, loops: str | PathLike[str] | None = None
) -> mujoco.MjSpec:
    """Return the specification of a model without missing meshes."""
    own = mujoco_input(model, loops)
    if own is not None:
        return parse_file(own)[0]
    from mechsim.io.readers import load

    solver = load(model, set, still=True)
    return spec_and_unlimited(solver)[0]


def spec_and_unlimited(solver: KinematicSolver) -> tuple[mujoco.MjSpec, list[str]]:
    """Return the specification of a mechanism, and the limited joints at which it cuts a loop."""
    from mechsim.simulation.source import assembled

    spec = assembled(solver.mechanism, Scene(level="dynamics", forces=solver.forces))
    if solver.mechanism.has_crank and (name := solver.mechanism.crank.name) != CRANK:
        # models of mechanisms reserve the name of the crank, and the user knows it by its own
        rename_crank(spec, name)
    stops = {} if solver.forces is None else solver.forces.stop_ranges
    return spec, limit_joints(spec, {**solver.ranges, **stops})


def rounded_angle(model: Any) -> Finding | None:
    """Return the rounded angle that locks the loops of a mechanism as it is written; None for none."""
    from mechsim.io.readers import open_model

    return corrected(open_model(model).describe({}, Prescription(still=True)).solver.mechanism).finding


def ranges_in_si(
    model: mujoco.MjModel, ranges: Mapping[str, tuple[float | str, float | str] | None]
) -> dict[str, tuple[float, float] | None]:
    """Return ranges of joints in [rad] or [m] from numbers in SI or text; None means the joint limits."""
    return {
        name: ends and (quantity_of_joint(model, name, ends[0]), quantity_of_joint(model, name, ends[1]))
        for name, ends in ranges.items()
    }


def quantity_of_joint(model: mujoco.MjModel, name: str, value: float | str) -> float:
    """Return a coordinate of a joint in SI; text may have a unit."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    unit: Unit = "m" if joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"
    return float(si(value, unit, f"the value of {name}"))
