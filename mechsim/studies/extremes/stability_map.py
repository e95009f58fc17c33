"""The stress test: steps, speed, size, mass ratio and errors of the guess, with the borders of outcomes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.io import catalog
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import Outcome
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.scene import Scene
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation.run import simulate
from mechsim.simulation.settings import Settings
from mechsim.simulation.source import assembled
from mechsim.studies.extremes.trial import StabilityMap, Trial, attempt, borders_along
from mechsim.studies.motions import driven_as, profile_of
from mechsim.units import rpm

# crank speeds in [rad/s]
SPEED, ASSEMBLED_SPEED = rpm(600.0), 10.0
# ranges in which every mechanism of the catalogue must pass
REQUIRED = {"speed": (1.0, 1e5), "size": (1e-5, 1e3), "mass ratio": (1e-6, 1e6)}


def steps(solver: KinematicSolver, value: float) -> Trial:
    """Steps per revolution; for the catalogue, 1000 or more must pass."""
    count = max(4, round(value))
    expected = "passed" if count >= 1000 and solver.closed_form is not None else None
    settings, motion = Settings(steps_per_turn=count), _motion(solver, SPEED)
    return attempt("steps", solver, value, settings=settings, expected=expected, **motion)


def speed(solver: KinematicSolver, value: float) -> Trial:
    """Crank speed in [rpm] at a thousand steps per revolution."""
    expected = _required("speed", value, solver)
    return attempt("speed", solver, value, expected=expected, **_motion(solver, rpm(value)))


def _motion(solver: KinematicSolver, speed: float) -> dict[str, Any]:
    """Return a revolution or a swing of the crank, or the motion laws, as arguments of `simulate`."""
    return driven_as(solver, profile_of(solver, speed, 1.0))


def characteristic_length(solver: KinematicSolver, value: float) -> Trial:
    """The mechanism scaled to a characteristic length in [m]."""
    scaled = resized(solver, value / solver.mechanism.characteristic_length)
    return attempt("size", scaled, value, expected=_required("size", value, solver), **_motion(scaled, SPEED))


def mass_ratio(solver: KinematicSolver, value: float) -> Trial:
    """Mass of the coupler relative to that of the other links."""
    spec = assembled(solver.mechanism, Scene())
    body = spec.body(coupler_of(solver.mechanism))
    body.mass, body.inertia = value * body.mass, value * np.asarray(body.inertia)
    expected, motion = _required("mass ratio", value, solver), _motion(solver, SPEED)
    return attempt("mass ratio", solver, value, spec, samples=72, expected=expected, **motion)


def coupler_of(mechanism: Mechanism) -> str | None:
    """Return the first link without a driver or a hinge on the ground; None if there is none."""
    grounded = {
        link
        for joint in mechanism.joints
        if joint.name in mechanism.drivers or KINDS[joint.kind].hinge
        for link in (joint.a.link, joint.b.link)
        if joint.name in mechanism.drivers or GROUND in (joint.a.link, joint.b.link)
    }
    return next((link.name for link in mechanism.links if link.name not in grounded), None)


def resized(solver: KinematicSolver, factor: float) -> KinematicSolver:
    """Return the closed form with every length scaled by a factor."""
    lengths = {name: value for name, (value, unit) in solver.dimensions.items() if unit == "m"}
    return solver.with_dimensions({name: factor * length for name, length in lengths.items()})


def _required(axis: str, value: float, solver: KinematicSolver) -> Outcome | None:
    low, high = REQUIRED[axis]
    return "passed" if low <= value <= high and solver.closed_form is not None else None


def far_start(solver: KinematicSolver, value: float, seed: int) -> Trial:
    """Assembly from a guess with errors of `value` in characteristic lengths and, for rotations, in [rad].

    The run must report the assembly mode in which it ends; the correct mode is the nearest.
    """
    from mechsim.compare.crosscheck import crosscheck

    random = np.random.default_rng([seed, round(1e3 * value)])
    mechanism = solver.mechanism
    guess = {
        name: _perturbed(pose, value, mechanism.characteristic_length, random)
        for name, pose in mechanism.guess.items()
    }
    expected = "passed" if value <= 0.01 else None
    trial = Trial(axis="far start", mechanism=solver.name, value=value, expected=expected)
    guessed = mechanism.with_guess(guess, mechanism.start)
    try:
        run = simulate(guessed, method="pose", samples=12, **_motion(solver, ASSEMBLED_SPEED))
    except AssemblyError:
        return trial
    outcome = crosscheck(run.motion, solver).outcome
    motion, exact = run.motion, solver.solve_as(run.motion)
    offsets = [motion.points[name].position[0] - point.position[0] for name, point in exact.points.items()]
    distance = float(np.linalg.norm(offsets, axis=1).max()) / mechanism.characteristic_length
    # another assembly mode of a hinge may rotate links only, with every point in its position
    rotated = any(
        np.abs(motion.links[name].rotation[0] - link.rotation[0]).max() > 1e-6
        for name, link in exact.links.items()
        if name in motion.links and name not in exact.spinning
    )
    right = "changed assembly" if distance > 1e-9 else "failed" if rotated else "passed"
    if not solver.selectors and "passed" not in (right, outcome):
        # without parameters that select an assembly mode, another one is a failure or a change
        right = outcome
    return replace(trial, outcome=outcome, right=right, error=distance)


def _perturbed(pose: Pose, value: float, length: float, random: np.random.Generator) -> Pose:
    from mechsim.kinematics.vector_method.rotations import turned_by

    shift, rotation = value * length * random.normal(size=3), value * random.normal(size=3)
    return Pose(pose.position + shift, turned_by(pose.rotation[None], rotation[None])[0])


# number of bisections of a border, which locate it to a twentieth of a decade, and that of a quick study
HALVINGS, QUICK_HALVINGS = 5, 2

Push = Callable[[Any, float], Trial]


def _decades(low: float, high: float, interval: int = 1) -> list[float]:
    return [10.0**n for n in range(round(np.log10(low)), round(np.log10(high)) + 1, interval)]


def axes_of(solver: KinematicSolver, quick: bool) -> list[tuple[str, Push, Sequence[float]]]:
    """Return the axes of one mechanism: name, trial at a value, values from stable to unstable."""
    coarse = 2 if quick else 1
    counts = [1e4, 1e3, 100.0, 50.0, 20.0, 10.0]
    pushes: list[tuple[str, Push, Sequence[float]]] = [("steps", steps, counts if quick else [1e5, *counts])]
    if solver.motion_laws.crank:
        pushes.append(("speed", speed, [1.0, 1e3, 1e5, 1e6, 1e7]))
    if solver.closed_form is not None:
        pushes += [
            ("size", characteristic_length, [1e-2, *_decades(1e-9, 1e-3, coarse)[::-1]]),
            ("size", characteristic_length, [1e-1, *_decades(1.0, 1e9, 2 * coarse - 1)]),
        ]
    # MJCF, whose masses change, has no functions
    functions = any(coupling.function is not None for coupling in solver.mechanism.couplings)
    if coupler_of(solver.mechanism) is not None and not functions:
        pushes += [
            ("mass ratio", mass_ratio, _decades(1e-12, 1.0, 2 * coarse)[::-1]),
            ("mass ratio", mass_ratio, _decades(10.0, 1e11, 2 * coarse)),
        ]
    for seed in range(2 if quick else 6):
        errors = [1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0]
        pushes.append(("far start", partial(far_start, seed=seed), errors))
    return pushes


def study(
    solvers: Sequence[KinematicSolver] | None = None,
    *,
    quick: bool = False,
    progress: Progress = no_progress,
) -> StabilityMap:
    """Vary the quantity of each axis until runs fail.

    Args:
        solvers: mechanisms; None selects those of the catalogue.
        quick: fewer values and coarser borders.
        progress: callback after each axis of each mechanism.
    """
    result = StabilityMap()
    solvers = solvers or [catalog.make(name) for name in catalog.MECHANISMS]
    rows = [(solver, *row) for solver in solvers for row in axes_of(solver, quick)]
    halvings = QUICK_HALVINGS if quick else HALVINGS
    for finished, (solver, axis, push, values) in enumerate(rows, 1):
        trials, borders = borders_along(partial(push, solver), values, halvings)
        result.trials += trials
        result.borders += borders if axis != "far start" else []
        progress(f"{solver.name}: {axis}", finished / len(rows))
    return result
