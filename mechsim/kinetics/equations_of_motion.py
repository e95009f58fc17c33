"""Equations of motion of any mechanism in the coordinates of its spanning tree.

M(q) a + h(q, v) = Q(q, v, t) + J' lambda with the loop constraints J a + gamma = 0. Displacements are in
characteristic lengths, angles in radians.

Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 8 (closed-loop systems); the mass
matrix is summed over the links from their spatial inertias at the ground's origin.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.kinematics.loops.constraints import TreeLoops
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses, link_poses, twists, velocity_products
from mechsim.kinematics.loops.start import CLOSED, assembled, close_nearest
from mechsim.kinetics.applied_forces import (
    add_tension,
    applied,
    distance_and_rate,
    length_and_rate,
    loads,
    power,
)
from mechsim.kinetics.link_forces import (
    DryFriction,
    LoadedCoordinate,
    causing_wrenches,
    constrained_acceleration,
    friction_wrenches,
    generalised_forces,
    inertial_wrenches,
    joint_wrenches,
    kinetic_energy,
    mass_matrix,
    responses,
    spatial_inertias,
)
from mechsim.kinetics.load_friction import friction_by_load
from mechsim.kinetics.model import REPEATED, DynamicModel
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.actuators import no_control
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.motion_laws import State
from mechsim.mechanism.nonlinear_springs import Phases
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.jets import stepped_sizes
from mechsim.numerics.rank import rank as rank_of
from mechsim.numerics.rank import right_vectors, significant

# step of the central difference for the rate of a friction direction, in units of the coordinates; the
# relative error of the rate is about 1e-10
DIFFERENCE = 1e-5
# distance from the start at which the rank of the constraints is looked at, too
NEXT_TO_START = 1e-2


@dataclass(frozen=True)
class Kinematics:
    """Constraints and links at n states; each is evaluated once, where it is first needed.

    Attributes:
        equations: equations of motion.
        q: coordinates of the spanning tree.
        rates: rates of the coordinates in units, (count, n) per second.
        activation: states of the actuators that have one, (states, n); None for their steady states.
    """

    equations: "EquationsOfMotion"
    q: Coordinates
    rates: Array
    activation: Array | None = None

    @cached_property
    def poses(self) -> LinkPoses:
        """Poses of the links."""
        return link_poses(self.equations.loops.tree, self.q)

    @cached_property
    def _physical(self) -> Array:
        return self.rates * self.equations.loops.units[:, None]

    @cached_property
    def twist(self) -> Array:
        """Twist of each link at the ground's origin, (links, 6, n)."""
        return twists(self.equations.loops.tree, self.poses, self._physical)

    @cached_property
    def bias(self) -> Array:
        """Acceleration of each link at constant rates, (links, 6, n)."""
        return velocity_products(self.equations.loops.tree, self.poses, self.twist, self._physical)

    @cached_property
    def jacobian(self) -> Array:
        """Jacobian of the constraints by the free coordinates in units, (n, rows, free).

        The rows of prescribed coordinates are last.
        """
        return constraint_jacobians(self.equations, self.q, poses=self.poses)

    @cached_property
    def conditioning(self) -> Array:
        """Smallest singular value of the loop constraints, (n,); 1 without loops.

        It is NaN where the loop equations are, as beyond the table of a coupling.
        """
        rank, n = self.equations.rank, len(self.q)
        if not rank:
            return np.ones(n)
        result, finite = np.full(n, np.nan), np.isfinite(self.jacobian).all((1, 2))
        result[finite] = np.linalg.svd(self.jacobian[finite], compute_uv=False)[:, rank - 1]
        return result

    @cached_property
    def gamma(self) -> Array:
        """Velocity-product term of the loops, (n, rows without prescribed ones)."""
        loops = self.equations.loops
        return loops.velocity_products(self.q, self.poses, self._physical, self.twist, self.bias).T

    @cached_property
    def unit(self) -> UnitMotion:
        """The links' motion by time as applied forces need it."""
        equations, mechanism = self.equations, self.equations.model.mechanism
        position = self.poses.position[equations.links].transpose(2, 0, 1)
        rotation = self.poses.rotation[equations.links].transpose(3, 0, 1, 2)
        twist = equations.of_links(self.twist).copy()
        twist[..., :3] += cross(twist[..., 3:], position)
        angle = np.zeros(len(self.q)) if equations.crank is None else self.q.values[equations.crank]
        none = np.zeros((*twist.shape, 0))
        unit = UnitMotion(mechanism, angle, position, rotation, twist, np.zeros_like(twist), none)
        continuous = {name: self.q.values[i] for name, i in equations.sprung.items()}
        return replace(unit, coordinates=continuous) if continuous else unit

    @cached_property
    def link_jacobians(self) -> Array:
        """Each link's Jacobian at the ground's origin by the free coordinates, (n, L, 6, free)."""
        loops, links, free = self.equations.loops, self.equations.links, self.equations.free
        moved = loops.tree.moved_by[links][:, free]
        scaled = self.poses.unit_twists[free] * loops.units[free, None, None]
        return moved[None, :, None, :] * scaled.transpose(2, 1, 0)[:, None]

    @cached_property
    def inertia(self) -> Array:
        """Spatial inertia of each link at the ground's origin."""
        return spatial_inertias(self.unit, *self.equations.inertias)

    @cached_property
    def mass(self) -> Array:
        """Mass matrix of the free coordinates in units, (n, free, free)."""
        return mass_matrix(self.link_jacobians, self.inertia) + self.equations.rotors


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Accelerations and energies at n states.

    Attributes:
        acceleration: accelerations of the coordinates in units, (count, n) per second squared.
        driving: drive force of each prescribed coordinate, (prescribed, n) in [N m] or [N].
        holding: force of each sticking friction, (frictions, n) in [N m] or [N].
        limits: largest sticking force of each friction, and force of a sliding one, (frictions, n).
        slip: acceleration of the rate that each sticking friction opposes, (frictions, n) in [1/s2]; nonzero
            if the joint reverses at a dead centre, which no friction prevents.
        contact: force of each stop in contact along its coordinate, (contacts, n) in [N m] or [N] times the
            unit of the coordinate.
        rows: constraint Jacobian of loops, sticking frictions and stops, (n, rows, free).
        kinetic: kinetic energy, (n,) in [J].
        potential: potential energy of gravity and springs, (n,) in [J].
        power_in: power of motor, loads and prescribed motion, (n,) in [W].
        power_lost: power lost in friction and dampers, (n,) in [W].
        activation: rates of the actuators' states, (states, n).
    """

    acceleration: Array
    driving: Array
    holding: Array
    limits: Array
    slip: Array
    contact: Array
    rows: Array
    kinetic: Array
    potential: Array
    power_in: Array
    power_lost: Array
    activation: Array


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """The equations of motion of a dynamic model; its drivers are free or follow motion laws.

    Attributes:
        model: the dynamic model.
        loops: loop equations, in which locked coordinates are prescribed.
        start: assembled coordinates.
        prescribed: coordinate -> its motion law; all others are free.
        added_moments: moments of inertia of passive rotations in the links' frames, (L, 3, 3); see
            `passive_rotation`.
    """

    model: DynamicModel
    loops: TreeLoops
    start: Coordinates
    prescribed: Mapping[str, State] = field(default_factory=dict[str, State])
    added_moments: Array | float = 0.0

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

    def of_links(self, values: Array) -> Array:
        """Return the mechanism's links' values (n, L, 6) among those of the tree's, (links, 6, n)."""
        return values[self.links].transpose(2, 0, 1)

    @cached_property
    def sprung(self) -> dict[str, int]:
        """Index in the tree of each coordinate along which springs act."""
        index_of = self.loops.tree.index_of
        return {name: index_of[name] for name in self.model.forces.sprung if name in index_of}

    @cached_property
    def crank(self) -> int | None:
        """Index of the crank's coordinate; None without a crank."""
        mechanism = self.model.mechanism
        return self.loops.tree.index_of[mechanism.crank.name] if mechanism.has_crank else None

    @cached_property
    def frictions(self) -> tuple[DryFriction, ...]:
        """Every Coulomb friction above zero, or with a load."""
        frictions: list[DryFriction] = []
        for friction in self.model.forces.friction:
            joint = self.model.mechanism.joint(friction.joint)
            loaded = [LoadedCoordinate(friction, *row) for row in friction.loaded(self.model.mechanism)]
            for i, (_, magnitude) in enumerate(friction.sizes(KINDS[joint.kind])):
                loads = tuple(item for item in loaded if item.coordinate == i)
                if magnitude or loads:
                    frictions.append(DryFriction(joint, i, magnitude, friction, loads))
        return tuple(frictions)

    @cached_property
    def inertias(self) -> tuple[Array, Array, Array]:
        """Masses (L,), centres (L, 3) and inertia matrices (L, 3, 3) in the links' frames."""
        inertias = [link.inertia for link in self.model.mechanism.links if link.inertia is not None]
        return (
            np.array([inertia.mass for inertia in inertias]),
            np.array([inertia.centre for inertia in inertias]),
            np.array([inertia.moments for inertia in inertias]) + self.added_moments,
        )

    def kinematics(
        self, q: Coordinates, rates: Array | None = None, activation: Array | None = None
    ) -> Kinematics:
        """Return constraints and links at coordinates and rates in units, (count, n); at rest for None."""
        return Kinematics(self, q, np.zeros_like(q.values) if rates is None else rates, activation)

    # whoever asks for the accelerations reports forces that are not finite
    @np.errstate(over="ignore", invalid="ignore")
    def accelerate(
        self,
        state: Kinematics,
        time: Array,
        sliding: Array,
        stuck: Sequence[int] = (),
        contacts: Sequence[int] = (),
        phases: Phases | None = None,
    ) -> Dynamics:
        """Return the accelerations at states.

        Args:
            state: n states.
            time: (n,) in [s].
            sliding: direction of each Coulomb friction's rate, (frictions,) of -1, 0, 1.
            stuck: indices of the sticking frictions.
            contacts: indices of the coordinates with a stop in contact.
            phases: phase of each nonlinear spring; None for that of the state.
        """
        unit, jacobians, mass = state.unit, state.link_jacobians, state.mass
        acting, loaded = applied(self.model, unit), loads(self.model, unit, time, phases=phases)
        at_joints, pulls, activation = _actuator_forces(self, state, time, loaded.crank)
        wrenches = acting.gravity + acting.springs + acting.damping + loaded.wrenches + pulls
        directions = self.friction_directions(state)
        inertial = inertial_wrenches(self.of_links(state.twist), self.of_links(state.bias), state.inertia)
        force = generalised_forces(unit, jacobians, wrenches, inertial) + at_joints
        _, driven_rates, driven_accelerations = self.prescribed_motion(time)
        # constraints: loops and prescribed coordinates, sticking friction, stops
        rows, gamma = state.jacobian, np.concatenate([state.gamma, -driven_accelerations.T], 1)
        if len(stuck):
            rows = np.concatenate([rows, directions[list(stuck)].transpose(1, 0, 2)], 1)
            gamma = np.concatenate([gamma, self._direction_rates(state, stuck)], 1)
        if len(contacts):
            rows = with_locked_rows(self, rows, contacts)
            gamma = np.concatenate([gamma, np.zeros((len(rows), len(contacts)))], 1)
        balance = directions, force, rows, gamma, wrenches, at_joints
        limits = self._friction_limits(state, time, sliding, stuck, contacts, *balance)
        rubbing = _rubbing(limits, sliding, directions, force)
        free, multipliers = constrained_acceleration(mass, force + rubbing, rows, gamma)
        acceleration = np.zeros_like(state.rates)
        acceleration[self.free] = free.T
        n, first = len(time), state.jacobian.shape[1]
        sticking = slice(first, first + len(stuck))
        holding, slip = np.zeros((2, len(self.frictions), n))
        holding[list(stuck)] = multipliers[:, sticking].T
        slip[list(stuck)] = ((rows[:, sticking] @ free[..., None])[..., 0] + gamma[:, sticking]).T
        rates = state.rates[self.free].T
        driving = multipliers[:, first - len(self.prescribed) : first].T
        return Dynamics(
            acceleration=acceleration,
            driving=driving / self.loops.units[self.prescribed_indices][:, None],
            holding=holding,
            limits=limits,
            slip=slip,
            contact=multipliers[:, first + len(stuck) :].T,
            rows=rows,
            kinetic=kinetic_energy(mass, rates),
            potential=acting.energy + loaded.energy,
            power_in=loaded.work
            + power(unit, pulls)
            + (at_joints * rates).sum(1)
            + (driving * driven_rates).sum(0),
            power_lost=loaded.lost - (acting.damping * unit.twist).sum((1, 2)) - (rubbing * rates).sum(1),
            activation=activation,
        )

    def _friction_limits(
        self,
        state: Kinematics,
        time: Array,
        sliding: Array,
        stuck: Sequence[int],
        contacts: Sequence[int],
        directions: Array,
        force: Array,
        rows: Array,
        gamma: Array,
        wrenches: Array,
        at_joints: Array,
    ) -> Array:
        """Return the magnitude of each sliding friction, and the limit of each other, (frictions, n).

        Those by the load follow from the wrenches in the joints without them, and by a unit of each.
        """
        n, first, units = len(time), state.jacobian.shape[1], self.loops.units[self.free]
        magnitudes = np.array([friction.magnitude for friction in self.frictions])
        limits = np.outer(magnitudes, np.ones(n))
        loaded = [(f, item) for f, friction in enumerate(self.frictions) for item in friction.loads]
        if not loaded:
            return limits
        force = force + _rubbing(limits, sliding, directions, force)
        without = constrained_acceleration(state.mass, force, rows, gamma)
        by_unit = responses(state.mass, np.array([-sliding[f] * directions[f] for f, _ in loaded]), rows)
        solutions = zip(without, by_unit, strict=True)
        accelerations, multipliers = (np.concatenate([alone[None], others]) for alone, others in solutions)
        # along each coordinate: frictions that slide without a load or stick, and changes of them
        along = np.zeros((1 + len(loaded), len(self.frictions), n))
        along[0] = -magnitudes[:, None] * sliding[:, None]
        along[:, list(stuck)] = multipliers[:, :, first : first + len(stuck)].transpose(0, 2, 1)
        for column, (f, _) in enumerate(loaded, 1):
            along[column, f] -= sliding[f]
        # the balance has no equations of drivers, whose forces are those in joints
        unit = replace(state.unit, mechanism=replace(self.model.mechanism, driver=()))
        still, bias = replace(unit, twist=np.zeros_like(unit.twist)), self.of_links(state.bias)
        index_of = self.loops.tree.index_of.items()
        columns = {name: int(np.searchsorted(self.free, i)) for name, i in index_of if i in self.free}
        driven, stopped = (np.searchsorted(self.free, index) for index in (self.prescribed_indices, contacts))
        unit_wrenches = [friction_wrenches(friction, unit) for friction in self.frictions]
        needed = np.zeros((*unit.twist.shape, 1 + len(loaded)))
        for column, (acceleration, multiplier) in enumerate(zip(accelerations, multipliers, strict=True)):
            in_joints = -acceleration @ self.rotors
            in_joints[:, driven] += multiplier[:, first - len(driven) : first]
            in_joints[:, stopped] += multiplier[:, first + len(stuck) :]
            in_joints = in_joints / units + (0.0 if column else at_joints / units)
            moved = (state.link_jacobians @ acceleration[:, None, :, None])[..., 0]
            inertial = causing_wrenches(still, moved) if column else causing_wrenches(unit, moved + bias)
            wrench = inertial - joint_wrenches(unit, {name: in_joints[:, k] for name, k in columns.items()})
            acting = zip(along[column], unit_wrenches, strict=True)
            wrench -= sum((effort[:, None, None] * stack for effort, stack in acting), 0.0)
            needed[..., column] = wrench if column else wrench - wrenches
        signs = [np.full(n, sliding[f]) if sliding[f] else -np.sign(along[0, f]) for f, _ in loaded]
        rates = np.einsum("fnk,kn->fn", directions, state.rates[self.free])
        ratios = [
            np.full(n, item.friction.ratio_at_rest) if f in stuck else item.friction.ratio(rates[f])
            for f, item in loaded
        ]
        labels = [f"{unit.mechanism.name} at {value:.6g} s" for value in time]
        items, by_load = [item for _, item in loaded], np.zeros_like(limits)
        frictions = friction_by_load(unit, needed, wrenches, items, signs, ratios, labels).T
        for (f, _), magnitude in zip(loaded, frictions, strict=True):
            by_load[f] += magnitude
        return limits + by_load

    def smooth_forces(self, state: Kinematics) -> tuple[Array, Array]:
        """Return generalised forces at time zero without Coulomb friction, and sums of their terms' sizes.

        Complex steps of coordinates or rates are propagated, also to the sizes. Both results are (n, free).
        """
        unit, time = state.unit, np.zeros(len(state.q))
        acting, loaded = applied(self.model, unit), loads(self.model, unit, time)
        at_joints, pulls, _ = _actuator_forces(self, state, time, loaded.crank)
        wrenches = acting.gravity, acting.springs, acting.damping, loaded.wrenches, pulls
        wrenches, none = [each for each in wrenches if each.any()], np.zeros_like(pulls)
        total, sizes = sum(wrenches, none), sum(map(stepped_sizes, wrenches), none)
        arms = stepped_sizes(unit.position).sum(-1, keepdims=True)
        sizes[..., 3:] += arms * sizes[..., :3].sum(-1, keepdims=True)
        total[..., 3:] += cross(unit.position, total[..., :3])
        moved = self.loops.tree.moved_by[self.links][:, self.free]
        unit_twists = state.poses.unit_twists[self.free] * self.loops.units[self.free, None, None]
        # real numbers, so that complex ones take no products with zeros
        force, magnitude = (
            np.einsum("jin,nji->nj", along, (links.T @ on_links.view(np.float64)).view(on_links.dtype))
            for along, links, on_links in (
                (unit_twists, moved, total),
                (stepped_sizes(unit_twists), np.abs(moved), sizes),
            )
        )
        return force + at_joints, magnitude + stepped_sizes(at_joints)

    def energy(self, state: Kinematics) -> tuple[float, float]:
        """Return kinetic and potential energy of one state in [J]."""
        twist, rates = self.of_links(state.twist), state.rates[self.free, 0]
        kinetic = 0.5 * (np.einsum("nli,nlij,nlj", twist, state.inertia, twist) + rates @ self.rotors @ rates)
        springs = zip(self.model.forces.nonlinear_springs, self.spring_lengths(state)[0], strict=True)
        stored = sum(spring.law.energy(lengths) for spring, lengths in springs)
        potential = applied(self.model, state.unit).energy + stored
        return float(kinetic), float(potential[0])

    @property
    def steady(self) -> bool:
        """Whether neither loads, controllers, actuators nor prescribed motion depend on time."""
        forces = self.model.forces
        varying = [a for a in forces.actuators if a.control is not no_control or a.inflow is not None]
        return not (self.prescribed or forces.controllers or varying) and not any(
            course.over == "time" for course in self.model.forces.load_profiles
        )

    @cached_property
    def rotors(self) -> Array:
        """Inertia of rotors and the flywheel, which depends on no coordinate, (free, free) in units."""
        forces, units = self.model.forces, self.loops.units[self.free]
        turning = forces.armature.items()
        if self.crank is not None:
            turning = [*turning, (self.model.mechanism.crank.name, forces.flywheel)]
        rows = [({name: 1.0}, inertia) for name, inertia in turning]
        rows += [(actuator.gear, actuator.inertia) for actuator in forces.actuators]
        total = np.zeros((len(units), len(units)))
        for gear, inertia in rows:
            along = self.loops.tree.coupled(gear)[self.free] * units
            total += inertia * np.outer(along, along)
        return total

    @cached_property
    def rank(self) -> int:
        """Numerical rank of the loop constraints, at the start or next to it: the start may be singular.

        It is not if they have no higher rank where all free coordinates are displaced and the loops open.
        """
        steps = np.zeros((self.loops.tree.count, 2))
        steps[self.free, 1] = NEXT_TO_START * np.cos(1.0 + np.arange(len(self.free)))
        both = self.loops.displaced(self.start.repeated(2), steps)
        jacobian, displaced = constraint_jacobians(self, both)
        if not jacobian.size:
            return 0
        values, basis = right_vectors(jacobian)
        rank = int(significant(values).sum())
        if np.isfinite(displaced).all() and rank_of(displaced) <= rank:
            return rank
        step = np.zeros((self.loops.tree.count, 1))
        step[self.free, 0] = NEXT_TO_START * basis[rank:].sum(0)
        moved, gap = close_nearest(self.loops, self.loops.displaced(self.start, step))
        if not (gap <= CLOSED).all():
            return rank
        return max(rank, rank_of(constraint_jacobians(self, moved)[0]))

    def spring_lengths(self, state: Kinematics) -> tuple[Array, Array]:
        """Return lengths and rates of the nonlinear springs, (springs, n) each."""
        unit, springs = state.unit, self.model.forces.nonlinear_springs
        lengths, rates = np.empty((2, len(springs), len(unit)))
        for k, spring in enumerate(springs):
            lengths[k], rates[k] = length_and_rate(unit, spring)
        return lengths, rates

    @cached_property
    def _constant_directions(self) -> tuple[Array, frozenset[int]]:
        """Generalised force of a unit of each friction along a coordinate of the tree, (frictions, free).

        Also the numbers of the other frictions, whose directions vary.
        """
        every, varying = np.diag(self.loops.units)[:, self.free], set[int]()
        directions = np.zeros((len(self.frictions), len(self.free)))
        for k, friction in enumerate(self.frictions):
            names = friction.joint.coordinates[friction.coordinate :]
            index = None if KINDS[friction.joint.kind].ball else self.loops.tree.index_of.get(names[0])
            if index is None:
                varying.add(k)
            else:
                directions[k] = every[index]
        return directions, frozenset(varying)

    def friction_directions(self, state: Kinematics) -> Array:
        """Return the generalised force of a unit of each friction, (frictions, n, free)."""
        constant, varying = self._constant_directions
        directions = np.repeat(constant[:, None], len(state.q), 1)
        for k in varying:
            wrenches = friction_wrenches(self.frictions[k], state.unit)
            directions[k] = generalised_forces(state.unit, state.link_jacobians, wrenches)
        return directions

    def friction_rates(self, state: Kinematics) -> Array:
        """Return the rate that each Coulomb friction opposes, (frictions, n) in [rad/s] or [m/s]."""
        return np.einsum("fnk,kn->fn", self.friction_directions(state), state.rates[self.free])

    def friction_accelerations(self, state: Kinematics, accelerations: Array) -> Array:
        """Return the changes of the opposed rates, (frictions, n), at accelerations (count, n)."""
        by_acceleration = np.einsum("fnk,kn->fn", self.friction_directions(state), accelerations[self.free])
        return by_acceleration + self._direction_rates(state, range(len(self.frictions))).T

    def _direction_rates(self, state: Kinematics, stuck: Sequence[int]) -> Array:
        """Return the velocity-product terms of the coordinates with sticking friction, (n, stuck)."""
        if self._constant_directions[1].isdisjoint(stuck):
            return np.zeros((len(state.q), len(stuck)))
        displaced: list[Array] = []
        for seconds in (DIFFERENCE, -DIFFERENCE):
            moved = self.kinematics(self.loops.displaced(state.q, seconds * state.rates), state.rates)
            displaced.append(self.friction_directions(moved))
        change = (displaced[0] - displaced[1])[list(stuck)] / (2.0 * DIFFERENCE)
        return np.einsum("fnk,kn->nf", change, state.rates[self.free])


def _actuator_forces(
    equations: EquationsOfMotion, state: Kinematics, time: Array, torque: Array
) -> tuple[Array, Array, Array]:
    """Return the generalised force of motor, controllers, actuators and load torque, (n, free).

    Also return the wrenches of actuators between points, (n, L, 6), and the rates of the actuators' states,
    (states, n).
    """
    forces, tree, units = equations.model.forces, equations.loops.tree, equations.loops.units
    dtype = np.result_type(state.q.values, state.rates)
    total = np.zeros((len(units), len(time)), dtype)
    if equations.crank is not None:
        total[equations.crank] = torque + forces.motor_torque(state.rates[equations.crank])
    for controller in forces.controllers:
        values = {name: state.q.values[tree.index_of[name]] for name in controller.coordinates}
        rates = {name: state.rates[i] * units[i] for name, i in tree.index_of.items() if name in values}
        index = tree.index_of[controller.coordinate]
        total[index] += controller.effort(values, rates, time) * units[index]
    activations: list[Array] = []
    pulls = np.zeros_like(state.unit.twist)
    for actuator in forces.actuators:
        arms = tree.coupled(actuator.gear)
        length, speed = arms @ state.q.values, (arms * units) @ state.rates
        if actuator.ends:
            length, speed = (actuator.pull * value for value in distance_and_rate(state.unit, actuator.ends))
        inputs = actuator.input(time)
        if state.activation is None or actuator.inflow is None:
            activation = actuator.steady_state(time, length, speed)
        else:
            activation = state.activation[len(activations)]
        force = actuator.force(inputs, length, speed, activation)
        total += np.outer(arms * units, force)
        if actuator.ends:
            add_tension(state.unit, pulls, actuator.ends, -actuator.pull * force)
        if actuator.inflow is not None:
            activations.append(actuator.state_rate(inputs, length, speed, activation))
    return total[equations.free].T, pulls, np.reshape(activations, (len(activations), len(time)))


def _rubbing(limits: Array, sliding: Array, directions: Array, force: Array) -> Array:
    """Return the generalised force of the sliding frictions, (n, free)."""
    rows = zip(limits, sliding, directions, strict=True)
    return sum((-sign * limit[:, None] * direction for limit, sign, direction in rows), np.zeros_like(force))


def with_locked_rows(equations: EquationsOfMotion, jacobian: Array, indices: Sequence[int]) -> Array:
    """Return a constraint Jacobian (n, rows, free) with additional rows that lock coordinates of the tree."""
    if not len(indices):
        return jacobian
    rows = np.eye(equations.loops.tree.count)[list(indices)][:, equations.free]
    return np.concatenate([jacobian, np.broadcast_to(rows, (len(jacobian), *rows.shape))], 1)


def constraint_jacobians(
    equations: EquationsOfMotion, q: Coordinates, locked: Sequence[int] = (), poses: LinkPoses | None = None
) -> Array:
    """Return the Jacobians (n, rows, free) of the loops, prescribed coordinates and further locked ones."""
    jacobian = equations.loops.linearise(q, poses)[1][:, equations.free].transpose(2, 0, 1)
    return with_locked_rows(equations, jacobian, [*equations.prescribed_indices, *locked])


def equations_of_motion(
    model: DynamicModel,
    coordinates: Iterable[str] | None = None,
    prescribed: Mapping[str, State] | None = None,
) -> EquationsOfMotion:
    """Return the equations of motion of a dynamic model, assembled at its guess.

    Args:
        model: the dynamic model.
        coordinates: joint coordinates that the spanning tree must contain, such as those with initial values.
        prescribed: coordinate -> its motion law.

    Raises:
        AssemblyError: if the loops do not close.
    """
    mechanism, laws = model.mechanism, prescribed or {}
    named = {*(coordinates or {}), *laws, *model.forces.controlled, *model.forces.sprung} - {
        *mechanism.drivers
    }
    needed = [name for joint in mechanism.joints for name in joint.coordinates if name in named]
    equations = _free_equations(model, tuple(needed))
    return replace(equations, prescribed=laws) if laws else equations


@lru_cache(maxsize=REPEATED)
def _free_equations(model: DynamicModel, needed: tuple[str, ...]) -> EquationsOfMotion:
    """Return the equations of motion of a model with free drivers and needed coordinates in the tree."""
    mechanism = model.mechanism
    loops, start = assembled(mechanism, needed)
    for name in sorted(model.forces.controlled):
        if name not in loops.tree.index_of or name in mechanism.locked:
            raise InputError(
                f"{mechanism.name}: a controller or actuator names {name!r}, which is locked or closes a "
                "loop among the coordinates of controllers and initial values; name another one"
            )
    locked = tuple(loops.tree.index_of[name] for name in mechanism.locked)
    return EquationsOfMotion(model, replace(loops, driven=locked), start)
