"""Coulomb friction that knows its load: frictions and reactions of a state are one problem.

The wrenches that joints transmit are linear in the frictions, and the frictions are sums of magnitudes of
these wrenches (`mechsim.mechanism.joint_friction`). The answer is the only stable solution
(`mechsim.numerics.complementarity`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mechsim.errors import FrictionError, InputError
from mechsim.kinetics.applied_forces import Applied, add_joint_force, dry_friction, joint_rates, require_idle
from mechsim.kinetics.link_forces import LoadedCoordinate
from mechsim.kinetics.reactions import linear_reactions
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.numerics.arrays import Array
from mechsim.numerics.complementarity import balanced_friction

# share of a self-stress that changes the magnitude of a load, above rounding
FELT = 1e-6
# load relative to the largest one, and to the largest force or moment on a link, below which it is
# rounding, and has no direction
NO_LOAD = 1e-9


def friction_by_load(
    unit: UnitMotion,
    needed: Array,
    acting: Array,
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
        acting: wrenches that act on the links, (n, L, 6), by whose sizes the first of `needed` has rounding.
        coordinates: the k coordinates with friction.
        directions: sign of the rate of each, (n,).
        ratios: friction at this rate relative to that in fast motion, (n,).
        labels: of the states, for messages.

    Raises:
        FrictionError: at the first state without unique frictions.
    """
    reactions = linear_reactions(unit, needed, [item.friction.coupling or item.joint for item in coordinates])
    terms: list[Array] = []
    stresses: list[Array] = []
    # largest change of a load by a self-stress, if nothing cancelled
    scale = np.zeros(len(unit))
    for k, (item, (wrench, alone, sound)) in enumerate(zip(coordinates, reactions, strict=True)):
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
        # no less than 1 N m or that over the length, as the self-stresses are scaled: less is rounding
        stress = np.maximum(force + moment / length, 1.0 / length)
        scale = np.maximum(scale, (by_force + by_moment / length) * stress)
    loads = np.stack(terms, 1)
    base, response = loads[..., 0], loads[..., 1:]
    constant = [(ratio - 1.0) * item.constant for item, ratio in zip(coordinates, ratios, strict=True)]
    magnitude, radius, solutions = balanced_friction(np.stack(constant, 1), base, response)
    final = base + np.einsum("nktcj,nj->nktc", response, magnitude)
    amount = np.sqrt((final**2).sum(-1))
    # in free fall only rounding is needed
    wrenches = np.concatenate([needed[..., 0], acting], 1)
    pull, couple = (np.linalg.norm(block, axis=2).max(1) for block in np.split(wrenches, 2, axis=2))
    largest = np.maximum(amount.max((1, 2)), pull + couple / unit.mechanism.characteristic_length)
    clear = amount > NO_LOAD * largest[:, None, None]
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
        item = coordinates[int(np.argmax(loose[i]))]
        name, instead = f"joint {item.joint.name!r}", "a coefficient there"
        if item.friction.coupling:
            name, instead = f"coupling {item.friction.coupling!r}", "an efficiency"
        cause = (
            f"the load of {name} is undetermined, since redundant constraints share it, and so is its "
            f"friction; give `coulomb` instead of {instead}"
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
        add_joint_force(unit, stack, item.joint, item.coordinate, -dry.direction)
        require_idle(unit, stack, "friction")
        stacks.append(stack)
    applied_wrenches = acting.total(speed)
    columns = [needed - applied_wrenches, *(-sign[:, None, None] * stack for stack in stacks)]
    directions = [sign * dry.direction for dry in frictions]
    ratios = [item.friction.ratio(dry.rate * speed) for item, dry in zip(coordinates, frictions, strict=True)]
    labels = [f"{unit.mechanism.name} at {value:.6g} rad" for value in unit.angle]
    stacked = np.stack(columns, -1)
    magnitudes = friction_by_load(unit, stacked, applied_wrenches, coordinates, directions, ratios, labels).T
    coulomb = acting.coulomb + sum(
        (magnitude[:, None, None] * stack for magnitude, stack in zip(magnitudes, stacks, strict=True)), 0.0
    )
    loaded = [replace(dry, magnitude=magnitude) for dry, magnitude in zip(frictions, magnitudes, strict=True)]
    return replace(acting, coulomb=coulomb, dry=(*acting.dry, *loaded))
