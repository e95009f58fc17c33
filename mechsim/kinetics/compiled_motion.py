"""Runs of forward dynamics by the C code: smooth motion in one contact mode, with dense output."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from mechsim.errors import FrictionError
from mechsim.kinetics.compiled_model import CompiledModel, NotCompiledError, c_fields
from mechsim.kinetics.contacts import ContactMode, Contacts
from mechsim.kinetics.initial_state import StateLayout
from mechsim.kinetics.right_hand_side import RightHandSide
from mechsim.numerics.arrays import Array
from mechsim.numerics.gauss_collocation import STIFF_NODES, TAIL, rule

FINISHED, FULL, BLOCKED, FAILED = range(4)
# largest relative difference of the derivatives by C and by numpy: rounding near a singular configuration
AGREED = 1e-7
# structures of the models for which C and numpy agreed
_AGREED = set[str]()
# index of a component of states, and values in units between which it is watched
Watched = tuple[int, float, float]
NOTHING: Watched = (-1, 0.0, 0.0)
# numbers of a step in C, of which the last four belong to the balance of energy
STEP = 6


class RunData(ctypes.Structure):
    """`Run` of `c/integration.c`."""

    _fields_ = c_fields("Run")


@dataclass(frozen=True, slots=True)
class DenseSteps:
    """The solution of successive steps, by polynomials of degree 7, or 12 where collocation took them.

    y = y0 + x (F0 + (1 - x) (F1 + x (F2 + ...))) with x from 0 to 1 in the step (Hairer, Norsett, Wanner I,
    section II.10).

    Attributes:
        starts: starts of the steps in [s], (m,).
        durations: durations of the steps in [s], (m,).
        coefficients: y0 and F0 to F6 or F11 of each step, (m, 8 or 13, size).
    """

    starts: Array
    durations: Array
    coefficients: Array

    @property
    def start(self) -> float:
        """Start of the last step in [s]."""
        return float(self.starts[-1])

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return self.coefficients.shape[1] - 1

    @property
    def knots(self) -> Array:
        """Ends of the steps in [s], (m + 1,)."""
        return np.append(self.starts, self.starts[-1] + self.durations[-1])

    def __call__(self, time: float | Array) -> Array:
        """Return the state (size,) at a time in [s], or the states (n, size) at n times."""
        times = np.atleast_1d(np.asarray(time, dtype=np.float64))
        k = np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, None)
        states = self._evaluated(k, times, self.degree)
        return states if np.ndim(time) else states[0]

    def beyond(self, times: Array) -> Array:
        """Return states (n, size) at times (n,) in [s] after the last step, by Hermite's cubic."""
        return self._evaluated(np.full(len(times), len(self.starts) - 1), times, 3)

    def _evaluated(self, k: Any, times: Array, degree: int) -> Array:
        x = ((times - self.starts[k]) / self.durations[k])[:, None]
        chosen, result = self.coefficients[k], np.zeros((len(times), self.coefficients.shape[2]))
        for i in range(degree, 0, -1):
            result = (result + chosen[:, i]) * (x if i % 2 else 1.0 - x)
        return chosen[:, 0] + result


@dataclass(frozen=True, slots=True)
class StepSettings:
    """What a call of the C code keeps: tolerance, scale and longest step, and singular configurations.

    Attributes:
        tolerance: relative error of a step.
        scale: scale of the state's components, (size,).
        origin: state from which displacements count, `StateLayout.origin`.
        longest: longest step in [s].
        rank: rank of the loop constraints.
        nearest: smallest pivot of the loop constraints at which the C code continues.
        mode: the contact mode.
        at_rest: indices of the coordinates that friction or stops hold.
        implicit: whether Newton's method solves the stiff equations of a step; if not, rates are scaled to
            the energy.
        watched: index of a component of states, and its values in units beyond which the steps end; -1 for
            none.
    """

    tolerance: float
    scale: Array
    origin: Array
    longest: float
    rank: int
    nearest: float
    mode: ContactMode
    at_rest: Sequence[int]
    implicit: bool
    watched: Watched = NOTHING


@dataclass(frozen=True, slots=True)
class StepsInC:
    """Steps that the C code took.

    Attributes:
        solution: their solution; None without a step.
        status: FINISHED, FULL (no space for more steps), BLOCKED (the next one is too close to a singular
            configuration) or FAILED (no step is possible).
        time: end in [s].
        state: state at the end, on the loops, (size,).
        balances: correction, largest kinetic energy, drift and fastest rate after each step, (m, 4).
        length: proposed duration of the next step in [s].
        evaluations: number of states evaluated.
    """

    solution: DenseSteps | None
    status: int
    time: float
    state: Array
    balances: Array
    length: float
    evaluations: int


@cache
def collocation_rule() -> Array:
    """Return the numbers of Gauss collocation on [0, 1] that the C code reads, one after the other.

    These are the nodes, the integrals to them, and two matrices of the differences between the states at the
    nodes and that at the start: coefficients of `DenseSteps`, and last coefficients of Legendre's series.
    """
    table = rule(STIFF_NODES)
    nodes, integrals = 0.5 * (1.0 + table.nodes), 0.5 * table.to_nodes
    basis = [nodes]
    for k in range(2, STIFF_NODES + 1):
        basis.append(basis[-1] * (nodes if k % 2 else 1.0 - nodes))
    dense: Array = np.linalg.inv(np.stack(basis, 1)).astype(np.float64)
    tail = 0.5 * table.to_integral[-TAIL:] @ np.linalg.inv(integrals)
    return np.concatenate([nodes, integrals.ravel(), dense.ravel(), tail.ravel()])


def integrated(
    model: CompiledModel,
    settings: StepSettings,
    time: float,
    state: Array,
    end: float,
    max_steps: int,
    energy: float,
    balance: Sequence[float],
    length: float = 0.0,
) -> StepsInC:
    """Return the steps from a state to an end in [s], at most `max_steps` of them.

    Args:
        model: the model.
        settings: what remains the same.
        time: start in [s].
        state: state at the start, (size,).
        end: latest end in [s].
        max_steps: largest number of steps.
        energy: kinetic and potential energy of the run's start in [J].
        balance: correction, largest kinetic energy, drift and fastest rate before.
        length: duration of the first step in [s]; 0 selects one.
    """
    state = state.copy()
    coefficients = STIFF_NODES + 1 if settings.implicit else 8
    numbers, dense = np.empty((max_steps, STEP)), np.empty((max_steps, coefficients, len(state)))
    scale = np.ascontiguousarray(settings.scale, dtype=np.float64)
    sliding, phase, at_rest = _arrays(settings.mode, settings.at_rest)
    correction, largest, drift, fastest = balance
    watched, *limits = settings.watched
    arrays = at_rest, phase, sliding, scale, settings.origin, collocation_rule(), state, numbers, dense
    run = RunData(  # in the order of its fields
        *(time, end, settings.tolerance, length, settings.longest, settings.nearest, fastest),
        *(energy, correction, largest, drift, *limits),
        *(settings.rank, settings.implicit, len(at_rest), max_steps, 0, 0, 0, watched + 1),
        *(array.ctypes.data for array in arrays),
    )
    model.library.integrate(ctypes.byref(model.data), ctypes.byref(run))
    m = run.steps
    solution = DenseSteps(numbers[:m, 0], numbers[:m, 1], dense[:m]) if m else None
    return StepsInC(solution, run.status, run.time, state, numbers[:m, 2:], run.length, run.evaluations)


def agreed_pivot(model: CompiledModel, right: RightHandSide, state: Array, time: float) -> float:
    """Return the smallest pivot of the loop constraints at a state and a time in [s].

    C and numpy are compared once for each structure, at rates that move every coordinate: an element that C
    lacks would otherwise go unnoticed in the result.

    Raises:
        NotCompiledError: if they disagree.
    """
    equations, layout, times = right.equations, right.layout, np.array([time])
    start = evaluated(model, state[None], times, right.mode)
    # in numpy, friction by the load may have no unique solution for some numbers
    usual = np.isfinite(start.derivatives).all() and start.pivot**2 > AGREED and not model.data.loaded
    if usual and model.structure in _AGREED:
        return start.pivot
    q, rates, work, lost = layout.unpack(state)
    fastest = max(1.0, float(np.abs(rates).max()))
    moving = rates.copy()
    moving[equations.free, 0] += fastest * np.cos(1.0 + np.arange(len(equations.free)))
    moved = layout.pack(q, moving, work, lost)[None]
    sample = evaluated(model, moved, times, right.mode, closing=True).states
    kinematics = equations.kinematics(*layout.unpack_states(sample), layout.activation(sample))
    sliding = np.sign(equations.friction_rates(kinematics)[:, 0])
    mode = ContactMode(sliding, phases=right.contacts.phases(kinematics))
    result = evaluated(model, sample, times, mode)
    try:
        dynamics = Contacts(equations).accelerate(kinematics, times, mode)
    except FrictionError:
        raise NotCompiledError("friction that may not be unique") from None
    expected = layout.derivatives(sample, kinematics, dynamics)[0]
    with np.errstate(invalid="ignore"):  # forces that are not finite are reported by the run
        agreed = np.abs(result.derivatives[0] - expected).max() <= AGREED * np.abs(expected).max()
    if not agreed:
        raise NotCompiledError("an element that changes the accelerations at the start")
    _AGREED.add(model.structure)
    return result.pivot


@dataclass(frozen=True, slots=True)
class StatesInC:
    """What the C code gives for n states.

    Attributes:
        states: the states, (n, size).
        derivatives: their derivatives by time, (n, size); NaN from the first state on that has none.
        kinetic: kinetic energies, (n,) in [J].
        potential: potential energies, (n,) in [J].
        rank: rank of the loop constraints at the last state.
        pivot: their smallest pivot there.
    """

    states: Array
    derivatives: Array
    kinetic: Array
    potential: Array
    rank: int
    pivot: float


def evaluated(
    model: CompiledModel,
    states: Array,
    times: Array,
    mode: ContactMode,
    at_rest: Sequence[int] = (),
    closing: bool = False,
) -> StatesInC:
    """Return what the C code gives for states (n, size) at times (n,) in [s].

    Args:
        model: the model.
        states: the states.
        times: their times.
        mode: the contact mode.
        at_rest: indices of the coordinates that friction or stops hold.
        closing: whether each state moves to the nearest one with closed loops and consistent rates first.
    """
    derivatives, energies = np.full(states.shape, np.nan), np.full((len(states), 2), np.nan)
    states, times = states.copy(), np.ascontiguousarray(times)
    directions, phase, resting = _arrays(mode, at_rest)
    run = RunData(
        resting=len(resting),
        at_rest=resting.ctypes.data,
        phase=phase.ctypes.data,
        sliding=directions.ctypes.data,
    )
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (times, states, derivatives, energies)]
    model.library.evaluate(
        ctypes.byref(model.data), ctypes.byref(run), len(states), pointers[0], closing, *pointers[1:]
    )
    return StatesInC(states, derivatives, energies[:, 0], energies[:, 1], run.rank, run.nearest)


def scale_of(
    layout: StateLayout, start: StatesInC, fastest: float, duration: float, displacement: float = 1.0
) -> Array:
    """Return the scale of the states of a run of a duration in [s] from a state, (size,)."""
    fastest_change = float(np.abs(layout.accelerations(start.derivatives)).max(initial=0.0))
    return layout.scale(layout.fastest(fastest, fastest_change, duration, displacement), displacement)


def _arrays(mode: ContactMode, at_rest: Sequence[int]) -> tuple[Array, Any, Any]:
    sliding, phases = (
        np.ascontiguousarray(values, dtype=np.float64) for values in (mode.sliding, mode.phases)
    )
    return sliding, phases, np.array(at_rest, dtype=np.int32)
