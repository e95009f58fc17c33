"""Programs, forces and formula of what moves, as lines of TOML."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from mechsim import files
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError
from mechsim.model.forces import Forces, Place
from mechsim.model.load_profile import LoadProfile
from mechsim.model.motion_laws import MotionLaws
from mechsim.model.motors import ConstantTorque, Geared, Motor, PlainMotor, TorqueSpeedLine
from mechsim.subjects.load_profile_text import WrittenLoad
from mechsim.subjects.motion_law_text import MotionLaw
from mechsim.subjects.toml_text import key, listed, number, quoted


def driving_lines(form: LoopForm) -> Iterator[str]:
    """Yield the lines of programs, forces and formula.

    Raises:
        InputError: for a program or a load that no text says.
    """
    if form.motion_laws is not None:
        yield from _motion_law_lines(form.motion_laws)
    if form.formula:
        yield from ("", "[formula]", f"python = {quoted(form.formula)}")
    if form.forces is not None:
        yield from _force_lines(form.forces)


def _motion_law_lines(laws: MotionLaws) -> Iterator[str]:
    yield f"duration = {number(laws.duration)}"
    yield from ("", "[programs]")
    for name, state in laws.by_name.items():
        if not isinstance(state, MotionLaw):
            raise InputError(f"the program of {name} is a function, which no text says; give it as text")
        yield f"{key(name)} = {quoted(_absolute(state.text))}"


def _force_lines(forces: Forces) -> Iterator[str]:
    yield from ("", "[forces]", f"gravity = {listed(forces.gravity)}")
    if forces.crank_torque is not None:
        yield f"crank_torque = {_components(forces.crank_torque, 'the load on the crank')[0]}"
    if forces.flywheel:
        yield f"flywheel = {number(forces.flywheel)}"
    if forces.motor is not None:
        yield f"motor = {_table(_motor(forces.motor))}"
    for friction in forces.friction:
        fields = ("viscous", "coulomb", "viscous_turn", "coulomb_turn")
        nonzero = {field: number(getattr(friction, field)) for field in fields if getattr(friction, field)}
        yield f"friction.{key(friction.joint)} = {_table(nonzero)}"
    for i, spring in enumerate(forces.springs, 1):
        numbers = {field: number(getattr(spring, field)) for field in ("stiffness", "rest", "damping")}
        yield f"springs.spring{i} = {_table({'a': _point(spring.a), 'b': _point(spring.b), **numbers})}"
    for spring in forces.joint_springs:
        numbers = {field: number(getattr(spring, field)) for field in ("stiffness", "rest")}
        yield f"joint_springs.{key(spring.joint)} = {_table(numbers)}"
    for i, load in enumerate(forces.loads, 1):
        force = ", ".join(_components(load.force, f"the load on {load.place}"))
        yield f"loads.load{i} = {_table({'at': _point(load.place), 'force': f'[{force}]'})}"
    for couple in forces.couples:
        moment = ", ".join(_components(couple.moment, f"the couple on {couple.link}"))
        yield f"couples.{key(couple.link)} = [{moment}]"


def _motor(motor: Motor) -> dict[str, str]:
    if isinstance(motor, Geared):
        return {**_plain_motor(motor.motor), "gear": number(motor.ratio)}
    return _plain_motor(motor)


def _plain_motor(motor: PlainMotor) -> dict[str, str]:
    if isinstance(motor, ConstantTorque):
        return {"kind": quoted("constant"), "torque": number(motor.value)}
    if isinstance(motor, TorqueSpeedLine):
        return {"kind": quoted("line"), "stall": number(motor.stall), "no_load": number(motor.no_load)}
    fields = {field: number(getattr(motor, field)) for field in ("voltage", "resistance", "constant")}
    return {"kind": quoted("dc"), **fields}


def _components(profile: LoadProfile, what: str) -> list[str]:
    """Return what a load is along each axis."""
    if isinstance(profile.value, WrittenLoad):
        texts = [component.text for component in profile.value.components]
        return [quoted(_absolute(text)) if isinstance(text, str) else number(text) for text in texts]
    if profile.over is not None:
        raise InputError(f"{what} is a function of {profile.over}, which no text says; give it as text")
    return [number(text) for text in profile.at(np.zeros(1)).ravel()]


def _absolute(text: str) -> str:
    """Return the text of a program or a load, by which it is found from anywhere if it is a file."""
    return str(Path(text).resolve()) if text.lower().endswith(files.EXTENSIONS) else text


def _point(point: Place) -> str:
    if isinstance(point, str):
        return quoted(point)
    return f"{{ link = {quoted(point[0])}, at = {listed(point[1])} }}"


def _table(fields: Mapping[str, str]) -> str:
    return f"{{ {', '.join(f'{name} = {value}' for name, value in fields.items())} }}"
