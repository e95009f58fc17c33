"""Longer steps that move as the scene's own: inertias, dampers, springs, rows and servos fitted anew.

What a step does to a scene is as much its own as its parts: light parts jump, rows give, a servo's speed is
felt late. With numbers fitted so that the motion at longer steps is that at the scene's own, most of it is
made good. Fitted is over two motions; the one that judges is neither of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import process_time

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.reduction.bench import Bench
from mechsim.studies.reduction.candidate import Candidate
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.knobs import Knob, knobs_of, turned, turned_in
from mechsim.studies.reduction.lean_scene import LeanScene
from mechsim.studies.reduction.stepping import CALLED, EULER, IMPLICITFAST, LONGER_STEPS, stepped_so
from mechsim.studies.scenes.scene_run import stepped

# processor time of one fit, in [s]
SECONDS = 30.0
# iterations before what was reached is looked at; part of the sum of squares by which these must lessen it
TURNS, WORTHWHILE = 6, 0.1
# what a knob is turned by to see what it does, and what counts where a run breaks, in tolerances
NUDGE, FAR = 1e-6, 1e3
# least effect of a knob turned by one that counts, in tolerances
FELT = 0.05
# part of the tolerance that is good enough
GOAL = 0.3
INTEGRATORS = (int(EULER), int(IMPLICITFAST))


@dataclass(frozen=True)
class Refit:
    """Longer steps and the numbers fitted to them.

    Attributes:
        candidate: these.
        error: worst over the motions fitted to, in [m].
        stand: knob -> where it stands, in turns; where to begin with steps still longer.
    """

    candidate: Candidate
    error: float
    stand: dict[Knob, float]


@quiet()
def refit(benches: Sequence[Bench], seen: Evidence, times: int, start: Mapping[Knob, float]) -> Refit | None:
    """Return a scene's steps made longer, what acts in it fitted so that it moves as before.

    Args:
        benches: the full scene over the motions fitted to.
        seen: of the scene with its own steps.
        times: as long.
        start: knob -> where it begins; those not named begin where they are.

    Returns:
        None where it takes too long, or nothing has any effect.
    """
    fits: list[_Fit] = []
    for kind in INTEGRATORS:
        longer = seen.spec.copy()
        stepped_so(longer, times, kind)
        fits.append(_Fit(benches, longer, seen, start))
    # the start of the motion is no measure: light parts jump there whatever the integrator
    best = min(fits, key=lambda one: float(np.median(np.abs(one.residuals(one.start)))))
    if best.seconds > SECONDS or not best.felt():
        return None
    values, worst = best.fitted()
    step, own = float(seen.spec.option.timestep), CALLED[int(seen.spec.option.integrator)]
    kind = int(best.spec.option.integrator)
    what = (
        f"steps of {step:g} s, {own}: {step * times:g} s, {CALLED[kind]}, and {len(best.knobs)} numbers "
        "fitted to them, of inertia, dampers, springs, rows and servos"
    )
    edit = partial(_refitted, times=times, integrator=kind, knobs=best.knobs, values=values)
    stand = dict(zip(best.knobs, values.tolist(), strict=True))
    return Refit(Candidate(LONGER_STEPS, what, edit), worst * seen.bound, stand)


def _refitted(spec: mujoco.MjSpec, times: int, integrator: int, knobs: Sequence[Knob], values: Array) -> None:
    stepped_so(spec, times, integrator)
    turned_in(spec, knobs, values)


class _Fit:
    """Knobs of a scene turned until it moves as the full one."""

    def __init__(
        self, benches: Sequence[Bench], spec: mujoco.MjSpec, seen: Evidence, start: Mapping[Knob, float]
    ):
        self.spec, self.bound = spec, seen.bound
        self.runs = [(bench, bench.lean(spec)) for bench in benches]
        self.knobs = knobs_of(spec, self.runs[0][1], seen.limited)
        self.start = np.array([start.get(knob, 0.0) for knob in self.knobs])
        began = process_time()
        self.residuals(self.start)
        # of a round of iterations
        self.seconds = TURNS * len(self.knobs) * (process_time() - began)

    def felt(self) -> bool:
        """Forget the knobs that do nothing where they begin; say whether any is left."""
        if not self.knobs:
            return False
        felt = np.abs(self._slopes(self.start)).max(0) > FELT
        self.knobs = tuple(knob for knob, one in zip(self.knobs, felt, strict=True) if one)
        self.start = self.start[felt]
        return bool(felt.any())

    def fitted(self) -> tuple[Array, float]:
        """Return where the knobs stand best, and the worst error there in tolerances."""
        from scipy.optimize import least_squares

        ends, values, cost = process_time() + SECONDS, self.start, np.inf
        while True:
            found = least_squares(self.residuals, values, jac=self._slopes, max_nfev=TURNS)  # pyright: ignore[reportArgumentType]
            values, worst = found.x, self._worst(found.x)
            if worst <= GOAL or process_time() > ends or found.cost > (1.0 - WORTHWHILE) * cost:
                return values, worst
            cost = float(found.cost)

    def residuals(self, values: Array) -> Array:
        """Return how far tracked points are from the full scene's, in tolerances, flat."""
        return np.concatenate([self._away(bench, lean, values) for bench, lean in self.runs])

    def _away(self, bench: Bench, lean: LeanScene, values: Array) -> Array:
        run = stepped(replace(lean, model=turned(lean.model, self.knobs, values)), records=None)
        if run.broken:
            steps = int(np.ceil(lean.duration / float(lean.model.opt.timestep) - 1e-6))
            return np.full(3 * len(lean.places) * (steps + 1), FAR)
        return (bench.away(run) / self.bound).ravel()

    def _worst(self, values: Array) -> float:
        return float(np.linalg.norm(self.residuals(values).reshape(-1, 3), axis=1).max())

    def _slopes(self, values: Array) -> Array:
        here = self.residuals(values)
        nudges = NUDGE * np.eye(len(values))
        return np.stack([(self.residuals(values + nudge) - here) / NUDGE for nudge in nudges], 1)
