"""Hypotheses of one wrong dimension: parameter, position of a joint or point, gear ratio or phase."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mechsim.errors import AssemblyError, MechsimError
from mechsim.kinematics.designs import DesignFamily, Dimension, placed_designs
from mechsim.kinematics.loops.assemblies import other_assemblies
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinematics.loops.motion import driven_path
from mechsim.kinematics.loops.tree import SpanningTree
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import AXES
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import wrapped
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, Values
from mechsim.studies.agreement.misfit import Hypothesis, Misfit, linearly_explains

# number of joint positions that are solved again: those that explain most to first order
MAX_SOLVED = 6
# smallest fraction of the difference that a dimension must explain to first order to be solved again
MIN_EXPLAINED = 0.25
# largest change of a dimension, relative to its value or to the mechanism's size
MAX_CHANGE = 3.0
# fraction of its nominal value below which a changed dimension is reported as 0
ROUNDED_TO_ZERO = 1e-4
# rank of a position, which no parameter names, among explanations by one size
PLACED = 0.5
# step of central differences, relative to the mechanism's size
STEP = 1e-5


def parameters(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of one wrong parameter, coupling ratio or coupling phase: the most likely ones."""
    designs = misfit.designs
    hypotheses = [_other_dimension(misfit, designs, name) for name in designs.dimensions]
    if not misfit.evaluation.solver.gear:
        numbers = _coupling_numbers(misfit.evaluation.solver)
        hypotheses += [_other_coupling(misfit, number) for number in numbers]
    # exact derivatives of forces are not available
    yield from hypotheses if misfit.needs_forces else _likely(misfit, hypotheses, MAX_SOLVED + 2)


@dataclass(frozen=True)
class CouplingNumber:
    """A ratio or a phase of a coupling that no parameter determines.

    Attributes:
        name: of the coupling.
        kind: "gear" of a ratio, "phase" of a phase.
        label: the ratio in words.
        ratio: ratio of the coupling.
        changed: change of the number -> the mechanism with it.
    """

    name: str
    kind: str
    label: str
    ratio: float
    changed: Callable[[float], KinematicSolver]


def _coupling_numbers(solver: KinematicSolver) -> Iterator[CouplingNumber]:
    """Yield the ratios and phases of gears, then those of other couplings."""
    mechanism = solver.mechanism

    def with_law(field: str, k: int, law: object) -> KinematicSolver:
        laws = list(getattr(mechanism, field))
        laws[k] = law
        return solver.with_mechanism(replace(mechanism, **{field: tuple(laws)}))

    def gear(k: int, number: str, by: float) -> KinematicSolver:
        own = mechanism.gears[k]
        return with_law("gears", k, replace(own, **{number: getattr(own, number) + by}))

    def coefficient(k: int, i: int, by: float) -> KinematicSolver:
        terms = list(mechanism.couplings[k].coefficients)
        terms[i] += by
        return with_law("couplings", k, replace(mechanism.couplings[k], coefficients=tuple(terms)))

    for k, own in enumerate(mechanism.gears):
        for number, kind in (("ratio", "gear"), ("phase", "phase")):
            label = f"the ratio of {own.name}"
            yield CouplingNumber(own.name, kind, label, own.ratio, partial(gear, k, number))
    for k, law in enumerate(mechanism.couplings):
        for i, kind in ((1, "gear"), (0, "phase")):
            if i < len(law.coefficients):
                label = f"the ratio of {law.name}"
                yield CouplingNumber(law.name, kind, label, law.ratio, partial(coefficient, k, i))


def gear_mistakes(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a gear ratio with the opposite sign, or inverted."""
    solver, designs = misfit.evaluation.solver, misfit.designs
    gears = {gear.name for gear in solver.mechanism.gears}
    numbers = [x for x in _coupling_numbers(solver) if x.kind == "gear" and x.name in gears]
    if own := solver.gear:
        ratio = designs.dimensions[own].value
        numbers = [CouplingNumber(own, "gear", own, ratio, lambda by: designs.make({own: ratio + by}))]
    for number in numbers:
        for other in {-number.ratio, 1.0 / number.ratio} - {number.ratio}:
            text, by = f"{number.label} is {other:.6g} instead of {number.ratio:.6g}", other - number.ratio

            def predict(number: CouplingNumber = number, by: float = by) -> Values:
                return misfit.predicted(misfit.evaluation.with_dimensions(number.changed(by), similar=False))

            yield Hypothesis("gear", number.name, predict, text, by / abs(number.ratio))


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
        derivative = np.zeros(1) if values is None else misfit.scaled(values)
        if derivative.any() and np.isfinite(derivative).all():
            ranked.append((linearly_explains(misfit, derivative[:, None]), hypothesis))
    ranked.sort(key=lambda pair: -pair[0])
    return [hypothesis for explains, hypothesis in ranked[:count] if explains > MIN_EXPLAINED]


def _first_order(hypothesis: Hypothesis) -> Values | None:
    """Return derivatives by the size of a hypothesis, exact or by differences; None without either."""
    with suppress(MechsimError, KeyError):
        if hypothesis.derivative is not None:
            return hypothesis.derivative()
    if hypothesis.rank != PLACED:
        with suppress(MechsimError, ValueError):
            # the central differences of predicted values by one size at zero
            ahead, behind = (hypothesis.predict(step) for step in (STEP, -STEP))
            return [(a - b) / (2.0 * STEP) for a, b in zip(ahead, behind, strict=True)]
    return None


def _other_dimension(misfit: Misfit, designs: DesignFamily, name: str, rank: float = 0.0) -> Hypothesis:
    evaluation, dimension = misfit.evaluation, designs.dimensions[name]
    scale = _scale(dimension, misfit.length)

    def predict(change: float) -> Values:
        _require_small(change)
        return misfit.predicted(with_changed(evaluation, designs, name, change))

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
    return Hypothesis(kind, name, predict, text, steps=(STEP,), derivative=derivative, rank=rank)


def with_changed(
    evaluation: EvaluationPoints, designs: DesignFamily, name: str, change: float
) -> EvaluationPoints:
    """Return evaluation points with one dimension changed by a fraction, as the value of a finding states it.

    Raises:
        AssemblyError: where the loops do not close.
    """
    before, dimension = evaluation.solver, designs.dimensions[name]
    scale = _scale(dimension, before.mechanism.characteristic_length)
    solver = designs.make({name: dimension.value + scale * change}).with_change_point(before.change_point)
    if not before.motion_laws.crank:
        solver = solver.with_mechanism(solver.mechanism, motion_laws=before.motion_laws)
    return evaluation.with_dimensions(solver)


def _scale(dimension: Dimension, length: float) -> float:
    """Return what changes of a dimension are relative to: its value, or a mechanism's size if it is 0."""
    whole = length if dimension.unit == "m" else 1.0
    return abs(dimension.value) if abs(dimension.value) > 1e-3 * whole else whole


def _require_small(change: float) -> None:
    """Reject a change larger than any plausible mistake in a dimension.

    Raises:
        AssemblyError: for more than `MAX_CHANGE` times the dimension.
    """
    if not abs(change) <= MAX_CHANGE:
        raise AssemblyError(f"changes of a dimension are limited to {MAX_CHANGE:g} times its value")


def _kind(designs: DesignFamily, dimension: Dimension, solver: KinematicSolver) -> str:
    """Return the kind of a dimension: gear ratio, gear phase, or parameter."""
    if own := solver.gear:
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
        return misfit.predicted(misfit.evaluation.with_dimensions(other))

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
    return Hypothesis("dimension", name, predict, text, steps=(STEP,), derivative=derivative, rank=PLACED)


def _other_coupling(misfit: Misfit, number: CouplingNumber) -> Hypothesis:
    geared, ratio = number.kind == "gear", number.ratio
    scale = (abs(ratio) or 1.0) if geared else 1.0

    def predict(change: float) -> Values:
        return misfit.predicted(misfit.evaluation.with_dimensions(number.changed(scale * change)))

    def text(change: float) -> str:
        if geared:
            return f"{number.label} is {ratio + scale * change:.6g} instead of {ratio:.6g}"
        return f"the phase of {number.name} is larger by {change:.6g}"

    return Hypothesis(number.kind, number.name, predict, text, steps=(STEP,))


def assemblies(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield the other assemblies of the mechanism, with the parameters that select each, or by its joints."""
    evaluation = misfit.evaluation
    solver, own = evaluation.solver, evaluation.solver.selectors
    modes = solver.assemblies(float(evaluation.angle[len(evaluation) // 3]))
    others = _searched_assemblies(solver) if modes is None else []
    for assembly in modes or ():
        if (chosen := assembly.selectors) != own:
            others.append((", ".join(f"{k} = {v}" for k, v in chosen.items() if v != own[k]), assembly))
    for what, other in others:
        predict = partial(misfit.predicted, evaluation.with_dimensions(other, similar=False))
        yield Hypothesis("assembly", what, predict, f"another assembly mode: {what}")


def _searched_assemblies(solver: KinematicSolver) -> list[tuple[str, KinematicSolver]]:
    """Return other assemblies at the start, by random starts, each with its joint that differs most."""
    mechanism = solver.mechanism
    start = mechanism.start if solver.motion_laws.crank else 0.0
    path = driven_path(mechanism, solver.motion_laws, solver.change_point)
    own = path.start
    drivers = {name: x for name, x in mechanism.guess_coordinates.items() if name in mechanism.drivers}
    others: list[tuple[str, KinematicSolver]] = []
    for poses in other_assemblies(path, start, solver.ranges, [solver.whole_motion([start]).links])[0]:
        q = path.loops.read(poses)
        with suppress(MechsimError):
            other = solver.with_mechanism(replace(mechanism, guess=poses, guess_coordinates=drivers))
            others.append((_description(mechanism, path.loops.tree, own, q), other))
    return others


def _description(mechanism: Mechanism, tree: SpanningTree, own: Coordinates, q: Coordinates) -> str:
    """Describe the difference of two assemblies by the joint that differs most."""
    difference = q.values[:, 0] - own.values[:, 0]
    relative = np.abs(
        np.where(tree.slides, difference / mechanism.characteristic_length, wrapped(difference) / np.pi)
    )
    if not tree.index_of:
        return "other"
    name, i = max(tree.index_of.items(), key=lambda joint: relative[joint[1]])
    unit = "m" if tree.slides[i] else "rad"
    return f"{name} = {q.values[i, 0]:.4g} {unit} instead of {own.values[i, 0]:.4g}"
