"""Results of runs in MuJoCo: a driven run, one with its forces, a free one."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mechsim.model.finding import Outcome
from mechsim.model.force_record import ForceRecord, FreeRun
from mechsim.model.masses import LinkMass
from mechsim.model.motion import Motion, short_repr
from mechsim.simulation.settings import Settings
from mechsim.simulation.tolerance import ToleranceReport

Method = Literal["step", "pose"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """Data that every run in MuJoCo records.

    Attributes:
        motion: at the recorded instants; its rates and accelerations belong to the same instants.
        steps: time steps taken, trials not counted; poses solved for method "pose".
        seconds: time spent stepping or solving, trials and the evaluation of records not counted.
        settings: of the stepping; None for method "pose".
        timestep: in [s]; None for method "pose".
        tolerance_report: whether a requested tolerance is satisfied; None for method "pose" and without one.
        note: changes of a custom model, and what dynamics do not determine; may be empty.
    """

    motion: Motion
    steps: int
    seconds: float
    settings: Settings | None = None
    timestep: float | None = None
    tolerance_report: ToleranceReport | None = None
    note: str = ""

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Run(RunRecord):
    """A run in MuJoCo and its outcome.

    Attributes:
        outcome: "passed", "failed", "diverged" or "changed assembly".
        tolerance: of the positions of tracked points, in [m]: as requested, or a ten-thousandth of the
            stroke.
        estimate: largest position error as estimated by the simulator: distance from the pose solved at
            the same crank angle, in [m].
        method: "step" or "pose".
    """

    outcome: Outcome
    tolerance: float
    estimate: float
    method: Method

    def summary(self) -> dict[str, Any]:
        """Return the output of `mechsim simulate --json`."""
        return {
            "outcome": self.outcome,
            "tolerance": self.tolerance,
            "estimate": self.estimate if np.isfinite(self.estimate) else None,
            "steps": self.steps,
            "seconds": self.seconds,
            "method": self.method,
            "note": self.note,
            "settings": self.settings.as_dict() | {"timestep": self.timestep} if self.settings else {},
        }


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Driven(RunRecord):
    """A dynamic model under a prescribed crank, by MuJoCo.

    Attributes:
        forces: at the recorded instants.
        outcome: "done" or "diverged"; with a tolerance "passed" or "failed".
        method: "pose" or "step".
        masses: of the links, with their sources.
    """

    forces: ForceRecord
    outcome: Outcome
    method: Method
    masses: tuple[LinkMass, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class SteppedFreeRun(RunRecord):
    """A free run by MuJoCo.

    Attributes:
        forces: at the recorded instants; no drive acts, so its torque is the residual of MuJoCo's equation
            of motion.
        free: crank motion, energies and outcome, at the same instants.
        masses: of the links, with their sources.
    """

    forces: ForceRecord
    free: FreeRun
    masses: tuple[LinkMass, ...] = ()
