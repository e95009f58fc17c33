"""Results of runs in MuJoCo: a driven run, a driven run with forces, a free run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mechsim.files import attributes
from mechsim.mechanism.finding import Outcome
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.masses import LinkMass
from mechsim.mechanism.motion import Motion, short_repr
from mechsim.simulation.settings import Settings

Method = Literal["step", "pose"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """Data that every run in MuJoCo records.

    Attributes:
        motion: motion at the recorded instants; its rates and accelerations belong to the same instants.
        steps: number of time steps without trials; number of solved poses for method "pose".
        seconds: time for stepping or solving in [s], without trials and the evaluation of records.
        settings: settings of the stepping; None for method "pose".
        timestep: time step in [s]; None for method "pose".
        note: changes of a custom model, and remarks on motion that dynamics do not determine; may be empty.
    """

    motion: Motion
    steps: int
    seconds: float
    settings: Settings | None = None
    timestep: float | None = None
    note: str = ""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Run(RunRecord):
    """A run in MuJoCo and its outcome.

    Attributes:
        outcome: "passed", "failed", "diverged" or "changed assembly".
        tolerance: tolerance on the positions of tracked points, in [m]: as requested, or 1e-4 of the stroke.
        estimate: the simulator's estimate of the largest position error: distance from the pose solved at the
            same crank angle, in [m].
        method: "step" or "pose".
        shortfall: sentence on a requested tolerance that more steps do not satisfy; else empty.
    """

    outcome: Outcome
    tolerance: float
    estimate: float
    method: Method
    shortfall: str = ""

    def summary(self) -> dict[str, Any]:
        """Return the output of `mechsim simulate --json`."""
        return {
            **attributes(self, "outcome", "tolerance", "steps", "seconds", "method", "note"),
            "estimate": self.estimate if np.isfinite(self.estimate) else None,
            "settings": self.settings.as_dict() | {"timestep": self.timestep} if self.settings else {},
        }


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Driven(RunRecord):
    """Result of a dynamic model with a prescribed crank motion in MuJoCo.

    Attributes:
        forces: forces at the recorded instants.
        outcome: "done" or "diverged".
        method: "pose" or "step".
        masses: masses of the links, with their sources.
    """

    forces: ForceRecord
    outcome: Outcome
    method: Method
    masses: tuple[LinkMass, ...] = ()
