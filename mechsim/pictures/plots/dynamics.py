"""Plots of dynamics: torque over a revolution, reactions in polar form, energy balance, speed fluctuation."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mechsim.mechanism.force_record import Fluctuation, ForceRecord
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import (
    COLOURS,
    LEGEND_RIGHT,
    STYLES,
    along_axis,
    angle_axis,
    blank,
    draw_curves,
    flattened,
    label_of,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RINGS = "#222831"


class Prescribed(Protocol):
    """A mechanism under a prescribed crank, with the components of its drive torque."""

    @property
    def forces(self) -> ForceRecord:
        """Forces and energies."""
        ...

    @property
    def torque_parts(self) -> Mapping[str, Array]:
        """Components of the drive torque, (n,) each in [N m]."""
        ...

    @property
    def power_stored(self) -> Array:
        """Rate at which the energy stored grows, (n,) in [W]."""
        ...


class WithEnergies(Protocol):
    """A run with its energies, (n,) each in [J]."""

    @property
    def kinetic(self) -> Array:
        """Kinetic energy."""
        ...

    @property
    def potential(self) -> Array:
        """Of gravity and springs."""
        ...

    @property
    def work(self) -> Array:
        """Done by motor and loads."""
        ...

    @property
    def lost(self) -> Array:
        """In friction, dampers and impacts."""
        ...


def draw_energies(ax: "Axes", time: Array, run: WithEnergies) -> None:
    """Draw the energies of a run; the potential energy starts at zero."""
    energies = {
        "kinetic": run.kinetic,
        "potential": run.potential - run.potential[0],
        "work of motor and loads": run.work,
        "lost": run.lost,
    }
    draw_curves(ax, time, energies, "energy", "J")
    ax.legend(**LEGEND_RIGHT)


@styled()
def dynamics_sheet(
    study: Prescribed,
    fluctuation: Fluctuation | None = None,
    simulated: ForceRecord | None = None,
) -> "Figure":
    """Draw torque or drives, reactions, powers and speed fluctuation on one sheet."""
    figure, axes = blank(2, 2, (10.4, 6.6))
    ax = axes[0, 0]
    if study.forces.drives:
        _drives(ax, study.forces, simulated)
    else:
        _torque(ax, study, simulated)
    _polar(axes[0, 1], study)
    _powers(axes[1, 0], study)
    if fluctuation is None:
        axes[1, 1].set_axis_off()
    else:
        _speeds(axes[1, 1], fluctuation)
    return figure


def _torque(ax: "Axes", study: Prescribed, simulated: ForceRecord | None) -> None:
    result, lines, degrees = study.forces, study.torque_parts, np.rad2deg(study.forces.angle)
    factor, unit = readable(result.torque, "N m")
    shown = {name: values for name, values in lines.items() if np.abs(values).max() > 1e-6 * factor}
    for i, (name, values) in enumerate(shown.items()):
        if len(shown) > 1:
            ax.plot(degrees, values / factor, color=COLOURS[i + 1], ls="--", lw=1.0, label=label_of(name))
    ax.plot(degrees, result.torque / factor, color=COLOURS[0], label="drive")
    if simulated is not None:
        every = max(1, len(simulated) // 48)
        x, y = np.rad2deg(simulated.angle[::every]), simulated.torque[::every] / factor
        ax.plot(x, y, "o", ms=3.5, mfc="none", mew=0.7, color=RINGS, label="MuJoCo")
    ax.set_ylabel(f"torque [{unit}]")
    flattened(ax, max(float(np.abs(values).max(initial=0.0)) for values in lines.values()) / factor, unit)
    angle_axis(ax)
    ax.legend(**LEGEND_RIGHT)


def _drives(ax: "Axes", result: ForceRecord, simulated: ForceRecord | None) -> None:
    """Each driver's torque or force over time."""
    assert result.time is not None
    scales = {name: readable(values, _unit(result, name)) for name, values in result.drives.items()}
    for i, (name, values) in enumerate(result.drives.items()):
        factor, unit = scales[name]
        style: dict[str, Any] = {"color": COLOURS[i % 6], "ls": STYLES[i // 6 % 3]}
        ax.plot(result.time, values / factor, label=label_of(f"{name} [{unit}]"), **style)
        if simulated is not None and simulated.time is not None:
            every = max(1, len(simulated) // 48)
            x, y = simulated.time[::every], simulated.drives[name][::every] / factor
            label = "MuJoCo" if i == 0 else None
            ax.plot(x, y, "o", ms=3.5, mfc="none", mew=0.7, color=RINGS, label=label)
    ax.set_ylabel("drives")
    ax.set_xlabel("time [s]")
    ax.legend(**LEGEND_RIGHT)


def _joint_forces(study: Prescribed) -> dict[str, Array]:
    """Return each joint's force, (n, 3), of minimum norm if undetermined, NaN where it has no limit."""
    gaps = study.forces.unbounded[:, None]
    return {name: np.where(gaps, np.nan, reaction.force) for name, reaction in study.forces.reactions.items()}


def _unit(result: ForceRecord, name: str) -> str:
    return "N" if name in result.straight else "N m"


def _polar(ax: "Axes", study: Prescribed) -> None:
    """Draw all forces in the x-y plane, as vectors from one origin."""
    forces = _joint_forces(study)
    factor, unit = readable(np.concatenate(list(forces.values())), "N")
    for i, (name, force) in enumerate(forces.items()):
        ax.plot(*(force[:, :2] / factor).T, color=COLOURS[i % 6], ls=STYLES[i // 6 % 3], label=label_of(name))
    ax.plot(0.0, 0.0, "+", color=RINGS)
    ax.set_xlabel(f"force along x [{unit}]")
    ax.set_ylabel(f"force along y [{unit}]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend(**LEGEND_RIGHT)


def _powers(ax: "Axes", study: Prescribed) -> None:
    result = study.forces
    along = result.time if result.drives and result.time is not None else np.rad2deg(result.angle)
    powers: dict[str, Array] = {
        "drive": result.power_in,
        "loads": result.power_loads,
        "less lost": -result.power_lost,
        "less stored": -study.power_stored,
    }
    factor, _ = draw_curves(ax, along, powers, "power into the machine", "W")
    ax.plot(along, np.sum([*powers.values()], axis=0) / factor, color=RINGS, lw=1.0, label="sum")
    along_axis(ax, bool(result.drives))
    ax.legend(**LEGEND_RIGHT)


def _speeds(ax: "Axes", fluctuation: Fluctuation) -> None:
    label = f"flywheel {fluctuation.flywheel:.3g} kg m², δ = {fluctuation.coefficient:.3g}"
    ax.plot(np.rad2deg(fluctuation.angle), fluctuation.speed, color=COLOURS[0], ls=STYLES[0], label=label)
    ax.axhline(fluctuation.mean, color=RINGS, lw=0.8)
    flattened(ax, abs(float(fluctuation.mean)), "rad/s")
    ax.set_ylabel("crank speed [rad/s]")
    angle_axis(ax)
    ax.legend(**LEGEND_RIGHT)
