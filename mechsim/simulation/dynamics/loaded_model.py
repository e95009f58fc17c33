"""The MuJoCo model of a mechanism and its forces, evaluated in any state without stepping.

The evaluated model has no dry friction, which would be a soft constraint. Friction is an applied force of a
given magnitude, opposite to the joint's rate.
"""

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.link_poses import virtual_body
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.meshes import threads_of
from mechsim.mechanism.nonlinear_springs import Bushing, Phases, phases_of
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.dynamics.bushings import bushing_forces
from mechsim.simulation.dynamics.friction import DryJoint, dry_frictions, oppose
from mechsim.simulation.mjcf.force_elements import (
    BUSHING_AXES,
    Actuators,
    actuator_slices,
    motor_control,
)
from mechsim.simulation.mjcf.joints import model_names
from mechsim.simulation.mjcf.link_inertias import with_accepted_inertia
from mechsim.simulation.recording import States
from mechsim.simulation.source import assembled, from_mechanism
from mechsim.simulation.state import ONE_THREAD

if TYPE_CHECKING:
    from mechsim.numerics.banded import Band, SparseMatrices

FIELDS = (
    *("M", "qacc", "qfrc_smooth", "qfrc_constraint", "qfrc_damper", "xpos", "xmat", "xipos", "ximat"),
    *("cvel", "site_xpos", "site_xmat", "subtree_com", "cfrc_int", "sensordata", "energy", "ten_velocity"),
    *("ten_length", "actuator_force", "actuator_length", "actuator_velocity"),
)
OFF, ON = mujoco.mjtDisableBit, mujoco.mjtEnableBit
SITE, TENDON = int(mujoco.mjtTrn.mjTRN_SITE), int(mujoco.mjtTrn.mjTRN_TENDON)


@dataclass(frozen=True, slots=True)
class AppliedForces:
    """Forces applied to a model at n states.

    Attributes:
        controls: of the actuators, (n, nu).
        generalised: forces on the coordinates, (n, nv) in [N] or [N m].
        wrenches: on bodies about their centres of mass, force before moment, (n, nbody, 6).
    """

    controls: Array
    generalised: Array
    wrenches: Array


@dataclass(frozen=True)
class LoadedModel(ClosedModel):
    """The closed model of a mechanism and its forces.

    Attributes:
        mechanism: with an inertia on every link.
        forces: applied forces.
        actuators: the model's actuators by purpose.
        dry: joints whose dry friction acts by controls.
    """

    mechanism: Mechanism
    forces: Forces
    actuators: Actuators
    dry: Sequence[DryJoint]

    @cached_property
    def bands(self) -> "dict[bytes, tuple[NDArray[np.intp], Band | None]]":
        """Orders in which the sparse equations of motion are banded."""
        return {}

    @cached_property
    def joints(self) -> dict[str, int]:
        """A map: coordinate or ball joint -> its joint in the model, without those that close loops."""
        joints = {self.model.joint(i).name: i for i in range(self.model.njnt)}
        called = model_names(self.mechanism)
        return joints | {name: joints[own] for name, own in called.items() if own in joints}

    def controls(self, angle: Array, time: Array | None) -> Array:
        """Return the controls at crank angles and times, (n, nu): motor, loads and torque on the crank."""
        values = np.zeros((len(angle), self.model.nu))
        forces, kinds = self.forces, self.actuators
        if forces.motor is not None:
            values[:, kinds.motor] = motor_control(forces.motor)
        if forces.crank_torque is not None:
            values[:, kinds.crank_torque] = forces.crank_torque.evaluate(angle, time)[:, None]
        if forces.loads:
            values[:, kinds.loads] = np.hstack([load.force.evaluate(angle, time) for load in forces.loads])
        if forces.couples:
            values[:, kinds.couples] = np.hstack(
                [couple.moment.evaluate(angle, time) for couple in forces.couples]
            )
        if forces.actuators and time is not None:
            values[:, kinds.actuators] = np.stack([a.control(time)[0] for a in forces.actuators], -1)
        return values

    def react(self, length: Array, velocity: Array, controls: Array, before: Phases = ()) -> None:
        """Set the controls (n, nu) that depend on lengths and velocities of actuators, (n, nu) each.

        They are those of nonlinear springs, bushings and dry friction. `before` are the phases of the springs
        before a single state; without them the springs have no memory.
        """
        oppose(self.dry, velocity, controls)
        springs, first = self.forces.nonlinear_springs, self.actuators.nonlinear.start
        lengths, rates = self.springs(length, velocity)
        phases = phases_of(springs, lengths[0], rates[0], before) if before else (None,) * len(springs)
        for k, (spring, phase) in enumerate(zip(springs, phases, strict=True)):
            controls[:, first + k] = spring.law.tension(lengths[:, k], rates[:, k], phase)
        for bushing, columns in self.bushings:
            controls[:, columns] = bushing_forces(bushing, length[:, columns], velocity[:, columns])[0]

    def springs(self, length: Array, velocity: Array) -> tuple[Array, Array]:
        """Return lengths and rates of the nonlinear springs, from those of actuators, (n, nu) each."""
        columns = self.actuators.nonlinear
        return length[:, columns], velocity[:, columns]

    @property
    def bushings(self) -> Iterator[tuple[Bushing, slice]]:
        """Each bushing and its actuators, three forces and three moments on each side."""
        width = 2 * len(BUSHING_AXES)
        for first, bushing in zip(
            count(self.actuators.bushings.start, width), self.forces.bushings, strict=False
        ):
            yield bushing, slice(first, first + width)

    def nothing(self, n: int) -> AppliedForces:
        """Return applied forces of zero at n states."""
        model = self.model
        return AppliedForces(np.zeros((n, model.nu)), np.zeros((n, model.nv)), np.zeros((n, model.nbody, 6)))

    def look(self, model: mujoco.MjModel, states: States, applied: AppliedForces) -> Mapping[str, Array]:
        """Return MuJoCo's fields at states under applied forces."""
        n = len(states.qpos)
        sims = batch.Batch(model, n, *([1] if n <= ONE_THREAD else []))
        sims.bind("qpos")[:], sims.bind("qvel")[:] = states.qpos, states.qvel
        sims.bind("qfrc_applied")[:], sims.bind("xfrc_applied")[:] = applied.generalised, applied.wrenches
        if model.nu:
            sims.bind("ctrl")[:] = applied.controls
        fields = {name: sims.bind(name) for name in FIELDS}
        sims.forward()
        return {name: np.array(field) for name, field in fields.items()}

    def inertia(self, fields: Mapping[str, Array]) -> "SparseMatrices":
        """Return the mass matrices, (nv, nv), from MuJoCo's fields."""
        from mechsim.numerics.banded import SparseMatrices

        rows, columns, index = self._inertia_entries
        values, crank = fields["M"].T[index], self.loops.crank
        if not self.loops.drivers.crank:
            # the path parameter advances steadily: its inertia, the mean, matters only to the solution method
            diagonal = rows == columns
            values[diagonal & (rows == crank)] = values[diagonal, 0].sum() / self.model.nv
        return SparseMatrices(rows, columns, values, (self.model.nv, self.model.nv))

    def body(self, link: str) -> int:
        """Return the index of a link's body."""
        return 0 if link == GROUND else int(self.model.body(link).id)

    def parent(self, link: str) -> str:
        """Return the parent of a link in the tree; an empty text for the ground."""
        if link == GROUND:
            return ""
        above = int(self.model.body_parentid[self.body(link)])
        return GROUND if above == 0 else str(self.model.body(above).name)

    def cut_pairs(self, joint: Joint) -> list[int]:
        """Return the indices of the point pairs that close a loop at a joint; none for joints of the tree."""
        # a joint of a file may have the name of the second pair, as in a file that mechsim wrote
        second = f"{joint.name}+"
        names = [joint.name] if second in self._joint_names else [joint.name, second]
        return sorted(i for name in names for i in self._equalities.get(name, ()))

    @cached_property
    def _joint_names(self) -> frozenset[str]:
        return frozenset(joint.name for joint in self.mechanism.joints)

    @cached_property
    def _equalities(self) -> dict[str, list[int]]:
        """The indices of the equalities with each name."""
        numbers: dict[str, list[int]] = {}
        for i in range(self.model.neq):
            numbers.setdefault(self.model.equality(i).name, []).append(i)
        return numbers

    @cached_property
    def rods(self) -> dict[str, int]:
        """Name of each rod's joint -> its index among the rods of the loops."""
        names = [self.model.equality(rod.equality).name for rod in self.loops.rods]
        return {name: names.index(name) for name in names}

    @cached_property
    def threads(self) -> dict[str, list[tuple[int, float]]]:
        """Screw joint -> the numbers of its couplings among all, and their ratios."""
        screws, threads = threads_of(self.mechanism), dict[str, list[tuple[int, float]]]()
        for i, (name, law) in enumerate(self.mechanism.named_laws.items()):
            if name in screws:
                threads.setdefault(screws[name].name, []).append((i, law.ratio))
        return threads

    def welded(self, joint: Joint) -> int | None:
        """Return the index of the frame pair that closes a loop at a joint; None if there is none."""
        return self._welds.get(joint.name)

    @cached_property
    def _welds(self) -> dict[str, int]:
        """Name of each weld -> its index among the frame pairs."""
        welds = np.flatnonzero(self.model.eq_type == int(mujoco.mjtEq.mjEQ_WELD))
        names = [self.model.equality(int(i)).name for i in welds]
        return {name: names.index(name) for name in names}

    def ends(self, joint: Joint) -> tuple[str, str]:
        """Return the links that a joint of the model connects; for a split joint, one is its virtual body."""
        stands = virtual_body(joint)
        if stands not in self.track.links:
            return joint.a.link, joint.b.link
        return (stands, GROUND) if joint.b.link == GROUND else (joint.a.link, stands)

    def looking(self, *, native: bool = True) -> mujoco.MjModel:
        """Return a model for evaluation, in which no constraint of MuJoCo closes the loops.

        Args:
            native: whether tendons and actuators act in the model; otherwise the caller applies wrenches.
        """
        model = copy.copy(self.model)
        self.prepare(model)
        model.opt.disableflags |= int(OFF.mjDSBL_CONSTRAINT)
        if not native:
            model.opt.disableflags |= int(OFF.mjDSBL_ACTUATION)
            model.tendon_stiffness[:] = model.tendon_damping[:] = 0.0
        return model

    def prepare(self, model: mujoco.MjModel) -> None:
        """Prepare a model for evaluation: enable sensors and energy, disable dry friction."""
        model.opt.disableflags &= ~int(OFF.mjDSBL_SENSOR)
        model.opt.enableflags |= int(ON.mjENBL_ENERGY)
        model.dof_frictionloss[:] = 0.0
        model.tendon_frictionloss[:] = 0.0

    @cached_property
    def _inertia_entries(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the mass matrix, and the index of each entry in MuJoCo's, (e,) each."""
        model = self.model
        rows, columns = np.repeat(np.arange(model.nv), model.M_rownnz), model.M_colind.astype(np.intp)
        below, index = rows != columns, np.arange(len(rows))
        return (
            np.concatenate([rows, columns[below]]),
            np.concatenate([columns, rows[below]]),
            np.concatenate([index, index[below]]),
        )


def loaded_model(
    mechanism: Mechanism, forces: Forces, cut: tuple[str, ...] | None = None, *, follows_laws: bool = False
) -> LoadedModel:
    """Generate the model of a mechanism and its forces, and close its loops.

    Args:
        mechanism: links without an inertia are rods, as in `masses.with_inertia`.
        forces: applied forces.
        cut: joints at which the loops are cut; None lets the generator choose.
        follows_laws: whether the drivers follow motion laws; otherwise a crank is driven.

    Raises:
        AssemblyError: if the loops do not close at the mechanism's start.
        InputError: for a link that is too light for MuJoCo.
    """
    described = with_accepted_inertia(mechanism)
    spec = assembled(described, Scene(level="dynamics", forces=forces, cut=cut))
    points = [name for name, (link, _) in mechanism.points.items() if link != GROUND]
    closed = from_mechanism(described, spec, tuple(points), follows_laws=follows_laws)
    return LoadedModel(
        loops=closed.loops,
        track=closed.track,
        qpos=closed.qpos,
        mechanism=described,
        forces=forces,
        actuators=actuator_slices(forces, closed.model),
        dry=dry_frictions(closed.model, forces.friction),
    )
