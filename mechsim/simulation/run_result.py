"""Runs in MuJoCo and how they ended: a driven one, one with its efforts, a free one."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mechsim.model.efforts import Efforts, FreeRun
from mechsim.model.finding import Outcome
from mechsim.model.masses import LinkMass
from mechsim.model.motion import Motion, short_repr
from mechsim.simulation.refine import ToleranceReport
from mechsim.simulation.settings import Settings

Method = Literal["step", "pose"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A run in MuJoCo and how it ended.

    Attributes:
        motion: at the recorded instants; its rates and accelerations belong to the same instants.
        outcome: "passed", "failed", "diverged" or "changed assembly".
        tolerance: bound on the place of any tracked point, in [m]: what was asked for, or a
            ten-thousandth of the stroke.
        estimate: the worst place error by the simulator's own account: distance from the pose solved
            at the same crank angle, in [m].
        steps: time steps taken, trials not counted; poses solved for method "pose".
        seconds: time spent stepping or solving, trials not counted.
        settings: how it was stepped; None for method "pose".
        timestep: in [s]; None for method "pose".
        method: "step" or "pose".
        promise: how a tolerance that was asked for was kept; None for method "pose" and without one.
        note: what was changed of a model of one's own, and what is not for dynamics to decide; empty where
            there is nothing.
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
    """A machine under a prescribed crank, as MuJoCo has it.

    Attributes:
        motion: at the recorded instants.
        efforts: at the same instants.
        outcome: "done" or "diverged"; where a tolerance was asked for, "passed" or "failed".
        method: "pose" or "step".
        steps: time steps taken, or poses solved.
        seconds: time spent stepping or solving, the evaluation of the records not counted.
        settings: how it was stepped; None for method "pose".
        timestep: in [s]; None for method "pose".
        promise: what was asked of it and how it came out; None where no tolerance was.
        note: what is to be said of it, in one sentence; empty where there is nothing.
        masses: of the links, and where each comes from.
    """

    motion: Motion
    efforts: Efforts
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
    """A free run as MuJoCo has it.

    Attributes:
        motion: at the recorded instants.
        efforts: at the same instants; no drive acts, so that the torque in it is what MuJoCo's equation
            of motion leaves over.
        free: crank motion, energies and how it ended, at the same instants.
        steps: time steps taken.
        seconds: time spent stepping.
        timestep: in [s].
        settings: how it was stepped.
        promise: what was asked of it and how it came out; None where no tolerance was.
        masses: of the links, and where each comes from.
    """

    motion: Motion
    efforts: Efforts
    free: FreeRun
    steps: int
    seconds: float
    timestep: float
    settings: Settings
    tolerance_report: ToleranceReport | None = None
    masses: tuple[LinkMass, ...] = ()

    __repr__ = short_repr
