"""Evaluation methods of designs: one formula for many, loop equations for many, or one by one."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import MechsimError, MobilityError, cut
from mechsim.kinematics.formulas import many_designs
from mechsim.kinematics.formulas.two_branch import TwoBranchForm
from mechsim.kinematics.loops.design_motion import many_motion
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.prescribed_motion import prescribed_along
from mechsim.mechanism.motion import Motion, select_instants
from mechsim.mechanism.motion_laws import interval_around, no_crank_range_error
from mechsim.mechanism.quantity import TRANSMISSION
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array
from mechsim.studies.sweep.measures import MeasureError, NoValueError, Turns
from mechsim.studies.sweep.task import CrankRows, Measured, Rows, SweepTask, swings_between

# poses solved at once: their arrays fit into a core's cache
BLOCK = 8192
# largest length of a stored reason, in characters
MAX_REASON = 240


def measured_designs(task: SweepTask, low: int, high: int) -> Measured:
    """Return the measures of designs low to high; designs that fail are reported by their outcome."""
    rows = task.designs.rows(low, high)
    result = task.unmeasured(high - low)
    remaining = np.arange(high - low)
    if formula := by_one_formula(task):
        remaining = _formula(task, formula, rows, result)
    elif task.loops is not None:
        remaining = _loops(task, rows, result)
    one_by_one(task, rows, remaining, result)
    return result


def by_one_formula(task: SweepTask) -> TwoBranchForm | None:
    """Return the formulas that measure designs as arrays; None if they are measured otherwise."""
    if task.single_only or task.subject.closed is None:
        return None
    return many_designs.formula_of_many(task.subject.closed, task.designs.values)


def _formula(task: SweepTask, formula: TwoBranchForm, rows: Mapping[str, Array], result: Measured) -> Rows:
    """Measure designs by one formula, over a turn or the reachable range; return those that it cannot."""
    every = np.arange(len(result.outcome))
    valid = np.flatnonzero(many_designs.allowed(formula, rows))
    if not len(valid):
        return every
    ranges = many_designs.crank_ranges(formula, _subset(rows, valid))
    low, high = many_designs.swing_arcs(ranges)
    swinging = np.flatnonzero(~ranges.uncertain & ~ranges.full & np.isfinite(low))
    turning = np.flatnonzero(~ranges.uncertain & ranges.full)
    stored: list[Rows] = []
    step = max(1, BLOCK // len(task.angles))
    for group in (swinging, turning):
        for first in range(0, len(group), step):
            block = group[first : first + step]
            designs, ends = valid[block], (low[block], high[block]) if group is swinging else None
            with np.errstate(all="ignore"):
                motion = many_designs.solved(
                    formula,
                    _subset(rows, designs),
                    *(task.within(*ends) if ends else task.revolution),
                    rates=task.measures.rated,
                    joints=task.measures.jointed,
                    links=task.measures.uses("link"),
                )
                values = task.values(_turns(task, _subset(rows, designs), motion))
            stored.append(result.store_finite(designs, values, swings=ends))
    return np.setdiff1d(every, np.concatenate([every[:0], *stored]))


def _turns(task: SweepTask, rows: Mapping[str, Array], motion: Motion) -> Turns:
    """Return the motions of designs, one design after another, with their transmission angles if measured."""
    designs = len(next(iter(rows.values())))
    poses, more = len(motion.angle) // designs, dict[str, Array]()
    if task.measures.includes(TRANSMISSION):
        assert task.subject.closed is not None
        more[TRANSMISSION] = many_designs.transmissions(task.subject.closed, rows, motion).reshape(
            designs, poses
        )
    return Turns(designs, poses, motion, more)


def _loops(task: SweepTask, rows: Mapping[str, Array], result: Measured) -> Rows:
    """Measure designs by loop equations together; return the others, among them those that swing."""
    assert task.loops is not None
    every = np.arange(len(result.outcome))
    # a catalogue mechanism must turn fully, which the end of the turn shows
    closed = task.subject.closed is not None
    angles = np.append(task.angles, REVOLUTION) if closed else task.angles
    try:
        assembled = task.assembled(rows)
        if assembled is None:
            return every
        started, index = assembled
        motion, valid = many_motion(task.loops, started, angles, task.path_speed, task.measures.joints)
    except (MechsimError, ArithmeticError, np.linalg.LinAlgError):
        return every
    if closed:
        valid &= come_back(motion, len(index))
        motion = select_instants(motion, np.tile(np.arange(len(angles)) < len(task.angles), len(index)))
    with np.errstate(all="ignore"):
        values = task.values(_turns(task, _subset(rows, index), motion))
    return np.setdiff1d(every, result.store_finite(index, values, valid))


def come_back(motion: Motion, designs: int) -> NDArray[np.bool_]:
    """Return whether designs return to their first pose at the last instant, (designs,)."""
    same = np.ones(designs, dtype=np.bool_)
    for point in motion.points.values():
        path = point.position.reshape(designs, -1, 3)
        same &= np.abs(path[:, -1] - path[:, 0]).max(1) <= ROUNDING * np.ptp(path, axis=1).max(1)
    return same


def _subset(rows: Mapping[str, Array], index: Rows) -> dict[str, Array]:
    return {name: values[index] for name, values in rows.items()}


def one_by_one(task: SweepTask, rows: Mapping[str, Array], index: Rows, result: Measured) -> None:
    """Measure designs one by one; errors become outcomes."""
    for i in index:
        row = np.array([i])
        try:
            made = task.subject.design_family.make({name: float(values[i]) for name, values in rows.items()})
            solver = made.with_closed_guess()
            arc = swing_arc(solver)
            values = _solved_alone(task, solver, task.revolution if arc is None else task.within(*arc))
            outcome, reason = ("passed", "") if arc is None else ("swings", swings_between(*arc))
        except MeasureError:
            raise
        except MechsimError as error:
            outcome = error.outcome if isinstance(error, MobilityError | NoValueError) else "cannot assemble"
            result.reject(row, outcome, cut(str(error), MAX_REASON))
            continue
        except (ArithmeticError, np.linalg.LinAlgError, ValueError) as error:
            result.reject(row, "diverged", cut(f"{type(error).__name__}: {error}", MAX_REASON))
            continue
        invalid = [name for name, value in values.items() if not np.isfinite(value)]
        result.store(row, {name: np.array([value]) for name, value in values.items()})
        result.reject(row, outcome, reason)
        if invalid:
            result.reject(row, "not measured", f"{invalid[0]} is not finite")


def swing_arc(solver: KinematicSolver) -> tuple[float, float] | None:
    """Return the reachable range of a crank that swings, in [rad]; None for full revolutions or motion laws.

    Raises:
        AssemblyError: if it assembles at no crank angle.
    """
    if not solver.motion_laws.crank:
        return None
    arcs = solver.crank_range()
    if arcs.full:
        return None
    arc = interval_around(arcs, solver.mechanism.start) if arcs.arcs else None
    if arc is None:
        raise no_crank_range_error(solver.name)
    return arc


def _solved_alone(task: SweepTask, solver: KinematicSolver, crank: CrankRows) -> dict[str, float]:
    """Return the measures of one design by its formulas or loop equations along a crank motion (p,)."""
    angles, path_speed, acceleration = crank
    if not solver.motion_laws.crank:
        # the rate of the path parameter depends on the design; the times do not
        rate = np.full_like(path_speed, solver.motion_laws.rate)
        angles, path_speed = angles / path_speed * rate, rate
    motion = solver.solve_along(angles, path_speed, acceleration)
    shape = (1, len(angles))
    more: dict[str, Array] = {}
    if task.measures.loaded:
        study = prescribed_along(dynamic_model(solver), angles, path_speed, acceleration)
        columns = dict(study.columns())
        # a crank under a motion law is a drive
        driver_column = f"drive {solver.mechanism.drivers[0]}"
        if driver_column in columns:
            columns.setdefault("torque", columns[driver_column])
        more = {name: column.reshape(shape) for name, column in columns.items()}
    if task.measures.includes(TRANSMISSION):
        more[TRANSMISSION] = solver.required_transmission_angle(angles).reshape(shape)
    turns = Turns(1, len(angles), motion, more)
    return {name: float(values[0]) for name, values in task.values(turns).items()}
