"""Work-precision plots: error over cost on logarithmic axes, a curve for each way of stepping."""

from typing import TYPE_CHECKING

import numpy as np

from mechsim.numerics.convergence import Order
from mechsim.pictures.plots.figure import COLOURS, blank, decades, round_numbers, styled
from mechsim.studies.tradeoff import BOUNDS, DEFAULTS, Point, Tradeoff
from mechsim.verdict.quantities import QUANTITIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY, FRONT = "#b4bac2", "#222831"
# points that err by a stroke or more are not drawn
LOST = 1.0


@styled()
def work_precision(found: Tradeoff, quantity: str = "position") -> "Figure":
    """Draw every point, the best curve of each integrator with its observed order, and the Pareto front.

    Args:
        found: what was measured.
        quantity: whose error to draw; a key of `Point.errors`.
    """
    figure, axes = blank(1, 1, (7.6, 4.4))
    ax: Axes = axes[0, 0]
    ax.set_xscale("log")
    ax.set_yscale("log")
    cost, error = _places(list(found.points), quantity)
    ax.plot(cost, error, "o", ms=1.8, color=GREY, label="every setting")
    for i, (name, curve) in enumerate(found.best_curves(quantity).items()):
        cost, error = _places(curve, quantity)
        label = f"{name}: {_order(found.order(curve, quantity))}"
        ax.plot(cost, error, marker="s" if name == DEFAULTS else "o", ms=4, color=COLOURS[i % 6], label=label)
    cost, error = _places(found.front(quantity), quantity)
    ax.step(cost, error, where="post", lw=0.9, color=FRONT, label="Pareto front")
    bar = found.subject.reference.bar.get(quantity)
    if bar:
        ax.axhline(bar, color="#b00020", lw=1.0, ls="--", label="error of the reference")
    _dress(ax, quantity)
    ax.set_title(f"{found.subject.name} against {found.subject.reference.what}")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _dress(ax: "Axes", quantity: str) -> None:
    decades(ax.yaxis)
    round_numbers(ax.xaxis)
    ax.set_yticks([bound for bound in (1.0, *BOUNDS, 1e-11, 1e-13) if _within(bound, ax.get_ylim())])
    ax.set_xlabel("processor time of one turn [ms]")
    row = QUANTITIES[quantity]
    ax.set_ylabel(f"worst {row.title} [{row.scale}]")


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]


def _places(points: list[Point], quantity: str) -> tuple[list[float], list[float]]:
    """Return costs in [ms] and errors of the points that are no worse than lost."""
    good = [point for point in points if 0.0 < point.errors[quantity] < LOST]
    return [1e3 * point.cost for point in good], [point.errors[quantity] for point in good]


def _order(order: Order | None) -> str:
    return "no order" if order is None or not np.isfinite(order.order) else f"order {order.order:.1f}"
