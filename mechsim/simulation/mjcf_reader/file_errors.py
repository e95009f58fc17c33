"""Errors about files in one line, and rejected numbers: not finite, too large, quaternions of length zero."""

import os
import re
from collections.abc import Iterator
from typing import Any
from xml.parsers import expat

import mujoco
import numpy as np

from mechsim.errors import InputError, cut
from mechsim.numerics.arrays import HUGE, Array

# maximum number of characters quoted from a message of MuJoCo
MAX_SHOWN = 300

_LINE = re.compile(r",?\s*line(?: number)?[ =:]+(\d+)", re.IGNORECASE)
_NOISE = re.compile(
    r"MuJoCo (?:refuses|rejects) the model: |(?:XML )?Error: |,? ?\bid -?\d+|Element name '',?"
    r"|ErrorID=\d+ \(0x[0-9a-f]+\)"
)
_PLUGIN = re.compile(r"plugin \S+ not found")
_NOT_INCLUDED = re.compile(r"Error opening file '(.+?)' Element 'include'")
# maximum nesting depth of MuJoCo's XML reader, and its error beyond that depth
MAX_DEPTH, _TOO_DEEP = 499, "XML_ELEMENT_DEPTH_EXCEEDED"
_ELEMENT = re.compile(r" Element (?:name )?('[^']*')")


def readable_error(path: str, error: Exception) -> InputError:
    """Return MuJoCo's error about a file in one line: file, line and message."""
    text = " ".join(str(error).split())
    if "XML parse error" in text:
        try:
            with open(path, "rb") as file:
                expat.ParserCreate().ParseFile(file)
        except expat.ExpatError as cause:
            return ill_formed(path, cause)
    line = _LINE.search(text)
    location = f"{path}, line {line[1]}" if line and int(line[1]) else path
    if include := _NOT_INCLUDED.search(text):
        folder, name = os.path.split(os.path.abspath(include[1]))
        return InputError(
            f"{location}: it includes {name}, which is not in {folder}; put it there, or correct the file"
        )
    if _TOO_DEEP in text:
        return InputError(
            f"{location}: elements are nested more than {MAX_DEPTH} deep, which MuJoCo's XML reader refuses; "
            "put the inner bodies into a file of their own and <include> it in their place"
        )
    message = " ".join(_NOISE.sub("", _LINE.sub("", text)).split()).strip(" ,;:")
    message = cut(_ELEMENT.sub(r" (element \1)", message), MAX_SHOWN)
    remedy = "take the plugin out of a copy" if _PLUGIN.search(message) else "correct the file"
    return InputError(f"{location}: MuJoCo refuses it: {message}; {remedy}")


def ill_formed(path: str, error: expat.ExpatError) -> InputError:
    """Return the error about a file that is no well-formed XML, with its position and cause."""
    return InputError(
        f"{path}, line {error.lineno}, column {error.offset + 1}: no well-formed XML, "
        f"{expat.ErrorString(error.code)}; correct the file"
    )


# largest length, in [m], and largest joint coordinate, in [m] or [rad]
MAX_LENGTH = 1e12


def require_numbers(path: str, spec: mujoco.MjSpec, model: mujoco.MjModel, start: Array) -> None:
    """Reject a model with numbers that are not finite or too large, invalid quaternions, or no time step.

    Args:
        path: path of the file.
        spec: specification of the model.
        model: model compiled from it.
        start: initial state, (nq,).

    Raises:
        InputError: with file, line, element and the numbers.
    """
    for what, element, values, limit in _numbers(spec, model):
        invalid = values[~(np.abs(values) <= limit)]
        if len(invalid) and not np.isfinite(invalid).all():
            raise _error(path, what, element, "numbers that are not finite")
        if len(invalid):
            raise _error(path, what, element, f"{invalid[0]:g}; give {limit:g} in SI at most")
    welds = [each for each in spec.equalities if each.type == mujoco.mjtEq.mjEQ_WELD]
    body_welds = [weld for weld in welds if weld.objtype == mujoco.mjtObj.mjOBJ_BODY]
    for what, elements, quaternions in (
        ("body", spec.bodies, model.body_quat),
        ("site", spec.sites, model.site_quat),
        ("weld", body_welds, model.eq_data[:, 6:10]),
    ):
        for element in elements:
            if not np.linalg.norm(quaternions[element.id]) > 0.0:
                raise _error(path, what, element, "a quat that is no turn")
    if not np.isfinite(start).all():
        raise InputError(f"{path}: where it starts is not finite; correct ref or the keyframe")
    if not 0.0 < model.opt.timestep <= HUGE:
        raise InputError(
            f"{path}: the timestep of <option> is {model.opt.timestep:g} s, by which no run goes on; "
            "give one above 0, or leave it out for 0.002"
        )
    if not np.abs(model.opt.gravity).max() <= HUGE:
        raise InputError(f"{path}: gravity is {model.opt.gravity.tolist()}; give {HUGE:g} m/s^2 at most")


def _error(path: str, what: str, element: Any, content: str) -> InputError:
    location = ", ".join([path, *filter(None, [element.info])])
    label = f" {element.name!r}" if element.name else ""
    return InputError(f"{location}: {what}{label} holds {content}; correct the file")


def _numbers(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[tuple[str, Any, Array, float]]:
    """Yield the kind of an element, the element, its numbers and their largest magnitude."""
    coordinates = np.append(model.jnt_qposadr, model.nq)

    def numbers_in(kind: str, rows: Any, *names: str) -> Array:
        """Return the numbers of an element in arrays of the model."""
        return np.concatenate([np.ravel(getattr(model, f"{kind}_{name}")[rows]) for name in names])

    for body in spec.bodies:
        yield "body", body, numbers_in("body", body.id, "pos", "ipos"), MAX_LENGTH
        yield "body", body, numbers_in("body", body.id, "quat", "mass", "inertia"), HUGE
    for joint in spec.joints:
        i, dofs = joint.id, model.dof_jntid == joint.id
        own = slice(coordinates[i], coordinates[i + 1])
        positions = [model.jnt_pos[i], model.qpos0[own], model.qpos_spring[own]]
        yield "joint", joint, np.concatenate(positions), MAX_LENGTH
        yield "joint", joint, numbers_in("jnt", i, "range"), np.inf
        yield "joint", joint, numbers_in("jnt", i, "axis", "solref", "solimp", "stiffness"), HUGE
        yield "joint", joint, numbers_in("dof", dofs, "damping", "armature", "frictionloss"), HUGE
    for tendon in spec.tendons:
        names = ("stiffness", "damping", "lengthspring", "armature")
        yield "tendon", tendon, numbers_in("tendon", tendon.id, *names), HUGE
    for site in spec.sites:
        yield "site", site, model.site_pos[site.id], MAX_LENGTH
        yield "site", site, model.site_quat[site.id], HUGE
    for equality in spec.equalities:
        yield "equality", equality, numbers_in("eq", equality.id, "data", "solref", "solimp"), HUGE
