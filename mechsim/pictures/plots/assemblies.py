"""Curves of assemblies over any two or three coordinates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.errors import InputError, needs
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import BESIDE, COLOURS, STYLES, blank, locator, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK = "#222831"
# a gap in the angles of all curves wider than this, in [rad], is a place to cut the turn
GAP = 0.2
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class AssemblyTable:
    """What a plot of assemblies is drawn from; each table is column -> values in SI.

    Attributes:
        curves: a table each.
        units: column -> "rad", "m", or "" of an arc.
        dead_centres: a table of the places where the crank turns back.
        meetings: a table of those where curves meet.
    """

    curves: Sequence[Mapping[str, Array]]
    units: Mapping[str, str]
    dead_centres: Mapping[str, Array] = field(default_factory=dict[str, Array])
    meetings: Mapping[str, Array] = field(default_factory=dict[str, Array])


@styled()
def assembly_plot(table: AssemblyTable, of: Sequence[str]) -> "Figure":
    """Draw all curves over two coordinates, or three in perspective: dead centres as dots, meetings as rings.

    Args:
        table: what is drawn.
        of: two or three columns of it.

    Raises:
        InputError: for another number of them.
    """
    if len(of) not in (2, 3):
        raise InputError(f"{len(of)} coordinates to plot over ({', '.join(of)}); give two or three")
    scales = [_Scale(table, name) for name in of]
    kind = {"projection": "3d"} if len(of) == 3 else {}
    figure, axes = blank(1, 1, (6.0, 4.6) if kind else (6.0, 3.8), subplot_kw=kind)
    ax: Any = axes[0, 0]
    for i, curve in enumerate(table.curves):
        line = _broken([scale.drawn(curve[scale.name]) for scale in scales])
        # curves that lie on each other in these coordinates are all to be seen
        width = 1.4 + min(1.3 * (len(table.curves) - 1 - i), 5.2)
        ax.plot(*line, color=COLOURS[i % 6], ls=STYLES[i // 6 % 3], lw=width, label=f"component {i + 1}")
    for marked, label, look in (
        (table.dead_centres, "dead centre", {"ms": 5, "color": INK}),
        (table.meetings, "assemblies meet", {"ms": 9, "mfc": "none", "mew": 1.4, "color": INK}),
    ):
        if marked and len(marked[of[0]]):
            ax.plot(*(scale.drawn(marked[scale.name]) for scale in scales), "o", label=label, **look)
    for axis, scale in zip("xyz", scales, strict=False):
        getattr(ax, f"set_{axis}label")(f"{scale.label} [{scale.unit}]" if scale.unit else scale.label)
        ticks = scale.ticks(sparse=bool(kind))
        if ticks is not None:
            getattr(ax, f"{axis}axis").set_major_locator(ticks)
    lengths = {table.units[name] for name in of} == {"m"}
    if len(of) == 3:
        _in_space(ax, scales if lengths else None)
        figure.legend(loc="outside upper left", ncols=3)
    else:
        if lengths:
            ax.set_aspect("equal", adjustable="datalim")
        ax.legend(**BESIDE)
    return figure


class _Scale:
    """How a column is drawn: lengths in a readable unit, angles in degrees, one turn cut where none is."""

    def __init__(self, table: AssemblyTable, name: str):
        self.name = name
        values = np.concatenate([curve[name] for curve in table.curves])
        self.turned = table.units[name] == "rad"
        # what swings over more than a turn and comes back, as a pinion on its rack, is drawn as it is counted
        gains = [abs(float(curve[name][-1] - curve[name][0])) for curve in table.curves]
        wide = max(float(np.ptp(curve[name])) for curve in table.curves) > TURN
        self.cut = self.turned and not (wide and max(gains) < np.pi)
        self.label, self.low = ("crank angle", 0.0) if name == "angle" else (name, 0.0)
        if self.turned:
            self.factor, self.unit, self.low = np.pi / 180.0, "°", _cut(values)
        else:
            self.factor, self.unit = readable(values, "m") if table.units[name] == "m" else (1.0, "")
        self.every = self.drawn(values)

    def drawn(self, values: Array) -> Array:
        """Return values as they stand on the axis."""
        if self.cut:
            # what is a rounding error below the cut is no turn away
            values = self.low + np.mod(values - self.low + ROUNDING, TURN) - ROUNDING
        return values / self.factor

    def ticks(self, *, sparse: bool) -> Any:
        """Return what puts the ticks; None leaves it to the axis."""
        with needs("pictures"):
            from matplotlib.ticker import MaxNLocator

        spread = float(np.ptp(self.every))
        if self.cut and spread > 90.0:
            return locator((90.0 if sparse else 60.0) if spread > 200.0 else 30.0)
        return MaxNLocator(4) if sparse else None


def _cut(values: Array) -> float:
    """Return the angle in [rad] at which a turn is cut: in the middle of the widest gap, or at nought."""
    known = np.sort(np.mod(values, TURN))
    gaps = np.diff(known, append=known[0] + TURN)
    widest = int(np.argmax(gaps))
    if gaps[widest] < GAP:
        return 0.0
    cut = float(known[widest] + 0.5 * gaps[widest])
    # counted about nought rather than about a turn
    middle = cut + np.pi
    return cut - TURN * float(np.round(middle / TURN))


def _broken(columns: Sequence[Array]) -> list[Array]:
    """Return columns with a gap wherever one of them leaps over the cut of its turn."""
    leaps = np.zeros(len(columns[0]) - 1, dtype=np.bool_)
    for column in columns:
        steps = np.abs(np.diff(column))
        leaps |= steps > 0.5 * max(float(np.ptp(column)), 1e-300)
    at = np.flatnonzero(leaps) + 1
    return [np.insert(column, at, np.nan) for column in columns]


def _in_space(ax: Any, alike: Sequence[_Scale] | None) -> None:
    """Set up axes in perspective; where all three are lengths, one scale for all."""
    if alike is not None:
        middles = [0.5 * (scale.every.min() + scale.every.max()) for scale in alike]
        half = 0.55 * max(float(np.ptp(scale.every)) for scale in alike)
        for axis, middle in zip("xyz", middles, strict=True):
            getattr(ax, f"set_{axis}lim")(middle - half, middle + half)
    for axis in "xyz":
        getattr(ax, f"{axis}axis").set_pane_color("#f5f6f8")
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.label.set_rotation(90.0)
    ax.set_box_aspect((1.0, 1.0, 1.0), zoom=0.92)
    ax.view_init(elev=22.0, azim=35.0)
