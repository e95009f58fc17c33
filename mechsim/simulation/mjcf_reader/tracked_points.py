"""Which points of a model are tracked: those asked for, else its named sites, else the origins of bodies."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.links import GROUND
from mechsim.simulation.mjcf_reader.driven_joints import listed, meant
from mechsim.simulation.mjcf_reader.link_places import Carrier

# body and place in its frame, in [m]
Place = tuple[str, Array]


def tracked(model: mujoco.MjModel, carried: Sequence[Carrier], asked: Sequence[str]) -> dict[str, Place]:
    """Return the tracked points: name -> body and place in its frame.

    Args:
        model: the model.
        carried: the link of every body.
        asked: NAME of a site or body, or NAME,BODY@x,y,z in [m]; empty takes the named sites on moving
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
    if asked:
        return dict(_asked(text, {**bodies, **sites}, bodies) for text in asked)
    moving = {model.body(b).name for b in range(model.nbody) if carried[b].link != GROUND}
    for known in (sites, bodies):
        found = {name: place for name, place in known.items() if place[0] in moving}
        if found:
            return found
    return {}


def _asked(text: str, known: dict[str, Place], bodies: dict[str, Place]) -> tuple[str, Place]:
    name, comma, rest = text.partition(",")
    if not comma:
        if name not in known:
            raise InputError(
                f"--track names {name!r}{meant(name, list(known))}; sites and bodies of the model "
                f"are {listed(list(known))}; "
                "write NAME,BODY@x,y,z for another point"
            )
        return name, known[name]
    body, at, numbers = rest.partition("@")
    if body not in bodies:
        raise InputError(
            f"--track {text!r} names body {body!r}{meant(body, list(bodies))}; bodies of the model are "
            f"{listed(list(bodies))}"
        )
    try:
        place = np.array([float(number) for number in numbers.split(",")]) if at else np.zeros(3)
    except ValueError:
        place = np.empty(0)
    if place.shape != (3,) or not np.isfinite(place).all() or not name:
        raise InputError(f"--track {text!r} has no name or no place; write NAME,BODY@x,y,z with metres")
    return name, (body, place)
