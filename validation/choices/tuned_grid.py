"""An exhaustive search over a grid of settings, to compare with the search of `mechsim tune`.

The first grid varies step, integrator, time constant and impedance of the loops. The second grid, around the
fastest settings that satisfy the tolerance, varies solver, iterations, solver tolerance, kind of matrix and
islands. The result satisfies the tolerance at every step over a motion 1.5 times as long.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.scene.converged_reference import LOWEST_COMPLIANCE_SOLIMP
from mechsim.studies.scene.errors import SceneEvaluator
from mechsim.studies.scene.run import SceneRun, run_scene, step_times
from mechsim.studies.scene.scene import UserScene
from mechsim.studies.scene.step_sizes import shortest_time_constant

# time steps relative to that of the file: largest, ratio of successive steps, smallest
MAX_STEP_RATIO, STEP_FACTOR, MIN_STEP_RATIO = 20.0, 1.2, 0.01
INTEGRATORS = ("Euler", "implicitfast", "discrete", "implicit", "RK4")
CONSTANTS = (1.5, 2.0, 3.0, 5.0, 10.0, None)
SOLVERS, ITERATIONS, TOLERANCES = ("Newton", "CG", "PGS"), (1, 2, 5, 100), (1.0, 100.0, 1e-4)
JACOBIANS = ("dense", "sparse")
# number of settings of the first grid to refine; of the second grid to time repeatedly
REFINED, TIMED = 3, 8
# the search ends where this fraction of the shortest time exceeds the best; factor of the longer motion
MIN_SPEED_RATIO, DURATION_FACTOR = 0.7, 1.5
# largest ratio to the best time, for the error of a single timing
MAX_TIME_RATIO = 1.5
# smallest number of steps in a motion
MIN_STEPS = 50
TimedSettings = tuple[float, PlainSettings]


def fastest_valid(scene: UserScene, tolerance: float) -> tuple[PlainSettings, float] | None:
    """Return the fastest settings of the grid that satisfy a closure tolerance, and their time in [s].

    The time is that of a simulated second.
    """
    result = sorted(_coarse_grid(scene, tolerance), key=lambda item: item[0])
    around = [settings for _, settings in result[:REFINED]]
    for settings in around:
        for item in _fine_grid(scene, settings):
            result += _if_valid(run_scene(scene, item.applied(scene.model)), item, tolerance, result)
    result.sort(key=lambda item: item[0])
    best = [settings for _, settings in result[: 3 * TIMED] if _valid_for_longer(scene, settings, tolerance)][
        :TIMED
    ]
    if not best:
        return None
    times = step_times([(scene, item.applied(scene.model)) for item in best])
    least = int(times.argmin())
    return best[least], float(times[least])


def _coarse_grid(scene: UserScene, tolerance: float) -> list[TimedSettings]:
    own, safe = float(scene.model.opt.timestep), 0.5 * shortest_time_constant(scene.model)
    longest = max(own, min(safe, scene.duration / MIN_STEPS))
    step, result = MAX_STEP_RATIO * own, list[TimedSettings]()
    while step >= MIN_STEP_RATIO * own:
        tried = list[float]()
        for integrator, constant, hard in itertools.product(INTEGRATORS, CONSTANTS, (True, False)):
            if step > longest * (1.0 + 1e-9) or (constant == 1.5 and step > safe):
                continue
            settings = PlainSettings(
                timestep=step,
                integrator=integrator,
                solver="Newton",
                solref=None if constant is None else (constant * step, 1.0),
                solimp=LOWEST_COMPLIANCE_SOLIMP if hard else None,
                refsafe=False if constant == 1.5 else None,
                tolerance=max(float(scene.model.opt.tolerance), scene.solver_tolerance),
            )
            run = run_scene(scene, settings.applied(scene.model))
            tried += [] if run.broken else [run.seconds_per_second]
            result += _if_valid(run, settings, tolerance, result)
        if result and tried and MIN_SPEED_RATIO * min(tried) > min(result)[0]:
            break
        step /= STEP_FACTOR
    return result


def _fine_grid(scene: UserScene, settings: PlainSettings) -> Iterator[PlainSettings]:
    usual = scene.solver_tolerance
    for solver, iterations, tolerance, jacobian, island in itertools.product(
        SOLVERS, ITERATIONS, TOLERANCES, JACOBIANS, (True, False)
    ):
        yield replace(
            settings,
            solver=solver,
            iterations=iterations,
            tolerance=tolerance * usual,
            jacobian=jacobian,
            island=island,
        )


def _if_valid(
    run: SceneRun, settings: PlainSettings, tolerance: float, result: Sequence[TimedSettings]
) -> list[TimedSettings]:
    """Return settings with their time if they satisfy the tolerance and are not much slower than others."""
    time = run.seconds_per_second
    slow = time > MAX_TIME_RATIO * min((item[0] for item in result), default=np.inf)
    return [] if slow or not SceneEvaluator().errors(run).closure <= tolerance else [(time, settings)]


def _valid_for_longer(scene: UserScene, settings: PlainSettings, tolerance: float) -> bool:
    model = settings.applied(scene.model)
    run = run_scene(scene, model, records=None, duration=DURATION_FACTOR * scene.duration)
    return SceneEvaluator().errors(run).closure <= tolerance
