"""Plots of sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import COLOURS, STYLES, blank, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# largest number of lines of a parallel plot; of more designs an even selection is drawn
MAX_LINES = 2000


@dataclass(frozen=True)
class SweepTable:
    """The data of a sweep plot.

    Attributes:
        title: name of the swept model.
        parameters: name -> (n,) of each design.
        measures: name -> (n,); NaN if it was not built.
        units: name -> SI unit.
        shape: shape of the grid; one length for a list.
    """

    title: str
    parameters: Mapping[str, Array]
    measures: Mapping[str, Array]
    units: Mapping[str, str]
    shape: tuple[int, ...]

    def scaled(self, name: str) -> tuple[Array, str]:
        """Return a column in a readable unit, and its label."""
        values = self.parameters.get(name, self.measures.get(name))
        assert values is not None
        unit = self.units.get(name, "1")
        if unit == "rad":
            return np.rad2deg(values), f"{name} [°]"
        if unit in ("1", ""):
            return values, name
        finite = values[np.isfinite(values)]
        factor, shown_unit = readable(finite if len(finite) else np.ones(1), unit)
        return values / factor, f"{name} [{shown_unit}]"


def sweep_plot(table: SweepTable, selected: Sequence[str] | None = None, kind: str | None = None) -> Figure:
    """Draw a sweep.

    Args:
        table: the sweep.
        selected: measures; None draws all.
        kind: "map", over one or two parameters; "parallel", every design a line; "pareto", one measure over
            another with the designs that none betters in both. None takes a map where there is a grid of one
            or two parameters, or a list of one; else parallel.

    Raises:
        InputError: for an unknown measure or kind, or a kind for which the sweep lacks columns.
    """
    names = [*table.measures] if selected is None else [*selected]
    for name in names:
        if name not in table.measures:
            raise InputError(f"the sweep has no measure {name!r}; choose from {', '.join(table.measures)}")
    wide = sum(length > 1 for length in table.shape)
    usual = "map" if len(table.parameters) == 1 or (wide <= 2 and len(table.shape) > 1) else "parallel"
    drawn = {"map": _map, "parallel": _parallel, "pareto": _pareto}
    if (kind or usual) not in drawn:
        raise InputError(f"there is no plot {kind!r} of a sweep; choose from {', '.join(drawn)}")
    return drawn[kind or usual](table, names)


@styled()
def _map(table: SweepTable, names: Sequence[str]) -> Figure:
    axes_of = [name for name, n in zip(table.parameters, table.shape, strict=False) if n > 1]
    if len(table.parameters) == 1:
        axes_of = [*table.parameters]
    if len(axes_of) == 1:
        return _lines(table, names, axes_of[0])
    if len(axes_of) != 2 or len(table.shape) == 1:
        raise InputError(
            f"a map is over one or two parameters of a grid, and this sweep varies {len(table.parameters)}; "
            "draw it with --kind parallel"
        )
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure, axes = blank(rows, columns, (4.2 * columns, 3.4 * rows))
    shape = tuple(n for n in table.shape if n > 1)
    (x, x_label), (y, y_label) = (table.scaled(name) for name in reversed(axes_of))
    for ax, name in zip(axes.flat, names, strict=False):
        values, label = table.scaled(name)
        ax.set_facecolor("#eef0f3")
        ax.grid(False)
        image = ax.pcolormesh(
            x.reshape(shape), y.reshape(shape), np.ma.masked_invalid(values.reshape(shape)), shading="nearest"
        )
        figure.colorbar(image, ax=ax, label=label)
        ax.set(xlabel=x_label, ylabel=y_label)
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    figure.suptitle(f"{table.title}; grey: not built", fontsize=9.0)
    return figure


def _lines(table: SweepTable, names: Sequence[str], over: str) -> Figure:
    figure, axes = blank(len(names), 1, (6.0, 2.4 * len(names)), sharex=True)
    x, x_label = table.scaled(over)
    order = np.argsort(x)
    for i, (ax, name) in enumerate(zip(axes[:, 0], names, strict=True)):
        values, label = table.scaled(name)
        ax.plot(x[order], values[order], color=COLOURS[i % len(COLOURS)], marker="." if len(x) < 60 else "")
        ax.set_ylabel(label)
        open_ = ~np.isfinite(values)
        if open_.any():
            heights = np.full(open_.sum(), 0.02)
            ax.plot(x[open_], heights, "|", color="#5b6470", transform=ax.get_xaxis_transform())
    axes[-1, 0].set_xlabel(x_label)
    figure.suptitle(f"{table.title}; | below: not built", fontsize=9.0)
    return figure


@styled()
def _parallel(table: SweepTable, names: Sequence[str]) -> Figure:
    from matplotlib.collections import LineCollection

    built = np.flatnonzero(np.all([np.isfinite(table.measures[name]) for name in names], axis=0))
    if not len(built):
        raise InputError("no design of the sweep was built; there is nothing to draw")
    subset = built[np.unique(np.linspace(0, len(built) - 1, min(len(built), MAX_LINES)).astype(int))]
    columns = [*table.parameters, *names]
    figure, axes = blank(1, 1, (1.5 * len(columns) + 1.5, 4.2))
    ax = axes[0, 0]
    heights, labels = np.empty((len(subset), len(columns))), list[str]()
    for i, name in enumerate(columns):
        values, label = table.scaled(name)
        low, high = float(values[subset].min()), float(values[subset].max())
        heights[:, i] = (values[subset] - low) / ((high - low) or 1.0)
        labels.append(label.replace(" [", "\n["))
        for height, end in ((-0.03, low), (1.03, high)):
            ax.text(i, height, f"{end:.4g}", ha="center", va="top" if height < 0 else "bottom")
    abscissae = np.broadcast_to(np.arange(len(columns)), heights.shape)
    lines = LineCollection(
        list(np.stack([abscissae, heights], -1)), cmap="viridis", alpha=0.6, linewidths=0.9
    )
    lines.set_array(heights[:, -1])
    ax.add_collection(lines)
    ax.set(xlim=(-0.3, len(columns) - 0.7), ylim=(-0.12, 1.12), yticks=[])
    ax.set_xticks(range(len(columns)), labels)
    ax.spines["left"].set_visible(False)
    drawn = "" if len(subset) == len(built) else f", {len(subset):,} drawn"
    ax.set_title(f"{table.title}: {len(built):,} designs built{drawn}; colour: {columns[-1]}")
    return figure


@styled()
def _pareto(table: SweepTable, names: Sequence[str]) -> Figure:
    if len(names) < 2:
        raise InputError("a Pareto front shows two measures; name two with --of")
    figure, axes = blank(1, 1, (5.4, 4.2))
    ax = axes[0, 0]
    (x, x_label), (y, y_label) = (table.scaled(name) for name in names[:2])
    built = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    ax.plot(x[built], y[built], ".", color="#b8bec7", ms=3)
    sides = (
        (1, 1, "both low"),
        (-1, 1, f"{names[0]} high"),
        (1, -1, f"{names[1]} high"),
        (-1, -1, "both high"),
    )
    for i, (a, b, label) in enumerate(sides):
        front = built[front_of(a * x[built], b * y[built])]
        style = STYLES[i % len(STYLES)]
        ax.plot(x[front], y[front], style, marker="o", ms=3, color=COLOURS[i], label=label)
    ax.set(xlabel=x_label, ylabel=y_label, title=f"{table.title}: designs that none betters in both")
    ax.legend(fontsize=8.0)
    return figure


def front_of(x: Array, y: Array) -> NDArray[np.intp]:
    """Return the designs that no other one beats in both, lower being better, by rising x."""
    order = np.lexsort((y, x))
    below = np.minimum.accumulate(np.concatenate([[np.inf], y[order][:-1]]))
    return order[y[order] < below]
