"""Mistakes in what is given: units, degrees, swapped names, mirror images, frames, senses and zeros."""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, permutations, product

import numpy as np

from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.model.quantities import AXES, Quantity
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.misfit import DISCRETE, NAMED, SIX, THREE, TWO, Hypothesis, Misfit, Values

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
EFFORT_UNITS = {1e3: "N mm for N m, or mN", 1e-3: "kN for N", 1.0 / 9.80665: "kgf for N"}
DEG = 180.0 / np.pi
VECTORS = ("position", "velocity", "acceleration")
LINEAR = ("m", "m/s", "m/s2")


def _indices_where(misfit: Misfit, condition: Callable[[Quantity], bool]) -> list[int]:
    return [i for i, candidate in enumerate(misfit.candidates) if condition(candidate.quantity)]


def _changed(misfit: Misfit, indices: Sequence[int], change: Callable[[Array, Quantity], Array]) -> Values:
    """Return the exact values with some of them changed."""
    predicted = list(misfit.exact)
    for i in indices:
        predicted[i] = change(predicted[i], misfit.candidates[i].quantity)
    return predicted


def _scaled(
    misfit: Misfit, kind: str, what: str, indices: Sequence[int], factor: float, text: str
) -> Hypothesis:
    return Hypothesis(
        kind,
        what,
        DISCRETE,
        lambda _: _changed(misfit, indices, lambda values, _: factor * values),
        lambda _: text,
        by=lambda _: factor,
    )


def _groups(misfit: Misfit, indices: Sequence[int]) -> Iterator[tuple[str, list[int]]]:
    """Yield all of some claims together, then each by itself where there are several."""
    if indices:
        yield "", list(indices)
    if len(indices) > 1:
        for i in indices:
            yield misfit.candidates[i].quantity.name, [i]


def units(misfit: Misfit) -> Iterator[Hypothesis]:
    """Lengths, rates and efforts in other units."""
    speed = float(np.abs(misfit.evaluation.speed).max())
    rates = {1.0 / speed: "of a driver at 1 rad/s", 30.0 / np.pi: "in rpm", 2.0 * np.pi: "per turn"}
    for called, units_of, factors in (
        ("lengths", LINEAR, LENGTHS),
        ("rates", ("m/s", "rad/s"), rates),
        ("efforts", ("N m", "N"), EFFORT_UNITS),
    ):
        for what, indices in _groups(
            misfit, _indices_where(misfit, lambda quantity, units_of=units_of: quantity.unit in units_of)
        ):
            whose = f"{called} of {what}" if what else called
            for factor, unit_text in factors.items():
                text = f"{whose} are {unit_text}: {factor:.6g} times as large"
                yield _scaled(misfit, "units", what, indices, factor, text)


def degrees(misfit: Misfit) -> Iterator[Hypothesis]:
    """Angles in degrees for radians, or the reverse."""
    for what, indices in _groups(
        misfit, _indices_where(misfit, lambda quantity: quantity.unit.startswith("rad"))
    ):
        suffix = f" of {what}" if what else ""
        yield _scaled(misfit, "degrees", what, indices, DEG, f"angles{suffix} are in degrees for radians")
        yield _scaled(
            misfit, "degrees", what, indices, 1 / DEG, f"angles{suffix} are turned from degrees twice"
        )


def swapped(misfit: Misfit) -> Iterator[Hypothesis]:
    """Two names of one kind swapped."""
    for i, j in combinations(range(len(misfit.candidates)), 2):
        first_quantity, other = misfit.candidates[i].quantity, misfit.candidates[j].quantity
        if (first_quantity.kind, first_quantity.axes, first_quantity.unit) != (
            other.kind,
            other.axes,
            other.unit,
        ):
            continue
        kinds = [k for k in VECTORS if first_quantity.kind in VECTORS] or [first_quantity.kind]
        pairs = [
            (a, b)
            for a, first in enumerate(misfit.candidates)
            for b, second in enumerate(misfit.candidates)
            if first.quantity.kind == second.quantity.kind in kinds
            and (first.quantity.subject, second.quantity.subject) == (first_quantity.subject, other.subject)
            and first.quantity.axes == second.quantity.axes
        ]
        if pairs[0] != (i, j):
            continue

        def predict(_: Array, pairs: list[tuple[int, int]] = pairs) -> Values:
            predicted = list(misfit.exact)
            for a, b in pairs:
                predicted[a], predicted[b] = predicted[b], predicted[a]
            return predicted

        what = f"{first_quantity.subject}, {other.subject}"
        yield Hypothesis("swapped", what, DISCRETE, predict, lambda _, what=what: f"{what} are swapped")


def _vectors(misfit: Misfit) -> tuple[list[int], str]:
    """Return the claims of points, and the axes that all of them have."""
    indices = _indices_where(misfit, lambda quantity: quantity.kind in VECTORS)
    axes = "".join(a for a in AXES if all(a in misfit.candidates[i].quantity.axes for i in indices))
    same = all(len(misfit.candidates[i].quantity.axes) == len(axes) for i in indices)
    return (indices, axes) if indices and same else ([], "")


def _rotated_vectors(
    misfit: Misfit, indices: Sequence[int], rotation: Array, shift: Array | None = None
) -> Values:
    def change(values: Array, quantity: Quantity) -> Array:
        moved = values @ rotation.T
        return moved if shift is None or quantity.kind != "position" else moved + shift

    return _changed(misfit, indices, change)


def mirrored(misfit: Misfit) -> Iterator[Hypothesis]:
    """Places mirrored in a plane of the axes or between two of them, or turned by quarters."""
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
            kind = "mirror" if np.linalg.det(rotation) < 0.0 else "frame"
            what = ", ".join(f"{'-' if signs[i] < 0 else ''}{axes[order[i]]}" for i in range(count))
            word = "mirrored" if kind == "mirror" else "turned by quarters"
            # the plainest are believed first
            tier = DISCRETE + 0.1 * (order != tuple(range(count))) + 0.1 * (sum(s < 0 for s in signs) > 1)
            yield Hypothesis(
                kind,
                what,
                tier,
                lambda _, rotation=rotation: _rotated_vectors(misfit, indices, rotation),
                lambda _, what=what, word=word: f"places are {word}: ({what}) stands for ({axes})",
            )


def frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """The frame of places shifted along an axis, or turned about one."""
    indices, axes = _vectors(misfit)
    count, extent = len(axes), misfit.evaluation.solver.mechanism.size
    any_position = any(misfit.candidates[i].quantity.kind == "position" for i in indices)
    for i, axis in enumerate(axes if any_position else ""):

        def along(p: Array, i: int = i) -> Values:
            return _rotated_vectors(misfit, indices, np.eye(count), p[0] * np.eye(count)[i])

        def text(p: Array, axis: str = axis) -> str:
            return f"the frame is shifted by {p[0]:.6g} m along {axis}"

        yield Hypothesis("frame", axis, NAMED, along, text, starts=((0.0,),), steps=(1e-3 * extent,))
    if count == 2:
        yield _planar_turn(misfit, indices, axes)
    if count == 3:
        yield from _turns_about_axes(misfit, indices)


def whole_frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """The frame of positions shifted or rotated in any direction."""
    indices, axes = _vectors(misfit)
    count, extent = len(axes), misfit.evaluation.solver.mechanism.size
    any_position = any(misfit.candidates[i].quantity.kind == "position" for i in indices)
    if any_position and count > 1:
        yield Hypothesis(
            "frame",
            "shift",
            THREE if count == 3 else TWO,
            lambda p: _rotated_vectors(misfit, indices, np.eye(count), p),
            lambda p: f"the frame is shifted by {_listed(p)} m",
            by=lambda p: float(np.linalg.norm(p)),
            starts=((0.0,) * count,),
            steps=(1e-3 * extent,) * count,
        )
    if count == 3:
        yield from _space_turns(misfit, indices, extent if any_position else 0.0)


def _listed(values: Array) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"


def _planar_turn(misfit: Misfit, indices: Sequence[int], axes: str) -> Hypothesis:
    def rotated(p: Array) -> Values:
        c, s = np.cos(p[0]), np.sin(p[0])
        return _rotated_vectors(misfit, indices, np.array([[c, -s], [s, c]]))

    starts = tuple((a,) for a in (0.0, 2.0, -2.0))
    plane = "".join(axes)
    return Hypothesis(
        "frame",
        f"turn in {plane}",
        NAMED,
        rotated,
        lambda p: f"the frame is turned by {p[0]:.6g} rad ({np.rad2deg(p[0]):.4g} deg) in {plane}",
        by=_wrapped,
        starts=starts,
        steps=(1e-4,),
    )


def _wrapped(p: Array) -> float:
    return float((p[0] + np.pi) % (2 * np.pi) - np.pi)


def _rotation_matrix(vector: Array) -> Array:
    return turned_by(np.eye(3)[None], vector[None])[0]


def _turns_about_axes(misfit: Misfit, indices: Sequence[int]) -> Iterator[Hypothesis]:
    for i, axis in enumerate(AXES):

        def about(p: Array, i: int = i) -> Values:
            return _rotated_vectors(misfit, indices, _rotation_matrix(p[0] * np.eye(3)[i]))

        def text(p: Array, axis: str = axis) -> str:
            return f"the frame is turned by {p[0]:.6g} rad ({np.rad2deg(p[0]):.4g} deg) about {axis}"

        starts = ((0.0,), (2.0,), (-2.0,))
        yield Hypothesis(
            "frame", f"turn about {axis}", NAMED, about, text, by=_wrapped, starts=starts, steps=(1e-4,)
        )


def _space_turns(misfit: Misfit, indices: Sequence[int], extent: float) -> Iterator[Hypothesis]:
    yield Hypothesis(
        "frame",
        "turn",
        THREE,
        lambda p: _rotated_vectors(misfit, indices, _rotation_matrix(p)),
        lambda p: f"the frame is turned by {_listed(p)} rad",
        by=lambda p: float(np.linalg.norm(p)),
        starts=((0.0,) * 3,),
        steps=(1e-4,) * 3,
    )
    if extent:
        yield Hypothesis(
            "frame",
            "shift and turn",
            SIX,
            lambda p: _rotated_vectors(misfit, indices, _rotation_matrix(p[:3]), p[3:]),
            lambda p: f"the frame is turned by {_listed(p[:3])} rad and shifted by {_listed(p[3:])} m",
            by=lambda p: float(np.linalg.norm(p[:3])),
            starts=((0.0,) * 6,),
            steps=(1e-4,) * 3 + (1e-3 * extent,) * 3,
        )


def senses(misfit: Misfit) -> Iterator[Hypothesis]:
    """Joints, rates and efforts counted the other way round."""
    counted = _indices_where(misfit, lambda quantity: quantity.kind != "position")
    by_subject: dict[tuple[str, bool], list[int]] = {}
    for i in counted:
        quantity = misfit.candidates[i].quantity
        if quantity.kind not in VECTORS:
            by_subject.setdefault(
                (quantity.subject, quantity.kind in ("torque", "force", "moment")), []
            ).append(i)
    for (subject, effort), indices in by_subject.items():
        what = f"{'effort in' if effort else 'joint'} {subject}"
        text = f"the {what} is counted in the reversed sense"
        yield _scaled(misfit, "sense", subject, indices, -1.0, text)


def zeros(misfit: Misfit) -> Iterator[Hypothesis]:
    """A joint's coordinate counted from another zero."""
    for i in _indices_where(misfit, lambda quantity: quantity.kind == "joint"):
        quantity = misfit.candidates[i].quantity

        def moved(p: Array, i: int = i) -> Values:
            return _changed(misfit, [i], lambda values, _: values + p[0])

        start = float(np.median(misfit.candidates[i].values - misfit.exact[i]))
        yield Hypothesis(
            "offset",
            quantity.subject,
            NAMED,
            moved,
            lambda p, quantity=quantity: (
                f"joint {quantity.subject} is counted from a zero {p[0]:.6g} {quantity.unit} away"
            ),
            starts=((start,),),
            steps=(1e-4,),
        )
