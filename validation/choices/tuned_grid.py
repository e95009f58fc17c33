"""An exhaustive search over a grid of settings, to hold the search of `mechsim tune` against.

First every step with every integrator, time constant and impedance of the loops; then, around the quickest of
what keeps the tolerance, every solver, number of iterations, tolerance of the solver, kind of matrix and
islands. What keeps it does so at every step over a motion half as long again.
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

# steps in those of the file's own, each so many times shorter than the one before
LONGEST, SHORTER, SHORTEST = 20.0, 1.2, 0.01
INTEGRATORS = ("Euler", "implicitfast", "discrete", "implicit", "RK4")
CONSTANTS = (1.5, 2.0, 3.0, 5.0, 10.0, None)
SOLVERS, ITERATIONS, TOLERANCES = ("Newton", "CG", "PGS"), (1, 2, 5, 100), (1.0, 100.0, 1e-4)
JACOBIANS = ("dense", "sparse")
# of the first grid, about whose quickest the second is laid; of the second, timed with care
AROUND, TIMED = 3, 8
# steps beyond the quickest found so far, in its time a simulated second, that could still be quicker
HOPE, LONGER = 0.7, 1.5
# as much slower as clocks may err
SLOWER = 1.5
# fewest steps in a motion
FEWEST = 50
Found = tuple[float, PlainSettings]


def quickest_kept(scene: UserScene, tolerance: float) -> tuple[PlainSettings, float] | None:
    """Return the settings of the grid that keep a tolerance by closure in the least time, with that, in [s].

    The time is of a simulated second.
    """
    result = sorted(_first(scene, tolerance), key=lambda item: item[0])
    around = [settings for _, settings in result[:AROUND]]
    for settings in around:
        for item in _second(scene, settings):
            result += _kept(run_scene(scene, item.applied(scene.model)), item, tolerance, result)
    result.sort(key=lambda item: item[0])
    best = [settings for _, settings in result[: 3 * TIMED] if _stands(scene, settings, tolerance)][:TIMED]
    if not best:
        return None
    times = step_times([(scene, item.applied(scene.model)) for item in best])
    least = int(times.argmin())
    return best[least], float(times[least])


def _first(scene: UserScene, tolerance: float) -> list[Found]:
    own, safe = float(scene.model.opt.timestep), 0.5 * shortest_time_constant(scene.model)
    longest = max(own, min(safe, scene.duration / FEWEST))
    step, result = LONGEST * own, list[Found]()
    while step >= SHORTEST * own:
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
            result += _kept(run, settings, tolerance, result)
        if result and tried and HOPE * min(tried) > min(result)[0]:
            break
        step /= SHORTER
    return result


def _second(scene: UserScene, settings: PlainSettings) -> Iterator[PlainSettings]:
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


def _kept(run: SceneRun, settings: PlainSettings, tolerance: float, result: Sequence[Found]) -> list[Found]:
    """Return settings with their time if they keep the tolerance and are not much slower than others."""
    time = run.seconds_per_second
    slow = time > SLOWER * min((item[0] for item in result), default=np.inf)
    return [] if slow or not SceneEvaluator().errors(run).closure <= tolerance else [(time, settings)]


def _stands(scene: UserScene, settings: PlainSettings, tolerance: float) -> bool:
    model = settings.applied(scene.model)
    run = run_scene(scene, model, records=None, duration=LONGER * scene.duration)
    return SceneEvaluator().errors(run).closure <= tolerance
