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
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.discrepancy import DISCRETE, NAMED, PLACED, Hypothesis, Miss, Values
from mechsim.studies.agreement.evaluation_points import Comparand
from mechsim.studies.agreement.fitting import linearly_explains
from mechsim.studies.quantities import AXES

# of all places of joints those that explain most in the first order are solved again
TRIED = 6
# a dimension that explains less in the first order explains nothing when solved again
LEAST = 0.25
# most by which a dimension is taken to be off, in parts of itself or of the size
MOST = 3.0
# step of differences, in parts of the size
STEP = 1e-5


def parameters(miss: Miss) -> Iterator[Hypothesis]:
    """One parameter, or the ratio or the phase of a coupling, different: the likeliest of them."""
    named = [_hypothesis(miss, miss.family, one, NAMED) for one in miss.family.dimensions.values()]
    among = [*named, *_of_couplings(miss)]
    # of efforts no exact derivatives are at hand
    efforts = any(claim.named.loaded for claim in miss.claims)
    yield from among if efforts else _likely(miss, among, TRIED + 2)


def gear_slips(miss: Miss) -> Iterator[Hypothesis]:
    """The ratio of a gear with the other sign, or the other way up."""
    form = miss.comparand.form
    geared: list[tuple[str, str, float, Callable[[float], Form]]] = []
    if isinstance(form, LoopForm):
        for k, gear in enumerate(form.mechanism.gears):
            changed = _gear_changed(form, k, "ratio")
            geared.append((gear.name, f"the ratio of {gear.name}", gear.ratio, changed))
    elif own := form.gear:
        ratio = miss.family.dimensions[own].value
        geared.append((own, own, ratio, lambda by: miss.family.make({own: ratio + by})))
    for name, said, ratio, changed in geared:
        for slip in {-ratio, 1.0 / ratio} - {ratio}:
            by, part = slip - ratio, (slip - ratio) / abs(ratio)
            words = f"{said} is {slip:.6g} instead of {ratio:.6g}"
            yield Hypothesis(
                "gear",
                name,
                DISCRETE,
                lambda _, by=by, changed=changed: miss.predicted(_anew(miss.comparand, changed(by))),
                lambda _, words=words: words,
                by=lambda _, part=part: part,
            )


def places(miss: Miss) -> Iterator[Hypothesis]:
    """One joint or one point in another place: the likeliest of them."""
    family = placed_of(miss)
    placed = [
        _hypothesis(miss, family, one, PLACED)
        for one in family.dimensions.values()
        if one.name not in miss.family.dimensions
    ]
    points = [_of_point(miss, point, i) for point in miss.comparand.form.mechanism.points for i in range(3)]
    yield from _likely(miss, [*placed, *points], TRIED)


def placed_of(miss: Miss) -> DesignFamily:
    """Return the mechanism among others whose joints are elsewhere."""
    return placed_family(miss.comparand.form)


def _likely(miss: Miss, among: list[Hypothesis], most: int) -> list[Hypothesis]:
    """Return the hypotheses that explain most in the first order."""
    found: list[tuple[float, Hypothesis]] = []
    for one in among:
        values = _first_order(one)
        if values is None:
            continue
        parts = [(value / bound).ravel() for value, bound in zip(values, miss.bounds, strict=True)]
        slope = np.concatenate(parts)
        if slope.any() and np.isfinite(slope).all():
            found.append((linearly_explains(miss, slope[:, None]), one))
    found.sort(key=lambda pair: -pair[0])
    return [one for explains, one in found[:most] if explains > LEAST]


def _first_order(hypothesis: Hypothesis) -> Values | None:
    """Return derivatives by the size of a hypothesis: exact, or of a parameter by differences; else None."""
    with suppress(MechsimError, KeyError):
        if hypothesis.slope is not None:
            return hypothesis.slope()
    if hypothesis.tier == NAMED:
        with suppress(MechsimError, ValueError):
            ahead, behind = (hypothesis.predict(np.array([sense * STEP])) for sense in (1.0, -1.0))
            return [(a - b) / (2.0 * STEP) for a, b in zip(ahead, behind, strict=True)]
    return None


def _hypothesis(miss: Miss, family: DesignFamily, dimension: Dimension, tier: float) -> Hypothesis:
    comparand, size = miss.comparand, miss.comparand.form.mechanism.size
    scale = _scale(dimension, size)

    def predict(p: Array) -> Values:
        within(p)
        made = family.make({dimension.name: dimension.value + scale * float(p[0])})
        return miss.predicted(remade(comparand, as_before(made, comparand.form)))

    def slope() -> Values:
        motion = comparand.by_dimension(family, dimension.name)
        return [scale * comparand.change(motion, claim.named) for claim in miss.claims]

    kind = _kind(family, dimension, miss.comparand.form)

    def say(p: Array) -> str:
        change = scale * float(p[0])
        unit = "" if dimension.unit == "1" else f" {dimension.unit}"
        part = f" ({100 * change / dimension.value:+.3g} %)" if abs(dimension.value) > 1e-3 * scale else ""
        now = dimension.value + change
        was, now = f"{dimension.value:.6g}", f"{now if abs(now) > 1e-12 * scale else 0.0:.6g}"
        return f"{dimension.name} is {now}{unit} instead of {was}{unit}{part}"

    return Hypothesis(kind, dimension.name, tier, predict, say, starts=((0.0,),), steps=(STEP,), slope=slope)


def within(p: Array) -> None:
    """Refuse a change that no slip of a dimension makes.

    Raises:
        AssemblyError: where it is more than `MOST` times what it changes.
    """
    if not abs(float(p[0])) <= MOST:
        raise AssemblyError(f"no dimension is taken to be off by more than {MOST:g} times itself")


def remade(comparand: Comparand, form: Form) -> Comparand:
    """Return a comparand with what has other dimensions."""
    return _anew(comparand, form) if isinstance(form, ClosedForm) else comparand.with_dimensions(form)


def _anew(comparand: Comparand, form: Form) -> Comparand:
    """Return a comparand with what stands so far from it that nothing is solved from its motion."""
    return replace(comparand, form=form, machine=comparand.machine_of(form), solved=None)


def as_before(made: Form, before: Form) -> Form:
    """Return what was made anew with the programs that it had."""
    if isinstance(made, LoopForm) and isinstance(before, LoopForm):
        return replace(made, motion_laws=before.motion_laws, change_point=before.change_point)
    return made


def _scale(dimension: Dimension, size: float) -> float:
    whole = size if dimension.unit == "m" else 1.0
    return abs(dimension.value) if abs(dimension.value) > 1e-3 * whole else whole


def _kind(family: DesignFamily, dimension: Dimension, form: Form) -> str:
    """Return whether a dimension is a gear's ratio, its phase, or one like others."""
    own = getattr(form, "gear", "")
    if own:
        return {own: "gear", "phase": "phase"}.get(dimension.name, "dimension")
    if not form.mechanism.laws or dimension.unit == "m":
        return "dimension"
    try:
        before, after = (
            family.describe({dimension.name: dimension.value + change})
            for change in (0.0, 1e-3 * (abs(dimension.value) or 1.0))
        )
    except MechsimError:
        return "dimension"
    if before.joints != after.joints or before.points != after.points:
        return "dimension"
    slopes = [(law.ratio, other.ratio) for law, other in zip(before.laws, after.laws, strict=True)]
    return "gear" if any(one != other for one, other in slopes) else "phase"


def _of_point(miss: Miss, point: str, i: int) -> Hypothesis:
    """Return that a tracked point lies elsewhere on its link."""
    form = miss.comparand.form
    link, place = form.mechanism.points[point]
    size = form.mechanism.size

    def moved(p: Array) -> Mechanism:
        there = list(place)
        there[i] += size * float(p[0])
        return replace(form.mechanism, points={**form.mechanism.points, point: (link, tuple(there))})

    def predict(p: Array) -> Values:
        within(p)
        own = form if isinstance(form, LoopForm) else LoopForm(form.mechanism)
        return miss.predicted(remade(miss.comparand, replace(own, mechanism=moved(p))))

    def slope() -> Values:
        links = miss.comparand.motion.links
        if link == GROUND or link not in links or any(claim.named.function for claim in miss.claims):
            raise KeyError(link)
        turn = links[link].rotation[:, :, i]
        spin, bend = links[link].angular_velocity, links[link].angular_acceleration
        rate = np.cross(spin, turn)
        by = {"position": turn, "velocity": rate, "acceleration": np.cross(bend, turn) + np.cross(spin, rate)}
        return [
            size * claim.named.select(by[claim.named.kind])
            if claim.named.subject == point and claim.named.kind in by
            else np.zeros_like(values)
            for claim, values in zip(miss.claims, miss.exact, strict=True)
        ]

    name = f"{point}.at.{AXES[i]}"

    def say(p: Array) -> str:
        return f"point {point} lies {size * p[0]:.6g} m farther along {AXES[i]} on link {link}"

    return Hypothesis("dimension", name, PLACED, predict, say, starts=((0.0,),), steps=(STEP,), slope=slope)


def _of_couplings(miss: Miss) -> list[Hypothesis]:
    """Return that the ratio or the phase of a coupling is another, where no parameter says so."""
    form = miss.comparand.form
    if not isinstance(form, LoopForm):
        return []
    found: list[Hypothesis] = []
    for k, gear in enumerate(form.mechanism.gears):
        for field, kind in (("ratio", "gear"), ("phase", "phase")):
            found.append(_coupled(miss, gear.name, kind, _gear_changed(form, k, field), gear.ratio))
    for k, law in enumerate(form.mechanism.couplings):
        for i, kind in ((1, "gear"), (0, "phase")):
            if i < len(law.coefficients):
                change = _coupling_changed(form, k, i)
                found.append(_coupled(miss, law.name, kind, change, law.ratio))
    return found


def _gear_changed(form: LoopForm, k: int, field: str) -> Callable[[float], LoopForm]:
    def changed(by: float) -> LoopForm:
        gears = list(form.mechanism.gears)
        gears[k] = replace(gears[k], **{field: getattr(gears[k], field) + by})
        return replace(form, mechanism=replace(form.mechanism, gears=tuple(gears)))

    return changed


def _coupling_changed(form: LoopForm, k: int, i: int) -> Callable[[float], LoopForm]:
    def changed(by: float) -> LoopForm:
        laws = list(form.mechanism.couplings)
        terms = list(laws[k].coefficients)
        terms[i] += by
        laws[k] = replace(laws[k], coefficients=tuple(terms))
        return replace(form, mechanism=replace(form.mechanism, couplings=tuple(laws)))

    return changed


def _coupled(
    miss: Miss, name: str, kind: str, changed: Callable[[float], LoopForm], ratio: float
) -> Hypothesis:
    scale = (abs(ratio) or 1.0) if kind == "gear" else 1.0

    def predict(p: Array) -> Values:
        return miss.predicted(remade(miss.comparand, changed(scale * float(p[0]))))

    def slope() -> Values:
        ahead, behind = predict(np.array([1e-5])), predict(np.array([-1e-5]))
        return [(a - b) / 2e-5 for a, b in zip(ahead, behind, strict=True)]

    def say(p: Array) -> str:
        if kind == "gear":
            return f"the ratio of {name} is {ratio + scale * p[0]:.6g} instead of {ratio:.6g}"
        return f"the phase of {name} is {p[0]:.6g} farther on"

    return Hypothesis(kind, name, NAMED, predict, say, starts=((0.0,),), steps=(STEP,), slope=slope)


# random starts from which loops are closed, and how far apart two assemblies are, in parts of the size
STARTS, APART, SEED = 16, 1e-4, 20


def assemblies(miss: Miss) -> Iterator[Hypothesis]:
    """The other assemblies of the mechanism."""
    for what, form in others(miss):

        def predict(_: Array, form: Form = form) -> Values:
            other = replace(miss.comparand, form=form, machine=miss.comparand.machine_of(form), solved=None)
            return miss.predicted(other)

        yield Hypothesis(
            "assembly", what, DISCRETE, predict, lambda _, w=what: f"it is in another assembly: {w}"
        )


def others(miss: Miss) -> list[tuple[str, Form]]:
    """Return the other assemblies, each with what tells it from the one meant."""
    form = miss.comparand.form
    if isinstance(form, ClosedForm):
        return list(_of_catalogue(form, float(miss.comparand.angle[len(miss.comparand) // 3])))
    return miss.comparand.other_assemblies(_found)


def _of_catalogue(form: ClosedForm, angle: float) -> Iterator[tuple[str, Form]]:
    own = {name: getattr(form, name) for name in SELECTORS if hasattr(form, name)}
    for one in form.assemblies(angle):
        chosen = {name: getattr(one, name) for name in own}
        if chosen != own:
            yield ", ".join(f"{k} = {v}" for k, v in chosen.items() if v != own[k]), one


def _found(form: LoopForm) -> list[tuple[str, Form]]:
    """Return assemblies of a mechanism found from random starts."""
    mechanism = form.mechanism
    try:
        loops, rough = tree_loops(mechanism, rough_poses(mechanism), starts(mechanism))
        own = closed(loops, rough)
    except MechsimError:
        return []
    tree, random = loops.tree, np.random.default_rng(SEED)
    known, found = [_places(mechanism, tree, own)], list[tuple[str, Form]]()
    slides = np.asarray(tree.slides)
    for _ in range(STARTS):
        values = own.values.copy()
        change = random.uniform(-np.pi, np.pi, tree.count) * np.where(slides, 0.3 * mechanism.size, 1.0)
        values[loops.unknown, 0] += change[loops.unknown]
        try:
            at = closed(loops, Coordinates(values, own.turns.copy()))
        except (MechsimError, np.linalg.LinAlgError):
            continue
        places = _places(mechanism, tree, at)
        if min(float(np.abs(places - one).max()) for one in known) < APART * mechanism.size:
            continue
        known.append(places)
        other = _with_guess(form, tree, at)
        if other is not None:
            found.append((_told(mechanism, tree, own, at), other))
    return found


def _places(mechanism: Mechanism, tree: SpanningTree, at: Coordinates) -> Array:
    """Return where all joints are, (joints, 3)."""
    here = link_poses(tree, at)
    found: list[Array] = []
    for joint in mechanism.joints:
        for end in (joint.a, joint.b):
            if end.link != GROUND:
                i = tree.links[end.link]
                found.append(here.position[i, :, 0] + here.rotation[i, :, :, 0] @ np.asarray(end.point))
    return np.array(found)


def _with_guess(form: LoopForm, tree: SpanningTree, at: Coordinates) -> LoopForm | None:
    here = link_poses(tree, at)
    poses = {
        name: Pose(here.position[i, :, 0].copy(), here.rotation[i, :, :, 0].copy())
        for name, i in tree.links.items()
    }
    mechanism = form.mechanism
    counted = {name: value for name, value in mechanism.counted.items() if name in mechanism.drivers}
    try:
        return replace(form, mechanism=replace(mechanism, guess=poses, counted=counted))
    except MechsimError:
        return None


def _told(mechanism: Mechanism, tree: SpanningTree, own: Coordinates, at: Coordinates) -> str:
    """Return in words what tells two assemblies apart: the joint that differs most."""
    gap = at.values[:, 0] - own.values[:, 0]
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
    return f"{name} = {at.values[i, 0]:.4g} {unit} instead of {own.values[i, 0]:.4g}"
