"""Friction by the load of joints in stepped models: MuJoCo's Coulomb friction, updated before each step.

The constraint forces at the start of a step, under the friction extrapolated from the two steps before, give
the friction there; extrapolated to the middle of the step, it acts during the step. The error is proportional
to the square of the step, and to the step after a joint reverses.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.force_record import Reaction
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_friction import TERMS, Friction
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.complementarity import newton
from mechsim.numerics.rank import pseudo_inverse
from mechsim.simulation.dynamics.applied_forces import coupling_forces, loop_forces, native, together
from mechsim.simulation.dynamics.friction import DryJoint
from mechsim.simulation.dynamics.inverse_dynamics import forces_of_couplings, row_scale
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.dynamics.reactions import transmitted
from mechsim.simulation.model_loops import ModelLoops

# Coulomb friction in [N] or [N m] by which a model has one where only the load causes it; it is replaced
PLACEHOLDER = 1e-12
# relative change of the frictions of one state at which they have converged, and largest number of iterations
CONVERGED, MAX_ITERATIONS = 1e-12, 100
# change of frictions relative to the largest by which their derivatives are measured, number of steps between
# these, and spectral radius of their bounds above which they are measured at each step
SMALL, MEASURED, STRONG = 1e-3, 20, 0.5
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
FRICTION = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
# where the magnitude of a friction is that acts by controls
DRY, DOF = "dry", "dof_frictionloss"
# rate relative to the fastest one below which a joint whose friction acts by controls is at rest
AT_REST = 1e-6
# rate relative to that which friction stops within a step, below which a joint is at rest: soft friction
# creeps with 1e-4 of it
CREEP = 1e-2
FIELDS = (
    *("xpos", "xmat", "xipos", "site_xpos", "site_xmat", "actuator_force", "ten_length", "ten_velocity"),
    *("subtree_com", "qacc"),
)


def with_placeholders(mechanism: Mechanism, forces: Forces) -> Forces:
    """Return forces with some Coulomb friction wherever there is friction by the load."""

    def rubbing(friction: Friction) -> Friction:
        if not friction.varies:
            return friction
        mixed = KINDS[mechanism.joint(friction.joint).kind].mixed
        names = ("coulomb", "coulomb_turn") if mixed else ("coulomb",)
        return replace(friction, **{name: max(getattr(friction, name), PLACEHOLDER) for name in names})

    return replace(forces, friction=tuple(map(rubbing, forces.friction)))


@dataclass(frozen=True, slots=True)
class StoredFriction:
    """A friction that varies, by its number in the joint.

    Attributes:
        friction: of the joint.
        number: of this friction among those of the joint.
        constant: friction without a load.
        array: where MuJoCo has its magnitude.
        index: in this array.
        inverse_inertia: acceleration of the coordinate by a unit of it, without the loops; 0 if it acts by
            controls.
    """

    friction: Friction
    number: int
    constant: float
    array: str
    index: int
    inverse_inertia: float


class UpdatedFriction:
    """Friction by the load in a stepped model.

    Args:
        model: the mechanism and its forces.
        loops: of the model to be stepped, which is changed.
        dry: joints whose friction acts by controls; replaced by updated ones.
    """

    def __init__(self, model: LoadedModel, loops: ModelLoops, dry: list[DryJoint]) -> None:
        self.model, self.loops, self.dry = model, loops, dry
        self.stored = [item for friction in model.forces.friction for item in self._stored(friction)]
        self.evaluated = model.looking(native=False)
        self.data = mujoco.MjData(self.evaluated)
        self.loads = np.zeros(len(self.stored))
        # changes of the terms of each load by a unit of each friction, (k, TERMS, 3, k)
        self.response = np.zeros((len(self.stored), TERMS, 3, len(self.stored)))
        self.fastest = 0.0
        # frictions by the load at the start of each step, and the rates before the present step, (k,)
        self.history = list[Array]()
        self.rates = np.zeros(len(self.stored))
        self.resting = np.zeros(len(self.stored), dtype=bool)

    def _stored(self, friction: Friction) -> list[StoredFriction]:
        mechanism, stepped = self.model.mechanism, self.loops.model
        joints = self.model.joints
        tendons = [stepped.tendon(i).name for i in range(stepped.ntendon)]
        stored: list[StoredFriction] = []
        for joint, number, index, _ in friction.loaded(mechanism):
            kind = KINDS[joint.kind]
            own = [other for other in self.model.forces.friction if other.joint == joint.name]
            constant = sum(other.sizes(kind)[index][1] for other in own)
            rows = list[tuple[int, float]]()
            name = "" if kind.ball else joint.coordinates[index]
            if name in joints:
                array = DOF, int(stepped.jnt_dofadr[joints[name]])
                rows = [(joints[name], 1.0)]
            elif f"friction in {joint.name}" in tendons:
                array = "tendon_frictionloss", tendons.index(f"friction in {joint.name}")
                first = int(stepped.tendon_adr[array[1]])
                wraps = range(first, first + int(stepped.tendon_num[array[1]]))
                rows = [(int(stepped.wrap_objid[w]), float(stepped.wrap_prm[w])) for w in wraps]
            else:
                array = DRY, next(i for i, item in enumerate(self.dry) if item.joint == joint.name)
            inverse_inertia = sum(
                weight**2 / float(stepped.dof_M0[stepped.jnt_dofadr[j]]) for j, weight in rows
            )
            stored.append(StoredFriction(friction, number, constant, *array, inverse_inertia))
        return stored

    def update(self, data: mujoco.MjData) -> None:
        """Set the friction of the next step by the constraint forces of the present state."""
        # a step leaves the rates of tendons and controls that were before it; the first one has none
        mujoco.mj_fwdPosition(self.loops.model, data)
        mujoco.mj_fwdVelocity(self.loops.model, data)
        resting, rates = self._resting(data), self._rates(data)
        changed, self.resting, self.rates = bool((resting != self.resting).any()), resting, rates
        if changed or not self.history:
            self._converge(data)
        else:
            before, last = self.history[-2:][0], self.loads
            bounds = np.sqrt((self.response**2).sum(2)).sum(1)
            if len(self.history) % MEASURED == 0 or np.abs(np.linalg.eigvals(bounds)).max() > STRONG:
                self._measure(data, last)
            self._improve(data, 2.0 * last - before)
            self.set(1.5 * self.loads - 0.5 * last)
        self.history.append(self.loads)

    def _converge(self, data: mujoco.MjData) -> None:
        """Set the friction that the constraint forces of a state under this friction cause."""
        self._improve(data, self.loads)
        self.loads = SMALL * self.loads
        for _ in range(MAX_ITERATIONS):
            before = self.loads
            self._measure(data, before)
            self._improve(data, before)
            if np.abs(self.loads - before).max() <= CONVERGED * np.abs(self.loads).max():
                break
        self.set(self.loads)

    def _measure(self, data: mujoco.MjData, friction: Array) -> None:
        """Set the changes of the terms of the loads by each friction."""
        step = SMALL * friction.max()
        if step > 0.0:
            changed = [self._terms(data, friction + row)[0] for row in step * np.eye(len(friction))]
            self.response = (np.stack(changed, -1) - self._terms(data, friction)[0][..., None]) / step

    def _improve(self, data: mujoco.MjData, friction: Array) -> None:
        """Set the loads to those that terms at a friction and their changes balance."""
        friction = np.maximum(friction, 0.0)
        terms, constant = self._terms(data, friction)
        base = terms - self.response @ friction
        solution, balanced = newton(constant[None], base[None], self.response[None], self.loads[None])
        self.loads = solution[0] if balanced[0] else constant + np.sqrt((terms**2).sum(2)).sum(1)

    def set(self, loads: Array) -> None:
        """Set the friction in MuJoCo's model from frictions by the load."""
        magnitudes: dict[tuple[str, int], float] = {}
        for item, load in zip(self.stored, loads.tolist(), strict=True):
            key = item.array, item.index
            magnitudes[key] = max(magnitudes.get(key, item.constant) + load, PLACEHOLDER)
        for (array, index), magnitude in magnitudes.items():
            if array == DRY:
                self.dry[index] = replace(self.dry[index], magnitude=magnitude)
            else:
                getattr(self.loops.model, array)[index] = magnitude

    def _terms(self, data: mujoco.MjData, friction: Array) -> tuple[Array, Array]:
        """Return terms of the loads under a friction, (k, TERMS, 3), and frictions besides them, (k,)."""
        self.set(friction)
        mujoco.mj_forward(self.loops.model, data)
        reactions, couplings = self._reactions(data)
        rubbing, constant = self._on_dofs(data, FRICTION), np.zeros(len(self.stored))
        terms = np.zeros((len(self.stored), TERMS, 3))
        for k, item in enumerate(self.stored):
            if item.friction.coupling:
                force = float(couplings[item.friction.coupling][0])
                terms[k, 0, 0] = item.friction.coefficient * force
                continue
            joint = self.model.mechanism.joint(item.friction.joint)
            axis = self._axis(data, joint)
            moment = reactions[joint.name].moment[0]
            if KINDS[joint.kind].helical and not item.number:
                # the friction of the thread is part of its load
                moment = moment + np.sign(rubbing[item.index]) * friction[k] * axis
            _, maps = item.friction.loads(joint, axis[None])[item.number]
            ratio = item.friction.ratio_at_rest
            if not self.resting[k]:
                ratio = float(item.friction.ratio(self.rates[[k]])[0])
            terms[k] = ratio * (maps[0] @ np.concatenate([reactions[joint.name].force[0], moment]))
            constant[k] = (ratio - 1.0) * (0.0 if KINDS[joint.kind].mixed else item.constant)
        return terms, constant

    def _resting(self, data: mujoco.MjData) -> NDArray[np.bool_]:
        """Return whether each friction is that at rest, which differs, (k,)."""
        model, rates = self.loops.model, self._rates(data)
        self.fastest = max(self.fastest, float(np.abs(data.qvel).max()))
        slow = [
            CREEP * model.opt.timestep * getattr(model, item.array)[item.index] * item.inverse_inertia
            if item.inverse_inertia
            else AT_REST * self.fastest
            for item in self.stored
        ]
        still = np.abs(rates) <= np.array(slow)
        # a rate that changes its sign within a step was zero, and decays at rest
        reversing, decaying = rates * self.rates < 0.0, np.abs(rates) < np.abs(self.rates)
        differs = np.array([item.friction.static > 0.0 for item in self.stored])
        return differs & (still | reversing | (self.resting & decaying))

    def _rates(self, data: mujoco.MjData) -> Array:
        """Return the rate of each friction, (k,); a magnitude where it acts by controls."""
        rates = {DOF: data.qvel, "tendon_frictionloss": data.ten_velocity}
        return np.array(
            [
                rates[item.array][item.index]
                if item.array in rates
                else np.linalg.norm(data.actuator_velocity[self.dry[item.index].actuators])
                for item in self.stored
            ],
            dtype=np.float64,
        )

    def _axis(self, data: mujoco.MjData, joint: Joint) -> Array:
        """Return the axis of a joint on side a, (3,)."""
        return data.xmat[self.model.body(joint.a.link)].reshape(3, 3) @ joint.a.frame[:, 2]

    def _on_dofs(self, data: mujoco.MjData, kind: int) -> Array:
        """Return the generalised force of the constraints of a kind, (nv,)."""
        result = np.zeros(self.loops.model.nv)
        forces = np.where(data.efc_type == kind, data.efc_force, 0.0)
        mujoco.mj_mulJacTVec(self.loops.model, data, result, forces)
        return result

    def _reactions(self, data: mujoco.MjData) -> tuple[dict[str, Reaction], dict[str, Array]]:
        """Return the reactions of the joints with friction by the load, and the forces of couplings."""
        model, loops = self.model, self.loops
        fields = {name: np.array(getattr(data, name))[None] for name in FIELDS}
        # batches accept no Python callback
        before = mujoco.get_mjcb_control()
        mujoco.set_mjcb_control(None)
        sparse = loops.sparse(data.qpos[None])[1]
        jacobian = loops.whole(sparse.values.T)
        mujoco.set_mjcb_control(before)
        scale, units = row_scale(model, jacobian.shape[1]), loops.units
        multipliers = np.zeros((1, jacobian.shape[1]))
        if multipliers.size:
            scaled = np.swapaxes(jacobian * scale[:, None] * units, 1, 2)
            on_dofs = self._on_dofs(data, EQUALITY)[None]
            multipliers = scale * (pseudo_inverse(scaled) @ (on_dofs * units)[..., None])[..., 0]
        wrenches = together(
            native(model.model, fields),
            loop_forces(model, fields, multipliers),
            coupling_forces(model, fields, sparse, multipliers),
        ).wrenches[0]
        scratch = self.data
        scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
        mujoco.mj_fwdPosition(self.evaluated, scratch)
        mujoco.mj_fwdVelocity(self.evaluated, scratch)
        scratch.qacc[:], scratch.xfrc_applied[:] = data.qacc, wrenches
        mujoco.mj_rnePostConstraint(self.evaluated, scratch)
        fields["cfrc_int"] = np.array(scratch.cfrc_int)[None]
        joints = {item.friction.joint: model.mechanism.joint(item.friction.joint) for item in self.stored}
        reactions = {name: transmitted(model, joint, fields, multipliers) for name, joint in joints.items()}
        return reactions, forces_of_couplings(model, multipliers)
