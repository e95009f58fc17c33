"""Hypotheses on candidate values: units, swaps, mirror images, frames, directions, zeros."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, permutations, product

import numpy as np

from mechsim.kinematics.vector_method.rotations import turned_by
from mechsim.mechanism.quantity import AXES, Quantity
from mechsim.numerics.arrays import REVOLUTION, Array, wrapped
from mechsim.studies.agreement.evaluation_points import Values
from mechsim.studies.agreement.misfit import Hypothesis, Misfit

LENGTHS = {
    1e3: "mm for m",
    1e-3: "m for mm",
    1e2: "cm for m",
    1e-2: "m for cm",
    10.0: "mm for cm",
    0.1: "cm for mm",
    1.0 / 0.0254: "inches for m",
    0.0254: "m for inches",
}
FORCE_UNITS = {1e3: "N mm for N m, or mN", 1e-3: "kN for N", 1.0 / 9.80665: "kgf for N"}
DEGREES = {180.0 / np.pi: "in degrees for radians", np.pi / 180.0: "converted from degrees twice"}
VECTORS = ("position", "velocity", "acceleration")
LINEAR, ANGULAR = ("m", "m/s", "m/s2"), ("rad", "rad/s", "rad/s2")
# initial angles in [rad] of the fit of a rotated frame, and its finite-difference step
ROTATIONS, ROTATION_STEP = (0.0, 2.0, -2.0), 1e-4
# finite-difference step of a shifted frame, relative to the mechanism's size
SHIFT_STEP = 1e-3
# no rotation, or no shift
NONE = np.zeros((0, 3))


def _changed(misfit: Misfit, indices: Sequence[int], change: Callable[[Array, Quantity], Array]) -> Values:
    """Return the exact values with some of them changed."""
    predicted = list(misfit.exact)
    for i in indices:
        predicted[i] = change(predicted[i], misfit.quantities[i])
    return predicted


def _scaled(
    misfit: Misfit, kind: str, what: str, indices: Sequence[int], factor: float, text: str
) -> Hypothesis:
    predict = partial(_changed, misfit, indices, lambda values, _: factor * values)
    return Hypothesis(kind, what, predict, text, factor)


def _groups(misfit: Misfit, indices: Sequence[int]) -> Iterator[tuple[str, list[int]]]:
    """Yield the indices of all candidates together, then of each subject if there are several."""
    if indices:
        yield "", list(indices)
    if len(indices) > 1:
        for i in indices:
            yield misfit.quantities[i].name, [i]


def units(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of lengths, rates and forces in other units, and of confused degrees and radians."""
    speed = float(np.abs(misfit.evaluation.speed).max())
    rates = {1.0 / speed: "of a driver at 1 rad/s", 30.0 / np.pi: "in rpm", REVOLUTION: "per turn"}
    for kind, called, units_of, factors in (
        ("units", "lengths", LINEAR, LENGTHS),
        ("units", "rates", ("m/s", "rad/s"), rates),
        ("units", "forces", ("N m", "N"), FORCE_UNITS),
        ("degrees", "angles", ANGULAR, DEGREES),
    ):
        indices = [i for i, quantity in enumerate(misfit.quantities) if quantity.unit in units_of]
        for what, group in _groups(misfit, indices):
            whose = f"{called} of {what}" if what else called
            for factor, unit_text in factors.items():
                times = f": {factor:.6g} times as large" if kind == "units" else ""
                yield _scaled(misfit, kind, what, group, factor, f"{whose} are {unit_text}{times}")


def swapped(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of two swapped names of one kind."""
    quantities = misfit.quantities
    for i, j in combinations(range(len(quantities)), 2):
        first, second = quantities[i], quantities[j]
        if (first.kind, first.axes, first.unit) != (second.kind, second.axes, second.unit):
            continue
        kinds = VECTORS if first.kind in VECTORS else (first.kind,)
        pairs = [
            (a, b)
            for a, named in enumerate(quantities)
            for b, other in enumerate(quantities)
            if named.kind == other.kind in kinds
            and (named.subject, other.subject) == (first.subject, second.subject)
            and named.axes == other.axes
        ]
        if pairs[0] == (i, j):
            what, predicted = f"{first.subject}, {second.subject}", list(misfit.exact)
            for a, b in pairs:
                predicted[a], predicted[b] = predicted[b], predicted[a]
            yield Hypothesis("swapped", what, lambda exchanged=predicted: exchanged, f"{what} are swapped")


def _vectors(misfit: Misfit) -> tuple[list[int], str]:
    """Return the indices of the candidates of points, and their common axes."""
    indices = [i for i, quantity in enumerate(misfit.quantities) if quantity.kind in VECTORS]
    own = [misfit.quantities[i].axes for i in indices]
    axes = "".join(axis for axis in AXES if all(axis in names for names in own))
    same = all(len(names) == len(axes) for names in own)
    return (indices, axes) if indices and same else ([], "")


def _in_frame(misfit: Misfit, rotation: Array, shift: Array | None = None) -> Values:
    """Return the exact values in a frame rotated by a matrix, (k, k), and shifted, (k,) in [m]."""

    def change(values: Array, quantity: Quantity) -> Array:
        moved = values @ rotation.T
        return moved if shift is None or quantity.kind != "position" else moved + shift

    return _changed(misfit, _vectors(misfit)[0], change)


def mirrored(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of positions mirrored in a plane of one or two axes, or rotated by quarter turns."""
    axes = _vectors(misfit)[1]
    count = len(axes)
    if count < 2:
        return
    for order in permutations(range(count)):
        for signs in product((1.0, -1.0), repeat=count):
            rotation = np.zeros((count, count))
            rotation[np.arange(count), order] = signs
            if np.array_equal(rotation, np.eye(count)):
                continue
            kind, word = "frame", "rotated by quarter turns"
            if np.linalg.det(rotation) < 0.0:
                kind, word = "mirror", "mirrored"
            what = ", ".join(f"{'-' if signs[i] < 0 else ''}{axes[order[i]]}" for i in range(count))
            # the simplest are reported first
            rank = 0.1 * (order != tuple(range(count))) + 0.1 * (sum(s < 0 for s in signs) > 1)
            predict = partial(_in_frame, misfit, rotation)
            yield Hypothesis(kind, what, predict, f"positions are {word}: ({what}) for ({axes})", rank=rank)


def frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a frame shifted along an axis, or rotated about one."""
    indices, axes = _vectors(misfit)
    along = _directions(axes)
    if any(misfit.quantities[i].kind == "position" for i in indices):
        for axis, direction in zip(axes, along, strict=True):
            text = f"shifted by {{0:.6g}} m along {axis}"
            yield _moved_frame(misfit, axis, NONE, direction[None], text)
    normals = {f"about {axis}": normal for axis, normal in zip(axes, along, strict=True)}
    if len(axes) < 3:
        normals = {f"in {axes}": np.cross(*along)} if len(axes) == 2 else {}
    for where, normal in normals.items():
        text = f"rotated by {{0:.6g}} rad ({{degrees:.4g}} deg) {where}"
        yield _moved_frame(misfit, f"turn {where}", normal[None], NONE, text)


def whole_frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a frame shifted or rotated in any direction."""
    indices, axes = _vectors(misfit)
    along, count = _directions(axes), len(axes)
    placed = any(misfit.quantities[i].kind == "position" for i in indices)
    if placed and count > 1:
        numbers = ", ".join(f"{{{i}:.6g}}" for i in range(count))
        yield _moved_frame(misfit, "shift", NONE, along, f"shifted by ({numbers}) m")
    if count == 3:
        rotated = "rotated by ({0:.6g}, {1:.6g}, {2:.6g}) rad"
        yield _moved_frame(misfit, "turn", along, NONE, rotated)
        if placed:
            text = f"{rotated} and shifted by ({{3:.6g}}, {{4:.6g}}, {{5:.6g}}) m"
            yield _moved_frame(misfit, "shift and turn", along, along, text)


def _directions(axes: str) -> Array:
    """Return the unit vectors of axes, (k, 3)."""
    return np.eye(3)[[AXES.index(axis) for axis in axes]]


def _moved_frame(misfit: Misfit, what: str, turns: Array, shifts: Array, text: str) -> Hypothesis:
    """Return the hypothesis of a frame that is rotated, then shifted.

    Args:
        misfit: the difference.
        what: name of the hypothesis.
        turns: rotation vectors, one for each of the first sizes in [rad], (a, 3).
        shifts: directions, one for each of the other sizes in [m], (b, 3).
        text: template of the message with the sizes, and with the first one in degrees.
    """
    own = [AXES.index(axis) for axis in _vectors(misfit)[1]]
    split, count = len(turns), len(turns) + len(shifts)

    def predict(*p: float) -> Values:
        rotation = turned_by(np.eye(3)[None], (np.array(p[:split]) @ turns)[None])[0]
        return _in_frame(misfit, rotation[np.ix_(own, own)], (np.array(p[split:]) @ shifts)[own])

    def largest(*p: float) -> float:
        if count > 1:
            return float(np.linalg.norm(p[:3]))
        return float(wrapped(np.array(p[0]))) if split else p[0]

    return Hypothesis(
        "frame",
        what,
        predict,
        lambda *p: "the frame is " + text.format(*p, degrees=np.rad2deg(p[0])),
        largest,
        steps=(ROTATION_STEP,) * split + (SHIFT_STEP * misfit.length,) * len(shifts),
        starts=ROTATIONS if (split, count) == (1, 1) else (0.0,),
    )


def directions(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of joints, rates and forces with the opposite direction."""
    by_subject: dict[tuple[str, bool], list[int]] = {}
    for i, quantity in enumerate(misfit.quantities):
        if quantity.kind not in VECTORS:
            key = quantity.subject, quantity.kind in ("torque", "force", "moment")
            by_subject.setdefault(key, []).append(i)
    for (subject, force), indices in by_subject.items():
        what = f"{'force in' if force else 'joint'} {subject}"
        text = f"the {what} has the opposite direction"
        yield _scaled(misfit, "sense", subject, indices, -1.0, text)


def zeros(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a joint coordinate with another zero."""
    for i, quantity in enumerate(misfit.quantities):
        if quantity.kind != "joint":
            continue
        yield Hypothesis(
            "offset",
            quantity.subject,
            lambda offset, i=i: _changed(misfit, [i], lambda values, _: values + offset),
            lambda offset, own=quantity: f"joint {own.subject} has its zero {offset:.6g} {own.unit} away",
            steps=(ROTATION_STEP,),
            starts=(float(np.median(misfit.candidates[i].values - misfit.exact[i])),),
        )
