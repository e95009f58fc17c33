"""Common parts of all plots: style, axes, and output to files."""

from __future__ import annotations

import io
import warnings
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError, needs
from mechsim.files import write_content
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import power_of_ten, readable
from mechsim.shapes.shape import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Format = Literal["svg", "png", "pdf"]
FORMATS: tuple[Format, ...] = ("svg", "png", "pdf")
# dots per inch of a plot in pixels, and its colours on a page
DPI, WEBP_COLOURS = 160, 32
# colour of lines outside the palette
INK = "#222831"
COLOURS = [colour[:3] for colour in PALETTE[:6]]
STYLES = ("-", "--", ":")
# distances of the ticks of a crank angle in degrees
ANGLE_STEPS = (1.0, 5.0, 15.0, 30.0, 60.0, 180.0)
# relative variation below which a curve is rounding
ROUNDED = 1e-12
# largest number of decades of a logarithmic axis with a tick for each
MAX_DECADES = 20
# largest number of characters of a label in a legend
MAX_LABEL = 40
# position of a legend to the right of axes full of curves
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
    # a dollar sign in a name starts no formula
    "text.parse_math": False,
    # equal plots give equal bytes
    "svg.hashsalt": "mechsim",
}


def format_of(path: str | Path) -> Format:
    """Return the format of a file's extension.

    Raises:
        InputError: for an unknown extension.
    """
    extensions: dict[str, Format] = {f".{file_format}": file_format for file_format in FORMATS}
    if Path(path).suffix not in extensions:
        raise InputError(
            f"cannot plot to {Path(path).name}: its extension is not one of {', '.join(extensions)}"
        )
    return extensions[Path(path).suffix]


@contextmanager
def styled() -> Generator[None]:
    """Draw with the style of all plots; matplotlib's settings are restored afterwards."""
    with needs("pictures"):
        from matplotlib import rc_context

    with rc_context(cast(Any, LOOK)), np.errstate(all="ignore"):
        yield


def blank(
    rows: int, columns: int, inches: tuple[float, float], **options: Any
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of a size in inches and its axes, (rows, columns).

    It is a figure of its own: The figure is independent of pyplot, so it needs no screen and is in no list of
    open figures.
    """
    with needs("pictures"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=inches, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for ax in axes.flat:
        # matplotlib creates the ticks of axes at their first use
        ax.tick_params(
            labelsize=LOOK["font.size"], grid_color=LOOK["grid.color"], grid_linewidth=LOOK["grid.linewidth"]
        )
    return figure, axes


def drawn(figure: Figure, file_format: Format = "svg") -> bytes:
    """Return a figure as the bytes of a file; equal plots give equal bytes.

    Raises:
        InputError: for an unknown format.
    """
    if file_format not in FORMATS:
        raise InputError(f"there is no plot format {file_format!r}; choose from {', '.join(FORMATS)}")
    out = io.BytesIO()
    layout = figure.get_layout_engine()
    with styled(), warnings.catch_warnings():
        # characters that the font lacks become boxes, and zeros leave a logarithmic axis empty
        warnings.filterwarnings("ignore", "Glyph .* missing|Data has no positive values", UserWarning)
        # laid out once; otherwise saving does it in both of its passes
        if layout is not None:
            layout.execute(figure)
            figure.set_layout_engine("none")
        dated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[file_format]
        figure.savefig(out, format=file_format, dpi=DPI, metadata=dated)
    figure.set_layout_engine(layout)
    return out.getvalue()


def webp(figure: Figure) -> bytes:
    """Return a figure as lossless WebP of few colours: half of its size in SVG.

    It is laid out and drawn once, where saving draws it twice.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas, out = FigureCanvasAgg(figure), io.BytesIO()
    figure.set_dpi(DPI)
    with styled():
        canvas.draw()
    pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    few = pixels.quantize(WEBP_COLOURS, Image.Quantize.FASTOCTREE)
    few.convert("RGB").save(out, "WEBP", lossless=True, method=2)
    return out.getvalue()


def write(path: str | Path, figure: Figure) -> None:
    """Write a figure to a file, in the format of its extension.

    Raises:
        InputError: for an unknown extension.
        OutputError: where the file cannot be written.
    """
    write_content(path, drawn(figure, format_of(path)))


def label_of(name: str) -> str:
    """Return a name as text of a legend: shortened if long, and visible if it starts with _."""
    short = name if len(name) <= MAX_LABEL else f"{name[: MAX_LABEL - 1]}…"
    return f" {short}" if short.startswith("_") else short


def draw_curves(
    ax: Axes, x: Array, curves: Mapping[str, Array], quantity: str, unit: str
) -> tuple[float, str]:
    """Draw named curves, in degrees or in a readable unit; return the factor and the name of that unit."""
    factor, shown = readable(np.concatenate([*curves.values()]), unit)
    for i, (name, values) in enumerate(curves.items()):
        style = STYLES[(i + i // len(COLOURS)) % len(STYLES)]
        ax.plot(x, values / factor, color=COLOURS[i % len(COLOURS)], ls=style, label=label_of(name))
    ax.set_ylabel(f"{quantity} [{shown}]")
    return factor, shown


def point_names(motion: Motion) -> list[str]:
    """Return the points to plot."""
    if not motion.points:
        raise InputError("the motion has no tracked point to plot")
    return [*motion.points]


def abscissa(motion: Motion) -> Array:
    """Return the crank angles of a motion, (n,) in degrees; under motion laws its times in seconds."""
    return motion.time if motion.drivers and motion.time is not None else np.rad2deg(motion.angle)


def along_axis(ax: Axes, timed: bool = False) -> None:
    """Label the horizontal axis for times in seconds, or for crank angles in degrees."""
    if timed:
        ax.set_xlabel("time [s]")
        return
    from matplotlib.ticker import MultipleLocator

    ax.set_xlabel("crank angle [°]")
    low, high = ax.get_xlim()
    step = next((step for step in ANGLE_STEPS if high - low < 7.5 * step), None)
    if step is not None:
        ax.xaxis.set_major_locator(MultipleLocator(step))


def flattened(ax: Axes, scale: float, unit: str) -> None:
    """Draw curves that vary by no more than rounding as flat lines, with a note.

    Args:
        ax: axes with the curves.
        scale: scale of the curves, in the numbers of the axis; 0 if unknown.
        unit: unit of these numbers.
    """
    values = np.concatenate([np.zeros(0), *(np.asarray(line.get_ydata(), float) for line in ax.get_lines())])
    values = values[np.isfinite(values)]
    if not len(values) or not np.ptp(values) < ROUNDED * scale:
        return
    middle = 0.5 * float(values.min() + values.max())
    ax.set_ylim(middle - 0.5 * scale, middle + 0.5 * scale)
    text = f"varies by less than {ROUNDED * scale:.1g} {unit}: rounding"
    ax.annotate(text, (0.03, 0.05), xycoords="axes fraction", fontsize=6.5, color="#5b6470")


def round_numbers(axis: Axis) -> None:
    """Label 1, 2 and 5 of each decade of a logarithmic axis with plain numbers; others without these."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def decades(axis: Axis) -> None:
    """Label powers of ten as plain text: typesetting each as a formula takes most of the time of a plot."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    def power(value: float, _position: Any = None) -> str:
        return power_of_ten(round(float(np.log10(value))) if value > 0.0 else 0)

    axis.set_major_locator(LogLocator(numticks=MAX_DECADES))
    axis.set_major_formatter(FuncFormatter(power))
    axis.set_minor_locator(NullLocator())
