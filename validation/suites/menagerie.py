"""Models of MuJoCo Menagerie with equality constraints, against MuJoCo's own evaluation of the files.

Free bases and joints without motor that the loops do not determine are fixed. The motors move so slowly over
1,000 configurations that only weight and springs count. MuJoCo evaluates the file at the joint coordinates of
mechsim: poses of all bodies, violations of the equality constraints, and generalised forces p of weight and
springs. The force of a motor u is -p . dq/du, with the null space dq/du of MuJoCo's own constraint Jacobian.
Meshes, friction and damping are left out of the file.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.reading import states_of
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite, rejected
from validation.suites.released import entries

EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
# configurations; every so many has its motor forces compared; duration in [s]
INSTANTS, EVERY, DURATION = 1000, 25, 1e6
# swing of a motor in [rad], or relative to the size
SWING = 0.1
TOLERANCE = 1e-9
REASON = "relative to the size and to the largest force"


def described(text: str) -> mujoco.MjSpec:
    """Return a file without meshes, textures, friction and damping."""
    spec = mujoco.MjSpec.from_string(text)
    for geom in list(spec.geoms):
        geom.material = ""
        if geom.meshname:
            spec.delete(geom)
    for item in (*spec.sites, *spec.tendons):
        item.material = ""
    for item in (*spec.meshes, *spec.skins, *spec.materials, *spec.textures):
        spec.delete(item)
    for item in (*spec.joints, *spec.tendons):
        item.frictionloss, item.damping = 0.0, np.zeros_like(item.damping)
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return spec


def moved(spec: mujoco.MjSpec, entry: Mapping[str, Any], fix_base: bool, key: str | None) -> KinematicSolver:
    """Return the solver of a file whose motors swing about the start, within their limits."""
    lock = {name: tuple(vector) for name, vector in entry.get("spins", {}).items()}
    options = {"fix_base": fix_base, "lock_others": True, "lock": lock, "key": key}
    model = ms.load(spec.copy(), still=True, **options, **entry.get("motors", {}))
    mechanism, laws = model.mechanism, {}
    for i, name in enumerate(mechanism.drivers, 1):
        lower, upper = model.ranges.get(name, (-np.inf, np.inf))
        unit = 1.0 if mechanism.unit(name) == "rad" else mechanism.characteristic_length
        swing = min(entry.get("swing", SWING) * unit, 0.4 * (upper - lower))
        middle = min(max(mechanism.guess_coordinates[name], lower + swing), upper - swing)
        laws[name] = f"{middle!r}+{swing!r}*sin(2*pi*{i}*t/{DURATION:g})"
    return ms.load(spec.copy(), drive=laws, duration=DURATION, **options)


def dofs(joint: Any) -> list[int]:
    return list(range(joint.dofadr[0], joint.dofadr[0] + len(joint.qpos0) - (len(joint.qpos0) > 1)))


def motor_forces(data: mujoco.MjData, motors: list[int], fixed: list[int]) -> np.ndarray:
    """Return the motor forces in balance with weight and springs, from MuJoCo's terms alone."""
    model, rows = data.model, data.efc_type == EQUALITY
    units = np.eye(model.nv)[[*fixed, *motors]]
    equations = np.vstack([data.efc_J.reshape(-1, model.nv)[rows], units])
    right = np.zeros((len(equations), len(motors)))
    right[len(equations) - len(motors) :] = np.eye(len(motors))
    tangent = np.linalg.lstsq(equations, right, rcond=1e-9)[0]
    return tangent.T @ (data.qfrc_bias - data.qfrc_passive)


def evaluated(model: mujoco.MjModel, solver: KinematicSolver, motion: ms.Motion) -> Iterator[mujoco.MjData]:
    """Yield MuJoCo's evaluation of the file at the joint coordinates of a motion."""
    own, data = solver.source.spec.copy().compile(), mujoco.MjData(model)
    values = {name: joint.value for name, joint in motion.joints.items()}
    # a fixed base has no coordinates of its own
    start = model.key_qpos[0] if model.nkey else model.qpos0
    for state in states_of(own, values, motion.links):
        data.qpos[:] = start
        for joint in map(own.joint, range(own.njnt)):
            data.joint(joint.name).qpos[:] = state[joint.qposadr[0] :][: len(data.joint(joint.name).qpos)]
        mujoco.mj_forward(model, data)
        yield data


@quiet()
def compared(name: str, text: str) -> Case:
    spec, entry = described(text), entries("menagerie").get(name, {})
    model = spec.copy().compile()
    joints = [model.joint(j) for j in range(model.njnt)]
    bases = [joint.name for joint in joints if joint.type[0] == mujoco.mjtJoint.mjJNT_FREE]
    solver = moved(spec, entry, bool(bases), model.key(0).name if model.nkey else None)
    times, mechanism = np.linspace(0.0, DURATION, INSTANTS), solver.mechanism
    motion, dynamic = solver.solve(t=times), ms.dynamics.dynamic_model(solver)
    drives = ms.dynamics.prescribed(dynamic, t=times[::EVERY]).forces.drives
    motors = [int(model.joint(name).dofadr[0]) for name in mechanism.drivers]
    locked = {*mechanism.locked, *bases} - {*entry.get("spins", {})}
    fixed = [dof for joint in joints if joint.name in locked for dof in dofs(joint)]
    loops, poses, forces = [], [], []
    for i, data in enumerate(evaluated(model, solver, motion)):
        loops.append(np.abs(data.efc_pos[data.efc_type == EQUALITY]).max())
        for link, own in motion.links.items():
            body = data.body(link)
            poses.append(np.abs(body.xpos - own.position[i]).max() / mechanism.characteristic_length)
            poses.append(np.abs(body.xmat.reshape(3, 3) - own.rotation[i]).max())
        if i % EVERY == 0:
            forces.append(motor_forces(data, motors, fixed))
    off = np.abs(np.array(forces).T - [drives[motor] for motor in mechanism.drivers]).max()
    values = {
        "loops": max(loops) / mechanism.characteristic_length,
        "poses of bodies": max(poses),
        "motor forces": off / np.abs(forces).max(),
    }
    return Case(name, tuple(Row(what, float(value), TOLERANCE, "", REASON) for what, value in values.items()))


def cases(clone: Clone | None) -> Iterator[Case]:
    for path in clone.paths(".") if clone else ():
        name, text = path.removesuffix(".xml"), clone.read(path) if path.endswith(".xml") else ""
        if ("<connect" not in text and "<weld" not in text) or "mjx" in name or name.endswith("_pos"):
            continue
        try:
            yield compared(name, text)
        except ms.MechsimError as error:
            yield rejected(name, error, entries("menagerie").get(name, {}))


SUITE = Suite(
    "MuJoCo Menagerie: models with loops",
    "johnnynunez/mujoco_menagerie",
    "A fork of google-deepmind/mujoco_menagerie. 1,000 configurations of each file, evaluated by MuJoCo"
    " without meshes. Licences by model.",
    cases,
)
