"""A claim beside what is exact: two curves on top of each other, their difference, where it comes from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import prefixed, readable
from mechsim.pictures.plots.figure import COLOURS, ROUNDED, along_axis, blank, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# of a curve with more instants the claimed ones are drawn as a line too
DOTS = 120


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoCurves:
    """What is drawn of one quantity.

    Attributes:
        name: of it.
        unit: of all values.
        at: crank angles in [rad], times in [s], or rows of a table, (n,).
        over: which of them: "rad", "s" or "row".
        exact: (n, k).
        claimed: (n, k).
        parts: names of the components, k.
        bound: how far both may lie apart.
        source: who claims it.
        shares: where the distance of a run comes from, part -> size; empty where none was run.
    """

    name: str
    unit: str
    at: Array
    over: str
    exact: Array
    claimed: Array
    parts: str
    bound: float
    source: str
    shares: Mapping[str, float]


@styled()
def agreement_plot(told: TwoCurves) -> "Figure":
    """Draw a claim on top of what is exact, the difference below, and below that where a run's comes from."""
    rows = 3 if told.shares else 2
    figure, axes = blank(rows, 1, (5.4, 2.1 * rows + 0.6))
    x = np.rad2deg(told.at) if told.over == "rad" else told.at
    _curves(axes[0, 0], x, told)
    lines = axes[0, 0].get_lines()
    figure.legend(handles=lines, ncols=len(lines), fontsize=7, loc="outside upper right", handlelength=1.6)
    _difference(axes[1, 0], x, told)
    for ax in axes[:2, 0]:
        along_axis(ax, told.over == "s")
        if told.over == "row":
            ax.set_xlabel("row")
    if told.shares:
        _shares(axes[2, 0], told)
    return figure


def _curves(ax: "Axes", x: Array, told: TwoCurves) -> None:
    factor, unit = _readable(np.concatenate([told.exact, told.claimed]), told.unit)
    for i in range(told.exact.shape[1]):
        colour, part = COLOURS[i], f" {told.parts[i]}" if told.parts else ""
        ax.plot(x, told.exact[:, i] / factor, color=colour, lw=2.6, alpha=0.45, label=f"exact{part}")
        few = len(x) <= DOTS
        marker, line = ("." if few else ""), ("none" if few else ":")
        ax.plot(
            x,
            told.claimed[:, i] / factor,
            color=colour,
            label=f"claimed{part}",
            marker=marker,
            ls=line,
            ms=3.5,
        )
    ax.set_ylabel(f"{told.name} [{unit}]")
    ax.set_title(f"{told.name}: exact, and {told.source}")


def _difference(ax: "Axes", x: Array, told: TwoCurves) -> None:
    gap = told.claimed - told.exact
    if told.unit == "rad":
        gap = gap - 2.0 * np.pi * np.round(gap / (2.0 * np.pi))
    floor = ROUNDED * float(np.nanmax(np.abs(told.exact), initial=0.0))
    rounding = float(np.nanmax(np.abs(gap), initial=0.0)) < floor
    factor, unit = _readable(np.array([max(floor, told.bound)]) if rounding else gap, told.unit)
    if rounding:
        gap = 0.0 * gap
    for i in range(gap.shape[1]):
        ax.plot(x, gap[:, i] / factor, color=COLOURS[i], label=told.parts[i : i + 1])
    largest = float(np.abs(gap).max(initial=0.0))
    if rounding:
        far = 1.3 * max(told.bound, floor) / factor
        ax.set_ylim(-far, far)
    if told.bound > 0.05 * largest:
        for sense in (1.0, -1.0):
            ax.axhline(sense * told.bound / factor, color="#5b6470", lw=0.8, ls="--")
    ax.set_ylabel(f"difference [{unit}]")
    most = (
        f"rounding, below {floor:.1g} {told.unit}" if rounding else f"at most {prefixed(largest, told.unit)}"
    )
    said = f"{most}, bound {prefixed(told.bound, told.unit)}"
    ax.set_title(f"the difference: {said}")


def _shares(ax: "Axes", told: TwoCurves) -> None:
    names = list(told.shares)
    values = np.array([told.shares[name] for name in names])
    factor, unit = _readable(values, told.unit)
    ax.barh(names[::-1], values[::-1] / factor, color=COLOURS[0], height=0.6)
    ax.axvline(0.0, color="#5b6470", lw=0.8)
    ax.set_xlabel(f"share of the largest distance between run and claim [{unit}]")
    ax.set_title("where the distance of a run in time comes from")


def _readable(values: Array, unit: str) -> tuple[float, str]:
    return readable(values, unit) if unit in ("m", "m/s", "N", "N m", "rad") else (1.0, unit)
