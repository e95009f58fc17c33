"""The ways a model is built that `mechsim tradeoff` compares: its cuts, level, drive and reductions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import Level, Scene
from mechsim.simulation.closed_model import Model, load
from mechsim.simulation.mjcf.alternatives import add_servo, gear_to_motor, rod_as_length

CrankDrive = Literal["drive_inertia", "geared", "servo"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """How a model is made.

    Attributes:
        cut: joints at which the loops are cut; None lets the generator choose.
        level: of the scene.
        drive: what turns the crank: a flywheel on it; an equality with a flywheel beside the mechanism; a
            velocity servo.
        gain: of the servo, in units of the inertia felt at the crank over the time step.
        rod: link made a constant length between two joints; None leaves all links bodies.
        variant: of the mechanism, with the same motion of its tracked points; None is the mechanism itself.
    """

    cut: tuple[str, ...] | None = None
    level: Level = "motion"
    drive: CrankDrive = "drive_inertia"
    gain: float = 1.0
    rod: str | None = None
    variant: str | None = None

    def as_dict(self) -> dict[str, str]:
        """Return the columns of the CSV that say how the model was made."""
        reduction = f"{self.rod} as a length" if self.rod else self.variant or ""
        return {
            "cut": "+".join(self.cut or ()),
            "level": self.level,
            "drive": self.drive,
            "reduction": reduction,
        }

    def made(self, source: Model, variants: Mapping[str, Mechanism]) -> Any:
        """Return MuJoCo's specification, made of a mechanism or of a model of one's own."""
        if self.variant is not None:
            source = variants[self.variant]
        spec = load(source, Scene(level=self.level, cut=self.cut))
        if self.rod is not None:
            assert isinstance(source, Mechanism)
            rod_as_length(spec, source, self.rod)
        if self.drive == "geared":
            gear_to_motor(spec)
        elif self.drive == "servo":
            add_servo(spec)
        return spec
