"""Equations of motion of any mechanism in the coordinates of its spanning tree.

M(q) a + h(q, v) = Q(q, v, t) + J' lambda with the loop constraints J a + gamma = 0. The coordinates and
their rates are in units of the mechanism: displacements in its size, angles in radians.

Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 8 (closed-loop systems); the mass
matrix is summed over the links from their spatial inertias at the ground's origin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics.applied_forces import add_joint_forces, applied, loads
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.loops.constraints import TreeLoops
from mechsim.analytic.loops.kinematics import Coordinates, LinkPoses, twists, velocity_products
from mechsim.analytic.loops.start import assembled
from mechsim.analytic.vector_method.rotations import cross, skew
from mechsim.errors import InputError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.motion_laws import State
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import significant

# step of the central difference for the rate of a friction direction, in units of the coordinates; its error
# is about 1e-10 of the rate
DIFFERENCE = 1e-5


@dataclass(frozen=True, slots=True)
class DryFriction:
    """One Coulomb friction: a joint, which of its coordinates it opposes, and its size in [N m] or [N]."""

    joint: Joint
    coordinate: int
    magnitude: float


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Constraints and links at n states.

    Attributes:
        q: coordinates of the spanning tree.
        rates: of the coordinates in units, (count, n) per second.
        residual: of the constraint equations, (rows, n).
        jacobian: of the constraints by the free coordinates in units, (n, rows, free), those of
            prescribed coordinates last.
        gamma: velocity-product term of the loops, (n, rows less prescribed ones).
        poses: of the links.
        twist: of each link at the ground's origin, (links, 6, n).
        bias: acceleration of each link at constant rates, (links, 6, n).
    """

    q: Coordinates
    rates: Array
    residual: Array
    jacobian: Array
    gamma: Array
    poses: LinkPoses
    twist: Array
    bias: Array


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Accelerations and energies at n states.

    Attributes:
        acceleration: of the coordinates in units, (count, n) per second squared.
        driving: effort that moves each prescribed coordinate, (prescribed, n) in [N m] or [N].
        holding: effort that each sticking friction carries, (frictions, n) in [N m] or [N].
        contact: force of each stop in contact along its coordinate, (contacts, n) in [N m] or [N] times the
            unit of the coordinate.
        kinetic: kinetic energy, (n,) in [J].
        potential: of gravity and springs, (n,) in [J].
        power_in: of motor, loads and prescribed motion, (n,) in [W].
        power_lost: in friction and dampers, (n,) in [W].
    """

    acceleration: Array
    driving: Array
    holding: Array
    contact: Array
    kinetic: Array
    potential: Array
    power_in: Array
    power_lost: Array


@dataclass(frozen=True)
class EquationsOfMotion:
    """The equations of motion of a dynamic model; its drivers are free or follow motion laws.

    Attributes:
        model: mechanism, masses and forces.
        loops: loop equations, in which locked coordinates are prescribed.
        start: assembled coordinates.
        prescribed: coordinate -> motion law that it follows; all others are free.
    """

    model: DynamicModel
    loops: TreeLoops
    start: Coordinates
    prescribed: Mapping[str, State] = field(default_factory=dict[str, State])

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Indices of the coordinates that are not locked."""
        return self.loops.unknown

    @cached_property
    def prescribed_indices(self) -> list[int]:
        """Index in the tree of each prescribed coordinate."""
        return [self.loops.tree.index_of[name] for name in self.prescribed]

    def prescribed_motion(self, times: Array) -> tuple[Array, Array, Array]:
        """Return values, rates and accelerations of the prescribed coordinates in units, (prescribed, n)."""
        units = self.loops.units[self.prescribed_indices][:, None]
        motion = np.zeros((3, len(self.prescribed), len(times)))
        for k, law in enumerate(self.prescribed.values()):
            motion[:, k] = [np.broadcast_to(values, times.shape) for values in law(times)]
        value, rate, acceleration = motion / units
        return value, rate, acceleration

    @cached_property
    def links(self) -> list[int]:
        """Index in the tree of each link of the mechanism."""
        return [self.loops.tree.index[link.name] for link in self.model.mechanism.links]

    @cached_property
    def crank(self) -> int | None:
        """Index of the crank's coordinate; None without a crank."""
        mechanism = self.model.mechanism
        return self.loops.tree.index_of[mechanism.crank.name] if mechanism.has_crank else None

    @cached_property
    def frictions(self) -> tuple[DryFriction, ...]:
        """Every Coulomb friction above zero."""
        frictions: list[DryFriction] = []
        for friction in self.model.forces.friction:
            joint = self.model.mechanism.joint(friction.joint)
            for i, (_, magnitude) in enumerate(friction.sizes(KINDS[joint.kind])):
                if magnitude:
                    frictions.append(DryFriction(joint, i, magnitude))
        return tuple(frictions)

    @cached_property
    def _inertias(self) -> tuple[Array, Array, Array]:
        """Masses (L,), centres (L, 3) and inertia matrices (L, 3, 3) in the links' own frames."""
        inertias = [link.inertia for link in self.model.mechanism.links if link.inertia is not None]
        return (
            np.array([inertia.mass for inertia in inertias]),
            np.array([inertia.centre for inertia in inertias]),
            np.array([inertia.moments for inertia in inertias]),
        )

    def kinematics(self, q: Coordinates, rates: Array) -> Kinematics:
        """Return constraints and links at coordinates and rates in units, (count, n)."""
        residual, jacobian, poses = self.loops.linearise(q)
        tree, physical = self.loops.tree, rates * self.loops.units[:, None]
        twist = twists(tree, poses, physical)
        bias = velocity_products(tree, poses, twist, physical)
        gamma = self.loops.velocity_products(q, poses, physical, twist, bias)
        free = self.with_prescribed(jacobian[:, self.free].transpose(2, 0, 1))
        return Kinematics(q, rates, residual, free, gamma.T, poses, twist, bias)

    def with_prescribed(self, jacobian: Array) -> Array:
        """Return a constraint Jacobian (n, rows, free) with the rows of prescribed coordinates."""
        if not self.prescribed:
            return jacobian
        rows = np.eye(self.loops.tree.count)[self.prescribed_indices][:, self.free]
        return np.concatenate([jacobian, np.broadcast_to(rows, (len(jacobian), *rows.shape))], 1)

    def accelerate(
        self,
        state: Kinematics,
        time: Array,
        sliding: Array,
        stuck: Sequence[int] = (),
        contacts: Sequence[int] = (),
    ) -> Dynamics:
        """Return the accelerations at states.

        Args:
            state: of n states.
            time: (n,) in [s].
            sliding: direction of each Coulomb friction's rate, (frictions,) of -1, 0, 1.
            stuck: indices of the frictions that hold their coordinate at rest.
            contacts: indices of the coordinates that a stop holds at rest.
        """
        unit, jacobians = self._unit_motion(state), self._link_jacobians(state)
        inertia = self._spatial_inertias(unit)
        mass = self._mass(jacobians, inertia)
        acting, loaded = applied(self.model, unit), loads(self.model, unit, time)
        wrenches = acting.gravity + acting.springs + acting.damping + loaded.wrenches
        on_crank = self._on_crank(state, loaded.crank)
        controlled = self._controlled(state, time)
        directions = self._friction_directions(unit, jacobians)
        rubbing = np.zeros_like(on_crank)
        for friction, direction, sign in zip(self.frictions, directions, sliding, strict=True):
            rubbing -= friction.magnitude * sign * direction
        force = (
            self._generalised(unit, jacobians, wrenches, self._inertial(state, inertia))
            + on_crank
            + controlled
            + rubbing
        )
        _, driven_rates, driven_accelerations = self.prescribed_motion(time)
        gamma = np.concatenate([state.gamma, -driven_accelerations.T], 1)
        rows, gamma = self._rows(state, gamma, directions, stuck, contacts)
        free, multipliers = constrained_acceleration(mass, force, rows, gamma)
        acceleration = np.zeros_like(state.rates)
        acceleration[self.free] = free.T
        n, first = len(time), state.jacobian.shape[1]
        holding = np.zeros((len(self.frictions), n))
        holding[list(stuck)] = multipliers[:, first : first + len(stuck)].T
        rates = state.rates[self.free].T
        driving = multipliers[:, first - len(self.prescribed) : first].T
        return Dynamics(
            acceleration=acceleration,
            driving=driving / self.loops.units[self.prescribed_indices][:, None],
            holding=holding,
            contact=multipliers[:, first + len(stuck) :].T,
            kinetic=0.5 * np.einsum("ni,nij,nj->n", rates, mass, rates),
            potential=acting.energy,
            power_in=(loaded.wrenches * unit.twist).sum((1, 2))
            + ((on_crank + controlled) * rates).sum(1)
            + (driving * driven_rates).sum(0),
            power_lost=-(acting.damping * unit.twist).sum((1, 2)) - (rubbing * rates).sum(1),
        )

    def impact(self, state: Kinematics, hit: Sequence[int], restitution: float) -> Array:
        """Return the rates after coordinates hit their stops, (count, 1), by the law of momentum.

        Source: F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts (1996), section 5.4
        (Newton's law of impact).
        """
        mass = self.mass(state)
        before = state.rates[self.free].T
        kept = np.concatenate([np.zeros_like(state.gamma), state.rates[self.prescribed_indices].T], 1)
        rows, _ = self._rows(state, kept, np.zeros((len(self.frictions), 1, len(self.free))), (), hit)
        target = np.concatenate([kept, -restitution * state.rates[list(hit)].T], 1)
        force = (mass @ before[..., None])[..., 0]
        after = np.zeros_like(state.rates)
        after[self.free] = constrained_acceleration(mass, force, rows, -target)[0].T
        return after

    def kinetic_energy(self, state: Kinematics, rates: Array) -> float:
        """Return the kinetic energy of one state at other rates, (count, 1), in [J]."""
        mass = self.mass(state)[0]
        free = rates[self.free, 0]
        return float(0.5 * free @ mass @ free)

    def mass(self, state: Kinematics) -> Array:
        """Return the mass matrix of the free coordinates in units, (n, free, free)."""
        return self._mass(self._link_jacobians(state), self._spatial_inertias(self._unit_motion(state)))

    def energy(self, state: Kinematics) -> tuple[float, float]:
        """Return kinetic and potential energy of one state in [J]."""
        unit = self._unit_motion(state)
        potential = float(applied(self.model, unit).energy[0])
        return self.kinetic_energy(state, state.rates), potential

    @property
    def steady(self) -> bool:
        """Whether nothing depends on time: neither loads, controllers nor prescribed motion."""
        return not (self.prescribed or self.model.forces.controllers) and not any(
            course.over == "time" for course in self.model.forces.courses
        )

    def _rows(
        self,
        state: Kinematics,
        gamma: Array,
        directions: Array,
        stuck: Sequence[int],
        contacts: Sequence[int],
    ) -> tuple[Array, Array]:
        """Return Jacobian (n, rows, free) and velocity products of loops, sticking frictions and stops."""
        rows, n = state.jacobian, len(state.q)
        if len(stuck):
            rows = np.concatenate([rows, directions[list(stuck)].transpose(1, 0, 2)], 1)
            gamma = np.concatenate([gamma, self._direction_rates(state, stuck)], 1)
        if len(contacts):
            units = np.eye(self.loops.tree.count)[list(contacts)][:, self.free]
            rows = np.concatenate([rows, np.broadcast_to(units, (n, *units.shape))], 1)
            gamma = np.concatenate([gamma, np.zeros((n, len(contacts)))], 1)
        return rows, gamma

    def _mass(self, jacobians: Array, inertia: Array) -> Array:
        """Return the mass matrix from link Jacobians and spatial inertias."""
        n, columns = len(jacobians), jacobians.shape[-1]
        momentum = (inertia @ jacobians).reshape(n, -1, columns)
        mass = jacobians.reshape(n, -1, columns).transpose(0, 2, 1) @ momentum
        if self.crank is not None:
            column = int(np.searchsorted(self.free, self.crank))
            mass[:, column, column] += self.model.forces.flywheel
        return mass

    @cached_property
    def rank(self) -> int:
        """Numerical rank of the loop constraints at the start."""
        jacobian = self.with_prescribed(self.loops.linearise(self.start)[1][None, :, self.free, 0])[0]
        return int(significant(np.linalg.svd(jacobian, compute_uv=False)).sum()) if jacobian.size else 0

    def conditioning(self, state: Kinematics) -> float:
        """Return the smallest singular value of one state's loop constraints; 1 without loops."""
        return float(self.conditionings(state)[0])

    def conditionings(self, state: Kinematics) -> Array:
        """Return the smallest singular value of the loop constraints of n states, (n,); 1 without loops."""
        if not self.rank:
            return np.ones(len(state.q))
        values: Array = np.linalg.svd(state.jacobian, compute_uv=False).astype(np.float64)
        return values[:, self.rank - 1]

    def friction_rates(self, state: Kinematics) -> Array:
        """Return the rate that each Coulomb friction opposes, (frictions, n) in [rad/s] or [m/s]."""
        directions = self._friction_directions(self._unit_motion(state), self._link_jacobians(state))
        return np.einsum("fnk,kn->fn", directions, state.rates[self.free])

    def _unit_motion(self, state: Kinematics) -> UnitMotion:
        """Return the links' motion by time in the form that applied forces are computed from."""
        position = state.poses.position[self.links].transpose(2, 0, 1)
        rotation = state.poses.rotation[self.links].transpose(3, 0, 1, 2)
        twist = state.twist[self.links].transpose(2, 0, 1).copy()
        twist[..., :3] += cross(twist[..., 3:], position)
        n = len(state.q)
        angle = np.zeros(n) if self.crank is None else state.q.values[self.crank]
        none = np.zeros((*twist.shape, 0))
        return UnitMotion(self.model.mechanism, angle, position, rotation, twist, np.zeros_like(twist), none)

    def _link_jacobians(self, state: Kinematics) -> Array:
        """Return each link's Jacobian at the ground's origin by the free coordinates, (n, L, 6, free)."""
        moved = self.loops.tree.moved_by[self.links][:, self.free]
        scaled = state.poses.unit_twists[self.free] * self.loops.units[self.free, None, None]
        return moved[None, :, None, :] * scaled.transpose(2, 1, 0)[:, None]

    def _spatial_inertias(self, unit: UnitMotion) -> Array:
        """Return each link's spatial inertia at the ground's origin, linear before angular, (n, L, 6, 6)."""
        masses, centres, moments = self._inertias
        rotation = unit.rotation
        centre = unit.position + (rotation @ centres[..., None])[..., 0]
        across, mass = skew(centre), masses[:, None, None]
        inertia = np.zeros((*centre.shape[:2], 6, 6))
        inertia[..., :3, :3] = mass * np.eye(3)
        inertia[..., 3:, :3], inertia[..., :3, 3:] = mass * across, -mass * across
        inertia[..., 3:, 3:] = rotation @ moments @ np.swapaxes(rotation, -1, -2) - mass * across @ across
        return inertia

    def _inertial(self, state: Kinematics, inertia: Array) -> Array:
        """Return the inertial wrenches at zero accelerations, at the ground's origin, (n, L, 6)."""
        twist, bias = (value[self.links].transpose(2, 0, 1) for value in (state.twist, state.bias))
        momentum, wrench = ((inertia @ value[..., None])[..., 0] for value in (twist, bias))
        linear, angular = twist[..., :3], twist[..., 3:]
        wrench[..., :3] += cross(angular, momentum[..., :3])
        wrench[..., 3:] += cross(angular, momentum[..., 3:]) + cross(linear, momentum[..., :3])
        return wrench

    def _generalised(
        self, unit: UnitMotion, jacobians: Array, wrenches: Array, less: Array | float = 0.0
    ) -> Array:
        """Return the generalised forces, (n, free).

        Args:
            unit: the links' motion.
            jacobians: of the links, (n, L, 6, free).
            wrenches: about the links' origins, (n, L, 6).
            less: wrenches at the ground's origin that are subtracted.
        """
        moved = wrenches - less
        moved[..., 3:] += cross(unit.position, wrenches[..., :3])
        return np.einsum("nlij,nli->nj", jacobians, moved)

    def _on_crank(self, state: Kinematics, torque: Array) -> Array:
        """Return the generalised force of motor and load torque on the crank, (n, free)."""
        total = np.zeros((len(torque), len(self.free)))
        if self.crank is not None:
            column = int(np.searchsorted(self.free, self.crank))
            total[:, column] = torque + self.model.forces.motor_torque(state.rates[self.crank])
        return total

    def _controlled(self, state: Kinematics, time: Array) -> Array:
        """Return the generalised force of the controllers, (n, free)."""
        total = np.zeros((len(time), len(self.free)))
        index_of, units = self.loops.tree.index_of, self.loops.units
        for controller in self.model.forces.controllers:
            values = {name: state.q.values[index_of[name]] for name in controller.coordinates}
            rates = {name: state.rates[i] * units[i] for name, i in index_of.items() if name in values}
            index = index_of[controller.coordinate]
            column = int(np.searchsorted(self.free, index))
            total[:, column] += controller.effort(values, rates, time) * units[index]
        return total

    def _friction_directions(self, unit: UnitMotion, jacobians: Array) -> Array:
        """Return the generalised force of a unit effort of each friction, (frictions, n, free)."""
        n, columns = len(unit), jacobians.shape[-1]
        directions = np.zeros((len(self.frictions), n, columns))
        for row, friction in zip(directions, self.frictions, strict=True):
            unit_forces = [np.zeros(n)] * friction.coordinate + [np.ones(n)]
            unit_forces += [np.zeros(n)] * len(friction.joint.coordinates)
            stack = np.zeros_like(unit.twist)
            add_joint_forces(unit, stack, friction.joint, unit_forces)
            row[:] = self._generalised(unit, jacobians, stack)
        return directions

    def _direction_rates(self, state: Kinematics, stuck: Sequence[int]) -> Array:
        """Return the velocity-product terms of the coordinates that friction holds, (n, stuck)."""
        ahead, behind = (self._displaced_directions(state, sign * DIFFERENCE) for sign in (1.0, -1.0))
        change = (ahead - behind)[list(stuck)] / (2.0 * DIFFERENCE)
        return np.einsum("fnk,kn->nf", change, state.rates[self.free])

    def _displaced_directions(self, state: Kinematics, seconds: float) -> Array:
        moved = self.kinematics(self.loops.displaced(state.q, seconds * state.rates), state.rates)
        return self._friction_directions(self._unit_motion(moved), self._link_jacobians(moved))


def constrained_acceleration(mass: Array, force: Array, rows: Array, gamma: Array) -> tuple[Array, Array]:
    """Solve M a = Q + J' lambda, J a + gamma = 0 where rows may repeat one another.

    Args:
        mass: (n, k, k), positive definite.
        force: (n, k).
        rows: constraint Jacobian J, (n, m, k).
        gamma: (n, m).

    Returns:
        Accelerations, (n, k), and the multipliers of least norm, (n, m).
    """
    if not rows.shape[1]:
        unconstrained: Any = np.linalg.solve(mass, force[..., None])[..., 0]
        return unconstrained, np.zeros_like(gamma)
    u, values, vh = np.linalg.svd(rows, full_matrices=False)
    kept = significant(values)
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    basis = vh * kept[..., None]
    along = np.swapaxes(vh, 1, 2) * inverse[:, None]
    particular = -(along @ (np.swapaxes(u, 1, 2) @ gamma[..., None]))
    projector = np.eye(mass.shape[1]) - np.swapaxes(basis, 1, 2) @ basis
    scale = np.trace(mass, axis1=1, axis2=2)[:, None, None] / mass.shape[1]
    reduced = projector @ mass @ projector + scale * (np.eye(mass.shape[1]) - projector)
    free = np.linalg.solve(reduced, projector @ (force[..., None] - mass @ particular))
    acceleration = projector @ free + particular
    multipliers = u @ (inverse[..., None] * (vh @ (mass @ acceleration - force[..., None])))
    result: Array = np.asarray(acceleration[..., 0])
    return result, multipliers[..., 0]


def equations_of_motion(
    model: DynamicModel,
    coordinates: Mapping[str, float] | None = None,
    prescribed: Mapping[str, State] | None = None,
) -> EquationsOfMotion:
    """Return the equations of motion of a dynamic model, assembled at its guess.

    Args:
        model: mechanism, masses and forces.
        coordinates: joint coordinates that the spanning tree should keep, as those with initial values.
        prescribed: coordinate -> motion law that it follows.

    Raises:
        AssemblyError: if the loops do not close.
    """
    mechanism, laws = model.mechanism, prescribed or {}
    controlled = [name for controller in model.forces.controllers for name in sorted(controller.coordinates)]
    kept = {name: 0.0 for name in [*(coordinates or {}), *laws, *controlled] if name not in mechanism.drivers}
    loops, start = assembled(replace(mechanism, counted={**kept, **mechanism.counted}))
    for name in controlled:
        if name not in loops.tree.index_of or name in mechanism.locked:
            raise InputError(
                f"{mechanism.name}: a controller names {name!r}, which is locked or closes a loop among the "
                "coordinates of controllers and initial values; name another one"
            )
    locked = tuple(loops.tree.index_of[name] for name in mechanism.locked)
    return EquationsOfMotion(model, replace(loops, driven=locked), start, laws)
