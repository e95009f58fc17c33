"""Inertias of links, gravity, and springs, dampers and Coulomb friction of joints."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mechsim.model.forces import Forces, Friction, JointSpring
from mechsim.model.links import Inertia, Link, vector
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.kinematic_tree import Carrier
from mechsim.simulation.state import SCALAR, gravity, rotation_matrix

# relative rounding of a sum of masses
ROUNDING = 1e-9


def with_inertias(
    model: mujoco.MjModel,
    links: Sequence[Link],
    carriers: Sequence[Carrier],
    raised: float = 0.0,
) -> tuple[Link, ...]:
    """Return links with the inertias of all their bodies.

    Args:
        model: the compiled model.
        links: the moving links.
        carriers: carrier of each body, the world first.
        raised: mass in [kg] assigned to massless bodies; 0 if there are none.
    """
    bodies = {link.name: list[int]() for link in links}
    for i, carrier in enumerate(carriers):
        if carrier.link in bodies:
            bodies[carrier.link].append(i)
    combined = {name: _combined(model, ids, carriers) for name, ids in bodies.items()}
    if not any(mass > 0.0 for mass, _, _ in combined.values()):
        return tuple(links)

    def inertia(name: str, mass: float, centre: Array, moments: Array) -> Inertia:
        massless = not mass > raised * len(bodies[name]) * (1.0 + ROUNDING)
        rows = (vector(moments[0]), vector(moments[1]), vector(moments[2]))
        return Inertia(mass, vector(centre), rows, negligible=massless)

    return tuple(replace(link, inertia=inertia(link.name, *combined[link.name])) for link in links)


def _combined(
    model: mujoco.MjModel, bodies: Sequence[int], carriers: Sequence[Carrier]
) -> tuple[float, Array, Array]:
    """Return mass, centre (3,) and moments about it (3, 3) of the bodies on one link, in its frame."""
    masses = np.array([model.body_mass[i] for i in bodies])
    centres = np.array([carriers[i].point(model.body_ipos[i]) for i in bodies]).reshape(-1, 3)
    total = float(masses.sum())
    if not total > 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centre, moments = masses @ centres / total, np.zeros((3, 3))
    for i, mass, body_centre in zip(bodies, masses, centres, strict=True):
        axes = carriers[i].pose.rotation @ rotation_matrix(model.body_iquat[i])
        arm = body_centre - centre
        moments += axes @ np.diag(model.body_inertia[i]) @ axes.T
        moments += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return total, centre, 0.5 * (moments + moments.T)


def forces_of_model(model: mujoco.MjModel) -> Forces:
    """Return gravity, and the dampers, springs and Coulomb friction of hinges and slides."""
    friction: list[Friction] = []
    springs: list[JointSpring] = []
    for j in range(model.njnt):
        if int(model.jnt_type[j]) not in SCALAR:
            continue
        name, dof, address = model.joint(j).name, model.jnt_dofadr[j], model.jnt_qposadr[j]
        viscous, coulomb = _linear(model.dof_damping[dof]), float(model.dof_frictionloss[dof])
        if viscous or coulomb:
            friction.append(Friction(name, viscous, coulomb))
        stiffness = _linear(model.jnt_stiffness[j])
        if stiffness:
            springs.append(JointSpring(name, stiffness, float(model.qpos_spring[address])))
    return Forces(gravity=vector(gravity(model)), friction=tuple(friction), joint_springs=tuple(springs))


def left_out_of_dynamics(model: mujoco.MjModel) -> list[str]:
    """Return the effects that MuJoCo simulates and the dynamics of this package omit, in a few words each."""
    tendons = bool(model.tendon_stiffness.any() or model.tendon_damping.any())
    present = {
        "armature": bool(model.dof_armature.any()),
        "fluid": bool(model.opt.density or model.opt.viscosity),
        "springs and dampers of tendons": tendons,
        "gravity compensation": bool(model.body_gravcomp.any()),
        "servos": bool(model.actuator_biasprm.any()),
    }
    return [name for name, acts in present.items() if acts]


def _linear(value: Array | float) -> float:
    """Return the linear part of a stiffness or damping, which may be a polynomial."""
    return float(np.ravel(value)[0])
