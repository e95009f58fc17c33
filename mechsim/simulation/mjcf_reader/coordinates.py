"""Driven joints and tracked points of a model, and suggestions for mistyped names."""

from collections.abc import Sequence
from difflib import get_close_matches

import mujoco
import numpy as np

from mechsim.errors import InputError, first_names
from mechsim.mechanism.links import GROUND, VIRTUAL_PREFIX
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.simulation.mjcf_reader.equality_constraints import tendon_weights
from mechsim.simulation.mjcf_reader.kinematic_tree import Carrier
from mechsim.simulation.state import BALL, FREE, scalar_joints

ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
ON_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
# maximum number of names in a message
MAX_LISTED = 12


def actuator_count(model: mujoco.MjModel) -> int:
    """Return the number of actuators; MuJoCo 4 counts it apart from controls, of which a `pid` has two."""
    return int(getattr(model, "nactuator", model.nu))


def actuator_names(model: mujoco.MjModel) -> list[str]:
    """Return the names of a model's actuators; unnamed ones are numbered from 1."""
    return [model.actuator(i).name or f"actuator{i + 1}" for i in range(actuator_count(model))]


def listed(names: Sequence[str]) -> str:
    """Return names as a message lists them, at most one line."""
    return first_names(names, MAX_LISTED) if names else "none"


def did_you_mean(name: str, names: Sequence[str]) -> str:
    """Return a suggestion for a mistyped name, as text; empty without a similar name."""
    close = get_close_matches(name, names, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def require_coordinate(model: mujoco.MjModel, name: str, what: str) -> None:
    """Reject a name that is no hinge or slide of a model."""
    names = [*scalar_joints(model)]
    if name not in names:
        kinds = {model.joint(j).name: int(model.jnt_type[j]) for j in range(model.njnt)}
        lock = f"hold it where it starts with --lock {name}"
        problems = {
            FREE: f"a free joint, which no one value places; {lock} or --fix-base",
            BALL: f"a ball joint, which no one value turns; {lock}, or write three hinges across each other "
            "in its place and name them",
        }
        if problem := problems.get(kinds.get(name, -1)):
            raise InputError(f"{what} names {name!r}, {problem}")
        raise InputError(
            f"{what} names {name!r}{did_you_mean(name, names)}; "
            f"hinges and slides of the model are {listed(names)}"
        )


def driven(
    model: mujoco.MjModel, requested: Sequence[str], locked: Sequence[str], describe_only: bool
) -> tuple[str, ...]:
    """Return the driven joints.

    Args:
        model: the model.
        requested: joints that the user names; if empty, the model selects them.
        locked: locked joints, which are no drivers even if an actuator acts on them.
        describe_only: whether a model without drivers is allowed.

    Raises:
        InputError: if a name is no hinge or slide, or none of several is a driver.
    """
    for name in requested:
        require_coordinate(model, name, "--drive")
    if requested:
        return tuple(dict.fromkeys(requested))
    candidates = [name for name in scalar_joints(model) if name not in locked]
    first = [name for a in range(len(model.actuator_trntype)) for name in actuated_joints(model, a)[:1]]
    actuated = tuple(dict.fromkeys(name for name in first if name in candidates))
    drivers = actuated or ((CRANK,) if CRANK in candidates else ())
    if candidates and not (drivers or describe_only):
        raise InputError(
            "nothing says what is driven: no actuator acts on a joint, and no hinge is called crank; "
            f"name joints by --drive, as in --drive '{candidates[0]}=0.1*sin(t)'; "
            f"there are {listed(candidates)}"
        )
    return drivers


def actuated_joints(model: mujoco.MjModel, actuator: int) -> list[str]:
    """Return the joints on which an actuator acts, directly or by a fixed tendon."""
    target, kind = int(model.actuator_trnid[actuator, 0]), int(model.actuator_trntype[actuator])
    if kind in ON_JOINT:
        return [model.joint(target).name]
    if kind == ON_TENDON and model.wrap_type[model.tendon_adr[target]] == mujoco.mjtWrap.mjWRAP_JOINT:
        return list(tendon_weights(model, target))
    return []


# body and position in its frame, in [m]
BodyPoint = tuple[str, Array]


def tracked(
    model: mujoco.MjModel, carriers: Sequence[Carrier], requested: Sequence[str]
) -> dict[str, BodyPoint]:
    """Return the tracked points: name -> body and position in its frame.

    Args:
        model: the model.
        carriers: the link of every body.
        requested: NAME of a site or body, or NAME,BODY@x,y,z in [m]; if empty, the named sites on moving
            bodies, or the origins of moving bodies if there are no such sites.

    Raises:
        InputError: if a name is no site or body, or a position is not three numbers.
    """
    sites = {
        model.site(s).name: (model.body(model.site_bodyid[s]).name, model.site_pos[s].copy())
        for s in range(model.nsite)
        if model.site(s).name and "@" not in model.site(s).name
    }
    bodies = {model.body(b).name: (model.body(b).name, np.zeros(3)) for b in range(1, model.nbody)}
    if requested:
        return dict(_parsed(text, {**bodies, **sites}, bodies) for text in requested)
    moving = {model.body(b).name for b in range(model.nbody) if carriers[b].link != GROUND}
    moving = {name for name in moving if not name.startswith(VIRTUAL_PREFIX)}

    def on_moving(candidates: dict[str, BodyPoint]) -> dict[str, BodyPoint]:
        return {name: point for name, point in candidates.items() if point[0] in moving}

    return on_moving(sites) or on_moving(bodies)


def _parsed(
    text: str, candidates: dict[str, BodyPoint], bodies: dict[str, BodyPoint]
) -> tuple[str, BodyPoint]:
    name, comma, rest = text.partition(",")
    if not comma:
        if name not in candidates:
            raise InputError(
                f"--track names {name!r}{did_you_mean(name, list(candidates))}; "
                f"sites and bodies of the model are {listed(list(candidates))}; "
                "write NAME,BODY@x,y,z for another point"
            )
        return name, candidates[name]
    body, marker, numbers = rest.partition("@")
    if body not in bodies:
        raise InputError(
            f"--track {text!r} names body {body!r}{did_you_mean(body, list(bodies))}; "
            f"bodies of the model are {listed(list(bodies))}"
        )
    try:
        position = np.array([float(number) for number in numbers.split(",")]) if marker else np.zeros(3)
    except ValueError:
        position = np.empty(0)
    if position.shape != (3,) or not np.isfinite(position).all() or not name:
        raise InputError(f"--track {text!r} has no name or no place; write NAME,BODY@x,y,z with metres")
    return name, (body, position)
