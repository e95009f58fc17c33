"""Hypotheses on candidate values: units, degrees, swaps, mirror images, frames, directions, zeros."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, permutations, product

import numpy as np

from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.model.quantity import AXES, Quantity
from mechsim.numerics.angles import REVOLUTION, wrapped
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.evaluation_points import (
    DISCRETE,
    SIX,
    THREE,
    TWO,
    Hypothesis,
    Values,
    discrete,
    sized,
)
from mechsim.studies.agreement.misfit import Misfit

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
DEG = 180.0 / np.pi
VECTORS = ("position", "velocity", "acceleration")
LINEAR = ("m", "m/s", "m/s2")
# initial angles in [rad] of the fit of a rotated frame, and its finite-difference step
ROTATIONS, ROTATION_STEP = (0.0, 2.0, -2.0), 1e-4
# finite-difference step of a shifted frame, relative to the mechanism's size
SHIFT_STEP = 1e-3


def _changed(misfit: Misfit, indices: Sequence[int], change: Callable[[Array, Quantity], Array]) -> Values:
    """Return the exact values with some of them changed."""
    predicted = list(misfit.exact)
    for i in indices:
        predicted[i] = change(predicted[i], misfit.quantities[i])
    return predicted


def _scaled(
    misfit: Misfit, kind: str, what: str, indices: Sequence[int], factor: float, text: str
) -> Hypothesis:
    def predict() -> Values:
        return _changed(misfit, indices, lambda values, _: factor * values)

    return discrete(kind, what, predict, text, factor)


def _groups(misfit: Misfit, indices: Sequence[int]) -> Iterator[tuple[str, list[int]]]:
    """Yield the indices of all candidates together, then of each subject if there are several."""
    if indices:
        yield "", list(indices)
    if len(indices) > 1:
        for i in indices:
            yield misfit.quantities[i].name, [i]


def units(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of lengths, rates and forces in other units."""
    speed = float(np.abs(misfit.evaluation.speed).max())
    rates = {1.0 / speed: "of a driver at 1 rad/s", 30.0 / np.pi: "in rpm", REVOLUTION: "per turn"}
    for called, units_of, factors in (
        ("lengths", LINEAR, LENGTHS),
        ("rates", ("m/s", "rad/s"), rates),
        ("forces", ("N m", "N"), FORCE_UNITS),
    ):
        indices = [i for i, quantity in enumerate(misfit.quantities) if quantity.unit in units_of]
        for what, group in _groups(misfit, indices):
            whose = f"{called} of {what}" if what else called
            for factor, unit_text in factors.items():
                text = f"{whose} are {unit_text}: {factor:.6g} times as large"
                yield _scaled(misfit, "units", what, group, factor, text)


def degrees(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of confused degrees and radians."""
    indices = [i for i, quantity in enumerate(misfit.quantities) if quantity.unit.startswith("rad")]
    for what, group in _groups(misfit, indices):
        suffix = f" of {what}" if what else ""
        for factor, text in ((DEG, "in degrees for radians"), (1 / DEG, "converted from degrees twice")):
            yield _scaled(misfit, "degrees", what, group, factor, f"angles{suffix} are {text}")


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
            what = f"{first.subject}, {second.subject}"
            yield discrete("swapped", what, partial(_exchanged, misfit, pairs), f"{what} are swapped")


def _exchanged(misfit: Misfit, pairs: Sequence[tuple[int, int]]) -> Values:
    predicted = list(misfit.exact)
    for a, b in pairs:
        predicted[a], predicted[b] = predicted[b], predicted[a]
    return predicted


def _vectors(misfit: Misfit) -> tuple[list[int], str]:
    """Return the indices of the candidates of points, and their common axes."""
    indices = [i for i, quantity in enumerate(misfit.quantities) if quantity.kind in VECTORS]
    own = [misfit.quantities[i].axes for i in indices]
    axes = "".join(axis for axis in AXES if all(axis in names for names in own))
    same = all(len(names) == len(axes) for names in own)
    return (indices, axes) if indices and same else ([], "")


def _moved_frame(
    misfit: Misfit, indices: Sequence[int], rotation: Array, shift: Array | None = None
) -> Values:
    """Return the exact values in a frame rotated by a matrix, (k, k), and shifted, (k,) in [m]."""

    def change(values: Array, quantity: Quantity) -> Array:
        moved = values @ rotation.T
        return moved if shift is None or quantity.kind != "position" else moved + shift

    return _changed(misfit, indices, change)


def mirrored(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of positions mirrored in a plane of one or two axes, or rotated by quarter turns."""
    indices, axes = _vectors(misfit)
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
            tier = DISCRETE + 0.1 * (order != tuple(range(count))) + 0.1 * (sum(s < 0 for s in signs) > 1)
            predict = partial(_moved_frame, misfit, indices, rotation)
            yield discrete(kind, what, predict, f"positions are {word}: ({what}) for ({axes})", tier=tier)


def frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a frame shifted along an axis, or rotated about one."""
    indices, axes = _vectors(misfit)
    if _any_position(misfit, indices):
        for i in range(len(axes)):
            yield _shift_along(misfit, indices, axes, i)
    if len(axes) == 2:
        yield _rotated_about(misfit, indices, f"in {axes}", _planar_rotation)
    if len(axes) == 3:
        for i, axis in enumerate(AXES):
            yield _rotated_about(misfit, indices, f"about {axis}", partial(_rotation_about, i))


def _any_position(misfit: Misfit, indices: Sequence[int]) -> bool:
    return any(misfit.quantities[i].kind == "position" for i in indices)


def _shift_along(misfit: Misfit, indices: Sequence[int], axes: str, i: int) -> Hypothesis:
    still, direction = np.eye(len(axes)), np.eye(len(axes))[i]
    return sized(
        "frame",
        axes[i],
        lambda shift: _moved_frame(misfit, indices, still, shift * direction),
        lambda shift: f"the frame is shifted by {shift:.6g} m along {axes[i]}",
        SHIFT_STEP * misfit.length,
    )


def _rotated_about(
    misfit: Misfit, indices: Sequence[int], where: str, rotation: Callable[[float], Array]
) -> Hypothesis:
    return sized(
        "frame",
        f"turn {where}",
        lambda angle: _moved_frame(misfit, indices, rotation(angle)),
        lambda angle: f"the frame is rotated by {angle:.6g} rad ({np.rad2deg(angle):.4g} deg) {where}",
        ROTATION_STEP,
        starts=ROTATIONS,
        by=lambda angle: float(wrapped(np.array(angle))),
    )


def _planar_rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _rotation_about(i: int, angle: float) -> Array:
    return _rotation_matrix(angle * np.eye(3)[i])


def _rotation_matrix(vector: Array) -> Array:
    return turned_by(np.eye(3)[None], vector[None])[0]


def whole_frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a frame shifted or rotated in any direction."""
    indices, axes = _vectors(misfit)
    count, shift_step = len(axes), SHIFT_STEP * misfit.length
    any_position = _any_position(misfit, indices)
    if any_position and count > 1:
        yield _whole(
            "shift",
            THREE if count == 3 else TWO,
            lambda p: _moved_frame(misfit, indices, np.eye(count), p),
            lambda p: f"the frame is shifted by {_listed(p)} m",
            (shift_step,) * count,
        )
    if count < 3:
        return
    yield _whole(
        "turn",
        THREE,
        lambda p: _moved_frame(misfit, indices, _rotation_matrix(p)),
        lambda p: f"the frame is rotated by {_listed(p)} rad",
        (ROTATION_STEP,) * 3,
    )
    if any_position:
        yield _whole(
            "shift and turn",
            SIX,
            lambda p: _moved_frame(misfit, indices, _rotation_matrix(p[:3]), p[3:]),
            lambda p: f"the frame is rotated by {_listed(p[:3])} rad and shifted by {_listed(p[3:])} m",
            (ROTATION_STEP,) * 3 + (shift_step,) * 3,
        )


def _whole(
    what: str,
    tier: float,
    predict: Callable[[Array], Values],
    text: Callable[[Array], str],
    steps: tuple[float, ...],
) -> Hypothesis:
    """Return the hypothesis of a frame moved by several sizes; the first three give the reported size."""
    return Hypothesis(
        "frame",
        what,
        tier,
        predict,
        text,
        by=lambda p: float(np.linalg.norm(p[:3])),
        starts=((0.0,) * len(steps),),
        steps=steps,
    )


def _listed(values: Array) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"


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
        if quantity.kind == "joint":
            yield _other_zero(misfit, i, quantity)


def _other_zero(misfit: Misfit, i: int, quantity: Quantity) -> Hypothesis:
    return sized(
        "offset",
        quantity.subject,
        lambda offset: _changed(misfit, [i], lambda values, _: values + offset),
        lambda offset: f"joint {quantity.subject} has its zero {offset:.6g} {quantity.unit} away",
        ROTATION_STEP,
        starts=(float(np.median(misfit.candidates[i].values - misfit.exact[i])),),
    )
