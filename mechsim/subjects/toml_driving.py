"""Programs, forces and formula of what moves, as lines of TOML."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from mechsim import files
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.errors import InputError
from mechsim.model.forces import Forces, Place
from mechsim.model.load_profile import LoadProfile
from mechsim.model.motors import ConstantTorque, Geared, Motor, PlainMotor, TorqueSpeedLine
from mechsim.model.programs import Programs
from mechsim.subjects.load_text import LoadText
from mechsim.subjects.program_text import Program
from mechsim.subjects.toml_text import key, listed, number, quoted


def driving_lines(form: LoopForm) -> Iterator[str]:
    """Yield the lines of programs, forces and formula.

    Raises:
        InputError: for a program or a load that no text says.
    """
    if form.programs is not None:
        yield from _programs(form.programs)
    if form.formula:
        yield from ("", "[formula]", f"python = {quoted(form.formula)}")
    if form.forces is not None:
        yield from _forces(form.forces)


def _programs(programs: Programs) -> Iterator[str]:
    yield f"duration = {number(programs.duration)}"
    yield from ("", "[programs]")
    for name, state in programs.by_name.items():
        if not isinstance(state, Program):
            raise InputError(f"the program of {name} is a function, which no text says; give it as text")
        yield f"{key(name)} = {quoted(_absolute(state.text))}"


def _forces(forces: Forces) -> Iterator[str]:
    yield from ("", "[forces]", f"gravity = {listed(forces.gravity)}")
    if forces.crank_torque is not None:
        yield f"crank_torque = {_components(forces.crank_torque, 'the load on the crank')[0]}"
    if forces.flywheel:
        yield f"flywheel = {number(forces.flywheel)}"
    if forces.motor is not None:
        yield f"motor = {_table(_motor(forces.motor))}"
    for friction in forces.friction:
        parts = ("viscous", "coulomb", "viscous_turn", "coulomb_turn")
        kept = {part: number(getattr(friction, part)) for part in parts if getattr(friction, part)}
        yield f"friction.{key(friction.joint)} = {_table(kept)}"
    for i, spring in enumerate(forces.springs, 1):
        numbers = {part: number(getattr(spring, part)) for part in ("stiffness", "rest", "damping")}
        yield f"springs.spring{i} = {_table({'a': _place(spring.a), 'b': _place(spring.b), **numbers})}"
    for spring in forces.joint_springs:
        numbers = {part: number(getattr(spring, part)) for part in ("stiffness", "rest")}
        yield f"joint_springs.{key(spring.joint)} = {_table(numbers)}"
    for i, load in enumerate(forces.loads, 1):
        force = ", ".join(_components(load.force, f"the load on {load.place}"))
        yield f"loads.load{i} = {_table({'at': _place(load.place), 'force': f'[{force}]'})}"
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
    parts = {part: number(getattr(motor, part)) for part in ("voltage", "resistance", "constant")}
    return {"kind": quoted("dc"), **parts}


def _components(profile: LoadProfile, what: str) -> list[str]:
    """Return what a load is along each axis."""
    if isinstance(profile.value, LoadText):
        texts = [part.text for part in profile.value.parts]
        return [quoted(_absolute(one)) if isinstance(one, str) else number(one) for one in texts]
    if profile.over is not None:
        raise InputError(f"{what} is a function of {profile.over}, which no text says; give it as text")
    return [number(one) for one in profile.at(np.zeros(1)).ravel()]


def _absolute(text: str) -> str:
    """Return the text of a program or a load, by which it is found from anywhere if it is a file."""
    return str(Path(text).resolve()) if text.lower().endswith(files.EXTENSIONS) else text


def _place(place: Place) -> str:
    if isinstance(place, str):
        return quoted(place)
    return f"{{ link = {quoted(place[0])}, at = {listed(place[1])} }}"


def _table(parts: Mapping[str, str]) -> str:
    return f"{{ {', '.join(f'{name} = {value}' for name, value in parts.items())} }}"
