"""Faults seeded into public models, what is found of them, and gaps of loops against what was predicted.

Problem: `mechsim check` accuses a scene of faults. Reference: we know the faults, for we put them there, one
at a time; of the originals every accusation is printed, to be checked by eye; and of soft loops MuJoCo's own
steps tell by how much they open.

    python validation/robustness/scene_findings.py FOLDER [--gaps]

FOLDER holds clones as for `public_mjcf.py`; a file that is not there is skipped.
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
from mechsim.simulation.findings.inspected import EQUALITY, Inspected, driver_swing
from mechsim.simulation.findings.predicted_gap import drive_directions, gaps_in, loop_forces
from mechsim.simulation.findings.rules import BY_KIND, violations
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader import MjcfModel, read_model

Spec = mujoco.MjSpec
CONNECT = mujoco.mjtEq.mjEQ_CONNECT
SITES = int(mujoco.mjtObj.mjOBJ_SITE)
# a prediction within this factor of what steps show is right
FACTOR = 2.0
# of servos, in [rad/s]
RATES = (30.0, 120.0)
# softnesses that are tried: as published, MuJoCo's default, and a soft and a hard one
SOLREFS = {"published": None, "default": (0.02, 1.0), "soft": (0.04, 1.0), "hard": (0.005, 1.0)}


def connects(spec):
    return [item for item in spec.equalities if item.type == CONNECT]


def ends(spec, item):
    """Return both bodies of a connect and its point in each, in [m]."""
    model = spec.copy().compile()
    i = [other.name for other in spec.equalities].index(item.name)
    if int(model.eq_objtype[i]) == SITES:
        sites = model.eq_obj1id[i], model.eq_obj2id[i]
        return [(model.body(model.site_bodyid[s]).name, model.site_pos[s]) for s in sites]
    bodies = model.eq_obj1id[i], max(model.eq_obj2id[i], 0)
    return [(model.body(b).name, model.eq_data[i, 3 * k : 3 * k + 3]) for k, b in enumerate(bodies)]


def body(spec, name):
    return spec.worldbody if name == "world" else spec.body(name)


def twice(spec, size):
    (a, at), (b, _) = ends(spec, connects(spec)[0])
    spec.add_equality(
        name="seeded",
        type=CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=a,
        name2=b,
        data=[*at, *[0.0] * 9],
    )


def apart(spec, size):
    item = connects(spec)[-1]
    (a, at_a), (b, at_b) = ends(spec, item)
    body(spec, a).add_site(name="seeded1", pos=at_a)
    body(spec, b).add_site(name="seeded2", pos=at_b + np.array([0.0, 0.0, 0.01 * size]))
    item.objtype, item.name1, item.name2 = mujoco.mjtObj.mjOBJ_SITE, "seeded1", "seeded2"


def colliding(spec, size):
    for item in list(spec.excludes):
        spec.delete(item)
    for number, (name, at) in enumerate(ends(spec, connects(spec)[0])):
        body(spec, name).add_geom(
            name=f"seeded{number}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.02 * size, 0.0, 0.0],
            pos=at,
            mass=0.0,
            contype=1,
            conaffinity=1,
        )


def limited(spec, size):
    model = spec.copy().compile()
    hinge = int(np.flatnonzero(np.isin(model.jnt_type, [2, 3]))[0])
    joint, at = spec.joint(model.joint(hinge).name), float(model.qpos0[model.jnt_qposadr[hinge]])
    low, high = at + 0.1, at + 1.0
    if spec.compiler.degree and int(model.jnt_type[hinge]) == 3:
        low, high = np.rad2deg([low, high])
    joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, [low, high]


def softened(spec, size):
    for item in spec.equalities:
        item.solref, item.solimp = [0.2, 1.0], [0.5, 0.5, 0.001, 0.5, 2.0]


def clamped(spec, size):
    for item in spec.equalities:
        item.solref = [0.4 * spec.option.timestep, 1.0]


def hasty(spec, size):
    for item in spec.equalities:
        rate = 3.0 / spec.option.timestep
        item.solref = [-(rate**2) / 2.0, -rate]
        item.solimp = [0.99, 0.99, 0.001, 0.5, 2.0]


def heaviest(spec):
    model = spec.copy().compile()
    moving = [b for b in range(1, model.nbody) if model.body_weldid[b] == b]
    b = max(moving, key=lambda b: model.body_mass[b])
    part = spec.body(model.body(b).name)
    part.explicitinertial, part.mass = True, model.body_mass[b]
    part.ipos, part.iquat, part.inertia = model.body_ipos[b], model.body_iquat[b], model.body_inertia[b]
    part.fullinertia = [np.nan] + [0.0] * 5
    return part


def lopsided(spec, size):
    part = heaviest(spec)
    part.inertia = np.array([1.0, 2.0, 4.0]) * part.inertia.max()


def in_square_millimetres(spec, size):
    part = heaviest(spec)
    part.inertia = part.inertia * 1e6


def in_grams(spec, size):
    part = heaviest(spec)
    part.mass = 1e3 * part.mass


def in_millimetres(spec, size):
    for part in spec.bodies:
        part.pos = 1000.0 * part.pos
        part.ipos = 1000.0 * part.ipos
    for part in (*spec.joints, *spec.sites, *spec.geoms):
        part.pos = 1000.0 * part.pos
    for item in connects(spec):
        item.data = [*(1000.0 * item.data[:6]), *item.data[6:]]


def loosened(spec, size):
    # with those that close the same loop once more
    gone = {name for name, _ in ends(spec, connects(spec)[0])}
    for item in connects(spec):
        if {name for name, _ in ends(spec, item)} == gone:
            spec.delete(item)


def second_servo(spec, size):
    """Put a servo on every joint of the loops' links: more than there are degrees of freedom."""
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            servo = spec.add_actuator(
                name=f"seeded_{joint.name}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
            )
            servo.set_to_position(kp=10.0)
            servo.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE


FAULTS: dict[str, tuple[Callable[[Spec, float], None], str]] = {
    "a loop closed twice": (twice, "redundant"),
    "a loop 1 % of the size open": (apart, "gap"),
    "balls about both ends of a loop": (colliding, "collision"),
    "a range beside the start": (limited, "limit"),
    "soft loops": (softened, "soft"),
    "a time constant of 0.4 steps": (clamped, "refsafe"),
    "direct stiffness for a third of the step": (hasty, "timestep"),
    "moments against the triangle": (lopsided, "inertia"),
    "inertia in kg mm2": (in_square_millimetres, "inertia"),
    "mass in g": (in_grams, "inertia"),
    "lengths in mm": (in_millimetres, "units"),
    "a loop left out": (loosened, "open"),
    "servos on all joints": (second_servo, "actuator"),
}


def found_in(spec, asked):
    """Return what the rules of `check` find in a specification."""
    with warnings.catch_warnings(action="ignore"):
        return violations(read_model(spec, **asked))


def _words(finding):
    """Return a message without its numbers."""
    return re.sub(r"[\d.e+-]+", "", finding.message)


@quiet()
def seeded(read: MjcfModel, asked, before):
    """Return the faults of a model that were not flagged, and how many were tried."""
    missed, tried = [], 0
    for name, (fault, kind) in FAULTS.items():
        spec = read.spec.copy()
        if not connects(spec):
            continue
        try:
            fault(spec, read.mechanism.characteristic_length)
        except (ValueError, KeyError, TypeError) as error:
            print(f"    cannot seed {name}: {' '.join(str(error).split())[:90]}")
            continue
        tried += 1
        try:
            after = found_in(spec, asked)
        except MechsimError as error:
            missed.append(f"{name} ({error})"[:160])
            continue
        sizes = {(item.rule, item.object, _words(item)): item.value for item in before}
        new = [
            item.rule
            for item in after
            if item.value > 1.01 * sizes.get((item.rule, item.object, _words(item)), -np.inf)
        ]
        if BY_KIND[kind].code not in new:
            missed.append(f"{name} ({', '.join(new) or 'nothing new'})")
    return missed, tried


def efforts(scene: Inspected, motion, inputs):
    """Return what moves the drivers along `inputs` over a motion, (n, k), and the inertia on each, (n, k)."""
    model, data = scene.loops_only, mujoco.MjData(scene.loops_only)
    dofs = [int(model.joint(name).dofadr[0]) for name in (*scene.drivers, *scene.read.mechanism.locked)]
    moving, heavy = [], []
    for qpos, qvel, qacc in zip(motion.qpos, motion.qvel, motion.qacc, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        gradient = data.efc_J.reshape(-1, model.nv)[data.efc_type == EQUALITY]
        left = inertia @ qacc + data.qfrc_bias - data.qfrc_passive
        left -= gradient.T @ loop_forces(scene, data, qacc, inputs)
        moving.append(np.linalg.lstsq(inputs.T, left, rcond=None)[0])
        heavy.append([inertia[d, d] / row[d] for d, row in zip(dofs, inputs, strict=True)])
    return np.array(moving), np.array(heavy), dofs


@quiet()
def stepped_gap(scene: Inspected, motion, rate):
    """Return the widest gap of each loop as MuJoCo steps the scene, and how far its drivers were off.

    They are moved by what it takes and by servos of a rate in [rad/s]. Limits and actuators are off: no limit
    is to carry what the loops carry.
    """
    model, inputs = scene.model, drive_directions(scene)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = motion.qpos[0], motion.qvel[0]
    shares, heavy, dofs = efforts(scene, motion, inputs)
    # what is left of the first jerk dies out in five time constants
    widest, settled = {}, max(0.15, 5.0 * float(np.abs(model.eq_solref[:, 0]).max()))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    off, astray = np.zeros(model.nv), 0.0
    # a state that goes bad sets MuJoCo's time back to zero
    for _ in range(int(motion.time[-1] / model.opt.timestep)):
        i = min(int(data.time / motion.time[1]), len(motion.time) - 1)
        late = data.time - motion.time[i]
        mujoco.mj_differentiatePos(model, off, 1.0, data.qpos, motion.qpos[i])
        wanted, fast = off + late * motion.qvel[i], motion.qvel[i] + late * motion.qacc[i] - data.qvel
        servo = (rate**2 * wanted + 2.0 * rate * fast)[dofs]
        data.qfrc_applied[:] = inputs.T @ (shares[i] + heavy[i] * servo)
        mujoco.mj_step(model, data)
        astray = max(astray, float(np.abs(wanted[dofs]).max()))
        if data.time > settled:
            rows = data.efc_type == EQUALITY
            for loop in np.unique(data.efc_id[rows]):
                own = data.efc_pos[rows][data.efc_id[rows] == loop][:3]
                widest[int(loop)] = max(widest.get(int(loop), 0.0), float(np.linalg.norm(own)))
    return widest, astray


def gaps(read: MjcfModel):
    """Print what was predicted of gaps next to what steps show, and return whether all agree."""
    good = True
    for name, solref in SOLREFS.items():
        spec = read.spec.copy()
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        for item in spec.equalities:
            if solref is not None:
                item.solref = solref
        changed = Inspected(MjcfModel(**{**vars(read), "spec": spec}))
        motion = driver_swing(changed)
        if motion is None:
            print("    its drivers settle no motion")
            return good
        reported = gaps_in(changed, motion)
        # a servo that is too quick for a scene shakes it, one that is too slow lags
        observed, _ = min((stepped_gap(changed, motion, rate) for rate in RATES), key=lambda item: item[1])
        # gaps that do not show are not predicted
        pairs = [
            (reported[i], observed[i], loop.name)
            for i, loop in ((item.number, item) for item in changed.loops)
        ]
        pairs = [pair for pair in pairs if max(pair[:2]) > 1e-5 * changed.length]
        for by, previous, loop in pairs:
            near = bool(1.0 / FACTOR <= by / previous <= FACTOR)
            good &= near
            flag = "" if near else "  MISSED"
            print(
                f"    {name:10s} {loop:12s} {by:9.2e} {previous:9.2e} {by / previous:6.2f}{flag}", flush=True
            )
    return good


def main(folder, *, measured):
    """Print what is found of every model and return whether every fault was flagged."""
    listed = tomllib.loads(Path(__file__).with_name("public_mjcf.toml").read_text())["model"]
    total = lost = 0
    good = True
    for options in listed:
        path = Path(folder) / options["file"]
        if not path.exists():
            print(f"{options['name']}: not there: {path}")
            continue
        known = ("drivers", "key", "track")
        asked = {name: options[name] for name in known if name in options}
        asked |= {"fix_base": options.get("fix_base", False)}
        asked |= {"lock": dict.fromkeys(options.get("holds", ()))}
        try:
            read = read_model(str(path), **asked)
            before = findings(read)
        except MechsimError as error:
            print(f"{options['name']}: {error}")
            continue
        print(f"{options['name']}:")
        if measured:
            good &= gaps(read)
            continue
        for item in before:
            print(f"    {item.kind}: {item.one_line}"[:220])
        # the specification has no held ball and free joints any more
        kept = {joint.name for joint in read.spec.joints}
        lock = {name: value for name, value in asked["lock"].items() if name in kept}
        asked |= {"fix_base": False, "key": None, "lock": lock}
        base = found_in(read.spec.copy(), asked)
        missed, tried = seeded(read, asked, base)
        total, lost = total + tried, lost + len(missed)
        for item in missed:
            print(f"    MISSED {item}")
    if not measured:
        print(f"{total - lost} of {total} seeded faults flagged")
    return good and not lost


if __name__ == "__main__":
    sys.exit(0 if main(sys.argv[1], measured="--gaps" in sys.argv) else 1)
