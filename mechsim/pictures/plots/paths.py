"""Plots in space: paths of points, from three sides or in perspective, and velocity plans."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import COLOURS, ROUNDED, blank, chosen, label_of, styled
from mechsim.shapes import point_colours
from mechsim.shapes.camera import upright

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class DrawablePlan(Protocol):
    """What a velocity plan must offer: see `velocity_plan.DrawablePlan`."""

    @property
    def pole(self) -> Array: ...
    @property
    def vectors(self) -> Mapping[str, Array]: ...
    @property
    def lines(self) -> tuple[tuple[str, str], ...]: ...
    @property
    def scale(self) -> float: ...


@styled()
def coupler_curve(
    mechanism: Mechanism,
    motion: Motion,
    points: Sequence[str] | None = None,
    *,
    other: Motion | None = None,
) -> "Figure":
    """Draw the paths of points: in their plane where they have one in common, else seen along Z, X and Y.

    Args:
        mechanism: whose points; gives the colours.
        motion: paths drawn as lines.
        points: tracked points; None draws all.
        other: a second motion of the same points, drawn as rings.
    """
    names, colours = chosen(motion, points), point_colours(mechanism)
    places = {name: motion.points[name].position for name in names}
    everything = np.vstack(list(places.values()))
    factor, unit = readable(everything, "m")
    spread, scale = float(np.ptp(everything, axis=0).max()), float(np.abs(everything).max())
    flat = np.ptp(everything[:, 2]) <= max(1e-9 * spread, ROUNDED * scale)
    views = [(0, 1)] if flat else [(0, 1), (2, 1), (0, 2)]
    figure, axes = blank(1, len(views), (3.6 * len(views) + 0.4, 3.4))
    for ax, (i, j) in zip(axes[0], views, strict=True):
        for name, place in places.items():
            colour = colours[name]
            ax.plot(place[:, i] / factor, place[:, j] / factor, color=colour, label=label_of(name))
            ax.plot(*(place[0, [i, j]] / factor), "o", ms=4, color=colour)
            if other is not None:
                rings = other.points[name].position[:, [i, j]] / factor
                ax.plot(*rings.T, "o", ms=3.5, mfc="none", mew=0.7, color="#222831")
        ax.set_xlabel(f"{'xyz'[i]} [{unit}]")
        ax.set_ylabel(f"{'xyz'[j]} [{unit}]")
        if spread < ROUNDED * scale:
            # what stands still is a point, not a path of rounding
            for middle, limits in zip(
                everything[0, [i, j]] / factor, (ax.set_xlim, ax.set_ylim), strict=True
            ):
                limits(middle - 0.5 * scale / factor, middle + 0.5 * scale / factor)
            ax.set_title(f"stands still within {ROUNDED * scale:.1g} m")
        ax.set_aspect("equal", adjustable="datalim")
    axes[0, 0].legend(loc="best")
    return figure


@styled()
def space_curve(mechanism: Mechanism, motion: Motion, points: Sequence[str] | None = None) -> "Figure":
    """Draw the paths of points in perspective, with their shadows on the floor; see `coupler_curve`."""
    names, colours = chosen(motion, points), point_colours(mechanism)
    places = {name: motion.points[name].position for name in names}
    everything = np.vstack(list(places.values()))
    factor, unit = readable(everything, "m")
    # a cube that holds everything, so that lengths compare across axes
    middle = (everything.min(0) + everything.max(0)) / 2.0 / factor
    spread, scale = float(np.ptp(everything, axis=0).max()), float(np.abs(everything).max())
    half = (0.55 * spread if spread >= ROUNDED * scale else 0.5 * scale) / factor
    up = upright(mechanism)
    vertical = int(np.argmax(np.abs(up)))
    order = [(vertical + 1) % 3, (vertical + 2) % 3, vertical]
    floor = middle[vertical] - half * up[vertical]
    figure, axes = blank(1, 1, (4.6, 4.4), subplot_kw={"projection": "3d"})
    ax = axes[0, 0]
    for name, place in places.items():
        colour = colours[name]
        # matplotlib's z points up, whichever of the mechanism's axes does
        first, second, height = (place / factor)[:, order].T
        ax.plot(first, second, np.full_like(height, floor), color="#b9bfc8", lw=1.0)
        ax.plot(first, second, height, color=colour, label=label_of(name))
        ax.plot(first[:1], second[:1], height[:1], "o", ms=4, color=colour)
    for axis, i in zip("xyz", order, strict=True):
        getattr(ax, f"set_{axis}lim")(middle[i] - half, middle[i] + half)
        getattr(ax, f"set_{axis}label")(f"{'xyz'[i]} [{unit}]")
        getattr(ax, f"{axis}axis").set_pane_color("#f5f6f8")
        # more marks than these run into one another where an axis points away
        ax.locator_params(axis, nbins=5)
    if up[vertical] < 0.0:
        ax.invert_zaxis()
    # left to itself this label turns with the axis and may stand on its head
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.label.set_rotation(90.0)
    ax.set_box_aspect((1.0, 1.0, 1.0), zoom=0.82)
    ax.view_init(elev=22.0, azim=35.0)
    ax.legend(loc="upper left")
    return figure


@styled()
def velocity_plan_plot(plan: DrawablePlan, title: str = "") -> "Figure":
    """Draw a velocity plan: from the pole p a vector to every point, thin lines between them."""
    vectors = {name: plan.scale * (np.asarray(end)[:2] - plan.pole[:2]) for name, end in plan.vectors.items()}
    reach = max(float(np.linalg.norm(end)) for end in vectors.values())
    factor, unit = readable(np.array([reach]), "m/s")
    figure, axes = blank(1, 1, (4.4, 4.2))
    ax = axes[0, 0]
    for i, (name, end) in enumerate(vectors.items()):
        tip = end / factor
        arrow = {"arrowstyle": "-|>", "color": COLOURS[i % 6], "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tip, (0.0, 0.0), arrowprops=arrow)
        ax.plot(*tip, "o", ms=2, color=COLOURS[i % 6])
        away = 8.0 * end / max(float(np.linalg.norm(end)), 1e-300)
        ax.annotate(name, tip, away, textcoords="offset points", ha="center", va="center", style="italic")
    for a, b in plan.lines:
        both = np.array([vectors[a], vectors[b]]) / factor
        ax.plot(*both.T, color="#5b6470", lw=0.9, ls="--")
    ax.plot(0.0, 0.0, "o", ms=5, color="#222831")
    ax.annotate("p", (0.0, 0.0), (-8, -8), textcoords="offset points", style="italic")
    ax.set_xlabel(f"velocity along x [{unit}]")
    ax.set_ylabel(f"velocity along y [{unit}]")
    ax.set_title(title)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.15)
    return figure
