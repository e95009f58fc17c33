"""Plots of studies: sweeps, maps of extremes, and work-precision diagrams of a trade-off."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mechsim.errors import needs
from mechsim.numerics.convergence import Order
from mechsim.pictures.plots.figure import COLOURS, blank, decades, round_numbers, styled
from mechsim.pictures.plots.sweeps import SweepTable, sweep_plot
from mechsim.studies.sweep.table import TEXTS, design_columns, read_sweep
from mechsim.studies.tradeoff.methods import DEFAULTS
from mechsim.studies.tradeoff.work_precision import BOUNDS, Point, Tradeoff
from mechsim.verdict.quantities import QUANTITIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mechsim.studies.extremes.results import StabilityMap


GREY, FRONT = "#b4bac2", "#222831"
# error in strokes above which points are not drawn
MAX_ERROR = 1.0


@styled()
def work_precision(result: Tradeoff, quantity: str = "position") -> "Figure":
    """Draw every point, the best curve of each integrator with its observed order, and the Pareto front.

    Args:
        result: of the measurement.
        quantity: whose error to draw; a key of `Point.errors`.
    """
    figure, axes = blank(1, 1, (7.6, 4.4))
    ax: Axes = axes[0, 0]
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.plot(*_costs_and_errors(result.points, quantity), "o", ms=1.8, color=GREY, label="every setting")
    for i, (name, curve) in enumerate(result.best_curves(quantity).items()):
        label, marker = f"{name}: {_order(result.order(curve, quantity))}", "s" if name == DEFAULTS else "o"
        ax.plot(*_costs_and_errors(curve, quantity), marker=marker, ms=4, color=COLOURS[i % 6], label=label)
    cost, error = _costs_and_errors(result.front(quantity), quantity)
    ax.step(cost, error, where="post", lw=0.9, color=FRONT, label="Pareto front")
    bar = result.subject.reference.own_error.get(quantity)
    if bar:
        ax.axhline(bar, color="#b00020", lw=1.0, ls="--", label="error of the reference")
    decades(ax.yaxis)
    round_numbers(ax.xaxis)
    low, high = ax.get_ylim()
    ax.set_yticks([error for error in (1.0, *BOUNDS, 1e-11, 1e-13) if low <= error <= high])
    ax.set_xlabel("processor time of one turn [ms]")
    row = QUANTITIES[quantity]
    ax.set_ylabel(f"worst {row.title} [{row.scale}]")
    ax.set_title(f"{result.subject.name} against {result.subject.reference.what}")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _costs_and_errors(points: Sequence[Point], quantity: str) -> tuple[list[float], list[float]]:
    """Return costs in [ms] and errors of the points with errors that are drawn."""
    drawn = [point for point in points if 0.0 < point.errors[quantity] < MAX_ERROR]
    return [1e3 * point.cost for point in drawn], [point.errors[quantity] for point in drawn]


def _order(order: Order | None) -> str:
    return "no order" if order is None or not np.isfinite(order.order) else f"order {order.order:.1f}"


# outcome -> height at which it is drawn (None: at its error), marker and colour
MARKERS: dict[str, tuple[float | None, str, str]] = {
    "passed": (None, "o", "#1b7f5c"),
    "failed": (None, "s", "#c77700"),
    "changed assembly": (None, "D", "#8e44ad"),
    "diverged": (1e2, "x", "#b00020"),
    "cannot assemble": (1e3, "^", "#5b6470"),
}
# relative error drawn for an error of zero: below the spacing of floating-point numbers
FLOOR = 1e-17


@styled()
def extremes_map(study: "StabilityMap") -> "Figure":
    """Draw one panel per axis: errors in characteristic lengths, a line per mechanism, a marker per outcome.

    Borders found by bisection are thin vertical lines; the tolerance is dashed.
    """
    from mechsim.studies.extremes.stability_map import AXES
    from mechsim.studies.extremes.trial import POSITION_TOLERANCE

    names = [axis for axis in AXES if any(trial.axis == axis for trial in study.trials)]
    rows = math.ceil(len(names) / 2)
    mechanisms = sorted({trial.mechanism for trial in study.trials})
    figure, axes = blank(rows, 2, (11.0, 2.6 * rows + 0.6))
    for ax, name in zip(axes.flat, names, strict=False):
        _panel(ax, study, name, mechanisms)
        ax.axhline(POSITION_TOLERANCE, color="#b00020", lw=1.0, ls="--")
        ax.set_xlabel(AXES[name])
        ax.set_ylabel("error / size")
        ax.set_title(name)
    for ax in list(axes.flat)[len(names) :]:
        ax.set_axis_off()
    with needs("pictures"):
        from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], ls="", marker=marker, color=colour, mfc="none", label=outcome)
        for outcome, (_, marker, colour) in MARKERS.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _panel(ax: "Axes", study: "StabilityMap", name: str, mechanisms: list[str]) -> None:
    trials = [trial for trial in study.trials if trial.axis == name]
    for i, mechanism in enumerate(mechanisms):
        own = sorted((t for t in trials if t.mechanism == mechanism), key=lambda t: t.value)
        line = [(t.value, max(t.error, FLOOR)) for t in own if t.error is not None and t.value > 0.0]
        if line:
            ax.loglog(*zip(*line, strict=True), lw=0.8, color=COLOURS[i % 6], alpha=0.5)
    for outcome, (level, marker, colour) in MARKERS.items():
        points = [
            (t.value, level or max(t.error or FLOOR, FLOOR))
            for t in trials
            if t.outcome == outcome and t.value > 0.0
        ]
        if points:
            ax.loglog(*zip(*points, strict=True), marker, ms=3.5, color=colour, mfc="none", mew=0.9)
    for border in study.borders:
        if border.axis == name and border.outside > 0.0:
            ax.axvline((border.inside * border.outside) ** 0.5, color="#9aa3ad", lw=0.6)
    ax.set_ylim(FLOOR / 3.0, 1e4)
    if name in ("dead centre", "beyond dead centre", "near tangent"):
        ax.invert_xaxis()


def drawn_sweep(path: str, measures: tuple[str, ...] | None, kind: str | None) -> "Figure":
    """Return a figure of a sweep file.

    Args:
        path: of the sweep file.
        measures: measures to draw; None for all.
        kind: of plot; None for the default of the data.

    Raises:
        InputError: for a file without a sweep, or a measure it does not contain.
    """
    result = read_sweep(path)
    table = design_columns(result)
    parameter_names = [str(name) for name in result.coords]
    measure_names = [name for name in table if name not in (*parameter_names, *TEXTS)]
    measured_columns = {name: table[name] for name in measure_names}
    description = {
        str(name): str(variable.attrs.get("units", "1")) for name, variable in result.variables.items()
    }
    title = str(result.attrs.get("model", path))
    parameters = {name: table[name] for name in parameter_names}
    return sweep_plot(
        SweepTable(title, parameters, measured_columns, description, result["outcome"].shape), measures, kind
    )
