"""A run in MuJoCo and how it ended."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mechsim.model.display import short_repr
from mechsim.model.motion import Motion
from mechsim.model.outcome import Outcome
from mechsim.simulation.refine import Promise
from mechsim.simulation.settings import Settings

Method = Literal["step", "pose"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A run in MuJoCo and how it ended.

    Attributes:
        motion: at the recorded instants; its rates and accelerations belong to the same instants.
        outcome: "met", "missed", "diverged" or "changed assembly".
        tolerance: bound on the place of any tracked point, in [m]: what was asked for, or a thousandth
            of the longest link.
        estimate: the worst place error by the simulator's own account: distance from the pose solved
            at the same crank angle, in [m].
        steps: time steps taken, trials not counted; poses solved for method "pose".
        seconds: time spent stepping or solving, trials not counted.
        settings: how it was stepped; None for method "pose".
        timestep: in [s]; None for method "pose".
        method: "step" or "pose".
        promise: how a tolerance that was asked for was kept; None for method "pose" and without one.
    """

    motion: Motion
    outcome: Outcome
    tolerance: float
    estimate: float
    steps: int
    seconds: float
    settings: Settings | None
    timestep: float | None = None
    method: Method
    promise: Promise | None = None

    __repr__ = short_repr

    def summary(self) -> dict[str, Any]:
        """Return what `mechsim simulate --json` prints."""
        return {
            "outcome": self.outcome,
            "tolerance": self.tolerance,
            "estimate": self.estimate if np.isfinite(self.estimate) else None,
            "steps": self.steps,
            "seconds": self.seconds,
            "method": self.method,
            "settings": self.settings.as_dict() | {"timestep": self.timestep} if self.settings else {},
        }
