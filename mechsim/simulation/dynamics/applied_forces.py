"""MuJoCo's own tendon, actuator and constraint forces as wrenches on bodies.

MuJoCo projects these forces onto coordinates. The reaction of a joint of the tree depends on the bodies on
which they act. For reactions, each force is therefore applied to its bodies.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mechsim.mechanism.force_record import MeshForce
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.meshes import Mesh, meshes_of
from mechsim.numerics.arrays import Array, cross
from mechsim.simulation.dynamics.loaded_model import SITE, TENDON, AppliedForces, LoadedModel
from mechsim.simulation.equality_rows import RodPair

if TYPE_CHECKING:
    from mechsim.numerics.banded import SparseMatrices

Fields = Mapping[str, Array]
SITES = int(mujoco.mjtWrap.mjWRAP_SITE)


def add_force(stack: Array, fields: Fields, body: int, point: Array, force: Array) -> None:
    """Add forces (n, 3) on a body at points (n, 3) to wrenches about centres of mass (n, nbody, 6)."""
    stack[:, body, :3] += force
    stack[:, body, 3:] += cross(point - fields["xipos"][:, body], force)


def native(model: mujoco.MjModel, fields: Fields) -> AppliedForces:
    """Return the forces of a model's tendons and actuators as applied forces."""
    n = len(fields["qacc"])
    forces = AppliedForces(np.zeros((n, model.nu)), np.zeros((n, model.nv)), np.zeros((n, model.nbody, 6)))
    for i in range(model.nu):
        effort, gear = fields["actuator_force"][:, i, None], model.actuator_gear[i]
        target, reference = (int(index) for index in model.actuator_trnid[i])
        if model.actuator_trntype[i] != SITE:
            joints, ratios = [target], [1.0]
            if model.actuator_trntype[i] == TENDON:
                first = int(model.tendon_adr[target])
                wrapped = slice(first, first + int(model.tendon_num[target]))
                joints, ratios = model.wrap_objid[wrapped], model.wrap_prm[wrapped]
                if model.wrap_type[first] == SITES:
                    _add_pull(model, fields, target, -gear[0] * effort[:, 0], forces.wrenches)
                    continue
            for joint, ratio in zip(joints, ratios, strict=True):
                forces.generalised[:, model.jnt_dofadr[joint]] += effort[:, 0] * gear[0] * ratio
            continue
        axes = fields["site_xmat"][:, reference].reshape(-1, 3, 3)
        bodies = model.site_bodyid[[target, reference]]
        force, couple = effort * (axes @ gear[:3]), effort * (axes @ gear[3:])
        for body, sign in zip(bodies, (1.0, -1.0), strict=True):
            add_force(forces.wrenches, fields, int(body), fields["site_xpos"][:, target], sign * force)
            forces.wrenches[:, body, 3:] += sign * couple
    for i in range(model.ntendon):
        _add_tendon(model, fields, i, forces.wrenches)
    return forces


def _add_tendon(model: mujoco.MjModel, fields: Fields, i: int, wrenches: Array) -> None:
    """Add the force of a spring between two sites."""
    if model.wrap_type[model.tendon_adr[i]] != SITES:
        return
    stretch = fields["ten_length"][:, i] - model.tendon_lengthspring[i, 0]
    springs, dampers = model.tendon_stiffness, model.tendon_damping
    stiffness, damping = (float(np.ravel(values[i])[0]) for values in (springs, dampers))
    _add_pull(model, fields, i, stiffness * stretch + damping * fields["ten_velocity"][:, i], wrenches)


def _add_pull(model: mujoco.MjModel, fields: Fields, i: int, tension: Array, wrenches: Array) -> None:
    """Add the forces of a tension (n,) of a tendon between two sites."""
    first = int(model.tendon_adr[i])
    sites = model.wrap_objid[first : first + 2]
    a, b = (fields["site_xpos"][:, site] for site in sites)
    length = np.sqrt(((b - a) ** 2).sum(1))
    force = (tension / np.where(length > 0.0, length, 1.0))[:, None] * (b - a)
    for site, point, sign in ((sites[0], a, 1.0), (sites[1], b, -1.0)):
        add_force(wrenches, fields, int(model.site_bodyid[site]), point, sign * force)


def dry_friction(loaded: LoadedModel, fields: Fields, qvel: Array) -> AppliedForces:
    """Return the dry friction of all joints: a given magnitude, opposite to the joint's rate."""
    model, forces = loaded.model, loaded.nothing(len(qvel))
    forces.generalised[:] = -model.dof_frictionloss * np.sign(qvel)
    for i in np.flatnonzero(model.tendon_frictionloss):
        joint = loaded.mechanism.joint(model.tendon(i).name.removeprefix("friction in "))
        body = model.body(joint.b.link).id if joint.b.link in loaded.track.links else 0
        other = model.body(joint.a.link).id if joint.a.link in loaded.track.links else 0
        axis = fields["xmat"][:, body].reshape(-1, 3, 3) @ np.asarray(joint.b.axis)
        couple = (-model.tendon_frictionloss[i] * np.sign(fields["ten_velocity"][:, i]))[:, None] * axis
        forces.wrenches[:, body, 3:] += couple
        forces.wrenches[:, other, 3:] -= couple
    return forces


def sliding(loaded: LoadedModel, fields: Fields, qvel: Array) -> Array:
    """Return the direction of motion of each joint with dry friction, (n, k) of -1, 0, 1."""
    model = loaded.model
    rates = [
        qvel[:, model.dof_frictionloss > 0.0],
        fields["ten_velocity"][:, model.tendon_frictionloss > 0.0],
    ]
    # the spin of a ball joint has no sign; its direction changes without a jump
    rates += [
        fields["actuator_velocity"][:, friction.actuators]
        for friction in loaded.dry
        if len(friction.actuators) == 1
    ]
    return np.sign(np.concatenate(rates, 1))


def loop_forces(loaded: LoadedModel, fields: Fields, multipliers: Array) -> AppliedForces:
    """Return the forces of cut joints from multipliers, (n, m); each acts on the first point of its pair."""
    loops, forces = loaded.loops, loaded.nothing(len(multipliers))
    for number, pair in enumerate(loops.pairs):
        force = multipliers[:, 3 * number : 3 * number + 3]
        for (body, local), sign in zip(pair.ends, (1.0, -1.0), strict=True):
            point = fields["xpos"][:, body] + fields["xmat"][:, body].reshape(-1, 3, 3) @ local
            add_force(forces.wrenches, fields, body, point, sign * force)
    for rod, multiplier in zip(loops.rods, multipliers[:, loops.rod_rows].T, strict=True):
        force, points = rod_force(fields, rod, multiplier)
        for body, point, sign in zip(rod.bodies, points, (1.0, -1.0), strict=True):
            add_force(forces.wrenches, fields, body, point, sign * force)
    moments = multipliers[:, loops.frame_rows].reshape(len(multipliers), -1, 3)
    for pair, moment in zip(loops.frames, np.moveaxis(moments, 1, 0), strict=True):
        rotations = (fields["xmat"][:, body].reshape(-1, 3, 3) for body in pair.bodies)
        couple = (np.swapaxes(pair.rotation_error(*rotations)[1], 1, 2) @ moment[..., None])[..., 0]
        for body, sign in zip(pair.bodies, (1.0, -1.0), strict=True):
            forces.wrenches[:, body, 3:] += sign * couple
    return forces


def rod_force(fields: Fields, rod: RodPair, multiplier: Array) -> tuple[Array, list[Array]]:
    """Return the force of a rod on its first point, (n, 3), from its multiplier, (n,), and both points."""
    axes = fields["xmat"].reshape(len(multiplier), -1, 3, 3)
    points = [fields["xpos"][:, body] + axes[:, body] @ local for body, local in rod.ends]
    return multiplier[:, None] * rod.along(points[0] - points[1]), points


def together(*applied: AppliedForces) -> AppliedForces:
    """Return the sum of applied forces."""
    return AppliedForces(
        sum((forces.controls for forces in applied[1:]), applied[0].controls),
        sum((forces.generalised for forces in applied[1:]), applied[0].generalised),
        sum((forces.wrenches for forces in applied[1:]), applied[0].wrenches),
    )


def coupling_forces(
    loaded: LoadedModel, fields: Fields, jacobian: "SparseMatrices", multipliers: Array
) -> AppliedForces:
    """Return the forces of couplings and locked coordinates: of teeth at pitch points, others on coordinates.

    A tooth force on a wheel, and its opposite on the carrier of the wheel, do the work of the coordinate's
    force. The forces on the carrier cancel.
    """
    forces = loaded.nothing(len(multipliers))
    meshes, first = meshes_of(loaded.mechanism), loaded.loops.coupled_rows.start
    toothed = [first + i for i, name in enumerate(loaded.mechanism.named_laws) if name in meshes]
    plain = np.setdiff1d(np.arange(multipliers.shape[1])[loaded.loops.coupled_rows], toothed)
    if len(plain):
        forces.generalised[:] += jacobian.only(plain).transposed.times(multipliers.T).T
    for row, mesh in zip(toothed, meshes.values(), strict=True):
        force, point = _at_pitch_point(loaded, fields, mesh, multipliers[:, row])
        for own, sign in ((mesh.driven, 1.0), (mesh.driver, -1.0)):
            proximal, distal = loaded.ends(own.joint)
            wheel, carrier = (distal, proximal) if own.sign > 0.0 else (proximal, distal)
            add_force(forces.wrenches, fields, loaded.body(wheel), point, sign * force)
            add_force(forces.wrenches, fields, loaded.body(carrier), point, -sign * force)
    return forces


def mesh_forces(loaded: LoadedModel, fields: Fields, multipliers: Array) -> dict[str, MeshForce]:
    """Return the tooth force of each coupling that has a pitch point."""
    names, first = [*loaded.mechanism.named_laws], loaded.loops.coupled_rows.start
    forces: dict[str, MeshForce] = {}
    for name, mesh in meshes_of(loaded.mechanism).items():
        effort = multipliers[:, first + names.index(name)]
        force, point = _at_pitch_point(loaded, fields, mesh, effort)
        forces[name] = MeshForce(link=mesh.driven.link, by=mesh.driver.link, force=force, point=point)
    return forces


def thread_forces(loaded: LoadedModel, joint: Joint, multipliers: Array) -> Iterator[tuple[Array, Array]]:
    """Yield force along and moment about a screw's axis on its link b, (n,) each; nothing for other kinds."""
    first = loaded.loops.coupled_rows.start
    for i, ratio in loaded.threads.get(joint.name, ()):
        yield multipliers[:, first + i], -ratio * multipliers[:, first + i]


def _at_pitch_point(loaded: LoadedModel, fields: Fields, mesh: Mesh, effort: Array) -> tuple[Array, Array]:
    """Return the force on the driven wheel and the pitch point, in the ground frame, (n, 3) each."""
    body = loaded.body(mesh.carrier)
    axes = fields["xmat"][:, body].reshape(-1, 3, 3)
    own = np.outer(effort, mesh.tangential) + np.outer(np.abs(effort), mesh.separating)
    return (axes @ own[..., None])[..., 0], fields["xpos"][:, body] + axes @ mesh.point


# minimum factor on MuJoCo's inverse weights for the computation of constraint forces. Smaller factors leave
# rounding errors with redundant rows. With larger ones, two passes leave an error of 1e-3 near a dead centre
# (validation/robustness/torque_scale.py)
COMPLIANCE_FACTOR = 1e-5
# number of Newton steps in each pass, and number of passes
ITERATIONS, PASSES = 10, 3
# ratio of the third correction to the second above which the third is rounding and is left out
SHRINKING = 0.1


def soften(model: mujoco.MjModel, compliance: float) -> float:
    """Make a model's constraints compliant enough for the computation of their forces.

    Args:
        model: compiled; its inverse weights are multiplied.
        compliance: present factor on its inverse weights.

    Returns:
        The factor by which they were multiplied, 1 or more.
    """
    factor = max(1.0, COMPLIANCE_FACTOR / compliance)
    model.body_invweight0[:] *= factor
    model.dof_invweight0[:] *= factor
    model.tendon_invweight0[:] *= factor
    model.opt.iterations = ITERATIONS
    return factor


def rigid_forces(look: Callable[[Array], Mapping[str, Array]], states: int, dofs: int) -> dict[str, Array]:
    """Return MuJoCo's fields of states with rigid constraints; "qfrc_constraint" is the constraint force.

    Args:
        look: additional generalised forces, (n, nv) -> MuJoCo's fields of the states.
        states: number of states n.
        dofs: number of degrees of freedom nv.
    """
    force = np.zeros((states, dofs))
    fields, before = look(force), np.full(states, np.inf)
    for number in range(PASSES):
        if number:
            fields = look(force)
        lacking = fields["qfrc_constraint"]
        magnitude = np.abs(lacking).max(1, initial=0.0)
        converged = (magnitude < SHRINKING * before) | (number < 2)
        force, before = force + np.where(converged[:, None], lacking, 0.0), magnitude
    return {**fields, "qfrc_constraint": force}
