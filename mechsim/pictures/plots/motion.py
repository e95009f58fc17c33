"""Plots over the crank angle: motions, transmission angle, errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import prefixed, readable
from mechsim.pictures.plots import figure as figures
from mechsim.pictures.plots.figure import COLOURS, LEGEND_RIGHT, STYLES, along_axis, blank, label_of, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# smallest error on a logarithmic axis; smaller ones are rounding
FLOOR = 1e-18
# rows of a plot of points: attribute of a point, and its SI unit
UNITS = {"position": "m", "velocity": "m/s", "acceleration": "m/s²"}


@styled()
def motion_plot(motion: Motion) -> Figure:
    """Draw displacement, velocity and acceleration of points over crank angle, under motion laws over time.

    Args:
        motion: what to draw.
    """
    x, names, scales = figures.abscissa(motion), figures.point_names(motion), _scales(motion)
    # a planar mechanism stays at zero along z
    reach = np.max([np.abs(point.position).max(axis=0) for point in motion.points.values()], axis=0)
    shown = np.flatnonzero(~(reach <= figures.ROUNDED * scales[0])).tolist() or [0, 1, 2]
    # as wide as other plots, so that a page scales their text alike
    width = max(5.4, 3.0 * len(names) + 0.6)
    figure, axes = blank(3, len(names), (width, 6.0), sharex=True)
    for column, name in enumerate(names):
        for row, (label, si) in enumerate(UNITS.items()):
            ax, values = axes[row, column], getattr(motion.points[name], label)
            factor, unit = readable(values, si)
            for i in shown:
                ax.plot(x, values[:, i] / factor, color=COLOURS[i], ls=STYLES[i], label="xyz"[i])
            ax.set_ylabel(f"{label} [{unit}]")
            figures.flattened(ax, scales[row] / factor, unit)
            # one position for all labels of a column; computing it takes a third of the plot's time
            ax.yaxis.set_label_coords(-0.6 * len(names) / width, 0.5)
        axes[0, column].set_title(label_of(name))
        along_axis(axes[2, column], bool(motion.drivers))
    figure.legend(handles=axes[0, 0].get_lines(), ncols=3, loc="outside upper right", handlelength=1.6)
    return figure


def _scales(motion: Motion) -> list[float]:
    """Return the scales of positions, velocities and accelerations that are not zero, in SI.

    The rates are at least those of a point at the largest distance that turns with the crank.
    """
    reach = max(float(np.abs(point.position).max(initial=0.0)) for point in motion.points.values())
    speed = float(np.abs(motion.speed).max(initial=0.0))
    scales = [reach]
    for order, rate in ((1, "velocity"), (2, "acceleration")):
        sizes = [np.abs(getattr(point, rate)).max(initial=0.0) for point in motion.points.values()]
        scales.append(max(reach * speed**order, float(np.nanmax(sizes))))
    return scales


@styled()
def transmission_plot(angles: ArrayLike, transmission: ArrayLike) -> Figure:
    """Draw the transmission angle over the crank angle, both in [rad]."""
    x, y = np.rad2deg(np.asarray(angles)), np.rad2deg(np.asarray(transmission))
    figure, ((ax,),) = blank(1, 1, (4.6, 2.8))
    ax.plot(x, y, color=COLOURS[1])
    worst = int(np.argmin(y))
    ax.plot(x[worst], y[worst], "o", ms=4, color=COLOURS[0])
    ax.annotate(f"{y[worst]:.1f}°", (x[worst], y[worst]), (0, 6), textcoords="offset points", ha="center")
    ax.set_ylim(0.0, 95.0)
    ax.set_yticks(range(0, 91, 30))
    ax.set_ylabel("transmission angle [°]")
    along_axis(ax)
    return figure


@styled()
def error_plot(
    instants: ArrayLike,
    errors: Mapping[str, ArrayLike],
    *,
    tolerance: float | None = None,
    timed: bool = False,
) -> Figure:
    """Draw errors in [m] over a revolution on a logarithmic scale, with their tolerance.

    Args:
        instants: crank angles, (n,) in [rad], or times in [s].
        errors: label -> error, (n,); its magnitude is drawn, NaN as a gap.
        tolerance: largest allowed error; None draws none.
        timed: whether the instants are times.
    """
    x = np.asarray(instants) if timed else np.rad2deg(np.asarray(instants))
    figure, ((ax,),) = blank(1, 1, (5.6, 3.0))
    for i, (label, values) in enumerate(errors.items()):
        error = np.abs(np.asarray(values, dtype=np.float64))
        error = np.where(np.isfinite(error), np.maximum(error, FLOOR), np.nan)
        ax.semilogy(x, error, color=COLOURS[i % 6], ls=STYLES[i % 3], lw=1.2, label=label_of(label))
    if tolerance is not None:
        ax.axhline(tolerance, color="#b00020", lw=1.2, ls="--", label=f"tolerance {tolerance:.1e} m")
    figures.decades(ax.yaxis)
    # an error that changes its sign passes zero; showing that would flatten all other errors
    sizes = (np.abs(np.asarray(values, dtype=np.float64)) for values in errors.values())
    peaks = [float(np.max(error, where=np.isfinite(error), initial=0.0)) for error in sizes]
    least = min((peak for peak in peaks if peak > FLOOR), default=None)
    ax.set_ylim(bottom=None if least is None else max(FLOOR, 1e-4 * least))
    ax.set_ylabel("error [m]")
    along_axis(ax, timed)
    ax.legend(**LEGEND_RIGHT)
    return figure


# number of instants above which candidate values are drawn as a line too
DOTS = 120


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoCurves:
    """The plotted data of one quantity.

    Attributes:
        name: name of the quantity.
        unit: of all values.
        instants: crank angles in [rad], times in [s], or rows of a table, (n,).
        over: kind of the instants: "rad", "s" or "row".
        exact: (n, k).
        claimed: (n, k).
        components: names of the components, k.
        tolerance: allowed difference.
        source: name of the function or file with the candidate values.
        shares: component -> size of the difference of a stepped run; empty without a run.
    """

    name: str
    unit: str
    instants: Array
    over: str
    exact: Array
    claimed: Array
    components: str
    tolerance: float
    source: str
    shares: Mapping[str, float]


@styled()
def agreement_plot(curves: TwoCurves) -> Figure:
    """Draw candidate values over exact ones, their difference, and the components of a run's difference."""
    rows = 3 if curves.shares else 2
    figure, axes = blank(rows, 1, (5.4, 2.1 * rows + 0.6))
    x = np.rad2deg(curves.instants) if curves.over == "rad" else curves.instants
    _curves(axes[0, 0], x, curves)
    lines = axes[0, 0].get_lines()
    figure.legend(handles=lines, ncols=len(lines), fontsize=7, loc="outside upper right", handlelength=1.6)
    _difference(axes[1, 0], x, curves)
    for ax in axes[:2, 0]:
        along_axis(ax, curves.over == "s")
        if curves.over == "row":
            ax.set_xlabel("row")
    if curves.shares:
        _shares(axes[2, 0], curves)
    return figure


def _curves(ax: Axes, x: Array, curves: TwoCurves) -> None:
    factor, unit = readable(np.concatenate([curves.exact, curves.claimed]), curves.unit)
    dots: dict[str, Any] = {"marker": ".", "ls": "none"} if len(x) <= DOTS else {"ls": ":"}
    for i, (exact, claimed) in enumerate(zip(curves.exact.T, curves.claimed.T, strict=True)):
        colour, component = COLOURS[i], f" {curves.components[i]}" if curves.components else ""
        ax.plot(x, exact / factor, color=colour, lw=2.6, alpha=0.45, label=f"exact{component}")
        ax.plot(x, claimed / factor, color=colour, label=f"claimed{component}", ms=3.5, **dots)
    ax.set_ylabel(f"{curves.name} [{unit}]")
    ax.set_title(f"{curves.name}: exact, and {curves.source}")


def _difference(ax: Axes, x: Array, curves: TwoCurves) -> None:
    gap = curves.claimed - curves.exact
    if curves.unit == "rad":
        gap = gap - 2.0 * np.pi * np.round(gap / (2.0 * np.pi))
    floor = figures.ROUNDED * float(np.nanmax(np.abs(curves.exact), initial=0.0))
    rounding = float(np.nanmax(np.abs(gap), initial=0.0)) < floor
    factor, unit = readable(np.array([max(floor, curves.tolerance)]) if rounding else gap, curves.unit)
    if rounding:
        gap = 0.0 * gap
    for i in range(gap.shape[1]):
        ax.plot(x, gap[:, i] / factor, color=COLOURS[i], label=curves.components[i : i + 1])
    largest = float(np.linalg.norm(gap, axis=1).max(initial=0.0))
    if rounding:
        limit = 1.3 * max(curves.tolerance, floor) / factor
        ax.set_ylim(-limit, limit)
    if curves.tolerance > 0.05 * largest:
        for sign in (1.0, -1.0):
            ax.axhline(sign * curves.tolerance / factor, color="#5b6470", lw=0.8, ls="--")
    ax.set_ylabel(f"difference [{unit}]")
    most = f"at most {prefixed(largest, curves.unit)}"
    if rounding:
        most = f"rounding, below {floor:.1g} {curves.unit}"
    ax.set_title(f"the difference: {most}, tolerance {prefixed(curves.tolerance, curves.unit)}")


def _shares(ax: Axes, curves: TwoCurves) -> None:
    names, values = list(curves.shares), np.array([*curves.shares.values()])
    factor, unit = readable(values, curves.unit)
    ax.barh(names[::-1], values[::-1] / factor, color=COLOURS[0], height=0.6)
    ax.axvline(0.0, color="#5b6470", lw=0.8)
    ax.set_xlabel(f"share of the largest distance between run and claim [{unit}]")
    ax.set_title("where the distance of a run in time comes from")
