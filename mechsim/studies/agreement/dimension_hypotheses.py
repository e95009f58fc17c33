"""One dimension different: a parameter, the place of a joint or of a point, a gear's ratio or phase."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from mechsim.analytic.catalog.base import SELECTORS, ClosedForm
from mechsim.analytic.derivatives.dimensions import DesignFamily, Dimension, placed_family
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.constraints import tree_loops
from mechsim.analytic.loops.kinematics import Coordinates, link_poses
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.start import closed
from mechsim.analytic.loops.tree import SpanningTree
from mechsim.errors import AssemblyError, MechsimError
from mechsim.model.link_poses import rough_poses, starts
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.quantities import AXES
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.agreement.fitting import linearly_explains
from mechsim.studies.agreement.misfit import DISCRETE, NAMED, PLACED, Hypothesis, Misfit, Values

# of all places of joints those that explain most in the first order are solved again
TRIED = 6
# a dimension that explains less in the first order explains nothing when solved again
LEAST = 0.25
# most by which a dimension is taken to be off, in parts of itself or of the size
MAX_CHANGE = 3.0
# step of differences, in parts of the size
STEP = 1e-5


def parameters(misfit: Misfit) -> Iterator[Hypothesis]:
    """One parameter, or the ratio or the phase of a coupling, different: the likeliest of them."""
    quantity = [
        _hypothesis(misfit, misfit.family, dimension, NAMED)
        for dimension in misfit.family.dimensions.values()
    ]
    among = [*quantity, *_of_couplings(misfit)]
    # of efforts no exact derivatives are at hand
    needs_forces = any(candidate.quantity.loaded for candidate in misfit.candidates)
    yield from among if needs_forces else _likely(misfit, among, TRIED + 2)


def gear_slips(misfit: Misfit) -> Iterator[Hypothesis]:
    """The ratio of a gear with the other sign, or the other way up."""
    solver = misfit.evaluation.solver
    geared: list[tuple[str, str, float, Callable[[float], Form]]] = []
    if isinstance(solver, LoopForm):
        for k, gear in enumerate(solver.mechanism.gears):
            changed = _gear_changed(solver, k, "ratio")
            geared.append((gear.name, f"the ratio of {gear.name}", gear.ratio, changed))
    elif isinstance(solver, ClosedForm) and (own := solver.gear):
        ratio = misfit.family.dimensions[own].value
        geared.append((own, own, ratio, lambda by: misfit.family.make({own: ratio + by})))
    for name, label, ratio, changed in geared:
        for slip in {-ratio, 1.0 / ratio} - {ratio}:
            by, fraction = slip - ratio, (slip - ratio) / abs(ratio)
            words = f"{label} is {slip:.6g} instead of {ratio:.6g}"
            yield Hypothesis(
                "gear",
                name,
                DISCRETE,
                lambda _, by=by, changed=changed: misfit.predicted(_anew(misfit.evaluation, changed(by))),
                lambda _, words=words: words,
                by=lambda _, fraction=fraction: fraction,
            )


def places(misfit: Misfit) -> Iterator[Hypothesis]:
    """One joint or one point in another place: the likeliest of them."""
    designs = placed_of(misfit)
    placed = [
        _hypothesis(misfit, designs, dimension, PLACED)
        for dimension in designs.dimensions.values()
        if dimension.name not in misfit.family.dimensions
    ]
    points = [
        _of_point(misfit, point, i) for point in misfit.evaluation.solver.mechanism.points for i in range(3)
    ]
    yield from _likely(misfit, [*placed, *points], TRIED)


def placed_of(misfit: Misfit) -> DesignFamily:
    """Return the mechanism among others whose joints are elsewhere."""
    return placed_family(misfit.evaluation.solver)


def _likely(misfit: Misfit, among: list[Hypothesis], most: int) -> list[Hypothesis]:
    """Return the hypotheses that explain most in the first order."""
    ranked: list[tuple[float, Hypothesis]] = []
    for hypothesis in among:
        values = _first_order(hypothesis)
        if values is None:
            continue
        scaled = [(value / weight).ravel() for value, weight in zip(values, misfit.bounds, strict=True)]
        derivative = np.concatenate(scaled)
        if derivative.any() and np.isfinite(derivative).all():
            ranked.append((linearly_explains(misfit, derivative[:, None]), hypothesis))
    ranked.sort(key=lambda pair: -pair[0])
    return [hypothesis for explains, hypothesis in ranked[:most] if explains > LEAST]


def _first_order(hypothesis: Hypothesis) -> Values | None:
    """Return derivatives by the size of a hypothesis: exact, or of a parameter by differences; else None."""
    with suppress(MechsimError, KeyError):
        if hypothesis.slope is not None:
            return hypothesis.slope()
    if hypothesis.tier == NAMED:
        with suppress(MechsimError, ValueError):
            ahead, behind = (hypothesis.predict(np.array([direction * STEP])) for direction in (1.0, -1.0))
            return [(a - b) / (2.0 * STEP) for a, b in zip(ahead, behind, strict=True)]
    return None


def _hypothesis(misfit: Misfit, designs: DesignFamily, dimension: Dimension, tier: float) -> Hypothesis:
    evaluation, extent = misfit.evaluation, misfit.evaluation.solver.mechanism.size
    scale = _scale(dimension, extent)

    def predict(p: Array) -> Values:
        within(p)
        made = designs.make({dimension.name: dimension.value + scale * float(p[0])})
        return misfit.predicted(remade(evaluation, as_before(made, evaluation.solver)))

    def derivative() -> Values:
        motion = evaluation.by_dimension(designs, dimension.name)
        return [scale * evaluation.change(motion, candidate.quantity) for candidate in misfit.candidates]

    kind = _kind(designs, dimension, misfit.evaluation.solver)

    def text(p: Array) -> str:
        change = scale * float(p[0])
        unit = "" if dimension.unit == "1" else f" {dimension.unit}"
        fraction = (
            f" ({100 * change / dimension.value:+.3g} %)" if abs(dimension.value) > 1e-3 * scale else ""
        )
        now = dimension.value + change
        was, now = f"{dimension.value:.6g}", f"{now if abs(now) > 1e-12 * scale else 0.0:.6g}"
        return f"{dimension.name} is {now}{unit} instead of {was}{unit}{fraction}"

    return Hypothesis(
        kind, dimension.name, tier, predict, text, starts=((0.0,),), steps=(STEP,), slope=derivative
    )


def within(p: Array) -> None:
    """Refuse a change that no slip of a dimension makes.

    Raises:
        AssemblyError: where it is more than `MAX_CHANGE` times what it changes.
    """
    if not abs(float(p[0])) <= MAX_CHANGE:
        raise AssemblyError(f"no dimension is taken to be off by more than {MAX_CHANGE:g} times itself")


def remade(evaluation: EvaluationPoints, solver: Form) -> EvaluationPoints:
    """Return evaluation points of a mechanism with other dimensions."""
    return _anew(evaluation, solver) if isinstance(solver, ClosedForm) else evaluation.with_dimensions(solver)


def _anew(evaluation: EvaluationPoints, solver: Form) -> EvaluationPoints:
    """Return evaluation points of a mechanism too different to be solved from the nominal motion."""
    return replace(evaluation, solver=solver, dynamic_model=evaluation.dynamic_model_of(solver), solved=None)


def as_before(made: Form, before: Form) -> Form:
    """Return what was made anew with the programs that it had."""
    if isinstance(made, LoopForm) and isinstance(before, LoopForm):
        return replace(made, motion_laws=before.motion_laws, change_point=before.change_point)
    return made


def _scale(dimension: Dimension, extent: float) -> float:
    whole = extent if dimension.unit == "m" else 1.0
    return abs(dimension.value) if abs(dimension.value) > 1e-3 * whole else whole


def _kind(designs: DesignFamily, dimension: Dimension, solver: Form) -> str:
    """Return whether a dimension is a gear's ratio, its phase, or one like others."""
    own = getattr(solver, "gear", "")
    if own:
        return {own: "gear", "phase": "phase"}.get(dimension.name, "dimension")
    if not solver.mechanism.laws or dimension.unit == "m":
        return "dimension"
    try:
        before, after = (
            designs.describe({dimension.name: dimension.value + change})
            for change in (0.0, 1e-3 * (abs(dimension.value) or 1.0))
        )
    except MechsimError:
        return "dimension"
    if before.joints != after.joints or before.points != after.points:
        return "dimension"
    derivatives = [(law.ratio, other.ratio) for law, other in zip(before.laws, after.laws, strict=True)]
    return "gear" if any(ratio_before != other for ratio_before, other in derivatives) else "phase"


def _of_point(misfit: Misfit, point: str, i: int) -> Hypothesis:
    """Return that a tracked point lies elsewhere on its link."""
    solver = misfit.evaluation.solver
    link, position = solver.mechanism.points[point]
    extent = solver.mechanism.size

    def moved(p: Array) -> Mechanism:
        other_position = list(position)
        other_position[i] += extent * float(p[0])
        return replace(
            solver.mechanism, points={**solver.mechanism.points, point: (link, tuple(other_position))}
        )

    def predict(p: Array) -> Values:
        within(p)
        own = solver if isinstance(solver, LoopForm) else LoopForm(solver.mechanism)
        return misfit.predicted(remade(misfit.evaluation, replace(own, mechanism=moved(p))))

    def derivative() -> Values:
        links = misfit.evaluation.motion.links
        if (
            link == GROUND
            or link not in links
            or any(candidate.quantity.function for candidate in misfit.candidates)
        ):
            raise KeyError(link)
        axis = links[link].rotation[:, :, i]
        spin, angular_acceleration = links[link].angular_velocity, links[link].angular_acceleration
        rate = np.cross(spin, axis)
        by = {
            "position": axis,
            "velocity": rate,
            "acceleration": np.cross(angular_acceleration, axis) + np.cross(spin, rate),
        }
        return [
            extent * candidate.quantity.select(by[candidate.quantity.kind])
            if candidate.quantity.subject == point and candidate.quantity.kind in by
            else np.zeros_like(values)
            for candidate, values in zip(misfit.candidates, misfit.exact, strict=True)
        ]

    name = f"{point}.at.{AXES[i]}"

    def text(p: Array) -> str:
        return f"point {point} lies {extent * p[0]:.6g} m farther along {AXES[i]} on link {link}"

    return Hypothesis(
        "dimension", name, PLACED, predict, text, starts=((0.0,),), steps=(STEP,), slope=derivative
    )


def _of_couplings(misfit: Misfit) -> list[Hypothesis]:
    """Return that the ratio or the phase of a coupling is another, where no parameter says so."""
    solver = misfit.evaluation.solver
    if not isinstance(solver, LoopForm):
        return []
    hypotheses: list[Hypothesis] = []
    for k, gear in enumerate(solver.mechanism.gears):
        for field, kind in (("ratio", "gear"), ("phase", "phase")):
            hypotheses.append(_coupled(misfit, gear.name, kind, _gear_changed(solver, k, field), gear.ratio))
    for k, law in enumerate(solver.mechanism.couplings):
        for i, kind in ((1, "gear"), (0, "phase")):
            if i < len(law.coefficients):
                change = _coupling_changed(solver, k, i)
                hypotheses.append(_coupled(misfit, law.name, kind, change, law.ratio))
    return hypotheses


def _gear_changed(solver: LoopForm, k: int, field: str) -> Callable[[float], LoopForm]:
    def changed(by: float) -> LoopForm:
        gears = list(solver.mechanism.gears)
        gears[k] = replace(gears[k], **{field: getattr(gears[k], field) + by})
        return replace(solver, mechanism=replace(solver.mechanism, gears=tuple(gears)))

    return changed


def _coupling_changed(solver: LoopForm, k: int, i: int) -> Callable[[float], LoopForm]:
    def changed(by: float) -> LoopForm:
        laws = list(solver.mechanism.couplings)
        terms = list(laws[k].coefficients)
        terms[i] += by
        laws[k] = replace(laws[k], coefficients=tuple(terms))
        return replace(solver, mechanism=replace(solver.mechanism, couplings=tuple(laws)))

    return changed


def _coupled(
    misfit: Misfit, name: str, kind: str, changed: Callable[[float], LoopForm], ratio: float
) -> Hypothesis:
    scale = (abs(ratio) or 1.0) if kind == "gear" else 1.0

    def predict(p: Array) -> Values:
        return misfit.predicted(remade(misfit.evaluation, changed(scale * float(p[0]))))

    def derivative() -> Values:
        ahead, behind = predict(np.array([1e-5])), predict(np.array([-1e-5]))
        return [(a - b) / 2e-5 for a, b in zip(ahead, behind, strict=True)]

    def text(p: Array) -> str:
        if kind == "gear":
            return f"the ratio of {name} is {ratio + scale * p[0]:.6g} instead of {ratio:.6g}"
        return f"the phase of {name} is {p[0]:.6g} farther on"

    return Hypothesis(kind, name, NAMED, predict, text, starts=((0.0,),), steps=(STEP,), slope=derivative)


# random starts from which loops are closed, and how far apart two assemblies are, in parts of the size
STARTS, ASSEMBLY_DISTANCE, SEED = 16, 1e-4, 20


def assemblies(misfit: Misfit) -> Iterator[Hypothesis]:
    """The other assemblies of the mechanism."""
    for what, solver in others(misfit):

        def predict(_: Array, solver: Form = solver) -> Values:
            other = replace(
                misfit.evaluation,
                solver=solver,
                dynamic_model=misfit.evaluation.dynamic_model_of(solver),
                solved=None,
            )
            return misfit.predicted(other)

        yield Hypothesis(
            "assembly", what, DISCRETE, predict, lambda _, w=what: f"it is in another assembly: {w}"
        )


def others(misfit: Misfit) -> list[tuple[str, Form]]:
    """Return the other assemblies, each with a description of the difference."""
    solver = misfit.evaluation.solver
    if isinstance(solver, ClosedForm):
        return list(_of_catalogue(solver, float(misfit.evaluation.angle[len(misfit.evaluation) // 3])))
    return _assemblies_from_random_starts(solver)


def _of_catalogue(solver: ClosedForm, angle: float) -> Iterator[tuple[str, Form]]:
    own = {name: getattr(solver, name) for name in SELECTORS if hasattr(solver, name)}
    for assembly in solver.assemblies(angle):
        chosen = {name: getattr(assembly, name) for name in own}
        if chosen != own:
            yield ", ".join(f"{k} = {v}" for k, v in chosen.items() if v != own[k]), assembly


def _assemblies_from_random_starts(solver: LoopForm) -> list[tuple[str, Form]]:
    """Return assemblies of a mechanism found from random starts."""
    mechanism = solver.mechanism
    try:
        loops, guess = tree_loops(mechanism, rough_poses(mechanism), starts(mechanism))
        own = closed(loops, guess)
    except MechsimError:
        return []
    tree, random = loops.tree, np.random.default_rng(SEED)
    positions_known, assemblies_found = [_positions(mechanism, tree, own)], list[tuple[str, Form]]()
    slides = np.asarray(tree.slides)
    for _ in range(STARTS):
        values = own.values.copy()
        change = random.uniform(-np.pi, np.pi, tree.count) * np.where(slides, 0.3 * mechanism.size, 1.0)
        values[loops.unknown, 0] += change[loops.unknown]
        try:
            q = closed(loops, Coordinates(values, own.turns.copy()))
        except (MechsimError, np.linalg.LinAlgError):
            continue
        positions = _positions(mechanism, tree, q)
        if (
            min(float(np.abs(positions - other_positions).max()) for other_positions in positions_known)
            < ASSEMBLY_DISTANCE * mechanism.size
        ):
            continue
        positions_known.append(positions)
        other = _with_guess(solver, tree, q)
        if other is not None:
            assemblies_found.append((_description(mechanism, tree, own, q), other))
    return assemblies_found


def _positions(mechanism: Mechanism, tree: SpanningTree, q: Coordinates) -> Array:
    """Return where all joints are, (joints, 3)."""
    own_position = link_poses(tree, q)
    found: list[Array] = []
    for joint in mechanism.joints:
        for end in (joint.a, joint.b):
            if end.link != GROUND:
                i = tree.links[end.link]
                found.append(
                    own_position.position[i, :, 0] + own_position.rotation[i, :, :, 0] @ np.asarray(end.point)
                )
    return np.array(found)


def _with_guess(solver: LoopForm, tree: SpanningTree, q: Coordinates) -> LoopForm | None:
    own_position = link_poses(tree, q)
    poses = {
        name: Pose(own_position.position[i, :, 0].copy(), own_position.rotation[i, :, :, 0].copy())
        for name, i in tree.links.items()
    }
    mechanism = solver.mechanism
    counted = {name: value for name, value in mechanism.counted.items() if name in mechanism.drivers}
    try:
        return replace(solver, mechanism=replace(mechanism, guess=poses, counted=counted))
    except MechsimError:
        return None


def _description(mechanism: Mechanism, tree: SpanningTree, own: Coordinates, q: Coordinates) -> str:
    """Describe the difference of two assemblies: the joint that differs most."""
    gap = q.values[:, 0] - own.values[:, 0]
    names = {place: name for name, place in tree.index_of.items()}
    turned = {
        name: float((gap[i] + np.pi) % (2 * np.pi) - np.pi) / np.pi
        if not tree.slides[i]
        else gap[i] / mechanism.size
        for i, name in names.items()
    }
    if not turned:
        return "other"
    name = max(turned, key=lambda one: abs(turned[one]))
    i = tree.index_of[name]
    unit = "m" if tree.slides[i] else "rad"
    return f"{name} = {q.values[i, 0]:.4g} {unit} instead of {own.values[i, 0]:.4g}"
