"""Hypotheses of one wrong dimension: parameter, position of a joint or point, gear ratio or phase."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from mechsim.analytic.designs import DesignFamily, Dimension, placed_designs
from mechsim.analytic.loops.constraints import tree_loops
from mechsim.analytic.loops.kinematics import Coordinates, link_poses
from mechsim.analytic.loops.start import closed
from mechsim.analytic.loops.tree import SpanningTree
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError, MechsimError
from mechsim.model.link_poses import guessed_poses, initial_coordinates
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.quantity import AXES
from mechsim.numerics.angles import wrapped
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.evaluation_points import (
    NAMED,
    PLACED,
    EvaluationPoints,
    Hypothesis,
    Values,
    discrete,
    sized,
)
from mechsim.studies.agreement.fitting import linearly_explains
from mechsim.studies.agreement.misfit import Misfit

# number of joint positions that are solved again: those that explain most to first order
MAX_SOLVED = 6
# smallest fraction of the difference that a dimension must explain to first order to be solved again
MIN_EXPLAINED = 0.25
# largest change of a dimension, relative to its value or to the mechanism's size
MAX_CHANGE = 3.0
# fraction of its nominal value below which a changed dimension is reported as 0
ROUNDED_TO_ZERO = 1e-4
# step of central differences, relative to the mechanism's size
STEP = 1e-5


def parameters(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of one wrong parameter, coupling ratio or coupling phase: the most likely ones."""
    designs = misfit.designs
    hypotheses = [_other_dimension(misfit, designs, name, NAMED) for name in designs.dimensions]
    hypotheses += _other_couplings(misfit)
    # exact derivatives of forces are not available
    yield from hypotheses if misfit.needs_forces else _likely(misfit, hypotheses, MAX_SOLVED + 2)


def gear_mistakes(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a gear ratio with the opposite sign, or inverted."""
    solver = misfit.evaluation.solver
    geared: list[tuple[str, str, float, Callable[[float], KinematicSolver]]] = []
    if not (own := solver.gear):
        for k, gear in enumerate(solver.mechanism.gears):
            label = f"the ratio of {gear.name}"
            geared.append((gear.name, label, gear.ratio, partial(_gear_changed, solver, k, "ratio")))
    else:
        ratio = misfit.designs.dimensions[own].value
        geared.append((own, own, ratio, lambda by: misfit.designs.make({own: ratio + by})))
    for name, label, ratio, changed in geared:
        for other in {-ratio, 1.0 / ratio} - {ratio}:
            text = f"{label} is {other:.6g} instead of {ratio:.6g}"
            predict = partial(_of_other_solver, misfit, changed, other - ratio)
            yield discrete("gear", name, predict, text, (other - ratio) / abs(ratio))


def _of_other_solver(misfit: Misfit, changed: Callable[[float], KinematicSolver], by: float) -> Values:
    return misfit.predicted(_solved_from_start(misfit.evaluation, changed(by)))


def positions(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of one joint or point in another position: the most likely ones."""
    solver = misfit.evaluation.solver
    designs = placed_designs(solver)
    joints = [
        _other_dimension(misfit, designs, name, PLACED)
        for name in designs.dimensions
        if name not in misfit.designs.dimensions
    ]
    points = [_other_point(misfit, point, i) for point in solver.mechanism.points for i in range(3)]
    yield from _likely(misfit, [*joints, *points], MAX_SOLVED)


def _likely(misfit: Misfit, hypotheses: list[Hypothesis], count: int) -> list[Hypothesis]:
    """Return the hypotheses that explain most to first order."""
    ranked: list[tuple[float, Hypothesis]] = []
    for hypothesis in hypotheses:
        values = _first_order(hypothesis)
        if values is None:
            continue
        derivative = misfit.scaled(values)
        if derivative.any() and np.isfinite(derivative).all():
            ranked.append((linearly_explains(misfit, derivative[:, None]), hypothesis))
    ranked.sort(key=lambda pair: -pair[0])
    return [hypothesis for explains, hypothesis in ranked[:count] if explains > MIN_EXPLAINED]


def _first_order(hypothesis: Hypothesis) -> Values | None:
    """Return derivatives by the size of a hypothesis, exact or by differences; None without either."""
    with suppress(MechsimError, KeyError):
        if hypothesis.derivative is not None:
            return hypothesis.derivative()
    if hypothesis.tier == NAMED:
        with suppress(MechsimError, ValueError):
            # the central differences of predicted values by one size at zero
            ahead, behind = (hypothesis.predict(np.array([direction * STEP])) for direction in (1.0, -1.0))
            return [(a - b) / (2.0 * STEP) for a, b in zip(ahead, behind, strict=True)]
    return None


def _other_dimension(misfit: Misfit, designs: DesignFamily, name: str, tier: float) -> Hypothesis:
    evaluation, dimension = misfit.evaluation, designs.dimensions[name]
    whole = misfit.length if dimension.unit == "m" else 1.0
    scale = abs(dimension.value) if abs(dimension.value) > 1e-3 * whole else whole

    def predict(change: float) -> Values:
        _require_small(change)
        solver = designs.make({name: dimension.value + scale * change})
        return misfit.predicted(_resolved(evaluation, _with_laws_of(evaluation.solver, solver)))

    def derivative() -> Values:
        motion = misfit.by_dimension(designs, name)
        return [scale * evaluation.change(motion, quantity) for quantity in misfit.quantities]

    def text(change: float) -> str:
        change = scale * change
        unit = "" if dimension.unit == "1" else f" {dimension.unit}"
        large = abs(dimension.value) > 1e-3 * scale
        fraction = f" ({100 * change / dimension.value:+.3g} %)" if large else ""
        value = dimension.value + change
        noise = max(1e-12 * scale, ROUNDED_TO_ZERO * abs(dimension.value))
        now = f"{value if abs(value) > noise else 0.0:.6g}"
        return f"{name} is {now}{unit} instead of {dimension.value:.6g}{unit}{fraction}"

    kind = _kind(designs, dimension, evaluation.solver)
    return sized(kind, name, predict, text, STEP, tier=tier, derivative=derivative)


def _require_small(change: float) -> None:
    """Reject a change larger than any plausible mistake in a dimension.

    Raises:
        AssemblyError: for more than `MAX_CHANGE` times the dimension.
    """
    if not abs(change) <= MAX_CHANGE:
        raise AssemblyError(f"changes of a dimension are limited to {MAX_CHANGE:g} times its value")


def _resolved(evaluation: EvaluationPoints, solver: KinematicSolver) -> EvaluationPoints:
    """Return evaluation points of a mechanism with other dimensions."""
    if solver.closed_form is not None:
        return _solved_from_start(evaluation, solver)
    return evaluation.with_dimensions(solver)


def _solved_from_start(evaluation: EvaluationPoints, solver: KinematicSolver) -> EvaluationPoints:
    """Return evaluation points of a mechanism too different to start from the nominal motion."""
    return replace(evaluation, solver=solver, dynamic_model=evaluation.dynamic_model_of(solver), solved=None)


def _with_laws_of(before: KinematicSolver, solver: KinematicSolver) -> KinematicSolver:
    """Return a solver with the motion laws of another one."""
    solver = solver.with_change_point(before.change_point)
    if before.motion_laws.crank:
        return solver
    return solver.with_mechanism(solver.mechanism, motion_laws=before.motion_laws)


def _kind(designs: DesignFamily, dimension: Dimension, solver: KinematicSolver) -> str:
    """Return the kind of a dimension: gear ratio, gear phase, or parameter."""
    own = getattr(solver, "gear", "")
    if own:
        return {own: "gear", "phase": "phase"}.get(dimension.name, "dimension")
    if not solver.mechanism.laws or dimension.unit == "m":
        return "dimension"
    step = 1e-3 * (abs(dimension.value) or 1.0)
    try:
        before, after = (
            designs.describe({dimension.name: dimension.value + change}) for change in (0.0, step)
        )
    except MechsimError:
        return "dimension"
    if before.joints != after.joints or before.points != after.points:
        return "dimension"
    ratios = [(law.ratio, other.ratio) for law, other in zip(before.laws, after.laws, strict=True)]
    return "gear" if any(ratio != other for ratio, other in ratios) else "phase"


def _other_point(misfit: Misfit, point: str, i: int) -> Hypothesis:
    """Return the hypothesis that a tracked point has another position on its link."""
    solver, extent = misfit.evaluation.solver, misfit.length
    link, position = solver.mechanism.points[point]

    def predict(change: float) -> Values:
        _require_small(change)
        moved = list(position)
        moved[i] += extent * change
        x, y, z = moved
        points = {**solver.mechanism.points, point: (link, (x, y, z))}
        other = solver.with_mechanism(replace(solver.mechanism, points=points))
        return misfit.predicted(_resolved(misfit.evaluation, other))

    def derivative() -> Values:
        links = misfit.evaluation.motion.links
        if link not in links or any(quantity.function for quantity in misfit.quantities):
            raise KeyError(link)
        motion = links[link]
        axis = motion.rotation[:, :, i]
        rate = np.cross(motion.angular_velocity, axis)
        second = np.cross(motion.angular_acceleration, axis) + np.cross(motion.angular_velocity, rate)
        by = {"position": axis, "velocity": rate, "acceleration": second}
        return [
            extent * quantity.select(by[quantity.kind])
            if quantity.subject == point and quantity.kind in by
            else np.zeros_like(values)
            for quantity, values in zip(misfit.quantities, misfit.exact, strict=True)
        ]

    def text(change: float) -> str:
        return f"point {point} lies {extent * change:.6g} m farther along {AXES[i]} on link {link}"

    name = f"{point}.at.{AXES[i]}"
    return sized("dimension", name, predict, text, STEP, tier=PLACED, derivative=derivative)


def _other_couplings(misfit: Misfit) -> list[Hypothesis]:
    """Return hypotheses of other coupling ratios and phases that no parameter determines."""
    solver = misfit.evaluation.solver
    if solver.gear:
        return []
    hypotheses: list[Hypothesis] = []
    for k, gear in enumerate(solver.mechanism.gears):
        for field, kind in (("ratio", "gear"), ("phase", "phase")):
            changed = partial(_gear_changed, solver, k, field)
            hypotheses.append(_other_coupling(misfit, gear.name, kind, changed, gear.ratio))
    for k, law in enumerate(solver.mechanism.couplings):
        for i, kind in ((1, "gear"), (0, "phase")):
            if i < len(law.coefficients):
                changed = partial(_coupling_changed, solver, k, i)
                hypotheses.append(_other_coupling(misfit, law.name, kind, changed, law.ratio))
    return hypotheses


def _gear_changed(solver: KinematicSolver, k: int, field: str, by: float) -> KinematicSolver:
    gears = list(solver.mechanism.gears)
    gears[k] = replace(gears[k], **{field: getattr(gears[k], field) + by})
    return solver.with_mechanism(replace(solver.mechanism, gears=tuple(gears)))


def _coupling_changed(solver: KinematicSolver, k: int, i: int, by: float) -> KinematicSolver:
    laws = list(solver.mechanism.couplings)
    terms = list(laws[k].coefficients)
    terms[i] += by
    laws[k] = replace(laws[k], coefficients=tuple(terms))
    return solver.with_mechanism(replace(solver.mechanism, couplings=tuple(laws)))


def _other_coupling(
    misfit: Misfit, name: str, kind: str, changed: Callable[[float], KinematicSolver], ratio: float
) -> Hypothesis:
    scale = (abs(ratio) or 1.0) if kind == "gear" else 1.0

    def predict(change: float) -> Values:
        return misfit.predicted(_resolved(misfit.evaluation, changed(scale * change)))

    def text(change: float) -> str:
        if kind == "gear":
            return f"the ratio of {name} is {ratio + scale * change:.6g} instead of {ratio:.6g}"
        return f"the phase of {name} is larger by {change:.6g}"

    return sized(kind, name, predict, text, STEP)


# number of random starts of the loop equations; smallest distance of two assemblies relative to the size
STARTS, ASSEMBLY_DISTANCE, SEED = 16, 1e-4, 20


def assemblies(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield the other assemblies of the mechanism."""
    for what, solver in _other_assemblies(misfit.evaluation):
        evaluation = partial(_solved_from_start, misfit.evaluation, solver)
        yield discrete(
            "assembly", what, partial(_predicted, misfit, evaluation), f"another assembly mode: {what}"
        )


def _predicted(misfit: Misfit, evaluation: Callable[[], EvaluationPoints]) -> Values:
    return misfit.predicted(evaluation())


def _other_assemblies(evaluation: EvaluationPoints) -> list[tuple[str, KinematicSolver]]:
    """Return the other assemblies, each with a description of the difference."""
    solver = evaluation.solver
    modes = solver.assemblies(float(evaluation.angle[len(evaluation) // 3]))
    return _assemblies_from_random_starts(solver) if modes is None else list(_selected(solver, modes))


def _selected(
    solver: KinematicSolver, modes: Iterable[KinematicSolver]
) -> Iterator[tuple[str, KinematicSolver]]:
    """Yield the other assemblies of a mechanism, each with the parameters that select it."""
    for assembly in modes:
        chosen = assembly.selectors
        if chosen != solver.selectors:
            yield ", ".join(f"{k} = {v}" for k, v in chosen.items() if v != solver.selectors[k]), assembly


def _assemblies_from_random_starts(solver: KinematicSolver) -> list[tuple[str, KinematicSolver]]:
    """Return assemblies of a mechanism found from random starts."""
    mechanism = solver.mechanism
    try:
        loops, guess = tree_loops(mechanism, guessed_poses(mechanism), initial_coordinates(mechanism))
        own = closed(loops, guess)
    except MechsimError:
        return []
    tree, random = loops.tree, np.random.default_rng(SEED)
    solutions, others = [_joint_positions(mechanism, tree, own)], list[tuple[str, KinematicSolver]]()
    amplitude = np.where(np.asarray(tree.slides), 0.3 * mechanism.characteristic_length, 1.0)
    for _ in range(STARTS):
        values = own.values.copy()
        change = random.uniform(-np.pi, np.pi, tree.count) * amplitude
        values[loops.unknown, 0] += change[loops.unknown]
        try:
            q = closed(loops, Coordinates(values, own.turns.copy()))
        except (MechsimError, np.linalg.LinAlgError):
            continue
        position = _joint_positions(mechanism, tree, q)
        nearest = min(float(np.abs(position - other).max()) for other in solutions)
        if nearest < ASSEMBLY_DISTANCE * mechanism.characteristic_length:
            continue
        solutions.append(position)
        other = _with_guess(solver, tree, q)
        if other is not None:
            others.append((_description(mechanism, tree, own, q), other))
    return others


def _joint_positions(mechanism: Mechanism, tree: SpanningTree, q: Coordinates) -> Array:
    """Return the positions of all joints on both of their links, (ends, 3)."""
    poses = link_poses(tree, q)
    ends = [end for joint in mechanism.joints for end in (joint.a, joint.b) if end.link != GROUND]
    return np.array(
        [
            poses.position[tree.links[end.link], :, 0]
            + poses.rotation[tree.links[end.link], :, :, 0] @ np.asarray(end.point)
            for end in ends
        ]
    )


def _with_guess(solver: KinematicSolver, tree: SpanningTree, q: Coordinates) -> KinematicSolver | None:
    """Return a solver that starts at given coordinates; None if the mechanism rejects them."""
    mechanism, poses = solver.mechanism, link_poses(tree, q).by_link(tree.links)
    guess = {name: pose.select(0) for name, pose in poses.items()}
    counted = {
        name: value for name, value in mechanism.guess_coordinates.items() if name in mechanism.drivers
    }
    try:
        return solver.with_mechanism(replace(mechanism, guess=guess, guess_coordinates=counted))
    except MechsimError:
        return None


def _description(mechanism: Mechanism, tree: SpanningTree, own: Coordinates, q: Coordinates) -> str:
    """Describe the difference of two assemblies by the joint that differs most."""
    difference = q.values[:, 0] - own.values[:, 0]
    relative = {
        name: difference[i] / mechanism.characteristic_length
        if tree.slides[i]
        else float(wrapped(difference[i])) / np.pi
        for name, i in tree.index_of.items()
    }
    if not relative:
        return "other"
    name = max(relative, key=lambda joint: abs(relative[joint]))
    i = tree.index_of[name]
    unit = "m" if tree.slides[i] else "rad"
    return f"{name} = {q.values[i, 0]:.4g} {unit} instead of {own.values[i, 0]:.4g}"
