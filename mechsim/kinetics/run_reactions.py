"""Joint reactions along a run of forward dynamics."""

from collections.abc import Mapping

import numpy as np

from mechsim.errors import InputError
from mechsim.kinetics.applied_forces import applied, loads
from mechsim.kinetics.dynamic_run import DynamicRun
from mechsim.kinetics.load_friction import with_load_friction
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.reactions import balance
from mechsim.kinetics.unit_motion import as_moved
from mechsim.mechanism.force_record import Reaction


def joint_reactions(model: DynamicModel, run: DynamicRun) -> Mapping[str, Reaction]:
    """Return the reaction of every joint along a run from an initial state, joint -> reaction.

    Newton's and Euler's equations of every link at the accelerations of the run. Motors, controllers and
    drives act along drivers.

    Args:
        model: the model of the run, from `dynamic_model` with the same forces.
        run: its run.

    Raises:
        InputError: for a run with sticking friction or touched stops, and for controllers, actuators and
            armature of joints that are not drivers: their forces along the joints are not computed.
    """
    forces = model.forces
    moved = {controller.coordinate for controller in forces.controllers}.union(
        forces.armature, *(actuator.gear for actuator in forces.actuators)
    )
    other = sorted(moved - {*model.mechanism.drivers})
    other += [f"the line of actuator {actuator.name}" for actuator in forces.actuators if actuator.ends]
    stuck = next((segment.first for segment in run.segments if segment.sticking), None)
    if other or stuck is not None:
        where = (
            f"forces act along {', '.join(other)}, not a driver"
            if other
            else f"a joint sticks or touches a stop at {stuck:g} s"
        )
        raise InputError(f"{model.mechanism.name}: {where}; the reactions of such a run are not computed")
    unit = as_moved(model.mechanism, run.motion)
    once = np.ones(len(run))
    needed = unit.inertial(once, 0.0 * once) - loads(model, unit, run.time).wrenches
    acting = with_load_friction(unit, forces, applied(model, unit), needed, once)
    return balance(unit, needed - acting.total(once)).reactions
