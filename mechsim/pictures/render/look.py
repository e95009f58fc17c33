"""Contents of a picture: size, camera, paths, labels, overlaid positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

from mechsim.errors import InputError, require_known
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.mechanism import Up, require_axis
from mechsim.shapes.camera import PRESETS, Angles
from mechsim.shapes.shape import Shape
from mechsim.units import option, parse_names

Paths = Literal["grow", "tail", "whole"]
Arrow = Literal["velocity", "acceleration", "force", "moment"]


def parse_pixels(text: str) -> tuple[int, int]:
    """Return a size written as width x height.

    Raises:
        InputError: for what is none.
    """
    numbers = text.lower().split("x")
    if len(numbers) != 2 or not all(text.strip().isdecimal() and len(text) < 9 for text in numbers):
        raise InputError(f"--size is {text!r}; write width x height in pixels, as in 960x720")
    return int(numbers[0]), int(numbers[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """What a user's file determines in pictures and pages.

    Attributes:
        bodies: link -> its body from a user's file; None draws bodies from the joints.
        closures: joints that close the loops of a user's file, which are marked.
        angles: azimuth and elevation of a file's camera in [deg]; None without one.
        forces: whose springs, dampers and bushings are drawn.
    """

    bodies: Mapping[str, Sequence[Shape]] | None = None
    closures: tuple[str, ...] = ()
    angles: Angles | None = None
    forces: Forces | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Look(Drawn):
    """Contents and style of a picture.

    Attributes:
        size: (width, height) in pixels.
        camera: "iso", "shaft" (along the crank shaft), "top" or "side".
        paths: of tracked points: True or "grow" draws them behind the points, "tail" only the last
            quarter of a turn, so that a full turn can be played in a loop, "whole" all at once.
        labels: whether tracked points have labels.
        notes: whether the picture has a scale bar, name and crank angle.
        overlay: number of positions drawn together over the whole motion; 1 draws one in each frame.
        arrows: what arrows show: "velocity" and "acceleration" of tracked points, "force" and "moment"
            where they were given.
        magnify: factor on the error between a run and the ghost of the closed form; None takes the
            round number, 1, 2 or 5 times a power of ten, that makes it plain to see.
        caption: a line at the bottom of the picture.
        up: coordinate axis that points up, as "z" or "-y"; None takes that of the mechanism, else y.
    """

    size: tuple[int, int] = option(
        (640, 480), "Width and height in pixels.", read=parse_pixels, text="960x720"
    )
    camera: str = option("iso", "View: iso, shaft, top or side.")
    paths: bool | Paths = True
    labels: bool = option(True, "Write the names of tracked points.")
    notes: bool = True
    overlay: int = option(1, "Positions overlaid in a picture.", name="--positions")
    arrows: tuple[Arrow, ...] = option(
        (), "Draw arrows of velocity, acceleration, force or moment.", read=parse_names, metavar="KINDS"
    )
    magnify: float | None = None
    caption: str = ""
    up: Up | None = option(
        None,
        "Axis that points up: x, y, z, -x, ... Default: opposite to gravity, else y.",
        metavar="AXIS",
    )

    def __post_init__(self) -> None:
        if self.camera not in PRESETS:
            raise InputError(f"there is no camera {self.camera!r}; choose from {', '.join(PRESETS)}")
        require_axis("a picture", self.up)
        if not all(16 <= edge <= 8192 for edge in self.size):
            raise InputError(f"picture size is {self.size} pixels; give edges from 16 to 8192")
        if self.paths not in (True, False, *get_args(Paths)):
            raise InputError(f"paths is {self.paths!r}; it can be on, off, {', '.join(get_args(Paths))}")
        if not 1 <= self.overlay <= 360:
            raise InputError(f"{self.overlay} overlaid positions; give 1 to 360")
        for kind in self.arrows:
            if kind not in get_args(Arrow):
                raise InputError(f"there is no arrow {kind!r}; choose from {', '.join(get_args(Arrow))}")
        if self.magnify is not None and not 0.0 < self.magnify < float("inf"):
            raise InputError(f"magnify is {self.magnify}; give a finite factor above 0")

    @property
    def trace(self) -> Paths | None:
        """The style of the paths, or None for no paths."""
        if isinstance(self.paths, str):
            return self.paths
        return "grow" if self.paths else None


def changed(look: Look | None, options: dict[str, Any]) -> Look:
    """Return a look, by default the standard one, with other values of some fields.

    Raises:
        InputError: for a field there is not, or a value that it cannot have.
    """
    require_known("a picture has no option", options, look_options())
    return replace(look or Look(), **options)


def look_options() -> list[str]:
    """Return the names of the options of a picture, which files do not state."""
    of_files = {field.name for field in fields(Drawn)}
    return [field.name for field in fields(Look) if field.name not in of_files]
