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
class Run:
    """A run in MuJoCo and its outcome.

    Attributes:
        motion: at the recorded instants; its rates and accelerations belong to the same instants.
        outcome: "passed", "failed", "diverged" or "changed assembly".
        tolerance: bound on the place of any tracked point, in [m]: what was asked for, or a
            ten-thousandth of the stroke.
        estimate: the worst place error by the simulator's own account: distance from the pose solved
            at the same crank angle, in [m].
        steps: time steps taken, trials not counted; poses solved for method "pose".
        seconds: time spent stepping or solving, trials not counted.
        settings: of the stepping; None for method "pose".
        timestep: in [s]; None for method "pose".
        method: "step" or "pose".
        tolerance_report: whether a requested tolerance is satisfied; None for method "pose" and without one.
        note: changes of a custom model, and what dynamics do not determine; may be empty.
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
    tolerance_report: ToleranceReport | None = None
    note: str = ""

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
            "note": self.note,
            "settings": self.settings.as_dict() | {"timestep": self.timestep} if self.settings else {},
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Driven:
    """A dynamic model under a prescribed crank, by MuJoCo.

    Attributes:
        motion: at the recorded instants.
        efforts: at the same instants.
        outcome: "done" or "diverged"; where a tolerance was asked for, "passed" or "failed".
        method: "pose" or "step".
        steps: time steps taken, or poses solved.
        seconds: time spent stepping or solving, the evaluation of the records not counted.
        settings: how it was stepped; None for method "pose".
        timestep: in [s]; None for method "pose".
        tolerance_report: whether a requested tolerance is satisfied; None without one.
        note: remark on the run as a sentence; may be empty.
        masses: of the links, with their sources.
    """

    motion: Motion
    efforts: ForceRecord
    outcome: Outcome
    method: Method
    steps: int
    seconds: float
    settings: Settings | None = None
    timestep: float | None = None
    tolerance_report: ToleranceReport | None = None
    note: str = ""
    masses: tuple[LinkMass, ...] = ()

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class SteppedFreeRun:
    """A free run by MuJoCo.

    Attributes:
        motion: at the recorded instants.
        efforts: at the same instants; no drive acts, so its torque is the residual of MuJoCo's equation of
            motion.
        free: crank motion, energies and outcome, at the same instants.
        steps: time steps taken.
        seconds: time spent stepping.
        timestep: in [s].
        settings: of the stepping.
        tolerance_report: whether a requested tolerance is satisfied; None without one.
        masses: of the links, with their sources.
    """

    motion: Motion
    efforts: ForceRecord
    free: FreeRun
    steps: int
    seconds: float
    timestep: float
    settings: Settings
    tolerance_report: ToleranceReport | None = None
    masses: tuple[LinkMass, ...] = ()

    __repr__ = short_repr
