"""Undetermined DOFs: the rank of the loop Jacobian decides, before a run, whether the drivers suffice."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import STEPPED, AssemblyError, MobilityError
from mechsim.model.limits import check_instants, extremes, require_within
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.model_loops import FREE, HINGE, SLIDE, ModelLoops
from mechsim.simulation.poses import follow
from mechsim.simulation.redundant_drivers import immobile_drivers, overdetermined_error

# displacement, in [rad] and in characteristic lengths, by which a null-space direction is probed; fraction of
# it that remains after closing the loops if the DOF is real; fraction by which a moving point or joint moves
NUDGE, STAYS, MATTERS = 1e-3, 0.5, 1e-2
# maximum number of bodies that a note lists
MAX_LISTED = 6


@dataclass(frozen=True, slots=True)
class ResidualMobility:
    """What can still move in a model with its drivers locked.

    Attributes:
        undetermined: joints and points that can still move, without passive DOFs such as a rod's spin.
        immobile_drivers: the drivers that cannot move independently although nothing is undetermined.
        at_change_point: whether the pose is a change point.
        determined_bodies: the bodies whose centres cannot move, (nbody,).
    """

    undetermined: tuple[str, ...]
    immobile_drivers: tuple[str, ...]
    at_change_point: bool
    determined_bodies: NDArray[np.bool_]


def residual_mobility(closed: ClosedModel) -> ResidualMobility:
    """Return what the drivers leave undetermined at the closed state of a model."""
    loops, state = closed.loops, closed.qpos[None]
    jacobian = loops.linearise(state)[1]
    held = loops.constrained_jacobian(jacobian)[0]
    _, values, freedoms = np.linalg.svd(held)
    rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
    unmoved = immobile_drivers(loops, jacobian[0])
    names: list[str] = []
    singular, settled = False, np.ones(loops.model.nbody, dtype=np.bool_)
    for freedom in freedoms[rank:]:
        moved = _closed_after_nudge(loops, closed.qpos, freedom)
        there = moved if moved is not None else _nudged(loops, closed.qpos, freedom)
        seen = _moved_names(closed, closed.qpos, there)
        settled &= ~_moved_bodies(loops, closed.qpos, there)
        singular |= moved is None and bool(seen)
        names += seen if moved is not None else ()
    return ResidualMobility(
        tuple(dict.fromkeys(names)),
        immobile_drivers=() if singular or names else unmoved,
        at_change_point=singular and not unmoved,
        determined_bodies=settled,
    )


def require_determined(closed: ClosedModel, found: ResidualMobility) -> None:
    """Reject a model whose poses the drivers do not determine.

    Raises:
        MobilityError: with the undetermined joints and points.
    """
    if found.undetermined:
        raise MobilityError(
            f"{closed.loops.name}: underdetermined: with the {_drivers(closed)} held "
            f"{', '.join(found.undetermined)} can still move; "
            f"drive, hold or couple them, or {STEPPED}",
            "underdetermined",
        )


def require_movable(closed: ClosedModel, found: ResidualMobility) -> None:
    """Reject immobile drivers, and a start at a change point, from which two motions lead.

    Raises:
        MobilityError: for immobile drivers.
        AssemblyError: for a start at a change point.
    """
    if found.immobile_drivers:
        raise overdetermined_error(closed.loops, found.immobile_drivers, closed.angle)
    if found.at_change_point:
        raise AssemblyError(
            f"{closed.loops.name}: it starts at {closed.loops.driver_text(closed.angle)}, where two "
            "assemblies meet and none can be told from the other; give a start at "
            f"{'another crank angle' if closed.loops.drivers is None else 'other values of the drivers'}"
        )


def require_within_limits(closed: ClosedModel, states: Array) -> None:
    """Reject states (n, nq) beyond the range of a joint.

    Raises:
        AssemblyError: with the joint, its value, its limit and the crank angle or the time.
    """
    model, limited = closed.model, _limited(closed)
    names = {i: str(model.joint(i).name or i) for i in limited}
    require_within(
        closed.loops.name,
        {name: (float(model.jnt_range[i, 0]), float(model.jnt_range[i, 1])) for i, name in names.items()},
        {name: states[:, model.jnt_qposadr[i]] for i, name in names.items()},
        {name: "rad" if model.jnt_type[i] == HINGE else "m" for i, name in names.items()},
        lambda worst: closed.loops.driver_text(float(states[worst, closed.loops.crank_address])),
        _range_remedy(closed),
    )


def require_path_within_limits(closed: ClosedModel, angles: Array) -> None:
    """Reject a motion on which a joint leaves its range, also between recorded instants.

    Args:
        closed: the model.
        angles: of the crank, or values of the path parameter, (n,) in [rad].

    Raises:
        AssemblyError: as `require_within_limits`.
    """
    limited = _limited(closed)
    if not limited or np.ptp(angles) == 0.0:
        return
    drive = closed.loops.drivers
    if drive is not None and not drive.law(angles)[1].any():
        # the law is constant: each set of driver coordinates is a separate pose
        return
    instants = check_instants(float(angles.min()), float(angles.max()))
    try:
        states = follow.follow(closed.loops, closed.qpos, instants)
        between = extremes(instants, states[:, closed.model.jnt_qposadr[limited]].T)
        if len(between):
            states = np.concatenate([states, follow.follow(closed.loops, closed.qpos, between)])
    except AssemblyError:
        # instants at which the loops do not close were not requested
        return
    require_within_limits(closed, states)


def _limited(closed: ClosedModel) -> list[int]:
    """Return the hinges and slides whose limits are active."""
    model = closed.model
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return []
    return [i for i in np.flatnonzero(model.jnt_limited).tolist() if model.jnt_type[i] in (HINGE, SLIDE)]


def _drivers(closed: ClosedModel) -> str:
    return "crank" if closed.loops.drivers is None else "drivers"


def _range_remedy(closed: ClosedModel) -> str:
    return "turn the crank less" if closed.loops.drivers is None else "move the drivers less"


def _nudged(loops: ModelLoops, state: Array, freedom: Array) -> Array:
    step = np.zeros((1, loops.model.nv))
    step[0, loops.free] = NUDGE * freedom
    return loops.displaced(state[None], step)[0]


def _closed_after_nudge(loops: ModelLoops, state: Array, freedom: Array) -> Array | None:
    """Return the state moved along a null-space direction and closed; None where the loops prevent it."""
    nudged = _nudged(loops, state, freedom)
    try:
        closed = loops.close(nudged[None])[0]
    except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
        return None
    return closed if np.abs(closed - nudged).max() < (1.0 - STAYS) * np.abs(nudged - state).max() else None


def _moved_names(closed: ClosedModel, state: Array, moved: Array) -> list[str]:
    """Return the joints and tracked points that differ between two states."""
    model, loops = closed.model, closed.loops
    found: list[str] = []
    swings = _moved_bodies(loops, state, moved)
    for body in range(model.nbody - 1, 0, -1):
        swings[model.body_parentid[body]] |= swings[body]
    for i, (kind, place) in enumerate(zip(model.jnt_type, model.jnt_qposadr, strict=True)):
        scale = loops.characteristic_length if kind == SLIDE else 1.0
        turned = kind in (HINGE, SLIDE) and abs(moved[place] - state[place]) > MATTERS * NUDGE * scale
        # a link that spins about its own axis has not moved
        if turned and swings[model.jnt_bodyid[i]]:
            found.append(f"joint {model.joint(i).name or i!r}")
    places = closed.point_positions(np.stack([state, moved]))
    gone = np.linalg.norm(places[1] - places[0], axis=1)
    for name, far in zip(closed.track.points, gone, strict=True):
        body = int(model.site_bodyid[model.site(name).id])
        if far > MATTERS * NUDGE * loops.characteristic_length and not _is_floating(loops, body):
            found.append(f"point {name}")
    return found


def _moved_bodies(loops: ModelLoops, state: Array, moved: Array) -> NDArray[np.bool_]:
    """Return which bodies' centres of mass differ between two states, (nbody,)."""
    gone = np.diff(loops.centres(np.stack([state, moved])), axis=0)[0]
    return np.linalg.norm(gone, axis=1) > MATTERS * NUDGE * loops.characteristic_length


def _is_floating(loops: ModelLoops, body: int) -> bool:
    """Return whether a body floats: it belongs to a free body that is in no loop."""
    return int(loops.model.body_rootid[body]) in _floating_bodies(loops)


def _floating_bodies(loops: ModelLoops) -> list[int]:
    """Return the bodies with free joints whose subtrees are in no loop."""
    model = loops.model
    free = model.jnt_bodyid[model.jnt_type == FREE].tolist()
    closing = {int(model.body_rootid[body]) for pair in (*loops.pairs, *loops.frames) for body in pair.bodies}
    return [body for body in free if body not in closing]


def floating_bodies_note(closed: ClosedModel) -> str:
    """Return a note about floating bodies, which poses leave at their initial poses; empty without any."""
    model, bodies = closed.model, _floating_bodies(closed.loops)
    if not bodies:
        return ""
    names = [str(model.body(body).name or f"body {body}") for body in bodies[:MAX_LISTED]]
    more = f" and {len(bodies) - MAX_LISTED} more" if len(bodies) > MAX_LISTED else ""
    floats, stands, them = (
        ("floats", "it stands where it starts", "it")
        if len(bodies) == 1
        else ("float", "they stand where they start", "them")
    )
    return (
        f"{', '.join(names)}{more} {floats} beside what is driven, and poses say nothing of that: {stands}; "
        f"hold {them} (--fix-base), or {STEPPED}"
    )
