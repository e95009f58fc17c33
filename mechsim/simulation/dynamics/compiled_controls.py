"""Forces of a freely moving model in C: `applied_controls.c`, which MuJoCo calls at every stage of a step."""

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mechsim.model.actuators import Actuator
from mechsim.model.instructions import (
    CONTROLLER,
    EXPRESSION,
    INSTRUCTION,
    Instructions,
    Variable,
    c_source,
)
from mechsim.model.nonlinear_springs import SoftStop
from mechsim.numerics.c_library import loaded_library
from mechsim.simulation.dynamics.loaded_model import SITE, LoadedModel
from mechsim.simulation.mjcf.force_elements import AXES, native

_CONSTANTS = ("side", "offset", "rest", "stiffness", "damping", "preload")
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
TABLES = (
    *("control", "controller", "actuator", "spring", "bushing", "dry"),
    *("driven", "gear", "instruction", "numbers"),
)


class ForcesData(ctypes.Structure):
    """`Forces` of `applied_controls.c`: numbers of the first six tables, and all tables."""

    _fields_ = [
        *((f"{name}s", ctypes.c_int) for name in TABLES[:6]),
        *((name, ctypes.c_void_p) for name in TABLES),
    ]


@dataclass(frozen=True)
class CompiledControls:
    """The forces of a model for the C code.

    Attributes:
        data: the structure that the C code reads.
        tables: arrays to which it points.
        library: the compiled code.
    """

    data: ForcesData
    tables: Mapping[str, np.ndarray[Any, Any]]
    library: ctypes.CDLL

    def select(self, data: mujoco.MjData) -> Any:
        """Return the callback, which applies these forces to one `data`."""
        self.library.select_forces(ctypes.byref(self.data), ctypes.c_void_p(data.qpos.ctypes.data))
        return self.library.apply_forces


def _library() -> ctypes.CDLL:
    text = Path(__file__).with_name("applied_controls.c").read_text(encoding="utf-8")
    header = f"/* MuJoCo {mujoco.__version__} */\n#include <mujoco/mujoco.h>\n"
    return loaded_library(
        "applied_controls", header + c_source() + text, Path(mujoco.__file__).with_name("include")
    )


def compiled_controls(
    model: LoadedModel,
    coordinates: Mapping[str, tuple[int, int]],
    others: Sequence[tuple[int, int, Actuator]],
    crank: int | None,
) -> CompiledControls:
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
        for name, ratio in actuator.gear.items():
            gear[coordinates[name][1]] += ratio
    dry = [(joint.actuators[0], len(joint.actuators), joint.magnitude) for joint in model.dry]
    bushings = [(columns.start, *bushing.matrices) for bushing, columns in model.bushings]
    tables = {
        "control": np.array(_varying(model, crank, added), CONTROLLER),
        "controller": np.array(controllers, CONTROLLER),
        "actuator": added.add_actuators([actuator for _, _, actuator in others]),
        "spring": _springs(model, added),
        "bushing": np.array(bushings, BUSHING),
        "dry": np.array(dry, DRY),
        "driven": np.array([numbers for *numbers, _ in others], DRIVEN),
        "gear": gears,
        "instruction": np.array(added.rows, INSTRUCTION),
        "numbers": np.array(added.numbers),
    }
    data = ForcesData(
        **{f"{name}s": len(tables[name]) for name in TABLES[:6]},
        **{name: tables[name].ctypes.data for name in TABLES},
    )
    return CompiledControls(data, tables, _library())


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
        row["offset"] = spring.law.reference if model.model.actuator_trntype[i] == SITE else 0.0
        row["side"] = spring.law.side if isinstance(spring.law, SoftStop) else 0.0
    return table
