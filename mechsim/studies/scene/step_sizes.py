"""The steps and settings that are worth trying on a scene, the cheapest first."""

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mechsim.model.limits import MAX_SCENE_STEPS
from mechsim.studies.scene import SceneErrors, SceneRun, errors_of, stepped
from mechsim.studies.scene.converged_reference import HARDEST
from mechsim.studies.scene.evaluator import RECORDS
from mechsim.studies.scene.scene import UserScene
from mechsim.studies.scene.settings import FREEABLE, PlainSettings, settings_of

# steps tried, in steps of the file's own; a motion has so many steps at least
RATIOS = (16.0, 12.0, 8.0, 6.0, 5.0, 4.0, 3.2, 2.5, 2.0, 1.6, 1.25, 1.0, 0.8, 0.64, 0.5, 0.4, 0.32, 0.25, 0.2)
FINER = (0.16, 0.125, 0.1, 0.08, 0.064, 0.05, 0.04, 0.032, 0.025, 0.02, 0.016, 0.0125, 0.01)
FEWEST = 50
# evaluations of a step, and integrators by what they cost
COSTS = {"Euler": 1.0, "implicitfast": 1.0, "discrete": 1.2, "implicit": 1.3, "RK4": 3.5}
CHEAP = ("Euler", "implicitfast", "discrete")
# time constants of the loops in steps; below two steps MuJoCo must be told not to mend them
CONSTANTS = (2.0, 1.5, 3.0, 5.0, 10.0)
SAFE = 2.0
# factors on softness that no file can say
COMPLIANCES = (1e-2, 1e-4, 1e-8)


def steps_of(scene: UserScene) -> list[float]:
    """Return the time steps worth trying, the longest first, in [s].

    None is so long that MuJoCo would soften contacts, limits or friction, unless the file's own is, or they
    are freed.
    """
    own = float(scene.model.opt.timestep)
    longest = max(own, min(0.5 * quickest(scene.model, scene.free), scene.duration / FEWEST))
    steps = [float(f"{ratio * own:.3g}") for ratio in (*RATIOS, *FINER)]
    shortest = scene.duration / MAX_SCENE_STEPS
    return [step for step in steps if shortest <= step <= longest * (1.0 + 1e-9)]


def quickest(model: mujoco.MjModel, free: Collection[str] = ()) -> float:
    """Return the shortest time constant of contacts, limits and friction that are not freed, in [s].

    Infinity without any.
    """
    # of a geom that can touch, a limited joint or tendon, and what rubs dry
    touching = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT) or touching.sum() < 2:
        touching[:] = False
    rows = {
        "contacts": (model.geom_solref[touching], model.pair_solref),
        "limits": (
            model.jnt_solref[model.jnt_limited != 0],
            model.tendon_solref_lim[model.tendon_limited != 0],
        ),
        "friction": (
            model.dof_solref[model.dof_frictionloss > 0.0],
            model.tendon_solref_fri[model.tendon_frictionloss > 0.0],
        ),
    }
    found = [one[:, 0] for kind, arrays in rows.items() if kind not in free for one in arrays if len(one)]
    constants = np.concatenate(found or [np.zeros(0)])
    return float(constants[constants > 0.0].min(initial=np.inf))


def probes(scene: UserScene, step: float) -> Iterator[PlainSettings]:
    """Yield a few settings that tell whether a step can do."""
    for integrator in CHEAP:
        yield _settings(scene, step, integrator, SAFE)


def cheap(scene: UserScene, step: float) -> Iterator[PlainSettings]:
    """Yield the settings of a step with integrators that evaluate a step once."""
    for integrator in CHEAP:
        for constant in (*CONSTANTS, None):
            yield _settings(scene, step, integrator, constant)
        yield PlainSettings(timestep=step, integrator=integrator, solver="Newton")
    yield PlainSettings(timestep=step)
    yield PlainSettings(timestep=step, solimp=HARDEST)


def fourth(scene: UserScene, step: float) -> Iterator[PlainSettings]:
    """Yield a few settings of the integrator of fourth order that tell whether a step can do."""
    for constant in (3.0, 10.0):
        yield _settings(scene, step, "RK4", constant)


def hardest(scene: UserScene, step: float) -> Iterator[PlainSettings]:
    """Yield a few settings that no file can say and that tell whether a step can do."""
    for integrator, constant in (("Euler", 2.0), ("RK4", 10.0)):
        yield replace(_settings(scene, step, integrator, constant), compliance=COMPLIANCES[-1])


def dear(scene: UserScene, step: float) -> Iterator[PlainSettings]:
    """Yield the settings of a step with the integrator of fourth order."""
    for constant in (SAFE, 3.0, 5.0, 10.0, None):
        yield _settings(scene, step, "RK4", constant)


def harder(scene: UserScene, step: float) -> Iterator[PlainSettings]:
    """Yield settings of a step that no file can say."""
    for compliance in COMPLIANCES:
        for integrator, constant in (("Euler", 2.0), ("implicitfast", 2.0), ("RK4", 5.0), ("RK4", 10.0)):
            yield replace(_settings(scene, step, integrator, constant), compliance=compliance)


def variants(scene: UserScene, settings: PlainSettings) -> Iterator[PlainSettings]:
    """Yield settings near some: other solvers, fewer iterations, other matrices, steps a little longer."""
    own = settings_of(scene.model)
    changes: tuple[dict[str, Any], ...] = (
        {"solver": own.solver},
        {"iterations": 1},
        {"iterations": 2},
        {"iterations": 1, "ls_iterations": 4},
        {"tolerance": 100.0 * scene.usual_tolerance},
        {"jacobian": "dense" if own.jacobian != "dense" else "sparse"},
        {"jacobian": "sparse"},
        {"island": False},
        {"solver": "CG"},
        {"solver": "PGS", "iterations": 10},
        {"diagexact": True},
        {"eulerdamp": False},
        *freed(scene),
    )
    for change in changes:
        yield replace(settings, **change)
    longest, now, solref = steps_of(scene)[0], settings.timestep or own.timestep or 0.0, settings.solref
    for ratio in (1.07, 1.15):
        step = float(f"{ratio * now:.3g}")
        constant = None if solref is None else (float(f"{ratio * solref[0]:.4g}"), solref[1])
        if step <= longest:
            yield replace(settings, timestep=step, solref=constant)


def freed(scene: UserScene) -> list[dict[str, Any]]:
    """Return what switches off all that is freed, and each kind of it."""
    each: list[dict[str, Any]] = [{FREEABLE[kind]: False} for kind in scene.free]
    return [{name: False for one in each for name in one}, *each] if len(each) > 1 else each


def _settings(scene: UserScene, step: float, integrator: str, constant: float | None) -> PlainSettings:
    """Return hard loops whose time constant is so many steps; None is what the file has."""
    solref = None if constant is None else (float(f"{constant * step:.4g}"), 1.0)
    # what it would mend of contacts and limits it must go on mending
    unsafe = constant is not None and constant < SAFE and step <= 0.5 * quickest(scene.model, scene.free)
    return PlainSettings(
        timestep=step,
        integrator=integrator,
        solver="Newton",
        solref=solref,
        solimp=HARDEST,
        refsafe=False if unsafe else None,
        # one that never stops by itself takes all its iterations
        tolerance=None if scene.model.opt.tolerance > 0.0 else scene.usual_tolerance,
    )


# steps tried after the file's own, in its steps, and time constant of the loops in steps
FINER_RATIOS = (1.0, 0.5, 0.25, 0.1, 0.04, 0.016, 0.006, 0.0025, 0.001)
# which takes springs and servos implicitly, for what another integrator does not bear
IMPLICIT = "discrete"
CONSTANT = 2.0


def finer(
    scene: UserScene,
    settings: PlainSettings,
    tolerance: float,
    *,
    fixed: bool = False,
    records: int | None = None,
) -> tuple[SceneRun, SceneErrors, PlainSettings]:
    """Return a run that keeps a tolerance by closure, or the best there is, with its errors and settings.

    A run that diverges is no reason to stop: it is made again with an integrator that takes stiffness
    implicitly, unless one was asked for, and finer ones follow.

    Args:
        scene: the scene.
        settings: that were asked for; the first run has these and nothing else.
        tolerance: in [m].
        fixed: whether no other settings are tried.
        records: instants recorded after the first.
    """
    found: list[tuple[SceneRun, SceneErrors, PlainSettings]] = []
    own = settings.timestep or float(scene.model.opt.timestep)
    tried = [settings]
    if not fixed:
        ratios = [ratio for ratio in FINER_RATIOS if scene.duration / (ratio * own) <= MAX_SCENE_STEPS]
        tried += [_harder(settings, ratio * own) for ratio in ratios]
    for one in tried:
        found.append(_run(scene, one, records))
        if found[-1][0].broken and not fixed and settings.integrator is None:
            found.append(_run(scene, replace(one, integrator=IMPLICIT), records))
        if found[-1][1].closure <= tolerance:
            break
    return min(found, key=lambda each: each[1].closure)


def _run(
    scene: UserScene, settings: PlainSettings, records: int | None
) -> tuple[SceneRun, SceneErrors, PlainSettings]:
    run = stepped(scene, settings.applied(scene.model), records=records or RECORDS)
    return run, errors_of(run), settings


def _harder(settings: PlainSettings, step: float) -> PlainSettings:
    """Return the same settings with a step and loops as hard as it bears."""
    return replace(
        settings,
        timestep=step,
        solver=settings.solver or "Newton",
        solref=settings.solref or (CONSTANT * step, 1.0),
        solimp=settings.solimp or HARDEST,
    )
