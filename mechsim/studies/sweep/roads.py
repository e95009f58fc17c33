"""By which road designs are measured: one formula for many, loop equations for many, or one by one."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.base import ClosedForm, TwoBranchForm
from mechsim.analytic.catalog.many_arcs import swing_arcs
from mechsim.analytic.catalog.many_designs import Turning, allowed, can_be_many, ranges, solved, turning
from mechsim.analytic.closure.many_motion import many_motion
from mechsim.analytic.closure.many_swings import SwingTracer
from mechsim.analytic.dynamics import machine
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.analytic.forms import Form, closed_form
from mechsim.errors import InputError, MechsimError, MobilityError, cut
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.crank_profile import arc_around, closes_nowhere
from mechsim.model.design_arrays import StartedDesigns
from mechsim.model.forces import Forces
from mechsim.model.motion import Motion, taken
from mechsim.simulation.mjcf.loop_cuts import cut_loops
from mechsim.studies.sweep.beginning import begun_designs
from mechsim.studies.sweep.measures import FACTS, table_of
from mechsim.studies.sweep.stepped_road import stepped_alone, stepped_together
from mechsim.studies.sweep.task import CrankRows, Measured, SweepTask, nothing_measured, swings_between
from mechsim.studies.sweep.turns import TRANSMISSION, Turns

Rows = NDArray[np.intp]
# poses solved in one go: their arrays stay in a core's own cache
BLOCK = 8192
# part of a stroke by which a point may be off after a turn: rounding, far from another assembly
SAME = 1e-9
# characters of a reason that are kept
LONGEST = 240


def measured(task: SweepTask, low: int, high: int) -> Measured:
    """Return what designs low to high measure; no bad one among them is an error."""
    rows = task.designs.rows(low, high)
    found = nothing_measured(task, high - low)
    left = np.arange(high - low)
    if task.settings is not None:
        left = _stepped(task, rows, found)
    elif by_one_formula(task):
        left = _formula(task, rows, found)
    elif task.together is not None:
        left = _loops(task, rows, found)
    one_by_one(task, rows, left, found)
    return found


def by_one_formula(task: SweepTask) -> bool:
    """Whether designs are measured by one formula on arrays."""
    form = task.subject.closed
    alone = task.loaded or task.wants("function") or task.wants(TRANSMISSION)
    return not alone and form is not None and can_be_many(form, task.designs.values)


def _formula(task: SweepTask, rows: Mapping[str, Array], found: Measured) -> Rows:
    """Measure designs by one formula; return those that it does not settle."""
    form = task.subject.form
    assert isinstance(form, TwoBranchForm)
    good, known = _known_to_turn(form, rows)
    if known is None:
        return np.arange(len(found.outcome))
    settled, fits = ~known.doubtful, ~known.doubtful
    facts = _facts(task, known) if any(one.kind in FACTS for one in task.measures) else {}
    left: list[Rows] = []
    if len(task.angles):
        left = _swing_blocks(task, rows, good, known, facts, found)
        fits = known.full & settled
    left += _blocks(task, rows, good[fits], {name: one[fits] for name, one in facts.items()}, found)
    for name, values in facts.items():
        found.values[name][good[settled]] = values[settled]
    return np.sort(np.concatenate([np.setdiff1d(np.arange(len(found.outcome)), good[settled]), *left]))


def _known_to_turn(form: TwoBranchForm, rows: Mapping[str, Array]) -> tuple[Rows, Turning | None]:
    """Return the designs that their parameters allow, and over which part of the turn they can stand."""
    good = np.flatnonzero(allowed(form, rows))
    return good, turning(form, _some(rows, good)) if len(good) else None


def _swing_blocks(
    task: SweepTask,
    rows: Mapping[str, Array],
    good: Rows,
    known: Turning,
    facts: Mapping[str, Array],
    found: Measured,
) -> list[Rows]:
    """Measure designs whose cranks swing over their reachable ranges; return those left to themselves."""
    swing = np.flatnonzero(~known.doubtful & ~known.full)
    low, high = swing_arcs(known)
    sure = swing[np.isfinite(low[swing])]
    left = [good[np.setdiff1d(swing, sure)]]
    step = max(1, BLOCK // max(1, len(task.angles)))
    for first in range(0, len(sure), step):
        some = sure[first : first + step]
        own = {name: one[some] for name, one in facts.items()}
        values = _block(task, rows, good[some], task.within(low[some], high[some]), own)
        finite = np.all([np.isfinite(one) for one in values.values()], axis=0)
        taken_in = {name: one[finite] for name, one in values.items()}
        found.take_swings(good[some[finite]], taken_in, low[some[finite]], high[some[finite]])
        left.append(good[some[~finite]])
    return left


def _block(
    task: SweepTask, rows: Mapping[str, Array], block: Rows, crank: CrankRows, facts: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the measures of designs along crank motions, (poses,) or (designs, poses), by one formula."""
    form = task.subject.form
    assert isinstance(form, ClosedForm)
    jointed = any(one.jointed for one in task.measures)
    with np.errstate(all="ignore"):
        motion = solved(
            form,
            _some(rows, block),
            crank.angle,
            crank.speed,
            crank.acceleration,
            rates=task.rated,
            joints=jointed,
        )
        turns = Turns(len(block), crank.angle.shape[-1], motion, facts=facts)
        return table_of(task.measures, turns, task.places)


def _stepped(task: SweepTask, rows: Mapping[str, Array], found: Measured) -> Rows:
    """Measure designs by stepping those together that can be; return the others."""
    form, every = task.subject.closed, np.arange(len(found.outcome))
    if not (isinstance(form, TwoBranchForm) and can_be_many(form, rows)):
        return stepped_together(task, rows, every, found)
    good, known = _known_to_turn(form, rows)
    if known is None:
        return every
    index = good[~known.doubtful & known.full & known.clear]
    left = stepped_together(task, rows, index, found)
    return np.union1d(left, np.setdiff1d(every, index))


def _facts(task: SweepTask, known: object) -> dict[str, Array]:
    """Return what is known of designs without a motion."""
    widths, ends = ranges(known)  # pyright: ignore[reportArgumentType]
    there = {"crank_range": widths, "dead_centres": ends.astype(float)}
    there["assemblies"] = np.where(widths > 0.0, 2.0, 0.0)
    return {one.kind: there[one.kind] for one in task.measures if one.kind in FACTS}


def _blocks(
    task: SweepTask, rows: Mapping[str, Array], fits: Rows, facts: Mapping[str, Array], found: Measured
) -> list[Rows]:
    """Measure designs that turn fully, some at a time; return those of which a measure is no number."""
    form, angles, left = task.subject.form, task.angles, [np.zeros(0, dtype=np.intp)]
    assert isinstance(form, ClosedForm)
    step = max(1, BLOCK // max(1, len(angles)))
    for first in range(0, len(fits), step):
        part = slice(first, first + step)
        block = fits[part]
        own = {name: one[part] for name, one in facts.items()}
        if len(angles):
            values = _block(task, rows, block, task.turn, own)
        else:
            motion = taken(form.solve(np.zeros(1), links=False), slice(0, 0))
            values = table_of(task.measures, Turns(len(block), 0, motion, facts=own), task.places)
        finite = np.all([np.isfinite(one) for one in values.values()], axis=0)
        if "crank_range" in own:
            finite &= own["crank_range"] > 0.0
        found.take(block[finite], {name: one[finite] for name, one in values.items()})
        left.append(block[~finite])
    return left


def _loops(task: SweepTask, rows: Mapping[str, Array], found: Measured) -> Rows:
    """Measure designs by loop equations, all together; return those that this does not settle."""
    assert task.together is not None
    every = np.arange(len(found.outcome))
    # a form of the catalogue is measured where its crank turns fully, which is seen where a turn ends
    closed = task.subject.closed is not None
    angles = np.append(task.angles, TURN) if closed else task.angles
    try:
        begun = begun_designs(task, rows)
        if begun is None:
            return every
        started, index = begun.started, begun.which
        motion, good = many_motion(task.together, started, angles, task.pace, task.joints, rates=task.rated)
    except (MechsimError, ArithmeticError, np.linalg.LinAlgError):
        return every
    if closed:
        good &= come_back(motion, len(index))
        motion = taken(motion, np.tile(np.arange(len(angles)) < len(task.angles), len(index)))
    with np.errstate(all="ignore"):
        values = table_of(task.measures, Turns(len(index), len(task.angles), motion), task.places)
    good &= np.all([np.isfinite(one) for one in values.values()], axis=0)
    found.take(index[good], {name: one[good] for name, one in values.items()})
    swung = _loop_swings(task, started, index, np.flatnonzero(~good), found)
    return np.setdiff1d(every, np.union1d(index[good], swung))


def _loop_swings(
    task: SweepTask, started: StartedDesigns, index: Rows, others: Rows, found: Measured
) -> Rows:
    """Measure designs whose cranks swing by loop equations, together; return which they are."""
    assert task.together is not None
    if not len(others) or task.subject.form.programs is not None:
        return others[:0]
    try:
        tracer = SwingTracer(task.together, started.some(others))
        swings = tracer.swings()
        if swings is None:
            return others[:0]
        crank = task.within(swings.low, swings.high)
        motion, good = tracer.motion(
            swings, crank.angle, crank.speed, crank.acceleration, task.joints, rates=task.rated
        )
    except (MechsimError, ArithmeticError, np.linalg.LinAlgError):
        return others[:0]
    with np.errstate(all="ignore"):
        turns = Turns(len(crank.angle), crank.angle.shape[1], motion)
        values = table_of(task.measures, turns, task.places)
    good &= np.all([np.isfinite(one) for one in values.values()], axis=0)
    rows = index[others[swings.rows[good]]]
    own = {name: one[good] for name, one in values.items()}
    found.take_swings(rows, own, swings.low[good], swings.high[good])
    return rows


def come_back(motion: Motion, designs: int) -> NDArray[np.bool_]:
    """Whether designs stand at the end of a turn, the last of their instants, as in the first, (designs,)."""
    same = np.ones(designs, dtype=np.bool_)
    for point in motion.points.values():
        path = point.position.reshape(designs, -1, 3)
        same &= np.abs(path[:, -1] - path[:, 0]).max(1) <= SAME * np.ptp(path, axis=1).max(1)
    return same


def _some(rows: Mapping[str, Array], index: Rows) -> dict[str, Array]:
    return {name: values[index] for name, values in rows.items()}


def one_by_one(task: SweepTask, rows: Mapping[str, Array], index: Rows, found: Measured) -> None:
    """Measure designs each by itself; what goes wrong with one is its outcome."""
    for i in index:
        row = np.array([i])
        try:
            form = task.subject.make({name: float(values[i]) for name, values in rows.items()})
            facts = facts_alone(task, form)
            for name, value in facts.items():
                found.values[name][i] = value
            values, outcome, why = alone(task, form, facts)
        except MechsimError as error:
            found.refuse(row, _outcome(error), cut(str(error), LONGEST))
            continue
        except (ArithmeticError, np.linalg.LinAlgError, ValueError) as error:
            found.refuse(row, "diverged", cut(f"{type(error).__name__}: {error}", LONGEST))
            continue
        lost = [name for name, value in values.items() if not np.isfinite(value)]
        found.take(row, {name: np.array([value]) for name, value in values.items()})
        found.refuse(row, outcome, why)
        if lost:
            found.refuse(row, "diverged", f"{lost[0]} is no finite number")


def _outcome(error: MechsimError) -> str:
    return error.outcome if isinstance(error, MobilityError) else "cannot assemble"


def facts_alone(task: SweepTask, form: Form) -> dict[str, float]:
    """Return what is known of a design without a motion, as far as it is asked for."""
    wanted = [one.kind for one in task.measures if one.kind in FACTS]
    found: dict[str, float] = {}
    for kind in wanted:
        arcs = form.crank_range()
        if kind == "crank_range":
            found[kind] = float(sum(high - low for low, high in arcs.arcs))
        elif kind == "dead_centres":
            found[kind] = float(len(form.dead_centres()))
        else:
            there = closed_form(form, "the number of assemblies")
            found[kind] = float(len(there.assemblies(arcs.start()))) if arcs.arcs else 0.0
    return found


def alone(task: SweepTask, form: Form, facts: Mapping[str, float]) -> tuple[dict[str, float], str, str]:
    """Return the measures of one design, its outcome, and why it is not met.

    Raises:
        AssemblyError: where it cannot be put together all along the motion.
    """
    angles = task.angles
    if not len(angles):
        if not form.crank_range().arcs:
            raise closes_nowhere(form.name)
        return {one.name: facts[one.kind] for one in task.measures}, "met", ""
    around = swing_arc(form)
    if task.settings is not None:
        values, outcome, why = stepped_alone(task, form)
        if around is not None and outcome == "met":
            outcome, why = "swings", swings_between(*around)
        return values, outcome, why
    if around is None:
        return _solved_alone(task, form, facts, task.turn), "met", ""
    values = _solved_alone(task, form, facts, task.within(*around))
    return values, "swings", swings_between(*around)


def swing_arc(form: Form) -> tuple[float, float] | None:
    """Return the reachable range of a crank that swings, in [rad]; None where it turns fully or laws drive.

    Raises:
        AssemblyError: where it can stand nowhere.
    """
    if form.programs is not None:
        return None
    arcs = form.crank_range()
    if arcs.full:
        return None
    around = arc_around(arcs, form.mechanism.start) if arcs.arcs else None
    if around is None:
        raise closes_nowhere(form.name)
    return around


def _solved_alone(
    task: SweepTask, form: Form, facts: Mapping[str, float], crank: CrankRows
) -> dict[str, float]:
    """Return the measures of one design by its formulas or loop equations along a crank motion (p,)."""
    kept = {name: np.array([value]) for name, value in facts.items()}
    angles, pace = crank.angle, crank.speed
    if form.programs is not None:
        # the pace goes with the size of the design; the times are the same
        angles, pace = angles / pace * form.programs.pace, np.full_like(pace, form.programs.pace)
    motion = form.solve_along(angles, pace, crank.acceleration)
    shape = (1, len(angles))
    efforts: dict[str, Array] = {}
    if task.loaded:
        acting = getattr(form, "forces", None) or Forces()
        study = prescribed_along(machine(form, acting), angles, pace, crank.acceleration)
        efforts = {name: column.reshape(shape) for name, column in study.columns()}
    transmission = None
    if task.wants(TRANSMISSION):
        transmission = closed_form(form, "a transmission angle").transmission_angle(angles).reshape(shape)
    turns = Turns(1, len(angles), motion, efforts, transmission, kept)
    return {name: float(one[0]) for name, one in table_of(task.measures, turns, task.places).items()}


def require_measurable(task: SweepTask) -> None:
    """Refuse measures that no design of a subject can have.

    Raises:
        InputError: naming the measure and the remedy.
    """
    form = task.subject.form
    if task.settings is not None:
        _require_stepped(task)
    for one in task.measures:
        if one.kind == "assemblies" and not isinstance(form, ClosedForm):
            raise InputError(
                f"the number of assemblies is known for mechanisms of the catalogue only, and {form.name!r} "
                "is none; `mechsim trace` finds those of any other"
            )
        if one.of is not None and one.of.kind == "transmission":
            closed_form(form, "a transmission angle")
    if form.programs is None and not form.mechanism.has_crank:
        raise InputError(
            f"{form.name} has no lone crank to turn; give its drivers programs with --drive JOINT=PROGRAM"
        )


def _require_stepped(task: SweepTask) -> None:
    """Refuse measures that no stepped motion tells."""
    mechanism = task.subject.form.mechanism
    cut = [name for joint in cut_loops(mechanism, splits=True).cuts for name in joint.coordinates]
    for one in task.measures:
        if one.kind in FACTS or (one.of is not None and one.of.kind == TRANSMISSION):
            raise InputError(f"{one.name} is known by formulas; leave out --method step, or that measure")
        if one.of is not None and one.of.kind == "joint" and one.of.subject in cut:
            told = [name for joint in mechanism.joints for name in joint.coordinates if name not in cut]
            raise InputError(
                f"{one.name}: MuJoCo's model is cut at {one.of.subject}, and its states do not hold it; "
                f"stepped motions tell {', '.join(told)}"
            )
    _ = task.records
