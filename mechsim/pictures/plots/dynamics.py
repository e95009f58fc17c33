"""Plots of dynamics: torque over a revolution, reactions in polar form, energy balance, speed fluctuation."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.mechanism.force_record import Fluctuation, ForceRecord
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots import figure as figures
from mechsim.pictures.plots.figure import COLOURS, LEGEND_RIGHT, STYLES, along_axis, blank, label_of, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RINGS = "#222831"


@styled()
def dynamics_sheet(
    forces: ForceRecord,
    torque_parts: Mapping[str, Array],
    power_stored: Array,
    fluctuation: Fluctuation | None = None,
    simulated: ForceRecord | None = None,
) -> "Figure":
    """Draw torque or drives, reactions, powers and speed fluctuation on one sheet.

    Args:
        forces: forces and energies of a prescribed motion.
        torque_parts: components of the drive torque, (n,) each in [N m].
        power_stored: rate at which the energy stored grows, (n,) in [W].
        fluctuation: a steady turn under a constant torque; None draws none.
        simulated: the forces by MuJoCo; None draws none.
    """
    figure, axes = blank(2, 2, (10.4, 6.6))
    if forces.drives:
        _drives(axes[0, 0], forces, simulated)
    else:
        _torque(axes[0, 0], forces, torque_parts, simulated)
    _polar(axes[0, 1], forces)
    _powers(axes[1, 0], forces, power_stored)
    if fluctuation is None:
        axes[1, 1].set_axis_off()
    else:
        _speeds(axes[1, 1], fluctuation)
    return figure


def _simulated(ax: "Axes", x: Array, y: Array, label: str | None) -> None:
    """Draw some values by MuJoCo as rings."""
    every = slice(None, None, max(1, len(x) // 48))
    ax.plot(x[every], y[every], "o", ms=3.5, mfc="none", mew=0.7, color=RINGS, label=label)


def _torque(
    ax: "Axes", result: ForceRecord, components: Mapping[str, Array], simulated: ForceRecord | None
) -> None:
    degrees = np.rad2deg(result.angle)
    factor, unit = readable(result.torque, "N m")
    shown = {name: values for name, values in components.items() if np.abs(values).max() > 1e-6 * factor}
    for i, (name, values) in enumerate(shown.items()):
        if len(shown) > 1:
            ax.plot(degrees, values / factor, color=COLOURS[i + 1], ls="--", lw=1.0, label=label_of(name))
    ax.plot(degrees, result.torque / factor, color=COLOURS[0], label="drive")
    if simulated is not None:
        _simulated(ax, np.rad2deg(simulated.angle), simulated.torque / factor, "MuJoCo")
    ax.set_ylabel(f"torque [{unit}]")
    figures.flattened(
        ax, max(float(np.abs(values).max(initial=0.0)) for values in components.values()) / factor, unit
    )
    along_axis(ax)
    ax.legend(**LEGEND_RIGHT)


def _drives(ax: "Axes", result: ForceRecord, simulated: ForceRecord | None) -> None:
    """Each driver's torque or force over time."""
    assert result.time is not None
    for i, (name, values) in enumerate(result.drives.items()):
        factor, unit = readable(values, "N" if name in result.straight else "N m")
        style: dict[str, Any] = {"color": COLOURS[i % 6], "ls": STYLES[i // 6 % 3]}
        ax.plot(result.time, values / factor, label=label_of(f"{name} [{unit}]"), **style)
        if simulated is not None and simulated.time is not None:
            _simulated(ax, simulated.time, simulated.drives[name] / factor, None if i else "MuJoCo")
    ax.set_ylabel("drives")
    ax.set_xlabel("time [s]")
    ax.legend(**LEGEND_RIGHT)


def _polar(ax: "Axes", result: ForceRecord) -> None:
    """Draw all forces in the x-y plane, as vectors from one origin, of minimum norm if undetermined."""
    gaps = result.unbounded[:, None]
    forces = {name: np.where(gaps, np.nan, reaction.force) for name, reaction in result.reactions.items()}
    factor, unit = readable(np.concatenate(list(forces.values())), "N")
    for i, (name, force) in enumerate(forces.items()):
        ax.plot(*(force[:, :2] / factor).T, color=COLOURS[i % 6], ls=STYLES[i // 6 % 3], label=label_of(name))
    ax.plot(0.0, 0.0, "+", color=RINGS)
    ax.set_xlabel(f"force along x [{unit}]")
    ax.set_ylabel(f"force along y [{unit}]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend(**LEGEND_RIGHT)


def _powers(ax: "Axes", result: ForceRecord, power_stored: Array) -> None:
    along = result.time if result.drives and result.time is not None else np.rad2deg(result.angle)
    powers: dict[str, Array] = {
        "drive": result.power_in,
        "loads": result.power_loads,
        "less lost": -result.power_lost,
        "less stored": -power_stored,
    }
    factor, _ = figures.draw_curves(ax, along, powers, "power into the machine", "W")
    ax.plot(along, np.sum([*powers.values()], axis=0) / factor, color=RINGS, lw=1.0, label="sum")
    along_axis(ax, bool(result.drives))
    ax.legend(**LEGEND_RIGHT)


def _speeds(ax: "Axes", fluctuation: Fluctuation) -> None:
    label = f"flywheel {fluctuation.flywheel:.3g} kg m², δ = {fluctuation.coefficient:.3g}"
    ax.plot(np.rad2deg(fluctuation.angle), fluctuation.speed, color=COLOURS[0], ls=STYLES[0], label=label)
    ax.axhline(fluctuation.mean, color=RINGS, lw=0.8)
    figures.flattened(ax, abs(float(fluctuation.mean)), "rad/s")
    ax.set_ylabel("crank speed [rad/s]")
    along_axis(ax)
    ax.legend(**LEGEND_RIGHT)
