"""Undetermined DOFs: before a run, the rank of the loop Jacobian shows whether the drivers suffice."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import STEPPED, AssemblyError, MobilityError, first_names
from mechsim.mechanism.limits import check_instants, extremes, require_within
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import pseudo_inverse
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses import follow
from mechsim.simulation.state import FREE, HINGE, SCALAR, SLIDE, limited_joints

# residual, relative to the largest Jacobian entry, above which a driver is immobile
LOCKED_FRACTION = 1e-6


def immobile_drivers(loops: ModelLoops, jacobian: Array) -> tuple[str, ...]:
    """Return the crank, or the drivers, that cannot move while the other drivers are locked.

    Args:
        loops: loops of the model.
        jacobian: Jacobian at one state, (m, nv).
    """
    names, driver_columns = ("crank",), -jacobian[:, [loops.crank]]
    if not loops.drivers.crank:
        names, driver_columns = loops.drivers.names, np.eye(len(jacobian))[:, -len(loops.drivers.names) :]
    constrained = loop_jacobian.constrained_jacobian(loops, jacobian[None])[0]
    projected = constrained @ (pseudo_inverse(constrained, floor=0.0) @ driver_columns)
    errors = np.abs(projected - driver_columns).max(0, initial=0.0)
    tolerance = max(LOCKED_FRACTION * float(np.abs(jacobian).max(initial=0.0)), loop_jacobian.rounding(loops))
    return tuple(name for name, miss in zip(names, errors, strict=True) if not miss <= tolerance)


def overdetermined_error(loops: ModelLoops, locked: tuple[str, ...], angle: float) -> MobilityError:
    """Return the error that names the immobile drivers; `angle` is the crank's, in [rad]."""
    if loops.drivers.crank:
        problem = f"the crank cannot move at {loops.drivers.text(angle)}"
        remedy = "remove a driver, a gear or a joint"
    else:
        others = "the other drivers are" if len(loops.drivers.names) > 1 else "all else is"
        problem = f"{', '.join(locked)} cannot move while {others} locked"
        remedy = "remove a driver, a coupling, a locked joint or a joint"
    return MobilityError(f"{loops.name}: overdetermined: {problem}; {remedy}", "overdetermined")


# displacement of the probe along a null-space direction, in [rad] and in characteristic lengths; its least
# fraction after closure of the loops for a finite DOF; least displacement of a moving joint or point
PROBE_DISPLACEMENT, MIN_REMAINING, MIN_DISPLACEMENT = 1e-3, 0.5, 1e-5
# maximum number of bodies in a note
MAX_LISTED = 6


@dataclass(frozen=True, slots=True)
class ResidualMobility:
    """The remaining mobility of a model with its drivers locked.

    Attributes:
        undetermined: joints and points that can still move, without passive DOFs such as a rod's spin.
        immobile_drivers: drivers that cannot move independently although nothing is undetermined.
        at_change_point: whether the pose is a change point.
        determined_bodies: whether each body's centre is determined, (nbody,).
    """

    undetermined: tuple[str, ...]
    immobile_drivers: tuple[str, ...]
    at_change_point: bool
    determined_bodies: NDArray[np.bool_]


def residual_mobility(closed: ClosedModel) -> ResidualMobility:
    """Return the mobility that the drivers leave at the closed state of a model."""
    loops, state = closed.loops, closed.qpos[None]
    jacobian = loops.linearise(state)[1]
    immobile = immobile_drivers(loops, jacobian[0])
    names: list[str] = []
    singular, determined = False, np.ones(loops.model.nbody, dtype=np.bool_)
    for direction in loop_jacobian.null_space(loops, jacobian):
        nudged = loops.displaced(state, PROBE_DISPLACEMENT * direction[None])[0]
        moved = _closed_after_nudge(loops, closed.qpos, nudged)
        reached = nudged if moved is None else moved
        moved_names = _moved_names(closed, closed.qpos, reached)
        determined &= ~_moved_bodies(loops, closed.qpos, reached)
        singular |= moved is None and bool(moved_names)
        names += moved_names if moved is not None else ()
    return ResidualMobility(
        tuple(dict.fromkeys(names)),
        immobile_drivers=() if singular or names else immobile,
        at_change_point=singular and not immobile,
        determined_bodies=determined,
    )


def require_determined(closed: ClosedModel, mobility: ResidualMobility) -> None:
    """Reject a model with poses that the drivers do not determine.

    Raises:
        MobilityError: if joints or points are undetermined; it names them.
    """
    if mobility.undetermined:
        drivers = "crank" if closed.loops.drivers.crank else "drivers"
        what = f"with the {drivers} locked {', '.join(mobility.undetermined)} can still move"
        raise MobilityError(
            f"{closed.loops.name}: underdetermined: {what}; drive, lock or couple them, or {STEPPED}",
            "underdetermined",
        )


def require_movable(closed: ClosedModel, mobility: ResidualMobility) -> None:
    """Reject immobile drivers, and a start at a change point, where two motions begin.

    Raises:
        MobilityError: if drivers are immobile.
        AssemblyError: if the start is a change point.
    """
    if mobility.immobile_drivers:
        raise overdetermined_error(closed.loops, mobility.immobile_drivers, closed.angle)
    if mobility.at_change_point:
        raise AssemblyError(
            f"{closed.loops.name}: it starts at {closed.loops.drivers.text(closed.angle)}, where two "
            "assemblies meet and cannot be distinguished; give a start at "
            f"{'another crank angle' if closed.loops.drivers.crank else 'other values of the drivers'}"
        )


def require_within_limits(closed: ClosedModel, states: Array) -> None:
    """Reject states (n, nq) beyond the range of a joint.

    Raises:
        AssemblyError: with the joint, its value, its limit and the crank angle or the time.
    """
    model, limited = closed.model, limited_joints(closed.model).tolist()
    names = {i: str(model.joint(i).name or i) for i in limited}
    require_within(
        closed.loops.name,
        {name: (float(model.jnt_range[i, 0]), float(model.jnt_range[i, 1])) for i, name in names.items()},
        {name: states[:, model.jnt_qposadr[i]] for i, name in names.items()},
        {name: "rad" if model.jnt_type[i] == HINGE else "m" for i, name in names.items()},
        lambda worst: closed.loops.drivers.text(float(states[worst, closed.loops.crank_address])),
        "turn the crank less" if closed.loops.drivers.crank else "move the drivers less",
    )


def require_path_within_limits(closed: ClosedModel, angles: Array) -> None:
    """Reject a motion on which a joint leaves its range, also between recorded instants.

    Args:
        closed: the model.
        angles: crank angles, or values of the path parameter, (n,) in [rad].

    Raises:
        AssemblyError: as `require_within_limits`.
    """
    limited, drivers = limited_joints(closed.model), closed.loops.drivers
    if not len(limited) or np.ptp(angles) == 0.0:
        return
    if not drivers.crank and not drivers.law(angles)[1].any():
        # the law is constant: each set of driver coordinates is a separate pose
        return
    instants = check_instants(float(angles.min()), float(angles.max()))
    try:
        states = follow.follow(closed.loops, closed.qpos, instants)
        between = extremes(instants, states[:, closed.model.jnt_qposadr[limited]].T)
        if len(between):
            states = np.concatenate([states, follow.follow(closed.loops, closed.qpos, between)])
    except AssemblyError:
        # the loops may not close between the requested instants
        return
    require_within_limits(closed, states)


def _closed_after_nudge(loops: ModelLoops, state: Array, nudged: Array) -> Array | None:
    """Return a state that was moved along a null-space direction, closed; None if the loops prevent it."""
    try:
        closed = loop_jacobian.close(loops, nudged[None])[0]
    except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
        return None
    remains = np.abs(closed - nudged).max() < (1.0 - MIN_REMAINING) * np.abs(nudged - state).max()
    return closed if remains else None


def _moved_names(closed: ClosedModel, state: Array, moved: Array) -> list[str]:
    """Return the joints and tracked points that differ between two states."""
    model, loops = closed.model, closed.loops
    names, moved_bodies = list[str](), _moved_bodies(loops, state, moved)
    for body in range(model.nbody - 1, 0, -1):
        moved_bodies[model.body_parentid[body]] |= moved_bodies[body]
    for i, (kind, address) in enumerate(zip(model.jnt_type, model.jnt_qposadr, strict=True)):
        scale = loops.characteristic_length if kind == SLIDE else 1.0
        if kind not in SCALAR or abs(moved[address] - state[address]) <= MIN_DISPLACEMENT * scale:
            continue
        # a link that spins about its own axis does not count as moved
        if moved_bodies[model.jnt_bodyid[i]]:
            names.append(f"joint {model.joint(i).name or i!r}")
    positions = closed.point_positions(np.stack([state, moved]))
    displacements = np.linalg.norm(positions[1] - positions[0], axis=1)
    for name, displacement in zip(closed.track.points, displacements, strict=True):
        root = int(model.body_rootid[model.site_bodyid[model.site(name).id]])
        floats = root in _floating_bodies(loops)
        if displacement > MIN_DISPLACEMENT * loops.characteristic_length and not floats:
            names.append(f"point {name}")
    return names


def _moved_bodies(loops: ModelLoops, state: Array, moved: Array) -> NDArray[np.bool_]:
    """Return a mask of the bodies whose centres of mass differ between two states, (nbody,)."""
    displacements = np.diff(loops.posed.centres(np.stack([state, moved])), axis=0)[0]
    return np.linalg.norm(displacements, axis=1) > MIN_DISPLACEMENT * loops.characteristic_length


def _floating_bodies(loops: ModelLoops) -> list[int]:
    """Return the bodies with free joints whose subtrees are in no loop."""
    model = loops.model
    free = model.jnt_bodyid[model.jnt_type == FREE].tolist()
    closing = [body for pair in (*loops.pairs, *loops.rods, *loops.frames) for body in pair.bodies]
    return [body for body in free if body not in model.body_rootid[closing]]


def floating_bodies_note(closed: ClosedModel) -> str:
    """Return a note about floating bodies, which keep their initial poses; empty without any."""
    model, bodies = closed.model, _floating_bodies(closed.loops)
    if not bodies:
        return ""
    names = [str(model.body(body).name or f"body {body}") for body in bodies]
    floats, state, pronoun = "float", "they stay at their initial poses", "them"
    if len(bodies) == 1:
        floats, state, pronoun = "floats", "it stays at its initial pose", "it"
    return (
        f"{first_names(names, MAX_LISTED)} {floats} independently of the drivers, so poses do not determine "
        f"it: {state}; fix {pronoun} (--fix-base), or {STEPPED}"
    )
