"""The velocity-product terms of nonlinear constraints, which MuJoCo leaves out of its equalities."""

import ctypes
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import RLock
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import MissingToolError, OutputError
from mechsim.mechanism.instructions import (
    EXPRESSION,
    INSTRUCTION,
    TIME,
    Instructions,
    NotCompiledError,
    c_source,
)
from mechsim.numerics.c_library import loaded_library
from mechsim.simulation.equality_rows import DIFFERENCE, CouplingConstraint, RodPair
from mechsim.simulation.model_loops import ModelLoops

EQUALITY, JOINT = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY), int(mujoco.mjtEq.mjEQ_JOINT)
# held while callbacks are installed, which are global: the runs of several threads take turns
CALLBACKS = RLock()
COUPLING = np.dtype(
    [("equality", "i4"), ("reference", "f8"), ("difference", "f8"), ("function", EXPRESSION)], align=True
)
ROD = np.dtype([("equality", "i4"), ("bodies", "i4", 2), ("points", "f8", (2, 3))], align=True)


@dataclass(frozen=True)
class CallbackData:
    """Arrays for a callback in C.

    Attributes:
        library: the compiled code.
        arrays: their lengths, then the arrays.
        addresses: of these, which the C code reads as a structure.
    """

    library: ctypes.CDLL
    arrays: Sequence[np.ndarray[Any, Any]]
    addresses: ctypes.Array[ctypes.c_void_p]


def callback_data(*tables: np.ndarray[Any, Any]) -> CallbackData:
    """Return arrays for a callback of `callbacks.c`.

    Raises:
        MissingToolError: if there is no C compiler.
        OutputError: if the cache is not writable.
    """
    text = Path(__file__).with_name("callbacks.c").read_text(encoding="utf-8")
    header = f"/* MuJoCo {mujoco.__version__} */\n#include <mujoco/mujoco.h>\n"
    headers = Path(mujoco.__file__).with_name("include")
    library = loaded_library("callbacks", header + c_source() + text, headers)
    arrays = np.array([len(table) for table in tables], np.int32), *tables
    addresses = (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
    return CallbackData(library, arrays, addresses)


def nonlinear_rows(loops: ModelLoops) -> list[CouplingConstraint | RodPair]:
    """Return the couplings and rods with velocity-product terms."""
    every, active = (*loops.couplings, *loops.rods), loops.model.eq_active0
    return [row for row in every if row.nonlinear and active[row.equality]]


def compiled_rows(loops: ModelLoops) -> CallbackData | None:
    """Return these couplings and rods for C; None without them, or if C lacks them."""
    nonlinear, added = nonlinear_rows(loops), Instructions()
    couplings = [row for row in nonlinear if isinstance(row, CouplingConstraint)]
    rods = [(rod.equality, rod.bodies, rod.local) for rod in nonlinear if isinstance(rod, RodPair)]
    weights = np.zeros((len(couplings), loops.model.nv))
    for row, coupling in zip(weights, couplings, strict=True):
        assert coupling.right is not None
        row[coupling.right.dofs] = coupling.right.weights
    try:
        rows = np.array([_coupling(row, added) for row in couplings], COUPLING)
        expressions = np.array(added.rows, INSTRUCTION), np.array(added.numbers)
        return callback_data(rows, np.array(rods, ROD), weights, *expressions) if nonlinear else None
    except (NotCompiledError, MissingToolError, OutputError):
        return None


def _coupling(row: CouplingConstraint, added: Instructions) -> tuple[int, float, float, tuple[int, int]]:
    if row.function is None:
        return row.equality, 0.0, 0.0, (0, 0)
    expression = added.add(getattr(row.function.function, "instructions", None), TIME, "a coupling")
    return row.equality, row.function.offset, row.function.difference, expression


@contextmanager
def velocity_products(loops: ModelLoops, data: mujoco.MjData) -> Generator[Callable[[], None]]:
    """Install a callback for nonlinear couplings and rods, and restore the previous one.

    It adds their velocity-product terms. MuJoCo makes a joint coupling q = f(p) compliant in proportion to
    1/m_q + 1/m_p with the inertias of both coordinates; the callback corrects this to 1/m_q + f'(p)^2 / m_p.
    A light cam under a preloaded follower, on a dwell, would otherwise yield as if it carried the load.

    Yields:
        The function that sets the polynomials of couplings by functions to those at the state of `data`.
    """
    nonlinear, compiled = nonlinear_rows(loops), compiled_rows(loops)
    rows: list[int] = []

    # MuJoCo calls this after it computes the constraint violations and before it computes accelerations
    def opened(_: mujoco.MjModel, data: mujoco.MjData) -> None:
        if not rows:
            constrained = np.where(data.efc_type == EQUALITY, data.efc_id, -1).tolist()
            rows.extend(constrained.index(coupling.equality) for coupling in nonlinear)
        qpos, qvel = data.qpos[None], data.qvel
        for coupling, row in zip(nonlinear, rows, strict=True):
            stiffness, _, impedance, _ = data.efc_KBIP[row]
            if isinstance(coupling, RodPair):
                data.efc_pos[row] += coupling.stretching(data) / (stiffness * impedance)
                continue
            assert coupling.right is not None
            rate = float(qvel[coupling.right.dofs] @ coupling.right.weights)
            (_,), (first,), (second,) = coupling.values(coupling.right.value(qpos))
            data.efc_pos[row] -= second * rate**2 / (stiffness * impedance)
            data.efc_R[row] *= _mobility_ratio(loops.model, coupling, first)
            data.efc_D[row] = 1.0 / data.efc_R[row]

    def expand() -> None:
        """Set the polynomials of couplings that are functions to their Taylor polynomials at the state."""
        for row in loops.couplings:
            if row.function is not None and row.right is not None:
                right = float(row.right.value(data.qpos[None])[0])
                loops.model.eq_data[row.equality, :5] = row.expanded(right)

    with CALLBACKS:
        before = callback = mujoco.get_mjcb_passive()
        if compiled:
            library, model = compiled.library, ctypes.c_void_p(loops.model._address)
            qpos, difference = ctypes.c_void_p(data.qpos.ctypes.data), ctypes.c_double(DIFFERENCE)
            library.select_rows(compiled.addresses, model)
            callback = library.add_velocity_products
            expand = partial(library.expand, compiled.addresses, model, qpos, difference)
        elif nonlinear:
            callback = opened
        mujoco.set_mjcb_passive(callback)
        try:
            yield expand
        finally:
            mujoco.set_mjcb_passive(before)


def _mobility_ratio(model: mujoco.MjModel, coupling: CouplingConstraint, rate: float) -> float:
    """Return the mobility of a coupling of two joints by its derivative, relative to that of derivative 1."""
    if coupling.right is None or model.eq_type[coupling.equality] != JOINT:
        return 1.0
    left, right = (model.dof_invweight0[side.dofs[0]] for side in (coupling.left, coupling.right))
    return float((left + rate**2 * right) / (left + right))
