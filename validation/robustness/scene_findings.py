"""Faults seeded into public models, the findings of `mechsim check`, and predicted loop-closure errors.

Each fault is seeded alone; the check must report it. The findings of the original models are printed for
inspection. With --gaps, the predicted loop-closure errors of compliant loops are compared with those of
MuJoCo's own steps.

    python validation/robustness/scene_findings.py FOLDER [--gaps]

FOLDER holds clones of the repositories in `public_mjcf.toml`; missing files are skipped.
"""

import re
import sys
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from mechsim.errors import MechsimError
from mechsim.simulation.findings import findings
from mechsim.simulation.findings.inspected import EQUALITY, Inspected, driver_swing, null_space
from mechsim.simulation.findings.predicted_gap import drive_directions, gaps_in, loop_forces
from mechsim.simulation.findings.rule_table import BY_KIND
from mechsim.simulation.findings.rules import violations
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.mjcf_reader.reading import read_model

Spec = mujoco.MjSpec
CONNECT = mujoco.mjtEq.mjEQ_CONNECT
SITES = int(mujoco.mjtObj.mjOBJ_SITE)
# largest ratio of predicted and stepped loop-closure error
FACTOR = 2.0
# rates of servos in [rad/s]
RATES = (30.0, 120.0)
# solref of the loops: as published, default, compliant, stiff
SOLREFS = {"published": None, "default": (0.02, 1.0), "soft": (0.04, 1.0), "stiff": (0.005, 1.0)}


def connect_constraints(spec):
    return [item for item in spec.equalities if item.type == CONNECT]


def connect_ends(spec, item):
    """Return both bodies of a connect constraint and its point in each, in [m]."""
    model = spec.copy().compile()
    i = [other.name for other in spec.equalities].index(item.name)
    if int(model.eq_objtype[i]) == SITES:
        sites = model.eq_obj1id[i], model.eq_obj2id[i]
        return [(model.body(model.site_bodyid[site]).name, model.site_pos[site]) for site in sites]
    bodies = model.eq_obj1id[i], max(model.eq_obj2id[i], 0)
    return [(model.body(b).name, model.eq_data[i, 3 * k : 3 * k + 3]) for k, b in enumerate(bodies)]


def body(spec, name):
    return spec.worldbody if name == "world" else spec.body(name)


def duplicate_loop(spec, length):
    (a, point), (b, _) = connect_ends(spec, connect_constraints(spec)[0])
    spec.add_equality(
        name="seeded",
        type=CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=a,
        name2=b,
        data=[*point, *[0.0] * 9],
    )


def shift_loop_end(spec, length):
    connect = connect_constraints(spec)[-1]
    (a, at_a), (b, at_b) = connect_ends(spec, connect)
    body(spec, a).add_site(name="seeded1", pos=at_a)
    body(spec, b).add_site(name="seeded2", pos=at_b + np.array([0.0, 0.0, 0.01 * length]))
    connect.objtype, connect.name1, connect.name2 = mujoco.mjtObj.mjOBJ_SITE, "seeded1", "seeded2"


def add_collision(spec, length):
    for item in list(spec.excludes):
        spec.delete(item)
    for number, (name, point) in enumerate(connect_ends(spec, connect_constraints(spec)[0])):
        body(spec, name).add_geom(
            name=f"seeded{number}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.02 * length, 0.0, 0.0],
            pos=point,
            mass=0.0,
            contype=1,
            conaffinity=1,
        )


def exclude_start(spec, length):
    model = spec.copy().compile()
    joint_id = int(np.flatnonzero(np.isin(model.jnt_type, [2, 3]))[0])
    joint, angle = spec.joint(model.joint(joint_id).name), float(model.qpos0[model.jnt_qposadr[joint_id]])
    low, high = angle + 0.1, angle + 1.0
    if spec.compiler.degree and int(model.jnt_type[joint_id]) == 3:
        low, high = np.rad2deg([low, high])
    joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, [low, high]


def soften_loops(spec, length):
    for item in spec.equalities:
        item.solref, item.solimp = [0.2, 1.0], [0.5, 0.5, 0.001, 0.5, 2.0]


def shorten_time_constant(spec, length):
    for item in spec.equalities:
        item.solref = [0.4 * spec.option.timestep, 1.0]


def stiffen_for_timestep(spec, length):
    for item in spec.equalities:
        rate = 3.0 / spec.option.timestep
        item.solref = [-(rate**2) / 2.0, -rate]
        item.solimp = [0.99, 0.99, 0.001, 0.5, 2.0]


def heaviest_body(spec):
    model = spec.copy().compile()
    moving = [b for b in range(1, model.nbody) if model.body_weldid[b] == b]
    b = max(moving, key=lambda b: model.body_mass[b])
    link = spec.body(model.body(b).name)
    link.explicitinertial, link.mass = True, model.body_mass[b]
    link.ipos, link.iquat, link.inertia = model.body_ipos[b], model.body_iquat[b], model.body_inertia[b]
    link.fullinertia = [np.nan] + [0.0] * 5
    return link


def violate_triangle(spec, length):
    link = heaviest_body(spec)
    link.inertia = np.array([1.0, 2.0, 4.0]) * link.inertia.max()


def inertia_in_mm2(spec, length):
    link = heaviest_body(spec)
    link.inertia = link.inertia * 1e6


def mass_in_grams(spec, length):
    link = heaviest_body(spec)
    link.mass = 1e3 * link.mass


def lengths_in_mm(spec, length):
    for element in spec.bodies:
        element.pos = 1000.0 * element.pos
        element.ipos = 1000.0 * element.ipos
    for element in (*spec.joints, *spec.sites, *spec.geoms):
        element.pos = 1000.0 * element.pos
    for item in connect_constraints(spec):
        item.data = [*(1000.0 * item.data[:6]), *item.data[6:]]


def remove_loop(spec, length):
    # with redundant constraints between the same bodies
    loop_bodies = {name for name, _ in connect_ends(spec, connect_constraints(spec)[0])}
    for item in connect_constraints(spec):
        if {name for name, _ in connect_ends(spec, item)} == loop_bodies:
            spec.delete(item)


def add_servos(spec, length):
    """Add a servo to every joint: more than there are degrees of freedom."""
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            servo = spec.add_actuator(
                name=f"seeded_{joint.name}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
            )
            servo.set_to_position(kp=10.0)
            servo.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE


FAULTS: dict[str, tuple[Callable[[Spec, float], None], str]] = {
    "a loop closed twice": (duplicate_loop, "redundant"),
    "a loop 1 % of the size open": (shift_loop_end, "gap"),
    "spheres at both ends of a loop": (add_collision, "collision"),
    "a range without the start": (exclude_start, "limit"),
    "soft loops": (soften_loops, "soft"),
    "a time constant of 0.4 steps": (shorten_time_constant, "refsafe"),
    "direct stiffness for a third of the step": (stiffen_for_timestep, "timestep"),
    "moments that violate the triangle inequality": (violate_triangle, "inertia"),
    "inertia in kg mm2": (inertia_in_mm2, "inertia"),
    "mass in g": (mass_in_grams, "inertia"),
    "lengths in mm": (lengths_in_mm, "units"),
    "a missing loop": (remove_loop, "open"),
    "servos on all joints": (add_servos, "actuator"),
}


def rule_findings(spec, options):
    """Return what the rules of `check` find in a specification."""
    with warnings.catch_warnings(action="ignore"):
        return violations(read_model(spec, **options))


def message_text(finding):
    """Return a message without its numbers."""
    return re.sub(r"[\d.e+-]+", "", finding.message)


@quiet()
def undetected_faults(read: MjcfModel, options, original):
    """Return the seeded faults that were not reported, and the number of seeded faults."""
    undetected, count = [], 0
    for name, (fault, kind) in FAULTS.items():
        spec = read.spec.copy()
        if not connect_constraints(spec):
            continue
        try:
            fault(spec, read.mechanism.characteristic_length)
        except (ValueError, KeyError, TypeError) as error:
            print(f"    cannot seed {name}: {' '.join(str(error).split())[:90]}")
            continue
        count += 1
        try:
            changed = rule_findings(spec, options)
        except MechsimError as error:
            undetected.append(f"{name} ({error})"[:160])
            continue
        values = {(item.rule, item.object, message_text(item)): item.value for item in original}
        new = [
            item.rule
            for item in changed
            if item.value > 1.01 * values.get((item.rule, item.object, message_text(item)), -np.inf)
        ]
        if BY_KIND[kind].code not in new:
            undetected.append(f"{name} ({', '.join(new) or 'nothing new'})")
    return undetected, count


def required_forces(scene: Inspected, motion, inputs):
    """Return the forces along `inputs` that cause a motion, and the inertia on each, (n, k) each."""
    model, data = scene.loops_only, mujoco.MjData(scene.loops_only)
    dofs = [int(model.joint(name).dofadr[0]) for name in (*scene.drivers, *scene.read.mechanism.locked)]
    forces, inertias = [], []
    for qpos, qvel, qacc in zip(motion.qpos, motion.qvel, motion.qacc, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        jacobian = data.efc_J.reshape(-1, model.nv)[data.efc_type == EQUALITY]
        remaining = inertia @ qacc + data.qfrc_bias - data.qfrc_passive
        remaining -= jacobian.T @ loop_forces(data, qacc, null_space(inputs))
        forces.append(np.linalg.lstsq(inputs.T, remaining, rcond=None)[0])
        inertias.append([inertia[d, d] / row[d] for d, row in zip(dofs, inputs, strict=True)])
    return np.array(forces), np.array(inertias), dofs


@quiet()
def stepped_gap(scene: Inspected, motion, rate):
    """Return the largest loop-closure error of each loop in a stepped run, and the largest driver error.

    The drivers have the required forces and servos of a rate in [rad/s]. Limits and actuators are disabled,
    so that only the loops carry forces.
    """
    model, inputs = scene.model, drive_directions(scene)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = motion.qpos[0], motion.qvel[0]
    forces, inertias, dofs = required_forces(scene, motion, inputs)
    # the initial transient decays in five time constants
    widest, transient_end = {}, max(0.15, 5.0 * float(np.abs(model.eq_solref[:, 0]).max()))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    offset, largest = np.zeros(model.nv), 0.0
    # after divergence MuJoCo resets its time to zero
    for _ in range(int(motion.time[-1] / model.opt.timestep)):
        i = min(int(data.time / motion.time[1]), len(motion.time) - 1)
        delay = data.time - motion.time[i]
        mujoco.mj_differentiatePos(model, offset, 1.0, data.qpos, motion.qpos[i])
        target, rate_error = (
            offset + delay * motion.qvel[i],
            motion.qvel[i] + delay * motion.qacc[i] - data.qvel,
        )
        servo = (rate**2 * target + 2.0 * rate * rate_error)[dofs]
        data.qfrc_applied[:] = inputs.T @ (forces[i] + inertias[i] * servo)
        mujoco.mj_step(model, data)
        largest = max(largest, float(np.abs(target[dofs]).max()))
        if data.time > transient_end:
            rows = data.efc_type == EQUALITY
            for loop in np.unique(data.efc_id[rows]):
                residual = data.efc_pos[rows][data.efc_id[rows] == loop][:3]
                widest[int(loop)] = max(widest.get(int(loop), 0.0), float(np.linalg.norm(residual)))
    return widest, largest


def compare_gaps(read: MjcfModel):
    """Print predicted and stepped loop-closure errors, and return whether all agree."""
    all_agree = True
    for name, solref in SOLREFS.items():
        spec = read.spec.copy()
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        for item in spec.equalities:
            if solref is not None:
                item.solref = solref
        changed = Inspected(MjcfModel(**{**vars(read), "spec": spec}))
        motion = driver_swing(changed)
        if motion is None:
            print("    its drivers determine no motion")
            return all_agree
        predicted = gaps_in(changed, motion)
        # a fast servo excites vibration, a slow one lags; the smaller error is used
        stepped, _ = min((stepped_gap(changed, motion, rate) for rate in RATES), key=lambda item: item[1])
        # negligible gaps are not compared
        pairs = [
            (predicted[i], stepped[i], loop.name)
            for i, loop in ((item.number, item) for item in changed.loops)
        ]
        pairs = [pair for pair in pairs if max(pair[:2]) > 1e-5 * changed.length]
        for expected, measured, loop in pairs:
            ratio = expected / measured
            agrees = bool(1.0 / FACTOR <= ratio <= FACTOR)
            all_agree &= agrees
            flag = "" if agrees else "  FAILED"
            print(f"    {name:10s} {loop:12s} {expected:9.2e} {measured:9.2e} {ratio:6.2f}{flag}", flush=True)
    return all_agree


def main(folder, *, measured):
    """Print the findings of every model and return whether every fault was reported."""
    models = tomllib.loads(Path(__file__).with_name("public_mjcf.toml").read_text())["model"]
    total = undetected_count = 0
    all_agree = True
    for options in models:
        path = Path(folder) / options["file"]
        if not path.exists():
            print(f"{options['name']}: missing: {path}")
            continue
        names = ("drivers", "key", "track")
        reader_options = {name: options[name] for name in names if name in options}
        reader_options |= {"fix_base": options.get("fix_base", False)}
        reader_options |= {"lock": dict.fromkeys(options.get("holds", ()))}
        try:
            read = read_model(str(path), **reader_options)
            original = findings(read)
        except MechsimError as error:
            print(f"{options['name']}: {error}")
            continue
        print(f"{options['name']}:")
        if measured:
            all_agree &= compare_gaps(read)
            continue
        for item in original:
            print(f"    {item.kind}: {item.one_line}"[:220])
        # the reader removed locked ball and free joints
        joint_names = {joint.name for joint in read.spec.joints}
        lock = {name: value for name, value in reader_options["lock"].items() if name in joint_names}
        reader_options |= {"fix_base": False, "key": None, "lock": lock}
        reference = rule_findings(read.spec.copy(), reader_options)
        undetected, count = undetected_faults(read, reader_options, reference)
        total, undetected_count = total + count, undetected_count + len(undetected)
        for item in undetected:
            print(f"    NOT REPORTED {item}")
    if not measured:
        print(f"{total - undetected_count} of {total} seeded faults reported")
    return all_agree and not undetected_count


if __name__ == "__main__":
    sys.exit(0 if main(sys.argv[1], measured="--gaps" in sys.argv) else 1)
