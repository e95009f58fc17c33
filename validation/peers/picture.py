"""The work-precision plot of all peers: errors over time on logarithmic axes, a column for each problem."""

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mechsim.pictures.plots.figure import COLOURS, blank, decades, drawn, styled

if TYPE_CHECKING:
    from compare import Row
    from matplotlib.axes import Axes

TITLES = {"rssr": "spatial four-bar (rssr)", "four_bar": "planar four-bar (four_bar)"}
QUANTITIES = {"position": "largest position error [crank]", "torque": "largest torque error [largest torque]"}
# errors from here on are no solution and are not drawn
MAX_ERROR = 1.0
# series of one library share its colour and differ by marker and line
LIBRARIES = ("mechsim", "Exudyn", "Pinocchio", "scipy", "pylinkage", "MuJoCo")
GREY, PALETTE = "#8a919b", 48
MARKERS, LINES = "osDv^P", ("-", "--", ":", "-.")


@styled()
def work_precision(rows: Sequence["Row"]) -> bytes:
    """Draw rows as a PNG: errors of position and of torque over ms a turn."""
    names = list(dict.fromkeys(row.problem for row in rows))
    looks = _looks(list(dict.fromkeys(row.series for row in rows)))
    figure_size = 4.2 * len(names) + 2.6, 7.2
    figure, axes = blank(len(QUANTITIES), len(names), figure_size, sharex="col", sharey="row")
    handles: dict[str, Any] = {}
    for quantity, line in zip(QUANTITIES, axes, strict=True):
        for name, ax in zip(names, line, strict=True):
            handles |= _curves(ax, [row for row in rows if row.problem == name], quantity, looks)
        line[0].set_ylabel(QUANTITIES[quantity])
    for name, top, bottom in zip(names, axes[0], axes[-1], strict=True):
        top.set_title(TITLES.get(name, name))
        bottom.set_xlabel("processor time of the solver for one turn [ms]")
    shown = [series for series in looks if series in handles]
    figure.legend([handles[item] for item in shown], shown, loc="outside right upper", fontsize=7.5)
    return _smaller(drawn(figure, "png"))


def _curves(ax: "Axes", rows: Sequence["Row"], quantity: str, looks: dict[str, Any]) -> dict[str, Any]:
    """Draw the curves of a panel; return the line of each series."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    lines: dict[str, Any] = {}
    for series, look in looks.items():
        selected = [row for row in rows if row.series == series and 0.0 < getattr(row, quantity) < MAX_ERROR]
        if selected:
            errors = [getattr(row, quantity) for row in selected]
            (lines[series],) = ax.plot([row.ms for row in selected], errors, label=series, **look)
    decades(ax.yaxis)
    ax.minorticks_off()
    ax.xaxis.set_major_formatter("{x:g}")
    return lines


def _looks(series_names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the line style of each series."""
    looks: dict[str, dict[str, Any]] = {}
    counts: dict[str, int] = {}
    for series in series_names:
        library = next(name for name in LIBRARIES if series.startswith(name))
        index = counts[library] = counts.get(library, -1) + 1
        number = LIBRARIES.index(library)
        looks[series] = {
            "color": COLOURS[number] if number < len(COLOURS) else GREY,
            "marker": MARKERS[index % len(MARKERS)],
            "ls": LINES[index % len(LINES)],
            "ms": 4,
            "lw": 2.2 if library == "mechsim" else 1.1,
        }
    return looks


def _smaller(drawing: bytes) -> bytes:
    """Return a PNG with a palette of few colours."""
    from PIL import Image

    out = io.BytesIO()
    with Image.open(io.BytesIO(drawing)) as image:
        image.convert("RGB").quantize(PALETTE).save(out, "PNG", optimize=True)
    return out.getvalue()
