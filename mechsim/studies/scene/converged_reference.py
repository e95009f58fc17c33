"""The limit of a user's scene: the motion it has with ever smaller steps and ever harder loops.

Everything else is the file's own: contacts, limits, friction, actuators, springs. A loop's time constant
goes with the step, so that the loops stand less open the smaller it is.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.convergence import believed_order
from mechsim.simulation.divergence import stiffness_cause
from mechsim.studies.scene.evaluator import SceneRun, stepped
from mechsim.studies.scene.scene import UserScene

# steps in the coarsest run, at least; and in the finest, at most; each next has twice as many
LEAST, MOST = 2000, 400_000
# tried in this order; the last takes stiffness implicitly
INTEGRATORS = ("RK4", "implicitfast", "discrete")
# tolerance of the solver, in its usual one
EXACTER = 1e-4
# instants recorded of each
RECORDED = 2000
# time constant of the loops in steps, and MuJoCo's hardest impedance
CONSTANT = 10.0
HARDEST = (0.9999, 0.9999, 0.001, 0.5, 2.0)


@dataclass(frozen=True)
class SceneLimit:
    """What a scene's motion tends to.

    Attributes:
        run: the finest run.
        bars: its own error, as found from three runs: of points in [m], of efforts in [N m] or [N].
        order: at which points changed from run to run; None where they did not.
        what: how it was found, in words.
        broken: why there is none, in words; empty where there is.
    """

    run: SceneRun
    bars: tuple[float, float]
    order: float | None
    what: str
    broken: str = ""

    def points(self, time: Array) -> Array:
        """Return the tracked points at times (n,) in [s], (n, k, 3) in [m]."""
        return self._at(time, self.run.points)

    def efforts(self, time: Array) -> Array:
        """Return the efforts at times (n,) in [s], (n, e)."""
        return self._at(time, self.run.efforts)

    def _at(self, time: Array, values: Array) -> Array:
        return interpolated(self.run.time, values, time)


def interpolated(known: Array, values: Array, time: Array) -> Array:
    """Return values (n, ...) known at rising times at other times, by cubics through four neighbours."""
    if len(known) < 4:
        return values[np.searchsorted(known, time).clip(0, len(known) - 1)]
    i = np.clip(np.searchsorted(known, time) - 2, 0, len(known) - 4)
    nodes = known[i[:, None] + np.arange(4)]  # (n, 4)
    weights = np.ones_like(nodes)
    for a in range(4):
        for b in range(4):
            if a != b:
                weights[:, a] *= (time - nodes[:, b]) / (nodes[:, a] - nodes[:, b])
    return sum(weights[:, a].reshape(-1, *(1,) * (values.ndim - 1)) * values[i + a] for a in range(4))  # pyright: ignore[reportReturnType]


def hardened(
    model: mujoco.MjModel, timestep: float, integrator: str, tolerance: float = 1e-12
) -> mujoco.MjModel:
    """Return a copy of a model with smaller steps and loops as hard as MuJoCo has them."""
    model = copy.copy(model)
    option = model.opt
    option.timestep = timestep
    option.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))
    option.solver = int(mujoco.mjtSolver.mjSOL_NEWTON)
    option.iterations, option.ls_iterations = max(option.iterations, 100), max(option.ls_iterations, 50)
    option.tolerance = min(option.tolerance, tolerance) or tolerance
    model.eq_solref[:] = CONSTANT * timestep, 1.0
    model.eq_solimp[:] = HARDEST
    return model


def limit_of(
    scene: UserScene,
    goal: float = 0.0,
    *,
    seconds: float = 10.0,
    tell: Callable[[str], None] = lambda _: None,
) -> SceneLimit:
    """Return the limit of a scene.

    Args:
        scene: the scene.
        goal: error of its points in [m] that is small enough; else it becomes as fine as is affordable.
        seconds: about which it may take.
        tell: told what is being done.
    """
    own = scene.duration / float(scene.model.opt.timestep)
    first = int(np.ceil(np.clip(2.0 * own, LEAST, MOST / 4)))
    found: SceneLimit | None = None
    for integrator in INTEGRATORS:
        finest = hardened(scene.model, 4.0 * scene.duration / MOST, integrator)
        if integrator != INTEGRATORS[-1] and stiffness_cause(finest):
            continue
        best = _finer(scene, first, integrator, goal, seconds, tell)
        if found is None or (found.broken and not best.broken) or best.bars[0] < found.bars[0]:
            found = best
        if not found.broken:
            break
    assert found is not None
    return found


def _finer(
    scene: UserScene,
    steps: int,
    integrator: str,
    goal: float,
    seconds: float,
    tell: Callable[[str], None],
) -> SceneLimit:
    """Return the limit by one integrator, finer and finer until it is good enough or dear enough."""
    runs: list[SceneRun] = []
    found = SceneLimit(stepped(scene, records=2), (np.inf, np.inf), None, "", "not run")
    took, ends = 0.0, perf_counter() + seconds
    # the next takes twice as long as the last
    while steps <= MOST and (0 < len(runs) < 3 or perf_counter() + 2.0 * took < ends):
        tell(f"limit: {integrator}, {steps:,} steps")
        model = hardened(scene.model, scene.duration / steps, integrator, EXACTER * scene.usual_tolerance)
        began = perf_counter()
        run = stepped(scene, model, records=RECORDED, held=0.5)
        took, steps = perf_counter() - began, 2 * steps
        runs = [] if run.broken else [*runs[-2:], run]
        if run.broken:
            found = found if found.broken == "" else SceneLimit(run, (np.inf, np.inf), None, "", run.broken)
        elif len(runs) == 3:
            found = _judged(runs, integrator)
            if found.bars[0] <= goal:
                break
    return found


def _judged(runs: Sequence[SceneRun], integrator: str) -> SceneLimit:
    """Return the limit that three runs, each of twice as many steps as the one before, point to."""
    coarse, middle, fine = runs
    bars, orders = list[float](), list[float]()
    for kind in ("points", "efforts"):
        last, before = _apart(fine, middle, kind), _apart(middle, coarse, kind)
        order = believed_order(before, last, 2.0)
        bars.append(last / (2.0**order - 1.0))
        orders.append(order)
    what = f"{fine.steps:,} steps of {integrator}, loops with time constants of {CONSTANT:g} steps"
    return SceneLimit(fine, (bars[0], bars[1]), orders[0], what)


def _apart(fine: SceneRun, run: SceneRun, kind: str) -> float:
    limit = SceneLimit(fine, (0.0, 0.0), None, "")
    if kind == "points":
        return float(np.linalg.norm(run.points - limit.points(run.time), axis=2).max(initial=0.0))
    return float(np.abs(run.efforts - limit.efforts(run.time)).max(initial=0.0))
