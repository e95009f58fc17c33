"""Coulomb friction that knows its load: frictions and reactions of a state are one problem.

The wrenches that joints transmit are linear in the frictions, and the frictions are sums of magnitudes of
these wrenches (`mechsim.mechanism.joint_friction`). The answer is the only stable solution
(`mechsim.numerics.complementarity`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechsim.errors import FrictionError, InputError
from mechsim.kinetics.applied_forces import Applied, add_joint_forces, dry_friction, joint_rates, require_idle
from mechsim.kinetics.link_forces import DryFriction, constrained_acceleration, friction_wrenches
from mechsim.kinetics.reactions import linear_reactions
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.complementarity import balanced_friction

# share of a self-stress that changes the magnitude of a load, above rounding
FELT = 1e-6
# load relative to the largest one below which it is rounding, and has no direction
NO_LOAD = 1e-9


@dataclass(frozen=True, slots=True)
class LoadedCoordinate:
    """A friction by the load: its number in its joint, the coordinate that it opposes, its constant part."""

    friction: Friction
    joint: Joint
    number: int
    coordinate: int
    constant: float

    def unit_forces(self, direction: Array) -> list[Array]:
        """Return the forces (n,) along the joint's coordinates of a unit friction against a direction."""
        kind, zero = KINDS[self.joint.kind], np.zeros(len(direction))
        count = 1 if kind.ball else kind.dof
        return [-direction if i == self.coordinate else zero for i in range(count)]


def friction_by_load(
    unit: UnitMotion,
    needed: Array,
    coordinates: Sequence[LoadedCoordinate],
    directions: Sequence[Array],
    ratios: Sequence[Array],
    labels: Sequence[str],
) -> Array:
    """Return the frictions of states, (n, k) in [N] or [N m].

    A self-stress that changes no load to first order is taken as zero: in a planar mechanism, forces across
    the plane.

    Args:
        unit: the motion.
        needed: wrenches that the joints exert on the links, in columns, (n, L, 6, 1 + k): without these
            frictions, and changes by a unit of each.
        coordinates: the k coordinates with friction.
        directions: sign of the rate of each, (n,).
        ratios: friction at this rate relative to that in fast motion, (n,).
        labels: of the states, for messages.

    Raises:
        FrictionError: at the first state without unique frictions.
    """
    wrenches = linear_reactions(unit, needed, [item.friction.coupling or item.joint for item in coordinates])
    terms: list[Array] = []
    stresses: list[Array] = []
    # largest change of a load by a self-stress, if nothing cancelled
    scale = np.zeros(len(unit))
    for k, (item, (wrench, alone, sound)) in enumerate(zip(coordinates, wrenches, strict=True)):
        axis, kind = unit.axis(item.joint), KINDS[item.joint.kind]
        _, maps = item.friction.loads(item.joint, axis)[item.number]
        maps = maps * ratios[k][:, None, None, None]
        if kind.helical and not item.number:
            wrench[:, 3:, 1 + k] -= directions[k][:, None] * axis
        terms.append(np.einsum("ntcw,nwj->ntcj", maps, wrench))
        stresses.append(np.einsum("ntcw,nws->ntcs", maps, alone * sound[:, None, None]))
        by_force, by_moment = (
            np.linalg.norm(block, axis=(2, 3)).max(1) for block in (maps[..., :3], maps[..., 3:])
        )
        force, moment = (np.linalg.norm(block, axis=(1, 2)) for block in (alone[:, :3], alone[:, 3:]))
        length = unit.mechanism.characteristic_length
        scale = np.maximum(scale, (by_force + by_moment / length) * (force + moment / length))
    loads = np.stack(terms, 1)
    base, response = loads[..., 0], loads[..., 1:]
    constant = [(ratio - 1.0) * item.constant for item, ratio in zip(coordinates, ratios, strict=True)]
    magnitude, radius, solutions = balanced_friction(np.stack(constant, 1), base, response)
    final = base + np.einsum("nktcj,nj->nktc", response, magnitude)
    amount = np.sqrt((final**2).sum(-1))
    clear = amount > NO_LOAD * amount.max((1, 2), keepdims=True)
    along = final / np.where(clear, amount, np.inf)[..., None]
    stress = np.stack(stresses, 1)
    felt = np.abs(np.einsum("nktc,nktcs->nkts", along, stress))
    loose = (felt > FELT * scale[:, None, None, None]).any((2, 3))
    wrong = np.flatnonzero(loose.any(1) | (solutions != 1))
    if not len(wrong):
        return magnitude
    i, names = wrong[0], ", ".join(dict.fromkeys(item.joint.name for item in coordinates))
    grow = f"balances the forces (loads grow by {radius[i]:.3g} of the friction); reduce a coefficient"
    outcome, cause = "undetermined", f"more than one stable friction in {names} {grow}"
    if not solutions[i]:
        outcome, cause = "jammed", f"friction jams the mechanism, since no stable friction in {names} {grow}"
    elif loose[i].any():
        cause = (
            f"the load of joint {coordinates[int(np.argmax(loose[i]))].joint.name!r} is undetermined, since "
            "redundant constraints share it, and so is its friction; give `coulomb` instead of a coefficient "
            "there"
        )
    raise FrictionError(f"{labels[i]}: {cause}", outcome)


def with_load_friction(
    unit: UnitMotion, forces: Forces, acting: Applied, needed: Array, speed: Array
) -> Applied:
    """Return the applied forces of a prescribed motion with the friction by the load.

    Args:
        unit: the motion per radian of the crank.
        forces: all forces.
        acting: applied forces without this friction.
        needed: wrenches on the links that cause the motion, less loads and drives, (n, L, 6).
        speed: crank speed, (n,) in [rad/s].

    Raises:
        FrictionError: at instants without unique frictions.
    """
    coordinates = [LoadedCoordinate(f, *row) for f in forces.friction for row in f.loaded(unit.mechanism)]
    if not coordinates:
        return acting
    if np.iscomplexobj(unit.position):
        raise InputError(
            f"{unit.mechanism.name}: derivatives of friction by the load are not computed; give `coulomb` "
            "instead of a coefficient"
        )
    frictions = [
        dry_friction(unit, item.joint, joint_rates(unit, item.joint), item.coordinate) for item in coordinates
    ]
    sign, stacks = np.sign(speed), list[Array]()
    for item, dry in zip(coordinates, frictions, strict=True):
        stack = np.zeros_like(needed)
        add_joint_forces(unit, stack, item.joint, item.unit_forces(dry.direction))
        require_idle(unit, stack, "friction")
        stacks.append(stack)
    columns = [needed - acting.total(speed), *(-sign[:, None, None] * stack for stack in stacks)]
    directions = [sign * dry.direction for dry in frictions]
    ratios = [item.friction.ratio(dry.rate * speed) for item, dry in zip(coordinates, frictions, strict=True)]
    labels = [f"{unit.mechanism.name} at {value:.6g} rad" for value in unit.angle]
    magnitudes = friction_by_load(unit, np.stack(columns, -1), coordinates, directions, ratios, labels).T
    coulomb = acting.coulomb + sum(
        (magnitude[:, None, None] * stack for magnitude, stack in zip(magnitudes, stacks, strict=True)), 0.0
    )
    loaded = [replace(dry, magnitude=magnitude) for dry, magnitude in zip(frictions, magnitudes, strict=True)]
    return replace(acting, coulomb=coulomb, dry=(*acting.dry, *loaded))


@dataclass(frozen=True, slots=True)
class ConstrainedMotion:
    """The equations of a motion, M a = Q + J' lambda and J a + gamma = 0, at n states.

    Attributes:
        unit: the links' motion by time; its mechanism has no drivers.
        jacobians: Jacobians of the links at the ground's origin, (n, L, 6, free).
        bias: accelerations of the links at constant rates, at the ground's origin, (n, L, 6).
        mass: M, (n, free, free).
        force: Q without frictions by the load, (n, free).
        rows: J, (n, m, free).
        gamma: velocity-product terms, (n, m).
        wrenches: applied wrenches on the links, without those in joints, (n, L, 6).
        steady: forces on the coordinates of joints that do not depend on the accelerations, (n, free).
    """

    unit: UnitMotion
    jacobians: Array
    bias: Array
    mass: Array
    force: Array
    rows: Array
    gamma: Array
    wrenches: Array
    steady: Array

    def solved(self, forces: Array) -> tuple[Array, Array]:
        """Return accelerations (c, n, free) and multipliers (c, n, m) under Q, and changes by other forces.

        `forces` are (c, n, free), the first of them Q.
        """
        count, n, _ = forces.shape
        gamma = np.concatenate([self.gamma, np.zeros(((count - 1) * n, self.gamma.shape[1]))])
        mass, rows = (np.tile(value, (count, 1, 1)) for value in (self.mass, self.rows))
        acceleration, multipliers = constrained_acceleration(mass, forces.reshape(count * n, -1), rows, gamma)
        return acceleration.reshape(count, n, -1), multipliers.reshape(count, n, -1)

    def inertial(self, acceleration: Array, *, change: bool) -> Array:
        """Return the inertial wrenches about the links' origins, (n, L, 6), or those of a change alone."""
        twist = np.zeros_like(self.unit.twist) if change else self.unit.twist
        moved = (self.jacobians @ acceleration[:, None, :, None])[..., 0] + (0.0 if change else self.bias)
        linear = moved[..., :3] + cross(moved[..., 3:], self.unit.position)
        linear = linear + cross(twist[..., 3:], twist[..., :3])
        second = np.concatenate([linear, moved[..., 3:]], -1)
        n = len(self.unit)
        return replace(self.unit, twist=twist, bias=second).inertial(np.ones(n), np.zeros(n))

    def on_links(self, tree: Mapping[str, int], forces: Array) -> Array:
        """Return wrenches on the links of forces (n, free) on coordinates, by their column."""
        stack = np.zeros_like(self.unit.twist)
        for joint in self.unit.mechanism.joints:
            if {*joint.coordinates} & {*tree}:
                zero = np.zeros(len(stack))
                own = [forces[:, tree[name]] if name in tree else zero for name in joint.coordinates]
                add_joint_forces(self.unit, stack, joint, own)
        return stack


def frictions_in_motion(
    motion: ConstrainedMotion,
    in_joints: Callable[[Array, Array], Array],
    columns: Mapping[str, int],
    frictions: Sequence[DryFriction],
    directions: Array,
    ratios: Array,
    sliding: Array,
    stuck: slice,
    sticking: Sequence[int],
    labels: Sequence[str],
) -> Array:
    """Return what each Coulomb friction has beyond its constant part, (frictions, n), when sticking at most.

    Args:
        motion: the equations of motion.
        in_joints: accelerations (n, free) and multipliers (n, m) -> forces on joint coordinates, (n, free).
        columns: joint coordinate -> its column among the free coordinates.
        frictions: all Coulomb frictions.
        directions: the generalised force of a unit of each, (frictions, n, free).
        ratios: friction at the rate of each relative to that in fast motion, (frictions, n).
        sliding: direction of each, (frictions,) of -1, 0, 1.
        stuck: multipliers of the sticking frictions.
        sticking: indices of the sticking frictions.
        labels: of the states, for messages.

    Raises:
        FrictionError: at states without unique frictions.
    """
    numbered = [(f, row) for f, friction in enumerate(frictions) for row in friction.loads]
    items = [LoadedCoordinate(frictions[f].friction, *row) for f, row in numbered]
    forces = np.stack([motion.force, *(-sliding[f] * directions[f] for f, _ in numbered)])
    accelerations, multipliers = motion.solved(forces)
    unit_wrenches = [friction_wrenches(friction, motion.unit) for friction in frictions]
    # along each coordinate: frictions that slide without a load or stick, and changes of them
    along = np.zeros((len(forces), len(frictions), len(motion.unit)))
    along[0] = -np.array([friction.magnitude for friction in frictions])[:, None] * sliding[:, None]
    along[:, sticking] = multipliers[:, :, stuck].transpose(0, 2, 1)
    for column, (f, _) in enumerate(numbered, 1):
        along[column, f] -= sliding[f]
    needed: list[Array] = []
    for column, (acceleration, multiplier, acting) in enumerate(
        zip(accelerations, multipliers, along, strict=True)
    ):
        at_joints = in_joints(acceleration, multiplier) + (0.0 if column else motion.steady)
        wrench = motion.inertial(acceleration, change=bool(column)) - motion.on_links(columns, at_joints)
        wrench -= sum(
            (force[:, None, None] * stack for force, stack in zip(acting, unit_wrenches, strict=True)), 0.0
        )
        needed.append(wrench if column else wrench - motion.wrenches)
    signs = [
        np.full(len(motion.unit), sliding[f]) if sliding[f] else -np.sign(along[0, f]) for f, _ in numbered
    ]
    magnitudes = friction_by_load(
        motion.unit, np.stack(needed, -1), items, signs, [ratios[f] for f, _ in numbered], labels
    ).T
    loads = np.zeros((len(frictions), len(motion.unit)))
    for (f, _), magnitude in zip(numbered, magnitudes, strict=True):
        loads[f] += magnitude
    return loads
