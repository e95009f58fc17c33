"""What is written on a picture: names of points, scale bar, crank angle."""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mechsim.render.camera import Camera

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

INK = (28, 32, 40)
HALO = (250, 250, 252)


def written(
    picture: Picture, camera: Camera, labels: dict[str, Array], clear: float, name: str, angle: float | None
) -> Picture:
    """Return a picture with labels at points and, if `name` is given, name, scale bar and crank angle.

    Args:
        picture: (height, width, 3).
        camera: that took it.
        labels: name of a point -> its place, (3,) in [m].
        clear: how far labels keep off their points, in [m].
        name: of the mechanism; empty for no notes.
        angle: of the crank in [rad]; None where the picture shows many.
    """
    image = Image.fromarray(picture)
    pen = ImageDraw.Draw(image)
    edge = max(11, round(camera.size[1] / 30))
    _labels(pen, camera, labels, 0.7 * clear * camera.scale + 0.3 * edge, edge)
    if name:
        _notes(pen, camera, name, angle, edge)
    return np.asarray(image)


def _labels(
    pen: ImageDraw.ImageDraw, camera: Camera, labels: dict[str, Array], off: float, edge: int
) -> None:
    """Write names beside their points, each off the middle of them all, so that links stay clear."""
    if not labels:
        return
    font = _font(edge)
    places = {name: camera.pixel(place) for name, place in labels.items()}
    middle = np.mean(list(places.values()), axis=0)
    for name, (x, y) in places.items():
        left = len(places) > 1 and x < middle[0]
        at = (x - off if left else x + off, y - off)
        _text(pen, at, name, font, "rs" if left else "ls")


def _notes(pen: ImageDraw.ImageDraw, camera: Camera, name: str, angle: float | None, edge: int) -> None:
    width, height = camera.size
    font, pad = _font(edge), round(0.8 * edge)
    _text(pen, (pad, pad), name.replace("_", "-"), font, "la")
    if angle is not None:
        _text(pen, (width - pad, pad), f"crank {np.rad2deg(angle) % 360.0:5.1f}°", font, "ra")
    length, text = scale_bar(camera)
    pixels = length * camera.scale
    y = height - pad
    pen.rectangle((pad - 1, y - edge // 4 - 1, pad + pixels + 1, y + 1), fill=HALO)
    pen.rectangle((pad, y - edge // 4, pad + pixels, y), fill=INK)
    _text(pen, (pad + pixels + 0.4 * edge, y + 1), text, font, "ls")


def scale_bar(camera: Camera) -> tuple[float, str]:
    """Return a round length of about a sixth of the picture's width in [m], and how it is written."""
    from mechsim.render.stage import nice

    length = nice(camera.size[0] / camera.scale / 5.0)
    for unit, factor in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if length >= 0.9999 * factor:
            return length, f"{length / factor:g} {unit}"
    return length, f"{length:g} m"


def _text(
    pen: ImageDraw.ImageDraw, at: tuple[float, float], text: str, font: ImageFont.FreeTypeFont, anchor: str
) -> None:
    pen.text(at, text, fill=INK, font=font, anchor=anchor, stroke_width=2, stroke_fill=HALO)


@cache
def _font(edge: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(edge)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font
