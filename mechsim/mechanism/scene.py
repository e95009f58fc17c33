"""Scenes: the purpose of a MuJoCo model, which determines its contents."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

from mechsim.errors import InputError
from mechsim.mechanism.forces import WEIGHT, Forces

Level = Literal["pose", "motion", "dynamics", "picture"]
LEVELS: tuple[Level, ...] = get_args(Level)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """The purpose of the MuJoCo model of a mechanism; each level extends the one before.

    - pose: links, joints, sites and loop constraints. No time; masses are placeholders.
    - motion: the crank is prescribed; time-stepping options that keep the loops closed.
    - dynamics: masses (rods for links without one) and all forces; the crank is free.
    - picture: geoms, lights and a camera, without collisions or masses.

    Attributes:
        level: one of these four.
        cut: joints at which loops are cut and closed by a constraint; None lets the generator choose.
        forces: forces on the mechanism, from level dynamics on. The default is the forces of the source, such
            as the `[forces]` of a file, or else gravity along -y.
    """

    level: Level = "motion"
    cut: tuple[str, ...] | None = None
    forces: Forces | None = None

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise InputError(f"there is no scene {self.level!r}; choose from {', '.join(LEVELS)}")

    @property
    def acting(self) -> Forces:
        """The forces of the scene, by default gravity along -y."""
        return WEIGHT if self.forces is None else self.forces

    def under(self, forces: Forces | None) -> "Scene":
        """Return the scene with these forces, unless it has its own."""
        return replace(self, forces=forces) if self.forces is None else self

    def holds(self, level: Level) -> bool:
        """Whether this scene includes a level."""
        return LEVELS.index(self.level) >= LEVELS.index(level)
