"""The work-precision plot of all peers: error over time on logarithmic axes, a panel for each problem."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mechsim.plots.sheet import COLOURS, canvas, decades

if TYPE_CHECKING:
    from compare import Row

# below what rounding can tell apart
FLOOR = 1e-16
TITLES = {"rssr": "spatial four-bar (rssr)", "four_bar": "planar four-bar (four_bar)"}
# families of one library share its colour, and differ by mark and line
LIBRARIES = ("mechsim", "Exudyn", "Pinocchio", "Drake", "scipy", "pylinkage", "MuJoCo")
GREY = "#8a919b"
MARKS, LINES = "osDv^P", ("-", "--", ":", "-.")


def work_precision(rows: Sequence["Row"]) -> bytes:
    """Draw rows as a PNG: worst place in units of the crank over ms a turn."""
    names = list(dict.fromkeys(row.problem for row in rows))
    families = list(dict.fromkeys(row.family for row in rows))
    looks = _looks(families)
    with canvas("png", 1, len(names), (4.4 * len(names) + 2.6, 4.6), sharey=True) as (figure, axes, out):
        handles = {}
        for ax, name in zip(axes[0], names, strict=True):
            for family in families:
                mine = [row for row in rows if (row.problem, row.family) == (name, family)]
                mine = sorted((row for row in mine if row.place < 1.0), key=lambda row: row.steps or row.ms)
                if mine:
                    costs, errors = [row.ms for row in mine], [max(row.place, FLOOR) for row in mine]
                    (handles[family],) = ax.loglog(costs, errors, label=family, **looks[family])
            decades(ax.yaxis)
            ax.minorticks_off()
            ax.xaxis.set_major_formatter("{x:g}")
            ax.set_title(TITLES.get(name, name))
            ax.set_xlabel("processor time of the solver for one turn [ms]")
        axes[0, 0].set_ylabel("worst place error [crank]")
        shown = [family for family in families if family in handles]
        figure.legend([handles[one] for one in shown], shown, loc="outside right center", fontsize=7.5)
    return out.getvalue()


def _looks(families: Sequence[str]) -> dict[str, dict[str, object]]:
    """Return how each family is drawn."""
    looks: dict[str, dict[str, object]] = {}
    seen: dict[str, int] = {}
    for family in families:
        library = family.split()[0].split("'")[0].strip(",")
        place = seen[library] = seen.get(library, -1) + 1
        number = LIBRARIES.index(library)
        colour = COLOURS[number] if number < len(COLOURS) else GREY
        mark, line = MARKS[place % len(MARKS)], LINES[place % len(LINES)]
        width = 2.2 if library == "mechsim" else 1.1
        looks[family] = {"color": colour, "marker": mark, "ls": line, "ms": 4, "lw": width}
    return looks
