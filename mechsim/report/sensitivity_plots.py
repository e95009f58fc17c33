"""Plots of sensitivities and tolerances."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np

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
from mechsim.studies.sensitivity.sensitivity import Sensitivity
from mechsim.studies.sensitivity.tolerance_analysis import PathDeviation, ToleranceStudy, path_bands

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# largest number of quantities on a sheet, and of dimensions in each
MAX_QUANTITIES, LINES = 12, 12
# drawn width of the widest band, relative to the path's extent
MAX_BAND_WIDTH = 0.06
# SI unit -> factor and name of the unit that is drawn
SHOWN: dict[str, tuple[float, str]] = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "°")}


@styled()
def sensitivity_plot(table: Sensitivity) -> Figure:
    """Draw derivatives of each quantity that has any over the motion, the largest few of its dimensions.

    They are drawn per mm or per degree, so that lengths and angles are comparable.

    Raises:
        InputError: for more quantities than a sheet holds.
    """
    over, _ = table.moved.over
    by = {name: dimension.unit for name, dimension in table.dimensions.items()}
    every = {quantity: table.derivatives(quantity) for quantity in table.values}
    curves = {
        quantity: lines
        for quantity, lines in every.items()
        if any(derivative.any() for derivative in lines.values())
    } or every
    _require_few(curves)
    figure, axes = blank(len(curves), 1, (7.2, 0.6 + 2.1 * len(curves)), sharex=True)
    names = [*dict.fromkeys(name for lines in curves.values() for name in lines)]
    for ax, (quantity, derivatives) in zip(axes[:, 0], curves.items(), strict=True):
        own = table.units[quantity]
        times, unit = SHOWN.get(own, (1.0, own))
        lines = {
            name: derivative * times / SHOWN.get(by[name], (1.0, ""))[0]
            for name, derivative in derivatives.items()
        }
        if unit == own:
            factor, unit = readable(np.concatenate([*lines.values()]), unit)
            lines = {name: derivative / factor for name, derivative in lines.items()}
        per = [shown for measure, (_, shown) in SHOWN.items() if measure in {by[name] for name in lines}]
        order = [name for name in _largest_first(lines) if lines[name].any()]
        for name in order[:LINES]:
            i = names.index(name)
            style = STYLES[i // len(COLOURS) % len(STYLES)]
            colour = COLOURS[i % len(COLOURS)]
            ax.plot(_instants(table), lines[name], style, color=colour, label=label_of(name))
        remaining = f", {len(order) - LINES} smaller left out" if len(order) > LINES else ""
        ax.set_title(f"derivatives of {quantity} [{unit} per {' or '.join(per) or '1'}]{remaining}")
        if order:
            ax.legend(**LEGEND_RIGHT, fontsize=8.0)
    along_axis(axes[-1, 0], over != "angle")
    return figure


def _largest_first(lines: Mapping[str, Array]) -> list[str]:
    return sorted(lines, key=lambda name: -float(np.abs(lines[name]).max(initial=0.0)))


@styled()
def tolerance_plot(study: ToleranceStudy) -> Figure:
    """Draw magnified bands around paths, deviations of quantities, and the shares of dimensions.

    Raises:
        InputError: for more quantities than a sheet holds.
    """
    paths, every = path_bands(study.table, study), [*study.table.values]
    quantities = [quantity for quantity in every if study.worst(quantity).any()] or every
    _require_few(quantities)
    rows = len(quantities) + len(paths)
    high = [3.6] * len(paths) + [2.1] * len(quantities)
    options = {"gridspec_kw": {"width_ratios": (2.6, 1.0), "height_ratios": high}}
    figure, axes = blank(rows, 2, (8.4, 0.6 + sum(high)), **options)
    for row, path in zip(axes, paths, strict=False):
        _draw_path(row[0], path)
        row[1].legend(*row[0].get_legend_handles_labels(), loc="center left", fontsize=8.0)
        row[1].set_axis_off()
    for row, quantity in zip(axes[len(paths) :], quantities, strict=True):
        _draw_band(row[0], study, quantity)
        _draw_shares(row[1], study.shares(quantity))
        along_axis(row[0], study.table.moved.over[0] != "angle")
    for ax in axes[len(paths) : -1, 0]:
        ax.set_xlabel("")
    return figure


def _draw_path(ax: Axes, path: PathDeviation) -> None:
    """Draw a path in its plane, with bands across it."""
    flat, normal = _in_plane(path.positions)
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


def _in_plane(positions: Array) -> tuple[Array, Array]:
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


def _draw_band(ax: Axes, study: ToleranceStudy, quantity: str) -> None:
    instants, own = _instants(study.table), study.table.units[quantity]
    times, unit = SHOWN.get(own, (1.0, own))
    worst, squares = times * study.worst(quantity), times * study.squares(quantity)
    random = study.random(quantity)
    ax.fill_between(instants, -worst, worst, color=COLOURS[1], alpha=0.25, label="worst case")
    ax.plot(instants, squares, "--", color=COLOURS[0], label="root of squares")
    ax.plot(instants, -squares, "--", color=COLOURS[0])
    if random:
        low, high, label = times * random["low"], times * random["high"], "95 % of random mechanisms"
        ax.fill_between(instants, low, high, color=COLOURS[0], alpha=0.35, label=label)
    ax.set_title(f"{quantity} is off by [{unit}]")
    ax.margins(y=0.3)
    ax.legend(fontsize=7.5, loc="upper center", ncols=3)


def _draw_shares(ax: Axes, shares: Mapping[str, float]) -> None:
    order = sorted(shares, key=lambda name: shares[name])[-8:]
    ax.barh(order, [100.0 * shares[name] for name in order], color=COLOURS[0])
    ax.tick_params(axis="y", labelsize=7.5)
    ax.set_title("share of the variance, %")


def _instants(table: Sensitivity) -> Array:
    over, instants = table.moved.over
    return np.rad2deg(instants) if over == "angle" else instants


def _require_few(quantities: Collection[str]) -> None:
    if not 1 <= len(quantities) <= MAX_QUANTITIES:
        raise InputError(
            f"{len(quantities)} quantities; a sheet holds 1 to {MAX_QUANTITIES}, name fewer with --of"
        )
