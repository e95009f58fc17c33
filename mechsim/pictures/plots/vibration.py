"""Plots of runs from an initial state and of vibrations: histories, Bode diagram, modes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.links import GROUND, IDENTITY
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.moved_links import moved_links
from mechsim.numerics.arrays import Array
from mechsim.pictures.plots import figure as figures
from mechsim.pictures.plots.figure import COLOURS, LEGEND_RIGHT, STYLES, along_axis, blank, label_of, styled
from mechsim.shapes.body import edges, stations
from mechsim.shapes.camera import directions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REST = "#9aa3ad"
# modes in a row of a sheet
ACROSS = 3


@styled()
def history_plot(motion: Motion, energies: Mapping[str, Array], quantities: Mapping[str, Array]) -> Figure:
    """Draw the coordinates of joints, other quantities and the energies of a run over time.

    Args:
        motion: of a run from an initial state.
        energies: "kinetic", "potential", "work" of motor and loads and "lost", (n,) each in [J]; the
            potential energy is drawn from zero on.
        quantities: label with unit -> values, (n,); each has axes of its own.
    """
    assert motion.time is not None
    time = motion.time
    units = sorted({joint.unit for joint in motion.joints.values()}, reverse=True)
    count = len(units) + len(quantities) + 1
    figure, axes = blank(count, 1, (6.4, 1.9 * count), sharex=True)
    for ax, unit in zip(axes[: len(units), 0], units, strict=True):
        _coordinates(ax, time, motion, unit)
    for i, (ax, (label, values)) in enumerate(zip(axes[len(units) : -1, 0], quantities.items(), strict=True)):
        ax.plot(time, values, color=COLOURS[i % 6])
        ax.set_ylabel(label_of(label))
    curves = {
        "kinetic": energies["kinetic"],
        "potential": energies["potential"] - energies["potential"][0],
        "work of motor and loads": energies["work"],
        "lost": energies["lost"],
    }
    figures.draw_curves(axes[-1, 0], time, curves, "energy", "J")
    axes[-1, 0].legend(**LEGEND_RIGHT)
    axes[-1, 0].set_xlabel("time [s]")
    return figure


@styled()
def quantity_plot(motion: Motion, quantities: Mapping[str, Array]) -> Figure:
    """Draw quantities over the crank angle, of motions in time over time.

    Args:
        motion: at n instants.
        quantities: label with unit -> values, (n,) in SI; each has axes of its own.
    """
    figure, axes = blank(len(quantities), 1, (5.8, 0.8 + 2.0 * len(quantities)), sharex=True)
    for i, (ax, (label, values)) in enumerate(zip(axes[:, 0], quantities.items(), strict=True)):
        ax.plot(figures.abscissa(motion), values, color=COLOURS[i % 6])
        ax.set_ylabel(label_of(label))
        figures.flattened(ax, float(np.abs(values).max(initial=0.0)), "")
    along_axis(axes[-1, 0], bool(motion.drivers))
    return figure


def _coordinates(ax: Axes, time: Array, motion: Motion, unit: str) -> None:
    """Draw the coordinates of joints with one unit; those below rounding of the largest are zero."""
    curves: dict[str, Array] = {}
    for name, joint in motion.joints.items():
        if joint.unit == unit:
            values = joint.value.reshape(len(time), -1)
            for k, column in enumerate(values.T):
                curves[f"{name}.q{k if values.shape[1] > 1 else ''}"] = column
    # of angles one radian, of lengths the distance of the points from the origin
    sizes = [np.ones(1)] if unit == "rad" else [point.position for point in motion.points.values()]
    scale = max(float(np.abs(values).max(initial=0.0)) for values in [*sizes, *curves.values()])
    curves = {name: np.where(np.abs(q) < figures.ROUNDED * scale, 0.0, q) for name, q in curves.items()}
    factor, text = figures.draw_curves(ax, time, curves, "angle" if unit == "rad" else "displacement", unit)
    figures.flattened(ax, scale / factor, text)
    ax.legend(**LEGEND_RIGHT)


@styled()
def bode_plot(response: Mapping[str, Array], label: str) -> Figure:
    """Draw magnitude and phase of a frequency response.

    Args:
        response: "frequency" in [Hz], "magnitude", "phase" in [rad], (n,) each.
        label: of the magnitude, with its unit.
    """
    figure, ((magnitude,), (phase,)) = blank(2, 1, (5.6, 4.4), sharex=True)
    frequency = response["frequency"]
    magnitude.loglog(frequency, response["magnitude"], color=COLOURS[0])
    magnitude.set_ylabel(label_of(label))
    figures.decades(magnitude.yaxis)
    phase.semilogx(frequency, np.rad2deg(response["phase"]), color=COLOURS[1])
    phase.set_ylabel("phase [°]")
    phase.set_xlabel("frequency [Hz]")
    figures.round_numbers(phase.xaxis)
    return figure


@styled()
def mode_plot(mechanism: Mechanism, modes: Mapping[str, Motion]) -> Figure:
    """Draw the mechanism at rest in grey, and at both ends of each mode's vibration.

    Args:
        mechanism: whose.
        modes: title -> one cycle along the mode shape.

    Raises:
        InputError: where there is no mode.
    """
    if not modes:
        raise InputError(f"{mechanism.name} has no mode to draw: nothing of it can move")
    across, down = min(len(modes), ACROSS), -(-len(modes) // ACROSS)
    figure, axes = blank(down, across, (3.4 * across, 3.0 * down))
    back, up = directions(mechanism, "iso")
    view = np.column_stack([np.cross(up, back), up])
    for ax, (title, motion) in zip(axes.flat, modes.items(), strict=False):
        half = (len(motion) - 1) // 2
        _frame(ax, mechanism, motion, half // 2, view, REST, "-")
        for i, frame in enumerate((0, half)):
            _frame(ax, mechanism, motion, frame, view, COLOURS[i], STYLES[i])
        for point in motion.points.values():
            ax.plot(*(point.position @ view).T, color=COLOURS[2], lw=1.0)
        ax.set_title(label_of(title), fontsize=8.0)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_axis_off()
    for ax in axes.flat[len(modes) :]:
        ax.set_axis_off()
    return figure


def _frame(
    ax: Axes, mechanism: Mechanism, motion: Motion, frame: int, view: Array, colour: Any, style: str
) -> None:
    """Draw the links as lines at one instant."""
    poses = {GROUND: IDENTITY, **moved_links(mechanism, motion)}
    for link in mechanism.links:
        pose = poses[link.name].select(frame)
        for ends in edges(stations(mechanism, link.name)):
            line = np.array([pose.point(tuple(end)) @ view for end in ends])
            ax.plot(*line.T, color=colour, ls=style, lw=1.6, solid_capstyle="round")
