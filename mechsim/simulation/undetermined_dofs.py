"""What the drivers leave open: rank decides before anything is run, so that no motion is invented."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import STEPPED, AssemblyError, MobilityError
from mechsim.maths.arrays import Array
from mechsim.model.joint_ranges import check_instants, extremes, require_within
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.model_loops import FREE, HINGE, SLIDE, ModelLoops
from mechsim.simulation.numerical_rank import RANK_TOLERANCE
from mechsim.simulation.poses import follow
from mechsim.simulation.redundant_drivers import refusal, stuck

# displacement, in [rad] and in units of the size, by which a freedom is tried; part of it that stays where
# there is one, and that a point or joint moves by which it matters
NUDGE, STAYS, MATTERS = 1e-3, 0.5, 1e-2
# bodies that a note lists
LISTED = 6


@dataclass(frozen=True, slots=True)
class Standing:
    """How a model stands with its drivers held.

    Attributes:
        open: joints and points that can still move; idle freedoms, such as a rod's spin, are none.
        locked: the drivers that cannot move by themselves though nothing is open.
        meeting: whether two assemblies meet in this very pose.
        settled: the bodies whose centres cannot move, (nbody,).
    """

    open: tuple[str, ...]
    locked: tuple[str, ...]
    meeting: bool
    settled: NDArray[np.bool_]


def standing(closed: ClosedModel) -> Standing:
    """Return what the drivers leave open at the closed state of a model."""
    loops, state = closed.loops, closed.closed[None]
    jacobian = loops.linearise(state)[1]
    held = loops.held(jacobian)[0]
    _, values, freedoms = np.linalg.svd(held)
    rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
    unmoved = stuck(loops, jacobian[0])
    names: list[str] = []
    singular, settled = False, np.ones(loops.model.nbody, dtype=np.bool_)
    for freedom in freedoms[rank:]:
        moved = _moved(loops, closed.closed, freedom)
        there = moved if moved is not None else _nudged(loops, closed.closed, freedom)
        seen = _seen(closed, closed.closed, there)
        settled &= ~_swings(loops, closed.closed, there)
        singular |= moved is None and bool(seen)
        names += seen if moved is not None else ()
    return Standing(
        tuple(dict.fromkeys(names)),
        locked=() if singular or names else unmoved,
        meeting=singular and not unmoved,
        settled=settled,
    )


def require_determined(closed: ClosedModel, found: Standing) -> None:
    """Refuse a model whose poses the crank does not settle.

    Raises:
        MobilityError: with the joints and points left open.
    """
    if found.open:
        raise MobilityError(
            f"{closed.loops.name}: undetermined: with the {_drivers(closed)} held "
            f"{', '.join(found.open)} can still move; "
            f"drive, hold or couple them, or {STEPPED}",
            "undetermined",
        )


def require_movable(closed: ClosedModel, found: Standing) -> None:
    """Refuse a crank that cannot move, and a start from which two motions lead.

    Raises:
        MobilityError: for a crank that cannot move.
        AssemblyError: where two assemblies meet in the pose it starts from.
    """
    if found.locked:
        raise refusal(closed.loops, found.locked, closed.angle)
    if found.meeting:
        raise AssemblyError(
            f"{closed.loops.name}: it starts at {closed.loops.said(closed.angle)}, where two assemblies "
            "meet and none can be told from the other; give a start at "
            f"{'another crank angle' if closed.loops.drive is None else 'other values of the drivers'}"
        )


def require_within_limits(closed: ClosedModel, states: Array) -> None:
    """Refuse poses beyond the range of a joint, states being (n, nq).

    Raises:
        AssemblyError: with the joint, its value, its bound and the crank angle or the time.
    """
    model, limited = closed.model, _limited(closed)
    names = {i: str(model.joint(i).name or i) for i in limited}
    require_within(
        closed.loops.name,
        {name: (float(model.jnt_range[i, 0]), float(model.jnt_range[i, 1])) for i, name in names.items()},
        {name: states[:, model.jnt_qposadr[i]] for i, name in names.items()},
        {name: "rad" if model.jnt_type[i] == HINGE else "m" for i, name in names.items()},
        lambda worst: closed.loops.said(float(states[worst, closed.loops.crank_place])),
        _less(closed),
    )


def require_path_within_limits(closed: ClosedModel, angles: Array) -> None:
    """Refuse a motion on which a joint leaves its range, between its recorded instants too.

    Args:
        closed: the model.
        angles: of the crank or of the clock, (n,) in [rad].

    Raises:
        AssemblyError: as `require_within_limits`.
    """
    limited = _limited(closed)
    if not limited or np.ptp(angles) == 0.0:
        return
    drive = closed.loops.drive
    if drive is not None and not drive.law(angles)[1].any():
        # rows of driver coordinates, each a pose by itself
        return
    instants = check_instants(float(angles.min()), float(angles.max()))
    try:
        states = follow.follow(closed.loops, closed.closed, instants)
        between = extremes(instants, states[:, closed.model.jnt_qposadr[limited]].T)
        if len(between):
            states = np.concatenate([states, follow.follow(closed.loops, closed.closed, between)])
    except AssemblyError:
        # instants at which the loops do not close are no part of what was requested
        return
    require_within_limits(closed, states)


def _limited(closed: ClosedModel) -> list[int]:
    """Return the hinges and slides whose ranges count."""
    model = closed.model
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return []
    return [i for i in np.flatnonzero(model.jnt_limited).tolist() if model.jnt_type[i] in (HINGE, SLIDE)]


def _drivers(closed: ClosedModel) -> str:
    return "crank" if closed.loops.drive is None else "drivers"


def _less(closed: ClosedModel) -> str:
    return "turn the crank less" if closed.loops.drive is None else "move the drivers less"


def _nudged(loops: ModelLoops, state: Array, freedom: Array) -> Array:
    step = np.zeros((1, loops.model.nv))
    step[0, loops.free] = NUDGE * freedom
    return loops.moved(state[None], step)[0]


def _moved(loops: ModelLoops, state: Array, freedom: Array) -> Array | None:
    """Return the state moved along a freedom and closed; None where the loops do not let it."""
    nudged = _nudged(loops, state, freedom)
    try:
        closed = loops.close(nudged[None])[0]
    except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
        return None
    return closed if np.abs(closed - nudged).max() < (1.0 - STAYS) * np.abs(nudged - state).max() else None


def _seen(closed: ClosedModel, state: Array, moved: Array) -> list[str]:
    """Return the joints and tracked points that differ between two states."""
    model, loops = closed.model, closed.loops
    found: list[str] = []
    swings = _swings(loops, state, moved)
    for body in range(model.nbody - 1, 0, -1):
        swings[model.body_parentid[body]] |= swings[body]
    for i, (kind, place) in enumerate(zip(model.jnt_type, model.jnt_qposadr, strict=True)):
        scale = loops.size if kind == SLIDE else 1.0
        turned = kind in (HINGE, SLIDE) and abs(moved[place] - state[place]) > MATTERS * NUDGE * scale
        # a link that spins about its own line stands as it did
        if turned and swings[model.jnt_bodyid[i]]:
            found.append(f"joint {model.joint(i).name or i!r}")
    places = closed.places(np.stack([state, moved]))
    gone = np.linalg.norm(places[1] - places[0], axis=1)
    for name, far in zip(closed.track.points, gone, strict=True):
        body = int(model.site_bodyid[model.site(name).id])
        if far > MATTERS * NUDGE * loops.size and not _floats(loops, body):
            found.append(f"point {name}")
    return found


def _swings(loops: ModelLoops, state: Array, moved: Array) -> NDArray[np.bool_]:
    """Return whose centres differ between two states, (nbody,)."""
    gone = np.diff(loops.centres(np.stack([state, moved])), axis=0)[0]
    return np.linalg.norm(gone, axis=1) > MATTERS * NUDGE * loops.size


def _floats(loops: ModelLoops, body: int) -> bool:
    """Say whether a body hangs on nothing: free, and in no loop."""
    return int(loops.model.body_rootid[body]) in _floating(loops)


def _floating(loops: ModelLoops) -> list[int]:
    """Return the bodies with free joints of which nothing is in a loop."""
    model = loops.model
    free = model.jnt_bodyid[model.jnt_type == FREE].tolist()
    closing = {int(model.body_rootid[body]) for pair in (*loops.pairs, *loops.frames) for body in pair.bodies}
    return [body for body in free if body not in closing]


def told_floating(closed: ClosedModel) -> str:
    """Return in one sentence which bodies poses leave where they start, hanging on nothing; else none."""
    model, bodies = closed.model, _floating(closed.loops)
    if not bodies:
        return ""
    names = [str(model.body(body).name or f"body {body}") for body in bodies[:LISTED]]
    more = f" and {len(bodies) - LISTED} more" if len(bodies) > LISTED else ""
    floats, stands, them = (
        ("floats", "it stands where it starts", "it")
        if len(bodies) == 1
        else ("float", "they stand where they start", "them")
    )
    return (
        f"{', '.join(names)}{more} {floats} beside what is driven, and poses say nothing of that: {stands}; "
        f"hold {them} (--fix-base), or {STEPPED}"
    )
