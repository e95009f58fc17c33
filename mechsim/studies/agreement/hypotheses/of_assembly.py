"""Another assembly: the same links put together otherwise."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mechsim.analytic.catalog.base import SELECTORS, ClosedForm
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.spanning_tree import SpanningTree
from mechsim.analytic.loops.tree_assembly import closed
from mechsim.analytic.loops.tree_loops import tree_loops
from mechsim.analytic.loops.tree_motion import Coordinates, link_poses
from mechsim.errors import MechsimError
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.rough_poses import rough_poses, starts
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.hypotheses.hypothesis import DISCRETE, Hypothesis
from mechsim.studies.agreement.miss import Miss, Values

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
