"""Which points of a model are tracked: those asked for, else its named sites, else the origins of bodies."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.model.links import GROUND
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.driven_joints import did_you_mean, listed
from mechsim.simulation.mjcf_reader.link_frames import Carrier

# body and place in its frame, in [m]
BodyPoint = tuple[str, Array]


def tracked(
    model: mujoco.MjModel, carriers: Sequence[Carrier], requested: Sequence[str]
) -> dict[str, BodyPoint]:
    """Return the tracked points: name -> body and place in its frame.

    Args:
        model: the model.
        carriers: the link of every body.
        requested: NAME of a site or body, or NAME,BODY@x,y,z in [m]; empty takes the named sites on moving
            bodies, or the origins of moving bodies where there are none.

    Raises:
        InputError: for a name that is no site and no body, or a place that is not three numbers.
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
    for candidates in (sites, bodies):
        selected = {name: point for name, point in candidates.items() if point[0] in moving}
        if selected:
            return selected
    return {}


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
