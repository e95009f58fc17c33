"""What all plots share: how they look, their axes, and how a figure becomes a file."""

import io
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError, needs
from mechsim.files import atomic_path
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import power_of_ten
from mechsim.shapes.shape import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Format = Literal["svg", "png", "pdf"]
FORMATS: tuple[Format, ...] = ("svg", "png", "pdf")
# colour of lines that the palette does not colour
INK = "#222831"
COLOURS = [colour[:3] for colour in PALETTE[:6]]
STYLES = ("-", "--", ":")
# what varies by less than this part of its scale is rounding
ROUNDED = 1e-12
# decades of a logarithmic axis up to which each has a tick
MAX_DECADES = 20
# characters of a label that fit into a legend
LONGEST_LABEL = 40
# a legend to the right of axes that curves may fill
LEGEND_RIGHT: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}

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
    # a dollar sign in a name begins no formula
    "text.parse_math": False,
    # the same plot gives the same bytes
    "svg.hashsalt": "mechsim",
}


def format_of(path: str | Path) -> Format:
    """Return the format that a file's extension asks for.

    Raises:
        InputError: for an unknown extension.
    """
    for file_format in FORMATS:
        if Path(path).suffix == f".{file_format}":
            return file_format
    raise InputError(
        f"cannot plot to {Path(path).name}: its extension is not one of {', '.join('.' + f for f in FORMATS)}"
    )


@contextmanager
def styled() -> Generator[None]:
    """Draw with the style of all plots; no setting of matplotlib's stays changed."""
    with needs("pictures"):
        from matplotlib import rc_context

    with rc_context(cast(Any, LOOK)), np.errstate(all="ignore"):
        yield


def blank(
    rows: int, columns: int, inches: tuple[float, float], **options: Any
) -> tuple["Figure", NDArray[Any]]:
    """Return a figure of a size in inches and its axes, (rows, columns).

    It is a figure of its own: it needs no pyplot, hence no screen and no list of open figures.
    """
    with needs("pictures"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=inches, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for ax in axes.flat:
        # matplotlib makes the ticks of axes when they are first used
        ax.tick_params(
            labelsize=LOOK["font.size"], grid_color=LOOK["grid.color"], grid_linewidth=LOOK["grid.linewidth"]
        )
    return figure, axes


def drawn(figure: "Figure", file_format: Format = "svg") -> bytes:
    """Return a figure as the bytes of a file; the same plot made again gives the same bytes.

    Raises:
        InputError: for an unknown format.
    """
    if file_format not in FORMATS:
        raise InputError(f"there is no plot format {file_format!r}; choose from {', '.join(FORMATS)}")
    out = io.BytesIO()
    layout = figure.get_layout_engine()
    with styled(), warnings.catch_warnings():
        # letters that the font lacks are drawn as boxes, which is all there is to say
        warnings.filterwarnings("ignore", "Glyph .* missing", UserWarning)
        # laid out once: left to itself, saving does it again for each of its two passes
        if layout is not None:
            layout.execute(figure)
            figure.set_layout_engine("none")
        dated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[file_format]
        figure.savefig(out, format=file_format, dpi=160, metadata=dated)
    figure.set_layout_engine(layout)
    return out.getvalue()


def write(path: str | Path, figure: "Figure") -> None:
    """Write a figure to a file, in the format that its extension asks for.

    Raises:
        InputError: for an unknown extension.
        OutputError: where the file cannot be written.
    """
    drawing = drawn(figure, format_of(path))
    with atomic_path(path) as temporary:
        temporary.write_bytes(drawing)


def label_of(name: str) -> str:
    """Return a name as a legend shows it: not all of a long one, and one that begins with _ at all."""
    short = name if len(name) <= LONGEST_LABEL else f"{name[: LONGEST_LABEL - 1]}…"
    return f" {short}" if short.startswith("_") else short


def chosen(motion: Motion, points: Sequence[str] | None) -> list[str]:
    """Return the points to plot: those requested, else all."""
    names = list(motion.points) if points is None else list(points)
    for name in names:
        if name not in motion.points:
            raise InputError(f"the motion has no point {name!r}; choose from {', '.join(motion.points)}")
    if not names:
        raise InputError("the motion has no tracked point to plot")
    return names


def abscissa(motion: Motion) -> Array:
    """Return the crank angles of a motion, (n,) in degrees; under motion laws its times in seconds."""
    return motion.time if motion.drivers and motion.time is not None else np.rad2deg(motion.angle)


def along_axis(ax: "Axes", timed: bool) -> None:
    """Make the horizontal axis one of times in seconds, or of crank angles in degrees."""
    if timed:
        ax.set_xlabel("time [s]")
    else:
        angle_axis(ax)


def angle_axis(ax: "Axes") -> None:
    """Make the horizontal axis one of crank angles in degrees."""
    ax.set_xlabel("crank angle [°]")
    low, high = ax.get_xlim()
    if high - low < 800.0:
        ax.xaxis.set_major_locator(locator(60.0 if high - low < 450.0 else 180.0))


def still(values: ArrayLike, scale: float) -> bool:
    """Say whether values vary by no more than the rounding of their scale."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    return bool(len(finite)) and scale > 0.0 and float(np.ptp(finite)) < ROUNDED * scale


def flattened(ax: "Axes", scale: float, unit: str) -> None:
    """Show curves that vary by no more than the rounding of their scale as flat, and say below what.

    Args:
        ax: with the curves.
        scale: of them, in the axis's own numbers; 0 where it is not known.
        unit: of these.
    """
    values = np.concatenate([np.zeros(0), *(np.asarray(line.get_ydata(), float) for line in ax.get_lines())])
    if not still(values, scale):
        return
    middle = 0.5 * float(np.nanmin(values) + np.nanmax(values))
    ax.set_ylim(middle - 0.5 * scale, middle + 0.5 * scale)
    text = f"varies by less than {ROUNDED * scale:.1g} {unit}: rounding"
    ax.annotate(text, (0.03, 0.05), xycoords="axes fraction", fontsize=6.5, color="#5b6470")


def locator(step: float) -> Any:
    """Return what puts ticks so far apart."""
    with needs("pictures"):
        from matplotlib.ticker import MultipleLocator

    return MultipleLocator(step)


def round_numbers(axis: "Axis") -> None:
    """Write 1, 2 and 5 of every decade of a logarithmic axis as plain numbers; others where it holds none."""
    with needs("pictures"):
        from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def decades(axis: "Axis") -> None:
    """Write powers of ten as plain text: typesetting each as a formula costs more than all the rest."""
    with needs("pictures"):
        from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    def power(value: float, _position: Any = None) -> str:
        exponent = round(float(np.log10(value))) if value > 0.0 else 0
        return power_of_ten(exponent)

    axis.set_major_locator(LogLocator(numticks=MAX_DECADES))
    axis.set_major_formatter(FuncFormatter(power))
    axis.set_minor_locator(NullLocator())
