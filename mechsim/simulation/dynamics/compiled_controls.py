"""Forces of a freely moving model in C: `callbacks.c`, which MuJoCo calls at every stage of a step."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.instructions import (
    CONTROLLER,
    EXPRESSION,
    INSTRUCTION,
    Instructions,
    NotCompiledError,
    Variable,
)
from mechsim.mechanism.nonlinear_springs import SoftStop
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.mjcf.force_elements import AXES, native
from mechsim.simulation.velocity_products import CallbackData, callback_data

_CONSTANTS = ("side", "rest", "stiffness", "damping", "preload")
_MATRIX = ("f8", (6, 6))
SPRING = np.dtype(
    [
        *((name, "i4") for name in ("control", "table", "over_rate")),
        *((name, "f8") for name in _CONSTANTS),
        ("expression", EXPRESSION),
    ],
    align=True,
)
BUSHING = np.dtype([("control", "i4"), ("stiffness", *_MATRIX), ("damping", *_MATRIX)], align=True)
DRY = np.dtype([("control", "i4"), ("count", "i4"), ("magnitude", "f8")], align=True)
DRIVEN = np.dtype([("control", "i4"), ("state", "i4")], align=True)


def compiled_controls(
    model: LoadedModel,
    coordinates: Mapping[str, tuple[int, int]],
    others: Sequence[tuple[int, int, Actuator]],
    crank: int | None,
) -> CallbackData:
    """Return the forces of a model for the C code.

    Args:
        model: the mechanism and its forces.
        coordinates: coordinate -> its address in qpos and its degree of freedom.
        others: actuators that MuJoCo does not have, with the numbers of their controls and states.
        crank: address of the crank in qpos; None without one.

    Raises:
        NotCompiledError: if a force is a function in Python.
        MissingToolError: if there is no C compiler.
        OutputError: if the cache is not writable.
    """
    added = Instructions()

    def variable(name: str, letter: str) -> Variable:
        address, dof = coordinates[name]
        return ("coordinate", address, 0.0) if letter == "q" else ("rate", dof, 1.0)

    controllers = [
        (coordinates[controller.coordinate][1], added.add_controller(controller, variable))
        for controller in model.forces.controllers
    ]
    gears = np.zeros((len(others), model.model.nv))
    for gear, (_, _, actuator) in zip(gears, others, strict=True):
        if actuator.ends:
            raise NotCompiledError(f"the line of {actuator.name}")
        for name, ratio in actuator.gear.items():
            gear[coordinates[name][1]] += ratio
    dry = [(joint.actuators[0], len(joint.actuators), joint.magnitude) for joint in model.dry]
    bushings = [(columns.start, *bushing.matrices) for bushing, columns in model.bushings]
    control = np.array(_varying(model, crank, added), CONTROLLER)
    actuators = added.add_actuators([actuator for _, _, actuator in others])
    springs = _springs(model, added)
    return callback_data(
        control,
        np.array(controllers, CONTROLLER),
        actuators,
        springs,
        np.array(bushings, BUSHING),
        np.array(dry, DRY),
        np.array([(control, state) for control, state, _ in others], DRIVEN),
        gears,
        np.array(added.rows, INSTRUCTION),
        np.array(added.numbers),
    )


def _varying(model: LoadedModel, crank: int | None, added: Instructions) -> list[tuple[int, tuple[int, int]]]:
    """Return the controls that depend on time or crank angle, with their expressions."""
    forces, kinds = model.forces, model.actuators
    angle: Variable = ("number", 0, 0.0) if crank is None else ("coordinate", crank, 0.0)
    profiles = [] if forces.crank_torque is None else [(kinds.crank_torque.start, forces.crank_torque)]
    for first, loads in (
        (kinds.loads.start, [load.force for load in forces.loads]),
        (kinds.couples.start, [couple.moment for couple in forces.couples]),
    ):
        profiles += [(first + len(AXES) * i, profile) for i, profile in enumerate(loads)]
    rows = [
        (first + k, expression)
        for first, profile in profiles
        if profile.over is not None
        for k, expression in enumerate(added.add_load(profile, angle))
    ]
    actuators = enumerate(forces.actuators, kinds.actuators.start)
    return rows + [(i, added.add_control(actuator)) for i, actuator in actuators if native(actuator)]


def _springs(model: LoadedModel, added: Instructions) -> np.ndarray[Any, Any]:
    """Return the nonlinear springs and stops."""
    springs = model.forces.nonlinear_springs
    table = np.zeros(len(springs), SPRING)
    for i, (row, spring) in enumerate(zip(table, springs, strict=True), model.actuators.nonlinear.start):
        for name, value in added.add_spring(spring).items():
            row[name] = value
        row["control"] = i
        if isinstance(law := spring.law, SoftStop):
            if law.exponent != 1.0:
                raise NotCompiledError("a contact law of Hertz")
            row["side"] = law.side
    return table
