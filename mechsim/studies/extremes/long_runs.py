"""Axes of patience: many turns, large gear ratios, more constraints than needed."""

from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.simulation import Settings, simulate
from mechsim.studies.extremes.trial import Trial, attempt

SPEED = 20.0 * np.pi
# steps a turn of a long run, and records in it
STEPS, RECORDS = 100, 20_000
# an error of the last turns above this many of the first is drift
GROWN = 2.0


@dataclass(frozen=True, slots=True)
class Drift:
    """Place errors of a long run against the closed form.

    Attributes:
        mechanism: name.
        turns: how many.
        first: worst error in the first hundredth of them, in units of the size.
        last: worst error in the last hundredth.
    """

    mechanism: str
    turns: float
    first: float
    last: float

    @property
    def passed(self) -> bool:
        """Whether the error did not grow."""
        return self.last <= GROWN * self.first


def drift(drive: ClosedForm, turns: float) -> Drift:
    """Run many turns at a hundred steps each and compare the last with the first."""
    mechanism = drive.mechanism
    samples = min(RECORDS, round(4 * turns))
    run = simulate(
        mechanism, speed=SPEED, turns=turns, settings=Settings(steps_per_turn=STEPS), samples=samples
    )
    if run.motion.broken:
        return Drift(drive.name, turns, np.nan, np.inf)
    exact = drive.positions(run.motion.angle)
    gaps = [np.sqrt(((run.motion.points[n].position - p) ** 2).sum(1)) for n, p in exact.items()]
    error = np.max(gaps, axis=0) / mechanism.size
    part = max(8, len(error) // 100)
    return Drift(drive.name, turns, float(error[1:part].max()), float(error[-part:].max()))


def gears(drive: ClosedForm, value: float) -> Trial:
    """A second crank geared `value` times faster, stepped as finely as it turns."""
    drive = replace(drive, **{drive.gear: float(round(value))})
    settings = Settings(steps_per_turn=500 * max(1, round(value)))
    return attempt("gear ratio", drive, value, drive.mechanism, speed=SPEED, settings=settings, samples=720)
