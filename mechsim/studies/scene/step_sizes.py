"""Candidate time steps and settings of a scene; the cheapest are first."""

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mechsim.mechanism.limits import MAX_SCENE_STEPS
from mechsim.simulation.plain_settings import ALLOWABLE, LOWEST_COMPLIANCE_SOLIMP, PlainSettings, settings_of
from mechsim.studies.scene.scene import UserScene

# time steps that `tune` tries, relative to the file's own
RATIOS = (16.0, 12.0, 8.0, 6.0, 5.0, 4.0, 3.2, 2.5, 2.0, 1.6, 1.25, 1.0, 0.8, 0.64, 0.5, 0.4, 0.32, 0.25, 0.2)
SMALL_RATIOS = (0.16, 0.125, 0.1, 0.08, 0.064, 0.05, 0.04, 0.032, 0.025, 0.02, 0.016, 0.0125, 0.01)
# smallest number of steps in a motion
MIN_STEPS = 50
# cost of a step by integrator, relative to Euler
COSTS = {"Euler": 1.0, "implicitfast": 1.0, "discrete": 1.2, "implicit": 1.3, "RK4": 3.5}
SINGLE_STAGE = ("Euler", "implicitfast", "discrete")
# time constants of the loops in steps; MuJoCo lengthens those below `SAFE_TIME_CONSTANT` unless refsafe is
# off
TIME_CONSTANTS = (2.0, 1.5, 3.0, 5.0, 10.0)
SAFE_TIME_CONSTANT = 2.0
# integrators and time constants that determine whether a step can satisfy a tolerance, of a single stage and
# of RK4, and all that are tried with a step of RK4
PROBES = tuple((integrator, SAFE_TIME_CONSTANT) for integrator in SINGLE_STAGE)
FOURTH_ORDER_PROBES = (("RK4", 3.0), ("RK4", 10.0))
FOURTH_ORDER = tuple(("RK4", constant) for constant in (SAFE_TIME_CONSTANT, 3.0, 5.0, 10.0, None))


def steps_of(scene: UserScene) -> list[float]:
    """Return the candidate time steps in [s]; the longest is first.

    Steps at which MuJoCo would soften contacts, limits or friction are omitted, unless the file's own step
    already does so or these elements may be disabled.
    """
    own = float(scene.model.opt.timestep)
    shortest_constant = shortest_time_constant(scene.model, scene.allowed)
    longest = max(own, min(0.5 * shortest_constant, scene.duration / MIN_STEPS))
    steps = [float(f"{ratio * own:.3g}") for ratio in (*RATIOS, *SMALL_RATIOS)]
    shortest = scene.duration / MAX_SCENE_STEPS
    return [step for step in steps if shortest <= step <= longest * (1.0 + 1e-9)]


def shortest_time_constant(model: mujoco.MjModel, allowed: Collection[str] = ()) -> float:
    """Return the shortest time constant of contacts, limits and friction in [s]; infinity without any.

    Args:
        model: the model.
        allowed: kinds of elements that may be disabled; they are ignored.
    """
    touching = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT) or touching.sum() < 2:
        touching[:] = False
    references = {
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
    constants = np.concatenate(
        [solref[:, 0] for kind, arrays in references.items() if kind not in allowed for solref in arrays]
        or [np.zeros(0)]
    )
    return float(constants[constants > 0.0].min(initial=np.inf))


def single_stage(scene: UserScene, step: float) -> Iterator[PlainSettings]:
    """Yield the settings of a step with integrators of a single stage."""
    for integrator in SINGLE_STAGE:
        for constant in (*TIME_CONSTANTS, None):
            yield loop_settings(scene, step, integrator, constant)
        yield PlainSettings(timestep=step, integrator=integrator, solver="Newton")
    yield PlainSettings(timestep=step)
    yield PlainSettings(timestep=step, solimp=LOWEST_COMPLIANCE_SOLIMP)


def variants(scene: UserScene, settings: PlainSettings) -> Iterator[PlainSettings]:
    """Yield similar settings: other solvers, fewer iterations, other matrices, slightly longer steps."""
    own = settings_of(scene.model)
    changes: tuple[dict[str, Any], ...] = (
        {"solver": own.solver},
        {"iterations": 1},
        {"iterations": 2},
        {"iterations": 1, "ls_iterations": 4},
        {"tolerance": 100.0 * scene.solver_tolerance},
        {"jacobian": "dense" if own.jacobian != "dense" else "sparse"},
        {"jacobian": "sparse"},
        {"island": False},
        {"solver": "CG"},
        {"solver": "PGS", "iterations": 10},
        {"diagexact": True},
        {"eulerdamp": False},
        *disabled(scene),
    )
    for change in changes:
        yield replace(settings, **change)
    longest, current, solref = steps_of(scene)[0], settings.timestep or own.timestep or 0.0, settings.solref
    for ratio in (1.07, 1.15):
        step = float(f"{ratio * current:.3g}")
        constant = None if solref is None else (float(f"{ratio * solref[0]:.4g}"), solref[1])
        if step <= longest:
            yield replace(settings, timestep=step, solref=constant)


def disabled(scene: UserScene) -> list[dict[str, Any]]:
    """Return the changes that disable all elements that may be disabled, and each kind of them."""
    flags: list[dict[str, Any]] = [{ALLOWABLE[kind]: False} for kind in scene.allowed]
    together = {name: False for flag in flags for name in flag}
    return [together, *flags] if len(flags) > 1 else flags


def loop_settings(scene: UserScene, step: float, integrator: str, constant: float | None) -> PlainSettings:
    """Return settings with loops of lowest compliance and a time constant in steps; None keeps the file's."""
    solref = None if constant is None else (float(f"{constant * step:.4g}"), 1.0)
    # MuJoCo must continue to lengthen short time constants of contacts and limits
    unsafe = (
        constant is not None
        and constant < SAFE_TIME_CONSTANT
        and step <= 0.5 * shortest_time_constant(scene.model, scene.allowed)
    )
    return PlainSettings(
        timestep=step,
        integrator=integrator,
        solver="Newton",
        solref=solref,
        solimp=LOWEST_COMPLIANCE_SOLIMP,
        refsafe=False if unsafe else None,
        # with tolerance 0 a solver always uses all iterations
        tolerance=None if scene.model.opt.tolerance > 0.0 else scene.solver_tolerance,
    )
