"""Maps of a study of extremes: the error along each axis, and how each run ended."""

import math
from typing import TYPE_CHECKING

from mechsim.errors import needs
from mechsim.pictures.plots.figure import COLOURS, blank, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mechsim.studies.extremes import StabilityMap

# outcome -> height at which it is drawn (None: at its error), marker and colour
MARKERS: dict[str, tuple[float | None, str, str]] = {
    "passed": (None, "o", "#1b7f5c"),
    "failed": (None, "s", "#c77700"),
    "changed assembly": (None, "D", "#8e44ad"),
    "diverged": (1e2, "x", "#b00020"),
    "cannot assemble": (1e3, "^", "#5b6470"),
}
FLOOR = 1e-17


@styled()
def extremes_map(study: "StabilityMap") -> "Figure":
    """Draw one panel per axis: errors in characteristic lengths, a line per mechanism, a marker per outcome.

    Borders found by bisection are thin upright lines; the bound is dashed.
    """
    from mechsim.studies.extremes.stability_map import AXES
    from mechsim.studies.extremes.trial import POSITION_TOLERANCE

    names = [axis for axis in AXES if any(trial.axis == axis for trial in study.trials)]
    rows = math.ceil(len(names) / 2)
    mechanisms = sorted({trial.mechanism for trial in study.trials})
    figure, axes = blank(rows, 2, (11.0, 2.6 * rows + 0.6))
    for ax, name in zip(axes.flat, names, strict=False):
        _panel(ax, study, name, mechanisms)
        ax.axhline(POSITION_TOLERANCE, color="#b00020", lw=1.0, ls="--")
        ax.set_xlabel(AXES[name])
        ax.set_ylabel("error / size")
        ax.set_title(name)
    for ax in list(axes.flat)[len(names) :]:
        ax.set_axis_off()
    _legend(figure)
    return figure


def _panel(ax: "Axes", study: "StabilityMap", name: str, mechanisms: list[str]) -> None:
    trials = [trial for trial in study.trials if trial.axis == name]
    for i, mechanism in enumerate(mechanisms):
        own = sorted((t for t in trials if t.mechanism == mechanism), key=lambda t: t.value)
        line = [(t.value, max(t.error, FLOOR)) for t in own if t.error is not None and t.value > 0.0]
        if line:
            ax.loglog(*zip(*line, strict=True), lw=0.8, color=COLOURS[i % 6], alpha=0.5)
    for outcome, (level, marker, colour) in MARKERS.items():
        points = [
            (t.value, level or max(t.error or FLOOR, FLOOR))
            for t in trials
            if t.outcome == outcome and t.value > 0.0
        ]
        if points:
            ax.loglog(*zip(*points, strict=True), marker, ms=3.5, color=colour, mfc="none", mew=0.9)
    for border in study.borders:
        if border.axis == name and border.outside > 0.0:
            ax.axvline((border.inside * border.outside) ** 0.5, color="#9aa3ad", lw=0.6)
    ax.set_ylim(FLOOR / 3.0, 1e4)
    if name in ("dead centre", "beyond dead centre", "near tangent"):
        ax.invert_xaxis()


def _legend(figure: "Figure") -> None:
    with needs("pictures"):
        from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], ls="", marker=marker, color=colour, mfc="none", label=outcome)
        for outcome, (_, marker, colour) in MARKERS.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
