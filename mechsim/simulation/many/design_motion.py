"""What is told of stepped designs: their motions at some of the recorded instants."""

from typing import Literal

import numpy as np

from mechsim.model.motion import JointMotion, Motion, PointMotion, join
from mechsim.simulation.many.design_models import Rows
from mechsim.simulation.many.stepped_designs import SteppedDesigns
from mechsim.simulation.model_loops import HINGE
from mechsim.simulation.recorded_motion import CHUNK, States, evaluate

# joints alone, which the states hold; places of points too; or rates and accelerations of all
Told = Literal["joints", "places", "rates"]


def design_motion(stepped: SteppedDesigns, rows: Rows, records: Rows, told: Told) -> Motion:
    """Return the motions of some designs at some records, one design after another.

    Of joints known are those of the tree (`LikeModel.joints`); what `told` leaves out is nought.
    """
    step = max(1, CHUNK // len(records))
    parts = [rows[first : first + step] for first in range(0, len(rows), step)]
    return join([_part(stepped, part, records, told) for part in parts])


def _part(stepped: SteppedDesigns, rows: Rows, records: Rows, told: Told) -> Motion:
    model, track = stepped.loops.model, stepped.models.like.closed.track
    at = np.ix_(rows, records)
    time = np.tile(stepped.time[records], len(rows))
    states = States(time, stepped.qpos[at].reshape(len(time), -1), stepped.qvel[at].reshape(len(time), -1))
    nothing, still = np.zeros((len(time), 3)), np.zeros(len(time))
    points: dict[str, PointMotion] = {}
    whole = None
    if told == "rates":
        whole = evaluate(stepped.over(rows, len(records)), track, states, "step")
        points = dict(whole.points)
    elif told == "places":
        sites = stepped.places_over(rows, len(records)).site_positions(states.qpos)
        points = {name: PointMotion(sites[:, model.site(name).id], nothing, nothing) for name in track.points}
    joints: dict[str, JointMotion] = {}
    for name, i in stepped.models.like.joints.items():
        place, dof = model.jnt_qposadr[i], model.jnt_dofadr[i]
        unit = "rad" if model.jnt_type[i] == HINGE else "m"
        acceleration = still
        if whole is not None:
            acceleration = whole.joints[track.name(model.joint(i).name)[0]].acceleration
        joints[name] = JointMotion(states.qpos[:, place], states.qvel[:, dof], acceleration, unit)
    loops = stepped.loops
    crank = states.qpos[:, loops.crank_address], states.qvel[:, loops.crank], still
    return Motion("step", *crank, points, joints=joints, time=time)
