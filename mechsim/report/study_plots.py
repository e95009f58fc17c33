"""The work-precision diagram of a trade-off."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mechsim.compare.quantities import QUANTITIES
from mechsim.numerics.convergence import Order
from mechsim.pictures.plots.figure import COLOURS, blank, decades, round_numbers, styled
from mechsim.studies.tradeoff.methods import DEFAULTS
from mechsim.studies.tradeoff.work_precision import BOUNDS, Point, Tradeoff

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    decades(ax.yaxis)
    round_numbers(ax.xaxis)
    low, high = ax.get_ylim()
    ax.set_yticks([error for error in (1.0, *BOUNDS, 1e-11, 1e-13) if low <= error <= high])
    ax.set_xlabel(
        f"processor time of one {'turn' if result.subject.solver.motion_laws.crank else 'cycle'} [ms]"
    )
    row = QUANTITIES[quantity]
    ax.set_ylabel(f"worst {row.title} [{row.scale}]")
    ax.set_title(f"{result.subject.name} against {result.subject.solver.method}")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _costs_and_errors(points: Sequence[Point], quantity: str) -> tuple[list[float], list[float]]:
    """Return costs in [ms] and errors of the points with errors that are drawn."""
    drawn = [point for point in points if 0.0 < point.errors[quantity] < MAX_ERROR]
    return [1e3 * point.cost for point in drawn], [point.errors[quantity] for point in drawn]


def _order(order: Order | None) -> str:
    return "no order" if order is None or not np.isfinite(order.order) else f"order {order.order:.1f}"
