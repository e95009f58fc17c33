"""What a picture shows: size, camera, paths, labels, projections, overlaid positions."""

from dataclasses import dataclass
from typing import Literal, get_args

from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.shapes.camera import PRESETS

Paths = Literal["grow", "tail", "whole"]
Arrow = Literal["velocity", "acceleration", "force", "moment"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What a picture shows.

    Attributes:
        size: (width, height) in pixels.
        camera: "iso", "shaft" (along the crank shaft), "top" or "side".
        backend: OpenGL back end to force; None takes the first that works.
        paths: of tracked points: True or "grow" draws them behind the points, "tail" only the last
            quarter of a turn, so that a full turn can be played in a loop, "whole" all at once.
        labels: whether tracked points carry their names.
        notes: whether scale bar, name and crank angle are written on the picture.
        sense: whether an arrow shows which way the crank turns.
        projections: tracked points whose paths are also thrown on the planes XY, XZ and YZ.
        overlay: positions drawn at once over the whole motion; 1 draws one a frame.
        arrows: what arrows show: "velocity" and "acceleration" of tracked points, "force" and "moment"
            where they were given.
        magnify: factor on the error between a run and the ghost of the closed form; None takes the
            power of ten that makes it plain to see.
        caption: a line to write at the foot of the picture.
    """

    size: tuple[int, int] = (640, 480)
    camera: str = "iso"
    backend: str | None = None
    paths: bool | Paths = True
    labels: bool = True
    notes: bool = True
    sense: bool = False
    projections: tuple[str, ...] = ()
    overlay: int = 1
    arrows: tuple[Arrow, ...] = ()
    magnify: float | None = None
    caption: str = ""

    def __post_init__(self) -> None:
        if self.camera not in PRESETS:
            raise InputError(f"there is no camera {self.camera!r}; known are {', '.join(PRESETS)}")
        if not all(16 <= edge <= 8192 for edge in self.size):
            raise InputError(f"picture size is {self.size} pixels; give edges from 16 to 8192")
        if self.paths not in (True, False, *get_args(Paths)):
            raise InputError(f"paths is {self.paths!r}; it can be on, off, {', '.join(get_args(Paths))}")
        if not 1 <= self.overlay <= 360:
            raise InputError(f"{self.overlay} overlaid positions; give 1 to 360")
        for kind in self.arrows:
            if kind not in get_args(Arrow):
                raise InputError(f"there is no arrow {kind!r}; known are {', '.join(get_args(Arrow))}")
        if self.magnify is not None and not 0.0 < self.magnify < float("inf"):
            raise InputError(f"magnify is {self.magnify}; give a finite factor above 0")

    @property
    def trace(self) -> Paths | None:
        """How paths are drawn, None for not at all."""
        if isinstance(self.paths, str):
            return self.paths
        return "grow" if self.paths else None

    def check(self, mechanism: Mechanism) -> None:
        """Raise InputError where a point is asked for that the mechanism does not track."""
        for name in self.projections:
            if name not in mechanism.points:
                raise InputError(
                    f"{mechanism.name} has no point {name!r} to project; "
                    f"known are {', '.join(mechanism.points)}"
                )
