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
        text = state.text
        if text.lower().endswith(files.EXTENSIONS):
            text = str(Path(text).resolve())
        yield f"{key(name)} = {quoted(text)}"


def _forces(forces: Forces) -> Iterator[str]:
    yield from ("", "[forces]", f"gravity = {listed(forces.gravity)}")
    if forces.crank_torque is not None:
        yield f"crank_torque = {number(_constant(forces.crank_torque, 'the load on the crank')[0])}"
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
        force = listed(_constant(load.force, f"the load on {load.place}"))
        yield f"loads.load{i} = {_table({'at': _place(load.place), 'force': force})}"
    for couple in forces.couples:
        moment = _constant(couple.moment, f"the couple on {couple.link}")
        yield f"couples.{key(couple.link)} = {listed(moment)}"


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


def _constant(profile: LoadProfile, what: str) -> list[float]:
    if profile.over is not None:
        raise InputError(f"{what} goes over {profile.over}, which a TOML file does not say; leave it out")
    return profile.at(np.zeros(1)).ravel().tolist()


def _place(place: Place) -> str:
    if isinstance(place, str):
        return quoted(place)
    return f"{{ link = {quoted(place[0])}, at = {listed(place[1])} }}"


def _table(parts: Mapping[str, str]) -> str:
    return f"{{ {', '.join(f'{name} = {value}' for name, value in parts.items())} }}"
