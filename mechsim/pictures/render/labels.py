"""Text on a picture: names of points, scale bar, crank angle."""

from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.pictures.label_positions import Placement, Rectangle, placed, shared
from mechsim.pictures.number_text import prefixed
from mechsim.shapes.camera import Camera, nice

if TYPE_CHECKING:
    from PIL import Image, ImageFont


Picture = NDArray[np.uint8]

Ink = tuple[int, int, int]
INK: Ink = (28, 32, 40)
# colour of the outline of letters, 0 to 255, and its width in pixels
HALO = (250, 250, 252)
HALO_WIDTH = 2
# height of a legend line, relative to the height of its letters
LINE = 1.45


@dataclass(frozen=True, slots=True)
class Notes:
    """The text at the edges of every frame.

    Attributes:
        name: of the mechanism.
        legend: lines at the bottom, and their colours.
    """

    name: str
    legend: tuple[tuple[str, Ink], ...] = ()


def written(
    picture: Picture,
    camera: Camera,
    labels: dict[str, Array],
    clear: float,
    notes: Notes | None,
    instant: str,
    stood: dict[str, Placement],
) -> Picture:
    """Return a picture with labels at points and, if there are notes, name, scale bar and crank angle.

    Args:
        picture: (height, width, 3).
        camera: the camera of the picture.
        labels: name of a point -> its position, (3,) in [m].
        clear: distance between labels and points, in [m].
        notes: text at the edges; None for none.
        instant: shown instant as text; empty if the picture shows many.
        stood: label -> its position in the frame before; updated.
    """
    from PIL import Image

    image = Image.fromarray(picture)
    edge = letters(camera.resolution)
    occupied = _notes(image, camera, notes, instant, edge) if notes else []
    # write names next to their points; coincident points share one
    named = shared({name: camera.pixel(placement) for name, placement in labels.items()})
    widths = [_font(edge).getlength(name) for name, _ in named]
    before = [stood.get(name) for name, _ in named]
    points, off = [position for _, position in named], 0.7 * clear * camera.scale + 0.3 * edge
    spots = placed(points, widths, 1.1 * edge, off, camera.resolution, occupied, before)
    for (name, _), (spot, placement) in zip(named, spots, strict=True):
        stood[name] = placement
        _text(image, (spot.x_low, spot.y_high - 0.2 * edge), name, edge, "ls")
    return np.asarray(image)


def letters(resolution: tuple[int, int]) -> int:
    """Return the height of the letters on a picture of a size, in pixels."""
    return max(10, round(resolution[1] / 34))


def foot(resolution: tuple[int, int], lines: int) -> float:
    """Return the fraction of a picture's height that legend lines take, at most 0.4."""
    # above a margin and the line of the scale bar
    return min(0.4, (0.8 + 1.5 + LINE * lines) * letters(resolution) / resolution[1]) if lines else 0.0


def _notes(image: "Image.Image", camera: Camera, notes: Notes, instant: str, edge: int) -> list[Rectangle]:
    """Write name, instant, scale bar and legend at the edges; return their rectangles.

    A legend that would reach over the scale bar stands above it.
    """
    width, height = camera.resolution
    pad, long = round(0.8 * edge), _font(edge).getlength
    _text(image, (pad, pad), notes.name, edge, "la")
    occupied = [Rectangle(0.0, 0.0, pad + long(notes.name), pad + 1.3 * edge)]
    if instant:
        _text(image, (width - pad, pad), instant, edge, "ra")
        occupied.append(Rectangle(width - pad - long(instant), 0.0, width, pad + 1.3 * edge))
    # a round length of about a sixth of the picture's width
    length = nice(width / camera.scale / 5.0)
    text = prefixed(length, "m")
    pixels = length * camera.scale
    y = height - pad
    from PIL import ImageDraw

    pen = ImageDraw.Draw(image)
    pen.rectangle((pad - 1, y - edge // 4 - 1, pad + pixels + 1, y + 1), fill=HALO)
    pen.rectangle((pad, y - edge // 4, pad + pixels, y), fill=INK)
    _text(image, (pad + pixels + 0.4 * edge, y + 1), text, edge, "ls")
    bar = Rectangle(0.0, y - 1.2 * edge, pad + pixels + 0.8 * edge + long(text), float(height))
    lines = list(reversed(notes.legend))
    widest = max((long(line) for line, _ in lines), default=0.0)
    stand = y - 1.5 * edge if width - pad - widest < bar.x_high else float(y)
    for i, (line, ink) in enumerate(lines):
        _text(image, (width - pad, stand + 1 - LINE * edge * i), line, edge, "rs", ink)
    if lines:
        top = stand - LINE * edge * len(lines)
        occupied.append(Rectangle(width - pad - widest, top, width, float(height)))
    return [*occupied, bar]


def _text(
    image: "Image.Image", anchor_point: tuple[float, float], text: str, edge: int, anchor: str, ink: Ink = INK
) -> None:
    """Write a text with its left ("l") or right ("r") end at a position, below ("a") or above ("s") it."""
    stamp, x_offset, y_offset, right = _stamp(text, edge, anchor[1], ink)
    x = anchor_point[0] + x_offset if anchor[0] == "l" else anchor_point[0] - right
    image.paste(stamp, (round(x), round(anchor_point[1] + y_offset)), stamp)


# drawing letters with a halo is the most expensive step of a picture, and names repeat
@lru_cache(maxsize=256)
def _stamp(text: str, edge: int, hang: str, ink: Ink) -> tuple["Image.Image", float, float, float]:
    """A text on a transparent background: picture, its left and top from the anchor, its right end."""
    from PIL import Image, ImageDraw

    font = _font(edge)
    x_low, top, right, bottom = font.getbbox(text, anchor=f"l{hang}", stroke_width=HALO_WIDTH)
    stamp = Image.new("RGBA", (int(np.ceil(right - x_low)) + 2, int(np.ceil(bottom - top)) + 2), (*HALO, 0))
    pen = ImageDraw.Draw(stamp)
    origin = -x_low + 1, -top + 1
    pen.text(origin, text, fill=ink, font=font, anchor=f"l{hang}", stroke_width=HALO_WIDTH, stroke_fill=HALO)
    return stamp, x_low - 1, top - 1, right - HALO_WIDTH


@cache
def _font(edge: int) -> "ImageFont.FreeTypeFont":
    """DejaVu Sans, which matplotlib brings along: Pillow's own font knows neither powers nor Greek."""
    from PIL import ImageFont

    spec = find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    return ImageFont.truetype(Path(spec.origin).parent / "mpl-data/fonts/ttf/DejaVuSans.ttf", edge)
