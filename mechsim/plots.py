"""Plots of motions and comparisons, drawn off screen and returned as the bytes of a file.

Every function returns SVG, PNG or PDF bytes; `write` puts them in a file by its extension. Axes
carry units, colours stay apart for colour-blind eyes.
"""

import io
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError
from mechsim.mechanism import Mechanism
from mechsim.motion import Motion
from mechsim.shapes import PALETTE, link_colours
from mechsim.tables import written_beside

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Format = Literal["svg", "png", "pdf"]
FORMATS: tuple[Format, ...] = ("svg", "png", "pdf")
COLOURS = [colour[:3] for colour in PALETTE[:6]]
STYLES = ("-", "--", ":")

# errors at and below this are rounding to zero; a logarithm needs something to show
FLOOR = 1e-18

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

LOOK: dict[str, Any] = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "grid.color": "#d5d9df",
    "grid.linewidth": 0.6,
    "axes.edgecolor": "#5b6470",
    "axes.axisbelow": True,
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "svg.fonttype": "path",
    # the same plot gives the same bytes
    "svg.hashsalt": "mechsim",
}


class Plan(Protocol):
    """What a velocity plan must offer: see `velocity_plan.Plan`."""

    @property
    def pole(self) -> Array: ...
    @property
    def vectors(self) -> Mapping[str, Array]: ...
    @property
    def lines(self) -> tuple[tuple[str, str], ...]: ...
    @property
    def scale(self) -> float: ...


def motion_plot(motion: Motion, points: Sequence[str] | None = None, *, form: Format = "svg") -> bytes:
    """Draw displacement, velocity and acceleration of points over the crank angle.

    Args:
        motion: what to draw.
        points: tracked points; None draws all.
        form: of the returned bytes.
    """
    names = _chosen(motion, points)
    rows = (("position", "position"), ("velocity", "velocity"), ("acceleration", "acceleration"))
    with _figure(form, 3, len(names), (3.0 * len(names) + 0.6, 6.0), sharex=True) as (figure, axes, out):
        for column, name in enumerate(names):
            for row, (attribute, label) in enumerate(rows):
                ax, values = axes[row, column], getattr(motion.points[name], attribute)
                factor, unit = _unit(values, ("m", "m/s", "m/s²")[row])
                for i, part in enumerate("xyz"):
                    ax.plot(
                        _degrees(motion), values[:, i] / factor, color=COLOURS[i], ls=STYLES[i], label=part
                    )
                ax.set_ylabel(f"{label} [{unit}]")
                # one line for all labels of a column; finding the line costs a third of the plot
                ax.yaxis.set_label_coords(-0.19, 0.5)
            axes[0, column].set_title(name)
            _angle_axis(axes[2, column])
        lines = axes[0, 0].get_lines()
        figure.legend(handles=lines, ncols=3, loc="outside upper right", handlelength=1.6)
    return out.getvalue()


def coupler_curve(
    mechanism: Mechanism,
    motion: Motion,
    points: Sequence[str] | None = None,
    *,
    other: Motion | None = None,
    form: Format = "svg",
) -> bytes:
    """Draw the paths of points: in their plane where they have one in common, else seen along Z, X and Y.

    Args:
        mechanism: whose points; gives the colours.
        motion: paths drawn as lines.
        points: tracked points; None draws all.
        other: a second motion of the same points, drawn as rings.
        form: of the returned bytes.
    """
    names, colours = _chosen(motion, points), link_colours(mechanism)
    places = {name: motion.points[name].position for name in names}
    everything = np.vstack(list(places.values()))
    factor, unit = _unit(everything, "m")
    flat = np.ptp(everything[:, 2]) <= 1e-9 * np.ptp(everything, axis=0).max()
    views = [(0, 1)] if flat else [(0, 1), (2, 1), (0, 2)]
    with _figure(form, 1, len(views), (3.6 * len(views) + 0.4, 3.4)) as (_, axes, out):
        for ax, (i, j) in zip(axes[0], views, strict=True):
            for name, place in places.items():
                colour = colours.get(mechanism.points[name][0], PALETTE[0])
                ax.plot(place[:, i] / factor, place[:, j] / factor, color=colour, label=name)
                ax.plot(*(place[0, [i, j]] / factor), "o", ms=4, color=colour)
                if other is not None:
                    rings = other.points[name].position[:, [i, j]] / factor
                    ax.plot(*rings.T, "o", ms=3.5, mfc="none", mew=0.7, color="#222831")
            ax.set_xlabel(f"{'xyz'[i]} [{unit}]")
            ax.set_ylabel(f"{'xyz'[j]} [{unit}]")
            ax.set_aspect("equal", adjustable="datalim")
        axes[0, 0].legend(loc="best")
    return out.getvalue()


def transmission_plot(angles: ArrayLike, transmission: ArrayLike, *, form: Format = "svg") -> bytes:
    """Draw the transmission angle over the crank angle, both in [rad]."""
    x, y = np.rad2deg(np.asarray(angles)), np.rad2deg(np.asarray(transmission))
    with _figure(form, 1, 1, (4.6, 2.8)) as (_, axes, out):
        ax = axes[0, 0]
        ax.plot(x, y, color=COLOURS[1])
        worst = int(np.argmin(y))
        ax.plot(x[worst], y[worst], "o", ms=4, color=COLOURS[0])
        ax.annotate(f"{y[worst]:.1f}°", (x[worst], y[worst]), (0, 6), textcoords="offset points", ha="center")
        ax.set_ylim(0.0, 95.0)
        ax.set_yticks(range(0, 91, 30))
        ax.set_ylabel("transmission angle [°]")
        _angle_axis(ax)
    return out.getvalue()


def error_plot(
    angles: ArrayLike,
    errors: Mapping[str, ArrayLike],
    *,
    unit: str,
    bound: float | None = None,
    title: str = "",
    form: Format = "svg",
) -> bytes:
    """Draw errors over the turn on a logarithmic scale, with the bound they must keep.

    Args:
        angles: crank angles, (n,) in [rad].
        errors: label -> error, (n,); the size is drawn, gaps stand for NaN.
        unit: of errors and bound.
        bound: largest error allowed; None draws none.
        title: what was compared.
        form: of the returned bytes.
    """
    x = np.rad2deg(np.asarray(angles))
    with _figure(form, 1, 1, (5.6, 3.0)) as (_, axes, out):
        ax = axes[0, 0]
        for i, (label, values) in enumerate(errors.items()):
            size = np.abs(np.asarray(values, dtype=np.float64))
            size = np.where(np.isfinite(size), np.maximum(size, FLOOR), np.nan)
            ax.semilogy(x, size, color=COLOURS[i % 6], ls=STYLES[i // 6 % 3], lw=1.2, label=label)
        if bound is not None:
            ax.axhline(bound, color="#b00020", lw=1.2, ls="--", label=f"bound {bound:.1e} {unit}")
        _decades(ax)
        # an error passes zero when it changes sign; following it there would flatten all the rest
        ax.set_ylim(bottom=max(FLOOR, 1e-4 * min(peaks)) if (peaks := _peaks(errors)) else None)
        ax.set_ylabel(f"error [{unit}]")
        ax.set_title(title)
        _angle_axis(ax)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return out.getvalue()


def velocity_plan_plot(plan: Plan, title: str = "", *, form: Format = "svg") -> bytes:
    """Draw a velocity plan: from the pole p a vector to every point, thin lines between them."""
    vectors = {name: plan.scale * (np.asarray(end)[:2] - plan.pole[:2]) for name, end in plan.vectors.items()}
    reach = max(float(np.linalg.norm(end)) for end in vectors.values())
    factor, unit = _unit(np.array([reach]), "m/s")
    with _figure(form, 1, 1, (4.4, 4.2)) as (_, axes, out):
        ax = axes[0, 0]
        for i, (name, end) in enumerate(vectors.items()):
            tip = end / factor
            arrow = {"arrowstyle": "-|>", "color": COLOURS[i % 6], "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
            ax.annotate("", tip, (0.0, 0.0), arrowprops=arrow)
            ax.plot(*tip, "o", ms=2, color=COLOURS[i % 6])
            away = 8.0 * end / max(float(np.linalg.norm(end)), 1e-300)
            ax.annotate(name, tip, away, textcoords="offset points", ha="center", va="center", style="italic")
        for a, b in plan.lines:
            both = np.array([vectors[a], vectors[b]]) / factor
            ax.plot(*both.T, color="#5b6470", lw=0.9, ls="--")
        ax.plot(0.0, 0.0, "o", ms=5, color="#222831")
        ax.annotate("p", (0.0, 0.0), (-8, -8), textcoords="offset points", style="italic")
        ax.set_xlabel(f"velocity along x [{unit}]")
        ax.set_ylabel(f"velocity along y [{unit}]")
        ax.set_title(title)
        ax.set_aspect("equal", adjustable="datalim")
        ax.margins(0.15)
    return out.getvalue()


def write(path: str | Path, drawing: bytes) -> None:
    """Write a drawing to a file.

    Raises:
        OutputError: where the file cannot be written.
    """
    with written_beside(path) as beside:
        beside.write_bytes(drawing)


def form_of(path: str | Path) -> Format:
    """Return the format that a file's extension asks for.

    Raises:
        InputError: for an unknown extension.
    """
    for form in FORMATS:
        if Path(path).suffix == f".{form}":
            return form
    raise InputError(
        f"cannot plot to {Path(path).name}: its extension is not one of {', '.join('.' + f for f in FORMATS)}"
    )


@contextmanager
def _figure(
    form: Format, rows: int, columns: int, size: tuple[float, float], **options: Any
) -> Generator[tuple["Figure", NDArray[Any], io.BytesIO]]:
    """Give a figure with axes; when the block ends, its bytes are in the buffer."""
    if form not in FORMATS:
        raise InputError(f"there is no plot format {form!r}; known are {', '.join(FORMATS)}")
    # a Figure of its own needs no pyplot, hence no screen and no list of open figures
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    out = io.BytesIO()
    with rc_context(cast(Any, LOOK)), np.errstate(all="ignore"):
        figure = Figure(figsize=size, layout="constrained")
        yield figure, figure.subplots(rows, columns, squeeze=False, **options), out
        # laid out once: left to itself, saving does it again for each of its two passes
        layout = figure.get_layout_engine()
        assert layout is not None
        layout.execute(figure)
        figure.set_layout_engine(None)
        dated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[form]
        figure.savefig(out, format=form, dpi=160, metadata=dated)


def _chosen(motion: Motion, points: Sequence[str] | None) -> list[str]:
    names = list(motion.points) if points is None else list(points)
    for name in names:
        if name not in motion.points:
            raise InputError(f"the motion has no point {name!r}; known are {', '.join(motion.points)}")
    if not names:
        raise InputError("the motion has no tracked point to plot")
    return names


def _peaks(errors: Mapping[str, ArrayLike]) -> list[float]:
    """The largest finite error of each label that has one above the floor."""
    sizes = (np.abs(np.asarray(values, dtype=np.float64)) for values in errors.values())
    peaks = [float(np.max(size, where=np.isfinite(size), initial=0.0)) for size in sizes]
    return [peak for peak in peaks if peak > FLOOR]


def _degrees(motion: Motion) -> Array:
    return np.rad2deg(motion.angle)


def _angle_axis(ax: "Axes") -> None:
    ax.set_xlabel("crank angle [°]")
    low, high = ax.get_xlim()
    if high - low < 800.0:
        ax.xaxis.set_major_locator(_locator(60.0 if high - low < 450.0 else 180.0))


def _locator(step: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    return MultipleLocator(step)


def _decades(ax: "Axes") -> None:
    """Write powers of ten as plain text: typesetting each as a formula costs more than all the rest."""
    from matplotlib.ticker import FuncFormatter

    def power(value: float, _place: Any = None) -> str:
        exponent = round(float(np.log10(value))) if value > 0.0 else 0
        return "10" + str(exponent).translate(SUPERSCRIPTS)

    ax.yaxis.set_major_formatter(FuncFormatter(power))
    ax.minorticks_off()


def _unit(values: ArrayLike, unit: str) -> tuple[float, str]:
    """Return a factor and the unit it gives, such that numbers are neither long nor tiny."""
    largest = float(np.nanmax(np.abs(np.asarray(values)), initial=0.0))
    for factor, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "µ")):
        if largest >= 0.5 * factor:
            return factor, prefix + unit
    return (1.0, unit) if largest == 0.0 else (1e-6, "µ" + unit)
