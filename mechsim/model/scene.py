"""Scene: what a model must hold, and no more."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

from mechsim.errors import InputError
from mechsim.model.forces import Forces

Level = Literal["pose", "motion", "dynamics", "picture"]
LEVELS: tuple[Level, ...] = get_args(Level)
GRAVITY = Forces(gravity=(0.0, -9.81, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """What the MuJoCo model of a mechanism is for; each level holds what the one before holds, and more.

    - pose: links, joints, sites and loop constraints. No time: masses are placeholders.
    - motion: the crank is prescribed; time-stepping options that keep the loops closed.
    - dynamics: masses count (rods where a link has none), all forces act, and the crank is free.
    - picture: geoms, lights and a camera that neither collide nor weigh anything.

    Attributes:
        level: one of the four above.
        cut: joints at which loops are cut and closed by a constraint; None lets the generator choose.
        forces: what acts on the mechanism; counts from level dynamics on. None takes the forces of what is
            run, as a file's `[forces]`, and gravity along -y where it has none.
    """

    level: Level = "motion"
    cut: tuple[str, ...] | None = None
    forces: Forces | None = None

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise InputError(f"there is no scene {self.level!r}; known are {', '.join(LEVELS)}")

    @property
    def acting(self) -> Forces:
        """The forces of the scene, gravity along -y where it has none."""
        return GRAVITY if self.forces is None else self.forces

    def under(self, forces: Forces | None) -> "Scene":
        """Return the scene with these forces, unless it has its own."""
        return replace(self, forces=forces) if self.forces is None else self

    def holds(self, level: Level) -> bool:
        """Return whether this scene reaches a level."""
        return LEVELS.index(self.level) >= LEVELS.index(level)
