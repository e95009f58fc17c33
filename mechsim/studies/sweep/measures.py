"""Measures of a design: one number from a turn, read from text as `range:rocker` or `max:P3.vx`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mechsim import units
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion, taken
from mechsim.model.programs import Programs
from mechsim.studies.sweep.turns import TurnQuantity, Turns, joint_units, quantity
from mechsim.subjects.python_object import run_object, run_user_code
from mechsim.subjects.toml_source import suggestion

# word -> what it makes of a quantity over the turn, (designs, poses) -> (designs,)
OVER: dict[str, Callable[[Array], Array]] = {
    "max": lambda of: of.max(1),
    "min": lambda of: of.min(1),
    "rms": lambda of: np.sqrt((of**2).mean(1)),
    "mean": lambda of: of.mean(1),
    # about the mean
    "ripple": lambda of: np.sqrt(((of - of.mean(1, keepdims=True)) ** 2).mean(1)),
}
# word -> unit of what is known of a design without a turn
FACTS = {"crank_range": "rad", "dead_centres": "1", "assemblies": "1"}
WORDS = ("range:J", "stroke:P", *(f"{word}:Q" for word in OVER), "at:ANGLE:Q", *FACTS, "FILE.py:FUNC")


@dataclass(frozen=True, slots=True)
class TurnMeasure:
    """One number of a design.

    Attributes:
        name: as it was asked for.
        kind: "range", "stroke", "at", "function", or one of `OVER` or `FACTS`.
        unit: in SI.
        of: the quantity; None for strokes, facts and functions.
        subject: the point of a stroke, or FILE.py:FUNC.
        angle: path parameter at which it is taken, in [rad]: of the crank, or `pace` of motion laws times the
            time; None over the turn.
    """

    name: str
    kind: str
    unit: str
    of: TurnQuantity | None = None
    subject: str = ""
    angle: float | None = None

    @property
    def turns(self) -> bool:
        """Whether it is of a motion; else of the design alone."""
        return self.kind not in FACTS

    @property
    def rated(self) -> bool:
        """Whether velocities or accelerations are needed."""
        return self.kind == "function" or (self.of is not None and self.of.rated)

    @property
    def loaded(self) -> bool:
        """Whether forces are needed."""
        return self.of is not None and self.of.kind == "effort"

    @property
    def jointed(self) -> bool:
        """Whether motions of joints are needed."""
        return self.kind == "function" or (self.of is not None and self.of.kind == "joint")

    def value(self, turns: Turns, place: int | None = None) -> Array:
        """Return the measure of designs, (designs,).

        Args:
            turns: their motions over the turn and, where `place` says, beyond.
            place: of the poses, the one at the measure's angle; None for measures over the turn.
        """
        if self.kind in FACTS:
            return turns.facts[self.kind]
        if self.kind == "function":
            return _function_values(self.subject, turns)
        if self.kind == "stroke":
            return _stroke(turns, self.subject)
        assert self.of is not None
        values = turns.of(self.of)
        if self.kind == "at":
            assert place is not None
            return values[:, place]
        if self.kind == "range":
            return values.max(1) - values.min(1)
        return OVER[self.kind](values)


def measure(text: str, mechanism: Mechanism, programs: Programs | None = None) -> TurnMeasure:
    """Return the measure that a text asks for.

    Args:
        text: range:J, stroke:P, max:Q, min:Q, rms:Q, mean:Q, ripple:Q (root mean square about the mean) with
            quantities as `turns.quantity` has them, at:ANGLE:Q or under motion laws at:TIME:Q, crank_range,
            dead_centres, assemblies, or FILE.py:FUNC of a Motion.
        mechanism: whose.
        programs: its motion laws; None where a crank is driven.

    Raises:
        InputError: for an unknown word or quantity, with the nearest one.
    """
    word, colon, rest = text.partition(":")
    if text in FACTS:
        return TurnMeasure(text, text, FACTS[text])
    if ".py:" in text:
        run_object(text)
        return TurnMeasure(text, "function", "", subject=text)
    if colon and word == "range":
        return _range(text, rest, mechanism)
    if colon and word == "stroke":
        if rest not in mechanism.points:
            raise InputError(f"{mechanism.name} has no point {rest!r}{suggestion(rest, mechanism.points)}")
        return TurnMeasure(text, word, "m", subject=rest)
    if colon and word in OVER:
        of = quantity(rest, mechanism)
        return TurnMeasure(text, word, of.unit, of)
    if colon and word == "at":
        place, _, name = rest.partition(":")
        of = quantity(name, mechanism)
        return TurnMeasure(text, word, of.unit, of, angle=_parameter(text, place, programs))
    said = f"{word}:" if colon else text
    raise InputError(f"there is no measure {text!r}{suggestion(said, WORDS)}")


def _parameter(text: str, place: str, programs: Programs | None) -> float:
    """Return the path parameter at a crank angle, or under motion laws at a time, in [rad]."""
    if programs is None:
        return units.parse(place, "rad", f"the angle of {text}")
    try:
        time = units.parse(place, "s", f"the time of {text}")
    except InputError as error:
        raise InputError(f"{error}; motion laws drive, so that it is taken at a time") from None
    if not 0.0 <= time <= programs.duration:
        raise InputError(
            f"{text} is taken at {time:g} s, and the motion laws last {programs.duration:g} s; give a time "
            "within them, or a longer duration"
        )
    return programs.pace * time


def _range(text: str, rest: str, mechanism: Mechanism) -> TurnMeasure:
    joints = joint_units(mechanism)
    if rest not in joints and "." not in rest and ":" not in rest:
        raise InputError(f"{mechanism.name} has no joint {rest!r} to range{suggestion(rest, joints)}")
    of = quantity(rest, mechanism)
    return TurnMeasure(text, "range", of.unit, of)


def _stroke(turns: Turns, point: str) -> Array:
    """Return the greatest distance of two places on the path of a point, (designs,) in [m]."""
    shape = (turns.designs, turns.poses)
    x, y, z = (part.reshape(shape) for part in turns.motion.points[point].position.T)
    most = np.zeros(turns.designs, x.dtype)
    for apart in range(1, turns.poses // 2 + 1):
        # each pair once: so many poses apart, round the turn
        dx, dy, dz = (part - np.roll(part, apart, 1) for part in (x, y, z))
        np.maximum(most, (dx * dx + dy * dy + dz * dz).max(1), out=most)
    return np.sqrt(most)


def _function_values(where: str, turns: Turns) -> Array:
    """Return what a user's function says of each motion, (designs,)."""
    function = run_object(where)
    out = np.empty(turns.designs)
    for i in range(turns.designs):
        motion: Motion = taken(turns.motion, slice(i * turns.poses, (i + 1) * turns.poses))
        out[i] = _number(where, run_user_code(where, lambda motion=motion: function(motion)))
    return out


def _number(where: str, given: object) -> float:
    try:
        return float(given)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        raise InputError(f"{where} returns {type(given).__name__}; return one number") from None


def measures(
    texts: "list[str] | tuple[str, ...]", mechanism: Mechanism, programs: Programs | None = None
) -> tuple[TurnMeasure, ...]:
    """Return the measures that texts ask for, each once.

    Raises:
        InputError: as `measure`, or where there is none.
    """
    if not texts:
        raise InputError(f"no measure is asked for; give one of {', '.join(WORDS)}")
    return tuple(measure(text, mechanism, programs) for text in dict.fromkeys(texts))


def table_of(asked: "tuple[TurnMeasure, ...]", turns: Turns, places: Mapping[float, int]) -> dict[str, Array]:
    """Return all measures of designs: name -> (designs,).

    Args:
        asked: the measures.
        turns: motions over the turn, then at the angles that some measures are taken at.
        places: such an angle -> which of the poses it is.
    """
    count = turns.poses - len(places)
    whole = _first(turns, count) if places else turns
    return {
        one.name: one.value(turns, places[one.angle]) if one.angle is not None else one.value(whole)
        for one in asked
    }


def _first(turns: Turns, count: int) -> Turns:
    """Return the motions over their first poses alone."""
    rows = np.zeros((turns.designs, turns.poses), dtype=np.bool_)
    rows[:, :count] = True
    cut = {name: one[:, :count] for name, one in turns.efforts.items()}
    angle = None if turns.transmission is None else turns.transmission[:, :count]
    return Turns(turns.designs, count, taken(turns.motion, rows.ravel()), cut, angle, turns.facts)
