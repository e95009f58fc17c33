"""Derivatives of quantities over a motion, and what tolerances make of a path and of quantities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array, tangents
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import COLOURS, LEGEND_RIGHT, STYLES, along_axis, blank, label_of, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# quantities on one sheet, and dimensions drawn in each
MAX_QUANTITIES, LINES = 12, 12
# how wide the widest band is drawn, in parts of the path's extent
WIDE = 0.06
INK = "#222831"
# units as they are drawn: how many of them one in SI is, and their names
SHOWN: dict[str, tuple[float, str]] = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "°")}


@dataclass(frozen=True, slots=True)
class Band:
    """What tolerances make of one quantity.

    Attributes:
        unit: of the quantity.
        worst: largest deviation where all conspire, (n,).
        squares: root of the sum of squares, (n,).
        low: beyond which 2.5 % of random mechanisms lie, as off, (n,); None without Monte Carlo.
        high: likewise above.
        shares: dimension -> part of the variance over the motion.
    """

    unit: str
    worst: Array
    squares: Array
    low: Array | None
    high: Array | None
    shares: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class PathBand:
    """A path of a point and how far it can lie aside.

    Attributes:
        point: its name.
        positions: (n, 3) in [m].
        worst: how far aside where all conspire, across the path in its plane, (n,) in [m].
        squares: likewise by the root of the sum of squares, (n,).
    """

    point: str
    positions: Array
    worst: Array
    squares: Array


@dataclass(frozen=True, slots=True)
class ToleranceSheet:
    """What a plot of tolerances is drawn from.

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
) -> "Figure":
    """Draw derivatives of each quantity that has any over the motion, the largest few of its dimensions.

    They are given per mm or per degree, so that lengths and angles compare.

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
def tolerance_plot(sheet: ToleranceSheet) -> "Figure":
    """Draw bands around paths, magnified as they say, deviations of quantities, and the shares of dimensions.

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


def _draw_path(ax: "Axes", path: PathBand) -> None:
    """Draw a path in its plane, with bands across it."""
    flat, normal = in_plane(path.positions)
    extent = float(np.ptp(flat, axis=0).max())
    widest = float(path.worst.max(initial=0.0))
    times = 1.0 if widest == 0.0 else _round_number(WIDE * extent / widest)
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


def _draw_band(ax: "Axes", sheet: ToleranceSheet, quantity: str, band: Band) -> None:
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


def _draw_shares(ax: "Axes", band: Band) -> None:
    order = sorted(band.shares, key=lambda name: band.shares[name])[-8:]
    ax.barh(order, [100.0 * band.shares[name] for name in order], color=COLOURS[0])
    ax.tick_params(axis="y", labelsize=7.5)
    ax.set_title("share of the variance, %")


def _axis(over: str, instants: Array) -> Array:
    return np.rad2deg(instants) if over == "angle" else instants


def _round_number(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most a value, and 1 at least."""
    power = 10.0 ** np.floor(np.log10(value))
    return max(1.0, float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value)))


def _require_few(quantities: Mapping[str, object]) -> None:
    if not 1 <= len(quantities) <= MAX_QUANTITIES:
        raise InputError(
            f"{len(quantities)} quantities; a sheet holds 1 to {MAX_QUANTITIES}, name fewer with --of"
        )
