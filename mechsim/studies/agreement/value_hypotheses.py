"""Mistakes in what is given: units, degrees, swapped names, mirror images, frames, senses and zeros."""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, permutations, product

import numpy as np

from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.misfit import DISCRETE, NAMED, SIX, THREE, TWO, Hypothesis, Misfit, Values
from mechsim.studies.quantities import AXES, Quantity

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


def _of(misfit: Misfit, wanted: Callable[[Quantity], bool]) -> list[int]:
    return [i for i, candidate in enumerate(misfit.candidates) if wanted(candidate.quantity)]


def _changed(misfit: Misfit, places: Sequence[int], change: Callable[[Array, Quantity], Array]) -> Values:
    """Return the exact values with some of them changed."""
    found = list(misfit.exact)
    for i in places:
        found[i] = change(found[i], misfit.candidates[i].quantity)
    return found


def _scaled(
    misfit: Misfit, kind: str, what: str, places: Sequence[int], factor: float, say: str
) -> Hypothesis:
    return Hypothesis(
        kind,
        what,
        DISCRETE,
        lambda _: _changed(misfit, places, lambda values, _: factor * values),
        lambda _: say,
        by=lambda _: factor,
    )


def _groups(misfit: Misfit, places: Sequence[int]) -> Iterator[tuple[str, list[int]]]:
    """Yield all of some claims together, then each by itself where there are several."""
    if places:
        yield "", list(places)
    if len(places) > 1:
        for i in places:
            yield misfit.candidates[i].quantity.name, [i]


def units(misfit: Misfit) -> Iterator[Hypothesis]:
    """Lengths, rates and efforts in other units."""
    speed = float(np.abs(misfit.evaluation.speed).max())
    rates = {1.0 / speed: "of a driver at 1 rad/s", 30.0 / np.pi: "in rpm", 2.0 * np.pi: "per turn"}
    for called, of, factors in (
        ("lengths", LINEAR, LENGTHS),
        ("rates", ("m/s", "rad/s"), rates),
        ("efforts", ("N m", "N"), EFFORT_UNITS),
    ):
        for what, places in _groups(misfit, _of(misfit, lambda quantity, of=of: quantity.unit in of)):
            whose = f"{called} of {what}" if what else called
            for factor, said in factors.items():
                say = f"{whose} are {said}: {factor:.6g} times as large"
                yield _scaled(misfit, "units", what, places, factor, say)


def degrees(misfit: Misfit) -> Iterator[Hypothesis]:
    """Angles in degrees for radians, or the reverse."""
    for what, places in _groups(misfit, _of(misfit, lambda quantity: quantity.unit.startswith("rad"))):
        of = f" of {what}" if what else ""
        yield _scaled(misfit, "degrees", what, places, DEG, f"angles{of} are in degrees for radians")
        yield _scaled(misfit, "degrees", what, places, 1 / DEG, f"angles{of} are turned from degrees twice")


def swapped(misfit: Misfit) -> Iterator[Hypothesis]:
    """Two names of one kind swapped."""
    for i, j in combinations(range(len(misfit.candidates)), 2):
        one, other = misfit.candidates[i].quantity, misfit.candidates[j].quantity
        if (one.kind, one.axes, one.unit) != (other.kind, other.axes, other.unit):
            continue
        kinds = [k for k in VECTORS if one.kind in VECTORS] or [one.kind]
        pairs = [
            (a, b)
            for a, first in enumerate(misfit.candidates)
            for b, second in enumerate(misfit.candidates)
            if first.quantity.kind == second.quantity.kind in kinds
            and (first.quantity.subject, second.quantity.subject) == (one.subject, other.subject)
            and first.quantity.axes == second.quantity.axes
        ]
        if pairs[0] != (i, j):
            continue

        def predict(_: Array, pairs: list[tuple[int, int]] = pairs) -> Values:
            found = list(misfit.exact)
            for a, b in pairs:
                found[a], found[b] = found[b], found[a]
            return found

        what = f"{one.subject}, {other.subject}"
        yield Hypothesis("swapped", what, DISCRETE, predict, lambda _, what=what: f"{what} are swapped")


def _vectors(misfit: Misfit) -> tuple[list[int], str]:
    """Return the claims of points, and the axes that all of them have."""
    places = _of(misfit, lambda quantity: quantity.kind in VECTORS)
    axes = "".join(a for a in AXES if all(a in misfit.candidates[i].quantity.axes for i in places))
    same = all(len(misfit.candidates[i].quantity.axes) == len(axes) for i in places)
    return (places, axes) if places and same else ([], "")


def _turned(misfit: Misfit, places: Sequence[int], turn: Array, shift: Array | None = None) -> Values:
    def change(values: Array, quantity: Quantity) -> Array:
        moved = values @ turn.T
        return moved if shift is None or quantity.kind != "position" else moved + shift

    return _changed(misfit, places, change)


def mirrored(misfit: Misfit) -> Iterator[Hypothesis]:
    """Places mirrored in a plane of the axes or between two of them, or turned by quarters."""
    places, axes = _vectors(misfit)
    count = len(axes)
    if count < 2:
        return
    for order in permutations(range(count)):
        for signs in product((1.0, -1.0), repeat=count):
            turn = np.zeros((count, count))
            turn[np.arange(count), order] = signs
            if np.array_equal(turn, np.eye(count)):
                continue
            kind = "mirror" if np.linalg.det(turn) < 0.0 else "frame"
            what = ", ".join(f"{'-' if signs[i] < 0 else ''}{axes[order[i]]}" for i in range(count))
            word = "mirrored" if kind == "mirror" else "turned by quarters"
            # the plainest are believed first
            tier = DISCRETE + 0.1 * (order != tuple(range(count))) + 0.1 * (sum(s < 0 for s in signs) > 1)
            yield Hypothesis(
                kind,
                what,
                tier,
                lambda _, turn=turn: _turned(misfit, places, turn),
                lambda _, what=what, word=word: f"places are {word}: ({what}) stands for ({axes})",
            )


def frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """The frame of places shifted along an axis, or turned about one."""
    places, axes = _vectors(misfit)
    count, size = len(axes), misfit.evaluation.solver.mechanism.size
    some = any(misfit.candidates[i].quantity.kind == "position" for i in places)
    for i, axis in enumerate(axes if some else ""):

        def along(p: Array, i: int = i) -> Values:
            return _turned(misfit, places, np.eye(count), p[0] * np.eye(count)[i])

        def say(p: Array, axis: str = axis) -> str:
            return f"the frame is shifted by {p[0]:.6g} m along {axis}"

        yield Hypothesis("frame", axis, NAMED, along, say, starts=((0.0,),), steps=(1e-3 * size,))
    if count == 2:
        yield _planar_turn(misfit, places, axes)
    if count == 3:
        yield from _turns_about_axes(misfit, places)


def whole_frame(misfit: Misfit) -> Iterator[Hypothesis]:
    """The frame of places shifted or turned anyhow."""
    places, axes = _vectors(misfit)
    count, size = len(axes), misfit.evaluation.solver.mechanism.size
    some = any(misfit.candidates[i].quantity.kind == "position" for i in places)
    if some and count > 1:
        yield Hypothesis(
            "frame",
            "shift",
            THREE if count == 3 else TWO,
            lambda p: _turned(misfit, places, np.eye(count), p),
            lambda p: f"the frame is shifted by {_listed(p)} m",
            by=lambda p: float(np.linalg.norm(p)),
            starts=((0.0,) * count,),
            steps=(1e-3 * size,) * count,
        )
    if count == 3:
        yield from _space_turns(misfit, places, size if some else 0.0)


def _listed(values: Array) -> str:
    return f"({', '.join(f'{one:.6g}' for one in values)})"


def _planar_turn(misfit: Misfit, places: Sequence[int], axes: str) -> Hypothesis:
    def turned(p: Array) -> Values:
        c, s = np.cos(p[0]), np.sin(p[0])
        return _turned(misfit, places, np.array([[c, -s], [s, c]]))

    starts = tuple((a,) for a in (0.0, 2.0, -2.0))
    said = "".join(axes)
    return Hypothesis(
        "frame",
        f"turn in {said}",
        NAMED,
        turned,
        lambda p: f"the frame is turned by {p[0]:.6g} rad ({np.rad2deg(p[0]):.4g} deg) in {said}",
        by=_wrapped,
        starts=starts,
        steps=(1e-4,),
    )


def _wrapped(p: Array) -> float:
    return float((p[0] + np.pi) % (2 * np.pi) - np.pi)


def _turn(vector: Array) -> Array:
    return turned_by(np.eye(3)[None], vector[None])[0]


def _turns_about_axes(misfit: Misfit, places: Sequence[int]) -> Iterator[Hypothesis]:
    for i, axis in enumerate(AXES):

        def about(p: Array, i: int = i) -> Values:
            return _turned(misfit, places, _turn(p[0] * np.eye(3)[i]))

        def say(p: Array, axis: str = axis) -> str:
            return f"the frame is turned by {p[0]:.6g} rad ({np.rad2deg(p[0]):.4g} deg) about {axis}"

        starts = ((0.0,), (2.0,), (-2.0,))
        yield Hypothesis(
            "frame", f"turn about {axis}", NAMED, about, say, by=_wrapped, starts=starts, steps=(1e-4,)
        )


def _space_turns(misfit: Misfit, places: Sequence[int], size: float) -> Iterator[Hypothesis]:
    yield Hypothesis(
        "frame",
        "turn",
        THREE,
        lambda p: _turned(misfit, places, _turn(p)),
        lambda p: f"the frame is turned by {_listed(p)} rad",
        by=lambda p: float(np.linalg.norm(p)),
        starts=((0.0,) * 3,),
        steps=(1e-4,) * 3,
    )
    if size:
        yield Hypothesis(
            "frame",
            "shift and turn",
            SIX,
            lambda p: _turned(misfit, places, _turn(p[:3]), p[3:]),
            lambda p: f"the frame is turned by {_listed(p[:3])} rad and shifted by {_listed(p[3:])} m",
            by=lambda p: float(np.linalg.norm(p[:3])),
            starts=((0.0,) * 6,),
            steps=(1e-4,) * 3 + (1e-3 * size,) * 3,
        )


def senses(misfit: Misfit) -> Iterator[Hypothesis]:
    """Joints, rates and efforts counted the other way round."""
    counted = _of(misfit, lambda quantity: quantity.kind != "position")
    by_subject: dict[tuple[str, bool], list[int]] = {}
    for i in counted:
        quantity = misfit.candidates[i].quantity
        if quantity.kind not in VECTORS:
            by_subject.setdefault(
                (quantity.subject, quantity.kind in ("torque", "force", "moment")), []
            ).append(i)
    for (subject, effort), places in by_subject.items():
        what = f"{'effort in' if effort else 'joint'} {subject}"
        say = f"the {what} is counted in the reversed sense"
        yield _scaled(misfit, "sense", subject, places, -1.0, say)


def zeros(misfit: Misfit) -> Iterator[Hypothesis]:
    """A joint's coordinate counted from another zero."""
    for i in _of(misfit, lambda quantity: quantity.kind == "joint"):
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
