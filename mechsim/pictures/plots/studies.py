"""Plots of sensitivities, tolerances and sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array, tangents
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import (
    COLOURS,
    INK,
    LEGEND_RIGHT,
    STYLES,
    along_axis,
    blank,
    label_of,
    styled,
)
from mechsim.shapes.camera import nice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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


# largest number of quantities on a sheet, and of dimensions in each
MAX_QUANTITIES, LINES = 12, 12
# drawn width of the widest band, relative to the path's extent
MAX_BAND_WIDTH = 0.06
# SI unit -> factor and name of the unit that is drawn
SHOWN: dict[str, tuple[float, str]] = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "°")}


@dataclass(frozen=True, slots=True)
class Band:
    """The effect of tolerances on one quantity.

    Attributes:
        unit: of the quantity.
        worst: worst-case deviation, (n,).
        squares: root sum of squares, (n,).
        low: 2.5 % quantile of the deviation, (n,); None without Monte Carlo.
        high: 97.5 % quantile.
        shares: dimension -> fraction of the variance over the motion.
    """

    unit: str
    worst: Array
    squares: Array
    low: Array | None
    high: Array | None
    shares: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class PathBand:
    """A path of a point and its lateral deviation.

    Attributes:
        point: its name.
        positions: (n, 3) in [m].
        worst: worst-case lateral deviation in the plane of the path, (n,) in [m].
        squares: root sum of squares, (n,) in [m].
    """

    point: str
    positions: Array
    worst: Array
    squares: Array


@dataclass(frozen=True, slots=True)
class ToleranceSheet:
    """The data of a tolerance plot.

    Attributes:
        over: "angle" in [rad] or "t" in [s].
        instants: (n,).
        bands: quantity -> band.
        paths: of points.
    """

    over: str
    instants: Array
    bands: Mapping[str, Band]
    paths: Sequence[PathBand] = field(default_factory=tuple)


@styled()
def sensitivity_plot(
    over: str,
    instants: Array,
    curves: Mapping[str, Mapping[str, Array]],
    units: Mapping[str, str],
    by: Mapping[str, str],
) -> Figure:
    """Draw derivatives of each quantity that has any over the motion, the largest few of its dimensions.

    They are drawn per mm or per degree, so that lengths and angles are comparable.

    Args:
        over: "angle" in [rad] or "t" in [s].
        instants: (n,).
        curves: quantity -> dimension -> derivative, (n,) in SI.
        units: quantity -> unit.
        by: dimension -> unit.

    Raises:
        InputError: for more quantities than a sheet holds.
    """
    curves = {
        quantity: lines
        for quantity, lines in curves.items()
        if any(derivative.any() for derivative in lines.values())
    } or curves
    _require_few(curves)
    figure, axes = blank(len(curves), 1, (7.2, 0.6 + 2.1 * len(curves)), sharex=True)
    names = [*dict.fromkeys(name for lines in curves.values() for name in lines)]
    for ax, (quantity, derivatives) in zip(axes[:, 0], curves.items(), strict=True):
        times, unit = SHOWN.get(units[quantity], (1.0, units[quantity]))
        lines = {
            name: derivative * times / SHOWN.get(by[name], (1.0, ""))[0]
            for name, derivative in derivatives.items()
        }
        if unit == units[quantity]:
            factor, unit = readable(np.concatenate([*lines.values()]), unit)
            lines = {name: derivative / factor for name, derivative in lines.items()}
        per = [shown for measure, (_, shown) in SHOWN.items() if measure in {by[name] for name in lines}]
        order = [name for name in _largest_first(lines) if lines[name].any()]
        for name in order[:LINES]:
            i = names.index(name)
            style = STYLES[i // len(COLOURS) % len(STYLES)]
            ax.plot(
                _axis(over, instants),
                lines[name],
                style,
                color=COLOURS[i % len(COLOURS)],
                label=label_of(name),
            )
        remaining = f", {len(order) - LINES} smaller left out" if len(order) > LINES else ""
        ax.set_title(f"derivatives of {quantity} [{unit} per {' or '.join(per) or '1'}]{remaining}")
        if order:
            ax.legend(**LEGEND_RIGHT, fontsize=8.0)
    along_axis(axes[-1, 0], over != "angle")
    return figure


def _largest_first(lines: Mapping[str, Array]) -> list[str]:
    return sorted(lines, key=lambda name: -float(np.abs(lines[name]).max(initial=0.0)))


@styled()
def tolerance_plot(sheet: ToleranceSheet) -> Figure:
    """Draw magnified bands around paths, deviations of quantities, and the shares of dimensions.

    Raises:
        InputError: for more quantities than a sheet holds.
    """
    bands = {name: band for name, band in sheet.bands.items() if band.worst.any()} or sheet.bands
    _require_few(bands)
    rows = len(bands) + len(sheet.paths)
    high = [3.6] * len(sheet.paths) + [2.1] * len(bands)
    options = {"gridspec_kw": {"width_ratios": (2.6, 1.0), "height_ratios": high}}
    figure, axes = blank(rows, 2, (8.4, 0.6 + sum(high)), **options)
    for row, path in zip(axes, sheet.paths, strict=False):
        _draw_path(row[0], path)
        row[1].legend(*row[0].get_legend_handles_labels(), loc="center left", fontsize=8.0)
        row[1].set_axis_off()
    for row, (quantity, band) in zip(axes[len(sheet.paths) :], bands.items(), strict=True):
        _draw_band(row[0], sheet, quantity, band)
        _draw_shares(row[1], band)
        along_axis(row[0], sheet.over != "angle")
    for ax in axes[len(sheet.paths) : -1, 0]:
        ax.set_xlabel("")
    return figure


def _draw_path(ax: Axes, path: PathBand) -> None:
    """Draw a path in its plane, with bands across it."""
    flat, normal = in_plane(path.positions)
    extent = float(np.ptp(flat, axis=0).max())
    widest = float(path.worst.max(initial=0.0))
    times = 1.0 if widest == 0.0 else max(1.0, nice(MAX_BAND_WIDTH * extent / widest))
    for width, colour, label in (
        (path.worst, COLOURS[1], "worst case"),
        (path.squares, COLOURS[0], "root of squares"),
    ):
        aside = normal * (times * width)[:, None] * 1e3
        outer, inner = flat * 1e3 + aside, flat * 1e3 - aside
        outline = np.concatenate([outer, inner[::-1]])
        ax.fill(
            *outline.T, color=colour, alpha=0.35, linewidth=0.0, label=f"{label},\n{times:g} times as wide"
        )
    ax.plot(*(flat * 1e3).T, color=INK, linewidth=1.0, label=label_of(f"path of {path.point}"))
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(f"path of {path.point}, seen square to it; at most {widest * 1e3:.3g} mm aside")
    ax.set_xlabel("[mm]")
    ax.set_ylabel("[mm]")


def in_plane(positions: Array) -> tuple[Array, Array]:
    """Return a path in the plane nearest to it, (n, 2) in [m], and unit vectors across it there, (n, 2)."""
    middle = positions - positions.mean(0)
    axes = np.linalg.svd(middle, full_matrices=False)[2][:2]
    # as people hold a page: x to the right where the plane lets it
    axes = axes * np.where(axes[:, np.abs(axes).argmax(1)].diagonal() < 0.0, -1.0, 1.0)[:, None]
    if abs(axes[0, 0]) < abs(axes[1, 0]):
        axes = axes[::-1]
    flat = middle @ axes.T
    along = tangents(flat)
    return flat, np.column_stack([-along[:, 1], along[:, 0]])


def _draw_band(ax: Axes, sheet: ToleranceSheet, quantity: str, band: Band) -> None:
    instants = _axis(sheet.over, sheet.instants)
    times, unit = SHOWN.get(band.unit, (1.0, band.unit))
    ax.fill_between(
        instants, -band.worst * times, band.worst * times, color=COLOURS[1], alpha=0.25, label="worst case"
    )
    ax.plot(instants, band.squares * times, "--", color=COLOURS[0], label="root of squares")
    ax.plot(instants, -band.squares * times, "--", color=COLOURS[0])
    if band.low is not None and band.high is not None:
        label = "95 % of random mechanisms"
        ax.fill_between(
            instants, band.low * times, band.high * times, color=COLOURS[0], alpha=0.35, label=label
        )
    ax.set_title(f"{quantity} is off by [{unit}]")
    ax.margins(y=0.3)
    ax.legend(fontsize=7.5, loc="upper center", ncols=3)


def _draw_shares(ax: Axes, band: Band) -> None:
    order = sorted(band.shares, key=lambda name: band.shares[name])[-8:]
    ax.barh(order, [100.0 * band.shares[name] for name in order], color=COLOURS[0])
    ax.tick_params(axis="y", labelsize=7.5)
    ax.set_title("share of the variance, %")


def _axis(over: str, instants: Array) -> Array:
    return np.rad2deg(instants) if over == "angle" else instants


def _require_few(quantities: Mapping[str, object]) -> None:
    if not 1 <= len(quantities) <= MAX_QUANTITIES:
        raise InputError(
            f"{len(quantities)} quantities; a sheet holds 1 to {MAX_QUANTITIES}, name fewer with --of"
        )
