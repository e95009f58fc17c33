"""Designs of catalogue mechanisms for the stress test: swinging cranks, and change points."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class SpecialDesigns:
    """Parameters of one mechanism for the stress test.

    Attributes:
        swinging: parameters for which the crank only swings; empty without such parameters.
        limiting_length: length whose change eventually prevents a full revolution of the crank.
        change_points: name -> parameters of a design with change points.
        long_runs: whether the mechanism is run for many revolutions.
    """

    swinging: Mapping[str, Any] = field(default_factory=dict[str, Any])
    limiting_length: str = ""
    change_points: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    long_runs: bool = False


_CHANGE_POINTS = {
    "parallelogram": {"ground": 0.1, "coupler": 0.1, "crank": 0.04, "rocker": 0.04},
    "kite": {"ground": 0.1, "rocker": 0.1, "crank": 0.04, "coupler": 0.04},
}
_DESIGNS = {
    "four_bar": SpecialDesigns({"rocker": 0.035}, "coupler", _CHANGE_POINTS, long_runs=True),
    "slider_crank": SpecialDesigns({"rod": 0.045}, "rod"),
    "rssr": SpecialDesigns({"rocker": 0.009}, "coupler", long_runs=True),
    "rrsrr": SpecialDesigns({"link": 0.055}, "link"),
    "bennett": SpecialDesigns(long_runs=True),
}


def special_designs(name: str) -> SpecialDesigns:
    """Return the special designs of a catalogue mechanism."""
    return _DESIGNS.get(name, SpecialDesigns())
