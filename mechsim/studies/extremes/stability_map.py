"""All axes, for chosen mechanisms, with their borders."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from mechsim.analytic import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.studies.extremes import axes
from mechsim.studies.extremes.axes import Drift
from mechsim.studies.extremes.trial import Border, Trial, pushed

# name of an axis -> what it is, with its unit
AXES: dict[str, str] = {
    "steps": "steps in a turn",
    "speed": "crank speed [rpm]",
    "size": "size of the mechanism [m]",
    "mass ratio": "mass of the coupler over that of the others",
    "dead centre": "distance to the dead centre [rad]",
    "beyond dead centre": "angle beyond the dead centre [rad]",
    "near tangent": "length from where the crank stops, of itself",
    "far start": "error of the starting guess [size, rad]",
    "change point": "distance to the change point [rad]",
    "gear ratio": "gear ratio",
}
# bisections of a border: to a twentieth of a decade, and quickly
HALVINGS, FEW = 5, 2
# the largest gear ratio that a quick and a whole study try; turns of the long run
RATIOS, TURNS = (8.0, 64.0), (200.0, 10_000.0)

Push = Callable[[ClosedForm, float], Trial]


@dataclass
class StabilityMap:
    """What came of it.

    Attributes:
        trials: every run.
        borders: where outcomes change along an axis.
        drifts: of the long runs.
    """

    trials: list[Trial] = field(default_factory=list[Trial])
    borders: list[Border] = field(default_factory=list[Border])
    drifts: list[Drift] = field(default_factory=list[Drift])

    @property
    def passed(self) -> bool:
        """Whether every run ended as the closed form says, and no long run drifted."""
        return all(one.passed for one in self.trials) and all(one.passed for one in self.drifts)

    @property
    def wrong(self) -> list[Trial]:
        """The runs that did not."""
        return [trial for trial in self.trials if not trial.passed]

    def as_dict(self) -> dict[str, Any]:
        """Return the study as plain data."""
        drifts = [
            {"mechanism": d.mechanism, "turns": d.turns, "first": d.first, "last": d.last, "passed": d.passed}
            for d in self.drifts
        ]
        return {
            "passed": self.passed,
            "borders": [border.as_dict() for border in self.borders],
            "drifts": drifts,
            "trials": [trial.as_dict() for trial in self.trials],
        }


def _decades(low: float, high: float, stride: int = 1) -> list[float]:
    return [10.0**n for n in range(round(np.log10(low)), round(np.log10(high)) + 1, stride)]


def pushes_of(drive: ClosedForm, quick: bool) -> list[tuple[str, Push, Sequence[float]]]:
    """Return the axes of one mechanism: name, what to do at a value, values from sound to unsound."""
    coarse = 2 if quick else 1
    most = 4 if quick else 5
    pushes: list[tuple[str, Push, Sequence[float]]] = [
        ("steps", axes.steps, [10.0**most, *([1e4] if most > 4 else []), 1e3, 100.0, 50.0, 20.0, 10.0]),
        ("speed", axes.speed, [1.0, 1e3, 1e5, 1e6, 1e7]),
        ("size", axes.size, [1e-2, *_decades(1e-9, 1e-3, coarse)[::-1]]),
        ("size", axes.size, [1e-1, *_decades(1.0, 1e9, 2 * coarse - 1)]),
        ("mass ratio", axes.mass_ratio, [*_decades(1e-12, 1.0, 2 * coarse)[::-1], 0.0]),
        ("mass ratio", axes.mass_ratio, _decades(10.0, 1e11, 2 * coarse)),
    ]
    if drive.swinging:
        near = _decades(1e-12, 1e-1, 3 if quick else 1)[::-1]
        for method in ("pose", "step"):
            pushes.append(("dead centre", partial(_dead_centre, method=method, beyond=False), near))
            pushes.append(("near tangent", partial(axes.tangent, method=method), near))
        pushes.append(
            (
                "beyond dead centre",
                partial(_dead_centre, method="pose", beyond=True),
                near[:: 2 if quick else 1],
            )
        )
    for seed in range(2 if quick else 6):
        far = [1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0]
        pushes.append(("far start", partial(axes.far_start, seed=seed), far))
    return pushes


def _dead_centre(drive: ClosedForm, value: float, method: str, beyond: bool) -> Trial:
    return axes.dead_centre(drive, value, method, beyond)


def study(
    names: Sequence[str] | None = None,
    *,
    quick: bool = False,
    done: Callable[[str], None] = lambda _: None,
) -> StabilityMap:
    """Push every axis until something breaks.

    Args:
        names: mechanisms of the catalogue; None takes all.
        quick: fewer values, coarser borders, shorter runs.
        done: called after each axis of each mechanism.
    """
    found = StabilityMap()
    for name in names or list(catalog.DRIVES):
        drive = catalog.make(name)
        for axis, push, values in pushes_of(drive, quick):
            trials, borders = pushed(partial(push, drive), values, FEW if quick else HALVINGS)
            found.trials += trials
            found.borders += borders if axis != "far start" else []
            done(f"{name}: {axis}")
        found.trials += [
            axes.change_point(drive, which, on) for which in drive.laid_flat for on in (True, False)
        ]
        if drive.gear:
            found.trials += [axes.gears(drive, ratio) for ratio in _ratios(RATIOS[0 if quick else 1])]
        if drive.long_runs:
            found.drifts.append(axes.drift(drive, TURNS[0 if quick else 1]))
            done(f"{name}: {found.drifts[-1].turns:g} turns")
    return found


def axes_of(names: Sequence[str] | None, quick: bool) -> int:
    """Return how often `study` will call `done`."""
    drives = [catalog.make(name) for name in names or catalog.DRIVES]
    return sum(drive.long_runs + len(pushes_of(drive, quick)) for drive in drives)


def _ratios(most: float) -> list[float]:
    return [2.0**n for n in range(round(np.log2(most)) + 1)]
