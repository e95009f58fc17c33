"""Many runs of forward dynamics of one mechanism: C integrates them in threads."""

import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import InputError, needs
from mechsim.kinetics.compiled_model import CompiledModel
from mechsim.kinetics.compiled_motion import (
    FINISHED,
    FULL,
    StepSettings,
    evaluated,
    integrated,
    scale_of,
)
from mechsim.kinetics.dynamic_run import (
    ENERGIES,
    TOLERANCE,
    RecordedStates,
    initial_values,
    joined,
    motion_in,
    recorded_states,
    require_regular,
    require_settings,
    run,
)
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, equations_of_motion
from mechsim.kinetics.forward_dynamics import BUDGET, MANY_STEPS, Integration
from mechsim.kinetics.gaps import opens
from mechsim.kinetics.initial_state import InitialValues, StateLayout, initial_state
from mechsim.kinetics.model import DynamicModel, dynamic_model
from mechsim.kinetics.passive_rotation import with_determined_motion
from mechsim.mechanism.forces import Forces
from mechsim.numerics.arrays import Array

if TYPE_CHECKING:
    from xarray import Dataset

# number of states whose motion is computed at once: their arrays take some 100 MB
TOGETHER = 20_000


def run_many(
    source: Any,
    forces: Forces | None = None,
    *,
    initial: Mapping[str, ArrayLike] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    duration: float | str,
    samples: int = 100,
    tolerance: float = TOLERANCE,
    threads: int | None = None,
) -> "Dataset":
    """Integrate the motion of a mechanism from many initial states or of many designs, as `run` does one.

    Args:
        source: as `run` takes it; with `parameters` a name, a file, or a function that returns the source of
            a dictionary of them.
        forces: as `run` takes them.
        initial: initial coordinates `J.q` and rates `J.v` in SI, (n,) each or one number.
        parameters: parameters of the designs in SI, (n,) each or one number. Designs are set up one by one.
        duration: time in [s], or text.
        samples: instants after the first at which the results are evaluated.
        tolerance: relative error of an integration step.
        threads: number of threads; the default is the number of processors.

    Returns:
        The columns of `run` over the dimensions `run` and `t`, the energies in [J], and the outcome and
        execution ("C" or "numpy") of each run. A run that ends early has no values (NaN).

    Raises:
        InputError: for invalid values.
        AssemblyError: if the loops do not close at the initial values of a run.
    """
    end = units.si(duration, "s", "the duration")
    columns, designs = _columns(initial or {}, parameters or {})
    count = len(next(iter((columns | designs).values())))
    require_settings(end, samples, tolerance)
    times = np.linspace(0.0, end, samples + 1)
    table: dict[str, Array] = {}
    # those of the runs in C
    outcomes, executed = ["done"] * count, ["C"] * count

    def add(rows: list[int], motions: Iterable[tuple[str, Array]]) -> None:
        for name, values in motions:
            if name not in table:
                table[name] = np.full((count, len(times)), np.nan)
            table[name][rows] = np.reshape(values, (len(rows), -1))

    remaining: Iterable[tuple[int, Any]]
    if designs:
        if not callable(source):
            raise InputError("parameters need a name, a file or a function of them as the source of the runs")
        remaining = ((i, source(_row(designs, i))) for i in range(count))
    else:
        model: DynamicModel = source if isinstance(source, DynamicModel) else dynamic_model(source, forces)
        complete = set[int]()
        for rows, motions in _in_c(model, columns, times, tolerance, threads):
            add(rows, motions)
            complete.update(rows)
        remaining = ((i, model) for i in range(count) if i not in complete)
    settings: dict[str, Any] = {"duration": end, "samples": samples, "tolerance": tolerance}
    for i, design in remaining:
        result = run(design, forces, initial=_row(columns, i), **settings)
        outcomes[i], executed[i] = result.outcome, result.executed
        if result.outcome == "done":
            add([i], result.columns())
    with needs("tables"):
        library: Any = import_module("xarray")
    variables: dict[str, Any] = {
        name: (("run", "t"), values) for name, values in table.items() if name not in ("t", "angle")
    }
    variables |= {"outcome": ("run", outcomes), "executed": ("run", executed)}
    coordinates = {"t": times} | {f"initial {name}": ("run", column) for name, column in columns.items()}
    coordinates |= {f"parameter {name}": ("run", column) for name, column in designs.items()}
    return library.Dataset(variables, coordinates)


def _row(columns: Mapping[str, Array], i: int) -> dict[str, float]:
    return {name: float(column[i]) for name, column in columns.items()}


def _columns(
    initial: Mapping[str, ArrayLike], parameters: Mapping[str, ArrayLike]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return initial values and parameters as columns of equal length."""
    values = [*initial.values(), *parameters.values()]
    if not values:
        raise InputError(
            "initial values or parameters of many runs are missing; give those that differ, such as J.q"
        )
    try:
        rows = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, np.float64)) for value in values))
    except ValueError:
        lengths = {name: np.size(value) for name, value in [*initial.items(), *parameters.items()]}
        raise InputError(
            f"the values of many runs have different numbers {lengths}; give equally many"
        ) from None
    if rows[0].ndim != 1 or not len(rows[0]):
        raise InputError(f"the values of many runs have the shape {rows[0].shape}; give (n,)")
    first = len(initial)
    return dict(zip(initial, rows[:first], strict=True)), dict(zip(parameters, rows[first:], strict=True))


def _in_c(
    model: DynamicModel, columns: Mapping[str, Array], times: Array, tolerance: float, threads: int | None
) -> Iterator[tuple[list[int], Iterable[tuple[str, Array]]]]:
    """Yield the runs that C integrates to their end, in blocks: their numbers and columns, (runs * n,) each.

    Ranges, stops, gaps, Coulomb friction, stiff motion and links without inertia need decisions in numpy.
    """
    count = len(next(iter(columns.values())))
    requested = [initial_values(model, _row(columns, i)) for i in range(count)]
    limited = model.solver.ranges or model.forces.stop_ranges or opens(model.mechanism)
    if limited or requested[0].rotations or requested[0].spins:
        return
    values = InitialValues(
        {name: np.array([row.coordinates[name] for row in requested]) for name in requested[0].coordinates},
        {name: np.array([row.rates[name] for row in requested]) for name in requested[0].rates},
    )
    equations = equations_of_motion(model, [*values.coordinates, *values.rates])
    q, rates = initial_state(equations, values)
    q, rates = (q if len(q) == count else q.repeated(count)), np.broadcast_to(rates, (len(rates), count))
    start = equations.kinematics(q.select(np.arange(1)), rates[:, :1])
    first = Integration(start, tolerance)
    require_regular(equations.kinematics(q, rates))
    if equations.frictions or with_determined_motion(start) is not start:
        return
    compiled = first.prepared(float(times[-1]))
    if compiled is None:
        return
    unlocked = equations.rank, first.nearest_pivot(), first.right.mode, ()
    settings = StepSettings(
        first.tolerance, first.state, first.origin, first.longest, *unlocked, first.implicit
    )
    states = first.layout.replaced(np.tile(first.state, (count, 1)), q, rates)
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        records = [*pool.map(lambda state: _sampled(equations, compiled, settings, state, times), states)]
    complete = [(i, record) for i, record in enumerate(records) if record is not None]
    block = max(1, TOGETHER // len(times))
    for begin in range(0, len(complete), block):
        rows, together = zip(*complete[begin : begin + block], strict=True)
        record = joined(together)
        motion = motion_in(equations, record.states, record.accelerations, np.tile(times, len(rows)))
        energies = record.kinetic, record.potential, record.states[:, -2], record.states[:, -1]
        yield [*rows], [*motion.columns(), *zip(ENERGIES, energies, strict=True)]


def _sampled(
    equations: EquationsOfMotion, model: CompiledModel, settings: StepSettings, state: Array, times: Array
) -> RecordedStates | None:
    """Return the states of a run at instants (n,) in [s]; None if C does not reach its end."""
    layout = StateLayout(equations)
    fastest = float(np.abs(state[layout.positions :]).max(initial=0.0))
    start = evaluated(model, state[None], times[:1], settings.mode)
    scale = scale_of(layout, start, fastest, float(times[-1]))
    settings = replace(settings, scale=scale, origin=layout.origin(state))
    kinetic = float(start.kinetic[0])
    energy, balance = kinetic + float(start.potential[0]), (0.0, kinetic, 0.0, fastest)
    result, time, length, evaluations = np.empty((len(times), len(state))), 0.0, 0.0, 0
    while evaluations < BUDGET:
        steps = integrated(
            model, settings, time, state, float(times[-1]), MANY_STEPS, energy, balance, length
        )
        if steps.solution is not None:
            inside = (times >= time) & (times <= steps.time)
            result[inside] = steps.solution(times[inside])
            balance = tuple(steps.balances[-1].tolist())
        if steps.status != FULL:
            finished = steps.status == FINISHED
            return recorded_states(equations, model, settings.mode, (), times, result) if finished else None
        time, state, length = steps.time, steps.state, steps.length
        evaluations += steps.evaluations
    return None
