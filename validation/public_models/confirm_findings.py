"""Errors and warnings of `mechsim check` on public models, checked by MuJoCo alone.

Problem: are the findings of a linter true? Each rule states something that MuJoCo itself can show: the
residual of an equality, contacts at the start, the rank of the equality rows, the force of an actuator. This
script computes it from the compiled model, without mechsim's readers and equations, and compares the numbers
of the message. A predicted gap of a loop (MS110) is compared with the gap while MuJoCo steps the scene,
within a factor of two (`robustness/scene_findings.py` says how the scene is driven).

    python validation/public_models/confirm_findings.py FOLDER [WORD] [--steps]

FOLDER holds clones of the repositories of `models.txt`. MS110 is checked with --steps only. Prints what is
not confirmed, and exits with 1 if that is more than 1 % of the checked findings.
"""

import re
import sys
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np

import mechsim as ms
from mechsim.errors import MechsimError
from mechsim.simulation.findings.inspected import Inspected, driver_swing
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.simulation.mjcf_reader.reading import read_model

sys.path.insert(0, str(Path(__file__).parents[1] / "robustness"))
from scene_findings import FACTOR, RATES, stepped_gap

LISTED = Path(__file__).with_name("models.txt")
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
# relative difference between a number of a message, which has three digits, and MuJoCo's
DIGITS = 0.05
# singular values below this component of the largest are zero for rounded dimensions
RANK = 1e-5
# number of configurations, and their random displacement in [rad] or [m] where none is closed
STATES, NUDGE = 5, 0.05
# largest deviation of the drivers from the swing with which steps show its gap, in [rad] or [m]
FOLLOWED = 0.03
FALSE_ALARMS = 0.01


def states(model):
    """Yield data of the reference and of each keyframe."""
    for qpos in (model.qpos0, *model.key_qpos):
        yield evaluated(model, qpos)


def evaluated(model, qpos):
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    with quiet():
        mujoco.mj_forward(model, data)
    return data


def close(value, expected):
    return abs(value - expected) <= DIGITS * abs(expected) + 1e-12


def dense(model, data):
    """Return the Jacobian of the constraints, (nefc, nv)."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J.reshape(-1, model.nv)
    rows = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return rows


def closed_states(model):
    """Return closed configurations, (n, nq), or random ones near the start if none is drawn."""
    random = np.random.default_rng(0)
    try:
        return ms.sample(model, STATES).qpos
    except MechsimError:
        moved = np.repeat(model.qpos0[None], STATES, 0)
        for qpos in moved:
            mujoco.mj_integratePos(model, qpos, random.normal(size=model.nv) * NUDGE, 1.0)
        return moved


def equality_rows(model):
    """Yield closed configurations and their equality rows, (m, nv)."""
    for qpos in closed_states(model):
        data = evaluated(model, qpos)
        yield qpos, dense(model, data)[data.efc_type == EQUALITY]


def rank(matrix):
    values = np.linalg.svd(matrix, compute_uv=False)
    return int((values > RANK * values.max(initial=0.0)).sum())


def gap(model, finding):
    """An equality is as open as stated, in a start."""
    for data in states(model):
        rows = data.efc_type == EQUALITY
        for number in np.unique(data.efc_id[rows]):
            residual = data.efc_pos[rows][data.efc_id[rows] == number]
            components = (residual[:3], residual[3:], residual)
            if any(close(float(np.linalg.norm(component)), finding.value) for component in components):
                return True
            # rotations of a weld, scaled by torquescale
            scale = model.eq_data[number, 10] or 1.0
            if close(2.0 * float(np.linalg.norm(residual[3:])) / scale, finding.value):
                return True
    return False


def units(model, finding):
    """Ranges are far more than a revolution, or all ranges are at most 3.2 degrees."""
    if finding.object == "angles":
        limited = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
        return bool(np.degrees(np.abs(model.jnt_range[limited])).max() <= 3.2)
    joints = [
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in finding.object.split(", ")
    ]
    wide = [np.ptp(model.jnt_range[joint]) > 2.0 * np.pi for joint in joints if joint >= 0]
    return "degrees" in finding.message and bool(wide) and all(wide)


def determined(model, finding):
    """Equalities, and unless they lock it the other actuated joints, determine the joint of an actuator."""
    number = model.actuator(finding.object).trnid[0]
    joints = model.actuator_trnid[model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT, 0].tolist()
    others = [] if "lock" in finding.message else [model.jnt_dofadr[j] for j in joints if j != number]
    unit, dof = np.eye(model.nv), model.jnt_dofadr[number]
    for _, rows in equality_rows(model):
        scaled = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
        constrained = np.vstack([scaled, unit[others]])
        if rank(np.vstack([constrained, unit[dof]])) > rank(constrained):
            return False
    return True


def implausible(model, finding):
    """A body's inertia belongs to a size far beyond the model's, or its mass is negligible or impossible."""
    body = model.body(finding.object).id
    mass, moments = float(model.body_mass[body]), np.sort(model.body_inertia[body])
    if "radius" in finding.message:
        radius = float(re.findall(r"gyration of (\S+) m", finding.message)[0])
        return radius > model.stat.extent and close(np.sqrt(moments[2] / mass), radius)
    if "negligible" in finding.message:
        return model.body_subtreemass[body] < 1e-4 * model.body_mass.max()
    if "moments" in finding.message:
        # MuJoCo's compiler may have balanced them, or raised the smaller ones
        stated = np.sort([float(word) for word in re.findall(r"[\d.e-]+(?=,| kg m2)", finding.message)[:3]])
        return stated[2] > stated[:2].sum() and moments[2] > 0.5 * stated[2]
    return mass <= 0.0


def joint_number(model, name):
    """Return the index of a joint; a joint without a name has a number at the end, counted from 1."""
    named = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    return named if named >= 0 else int(re.findall(r"_joint(\d+)$", name)[0]) - 1


def limit(model, finding):
    """A joint or tendon starts as far outside its range as stated, or its range is one value."""
    tendon = finding.message.startswith("tendon")
    for data in states(model):
        if tendon:
            number = model.tendon(finding.object).id
            value, (low, high) = data.ten_length[number], model.tendon_range[number]
        else:
            number = joint_number(model, finding.object)
            value, (low, high) = data.qpos[model.jnt_qposadr[number]], model.jnt_range[number]
        if "only" in finding.message:
            dof = model.jnt_dofadr[number]
            moving = [np.abs(rows[:, dof]).max(initial=0.0) > 0.0 for _, rows in equality_rows(model)]
            return low == high and any(moving)
        if close(max(low - value, value - high), finding.value):
            return True
    return False


def collision(model, finding):
    """Two bodies penetrate by the stated depth at the start; joined ones at all: depths are of a motion."""
    names = set(finding.object.split(", "))
    deepest = 0.0
    at_start = list(states(model))
    for data in at_start:
        for contact in data.contact:
            if min(contact.geom) >= 0:
                bodies = {model.body(model.geom_bodyid[geom]).name for geom in contact.geom}
                if bodies == names:
                    deepest = max(deepest, -float(contact.dist))
                    if close(deepest, finding.value):
                        return True
    return "joined" in finding.message and deepest > 0.0


def redundant(model, finding):
    """The equality rows have the stated number and rank."""
    return any(len(rows) - rank(rows) >= finding.value for _, rows in equality_rows(model))


def actuator(model, finding):
    """A servo starts with the stated force, or its joint follows from the loops and the other servos."""
    number = model.actuator(finding.object).id
    if "redundant" not in finding.message:
        return any(close(abs(float(data.actuator_force[number])), finding.value) for data in states(model))
    servos = [a for a in range(model.nu) if model.actuator_biasprm[a, 1] < 0.0 and a != number]
    for qpos, rows in equality_rows(model):
        data, arms = evaluated(model, qpos), np.zeros((model.nu, model.nv))
        moment = data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(arms, *moment)
        arms /= np.maximum(np.linalg.norm(arms, axis=1, keepdims=True), 1e-300)
        if rank(np.vstack([rows, arms[servos], arms[number]])) > rank(np.vstack([rows, arms[servos]])):
            return False
    return True


def refsafe(model, finding):
    """A time constant is below two steps by the stated factor, and MuJoCo raises it."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        return False
    constants = model.eq_solref[:, 0]
    return any(close(2.0 * model.opt.timestep / c, finding.value) for c in constants if c > 0.0)


CHECKS = {
    "MS102": gap,
    "MS103": units,
    "MS104": implausible,
    "MS105": limit,
    "MS106": collision,
    "MS107": redundant,
    "MS108": actuator,
    "MS109": refsafe,
    "MS201": determined,
}


def predicted_gaps(path, computed):
    """Yield MS110 findings of a swing that MuJoCo follows, and the predicted gap over that of its steps."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    scene = Inspected(read_model(spec, lint=True))
    motion = driver_swing(scene)
    if motion is None:
        return
    observed, deviation = min(
        (stepped_gap(scene, motion, rate) for rate in RATES), key=lambda result: result[1]
    )
    if not deviation < FOLLOWED:
        return
    for finding in computed:
        number = next(loop.number for loop in scene.loops if loop.name == finding.object)
        ratio = finding.value / max(observed.get(number, 0.0), 1e-300)
        yield finding, ratio


def main(folder, word="", *, steps):
    """Print the findings that MuJoCo does not confirm, and return whether they are few enough."""
    checked, refuted = Counter(), Counter()
    names = [line for line in LISTED.read_text().splitlines() if line.strip() and not line.startswith("#")]
    for name in names:
        path = Path(folder) / name
        if word not in name or not path.exists():
            continue
        try:
            computed = [v for v in ms.check(str(path)) if v.severity != "note"]
            model = parse_file(str(path)).model
        except MechsimError as error:
            print(f"{name}: {error}")
            continue
        for finding in computed:
            check = CHECKS.get(finding.rule)
            if check is None:
                if finding.rule != "MS110":
                    print(f"{name}: no check for {finding.rule}: {finding.message}")
                continue
            checked[finding.rule] += 1
            if not check(model, finding):
                refuted[finding.rule] += 1
                print(f"{name}\n    {finding.rule} [{finding.object}]: {finding.message}", flush=True)
        soft = [v for v in computed if v.rule == "MS110"]
        for finding, ratio in predicted_gaps(path, soft) if steps and soft else ():
            checked["MS110"] += 1
            if not 1.0 / FACTOR <= ratio <= FACTOR:
                refuted["MS110"] += 1
                print(
                    f"{name}\n    {ratio:.2g} of MuJoCo's gap [{finding.object}]: {finding.message}",
                    flush=True,
                )
    for rule in sorted(checked):
        print(f"{rule}: {checked[rule]} checked, {refuted[rule]} not confirmed")
    total = sum(checked.values())
    print(f"{total} findings checked, {sum(refuted.values())} not confirmed")
    return sum(refuted.values()) <= FALSE_ALARMS * max(total, 1)


if __name__ == "__main__":
    words = [argument for argument in sys.argv[1:] if argument != "--steps"]
    sys.exit(0 if main(*words, steps="--steps" in sys.argv) else 1)
