"""Balance of a run in the model of its file: d'Alembert's principle with MuJoCo's own forces.

At coordinates q, rates v and accelerations a of a run, MuJoCo's terms of the file leave

    r = M a + c - f_passive - f_actuator.

Constraints do no work along the free motions N, J N = 0: so N' r = 0 if the run has all forces of the file.
Unlike a run in MuJoCo, which is made from the forces as mechsim has read them, this finds what was not read.

Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), section 8.2.
"""

from collections.abc import Iterable
from dataclasses import replace

import mujoco
import numpy as np

from mechsim.mechanism.actuators import no_control
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.rank import significant
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf_reader.kinematic_tree import kinematic_tree, link_name
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.mjcf_reader.reading import states_of
from mechsim.simulation.state import FREE, SCALAR, angular_dofs

# what is no passive force of the file
WITHOUT = (
    *(mujoco.mjtDisableBit.mjDSBL_CONTACT, mujoco.mjtDisableBit.mjDSBL_LIMIT),
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
)


def has_balance(read: MjcfModel, forces: Forces) -> bool:
    """Return whether forces are all of those of a file, with other controls."""
    own, acting = (
        replace(
            each,
            actuators=tuple(replace(a, control=no_control, text="") for a in each.actuators),
        )
        for each in (read.forces, forces)
    )
    return own == acting and not read.left_out


def imbalance(
    read: MjcfModel, forces: Forces, motion: Motion, time: Array, activation: Array, fixed: Iterable[str]
) -> tuple[Array, float]:
    """Return the largest component of N' r at n instants, (n,), and the largest of its terms, in [N m].

    Forces along displacements are multiplied by the characteristic length.

    Args:
        read: the file as read.
        forces: its forces, with controls.
        motion: a run at n instants.
        time: in [s], (n,).
        activation: states of the actuators that have one, (states, n).
        fixed: coordinates along which other forces act, such as those of drivers.
    """
    model = compiled(read.spec)
    for flag in WITHOUT:
        model.opt.disableflags |= int(flag)
    model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    data = mujoco.MjData(model)
    values = {name: joint.value for name, joint in motion.joints.items()}
    qpos = states_of(model, values, motion.links)
    rates, accelerations = _rates(model, motion)
    controls, names = np.zeros((model.nu, len(time))), [*read.actuators]
    for actuator in forces.actuators:
        # passive tendons have no control
        if actuator.name in names:
            controls[names.index(actuator.name)] = actuator.control(time)[0]
    locked = np.eye(model.nv)[[int(model.joint(name).dofadr[0]) for name in fixed]]
    units = np.where(angular_dofs(model), 1.0, read.mechanism.characteristic_length)
    along_motion, scale, ranks = np.zeros(len(time)), 0.0, np.zeros(len(time), int)
    for k, (q, v, a) in enumerate(zip(qpos, rates, accelerations, strict=True)):
        data.qpos[:], data.qvel[:], data.time = q, v, time[k]
        data.ctrl[:] = controls[:, k]
        # none where actuation is switched off
        data.act[: len(activation)] = activation[:, k] if len(activation) else 0.0
        for stage in (mujoco.mj_fwdPosition, mujoco.mj_fwdVelocity, mujoco.mj_fwdActuation):
            stage(model, data)
        inertial = np.empty(model.nv)
        mujoco.mj_mulM(model, data, inertial, a)
        terms = units * np.array([inertial, data.qfrc_bias, -data.qfrc_passive, -data.qfrc_actuator])
        equal = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        rows = np.concatenate([data.efc_J.reshape(-1, model.nv)[equal], locked]) * units
        _, singular, vh = np.linalg.svd(rows)
        ranks[k] = significant(singular).sum()
        along = vh[ranks[k] :] @ terms.T
        along_motion[k] = np.abs(along.sum(1)).max(initial=0.0)
        scale = max(scale, float(np.abs(terms).max(initial=0.0)))
    # where the rank is less, more than the free motions are in the null space
    return np.where(ranks == ranks.max(initial=0), along_motion, 0.0), scale


def _rates(model: mujoco.MjModel, motion: Motion) -> tuple[Array, Array]:
    """Return rates and accelerations in the degrees of freedom of a model at the n instants, (n, nv) each.

    Those of a ball are its relative angular velocity R' (w - w_a) in the frame of its body, and their
    derivative R' (w' - w_a' + w x w_a); those of a free joint are of the body's origin, and R' w and R' w'.
    """
    rates, accelerations = np.zeros((2, len(motion.angle), model.nv))
    for j, joint in enumerate(kinematic_tree(model).joints):
        dof, kind = int(model.jnt_dofadr[j]), int(model.jnt_type[j])
        if kind in SCALAR:
            scalar = motion.joints[joint.name]
            rates[:, dof], accelerations[:, dof] = scalar.rate, scalar.acceleration
            continue
        link = motion.links[link_name(model, int(model.jnt_bodyid[j]))]
        spin, change = link.angular_velocity, link.angular_acceleration
        if kind == FREE:
            rates[:, dof : dof + 3], accelerations[:, dof : dof + 3] = link.velocity, link.acceleration
            dof += 3
        elif joint.a.link != GROUND:
            carrier = motion.links[joint.a.link]
            change = change - carrier.angular_acceleration + cross(spin, carrier.angular_velocity)
            spin = spin - carrier.angular_velocity
        frame = link.rotation @ joint.b.frame
        for out, vector in ((rates, spin), (accelerations, change)):
            out[:, dof : dof + 3] = np.einsum("nji,nj->ni", frame, vector)
    return rates, accelerations
