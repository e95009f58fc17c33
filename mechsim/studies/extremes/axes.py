"""The axes of the stress test: numerical quantities, singular configurations, long runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mechsim.analytic.formulas.two_branch import TwoBranchForm
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError
from mechsim.model.finding import Outcome
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import swing
from mechsim.model.scene import Scene
from mechsim.numerics.angles import REVOLUTION
from mechsim.simulation.run import simulate
from mechsim.simulation.settings import Settings
from mechsim.simulation.source import assembled
from mechsim.studies.extremes.results import Drift, Trial
from mechsim.studies.extremes.trial import attempt, position_errors
from mechsim.studies.motions import driven_as, profile_of
from mechsim.units import rpm


@dataclass(frozen=True)
class SpecialDesigns:
    """Parameters of one mechanism for the stress test.

    Attributes:
        swinging: parameters for which the crank only swings; empty without such parameters.
        limiting_length: length whose change eventually prevents a full revolution of the crank.
        change_points: name -> parameters of a design with change points.
        long_runs: whether the mechanism is run for many revolutions.
    """

    swinging: Mapping[str, Any] = field(default_factory=dict[str, Any])
    limiting_length: str = ""
    change_points: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    long_runs: bool = False


_CHANGE_POINTS = {
    "parallelogram": {"ground": 0.1, "coupler": 0.1, "crank": 0.04, "rocker": 0.04},
    "kite": {"ground": 0.1, "rocker": 0.1, "crank": 0.04, "coupler": 0.04},
}
_DESIGNS = {
    "four_bar": SpecialDesigns({"rocker": 0.035}, "coupler", _CHANGE_POINTS, long_runs=True),
    "slider_crank": SpecialDesigns({"rod": 0.045}, "rod"),
    "rssr": SpecialDesigns({"rocker": 0.009}, "coupler", long_runs=True),
    "rrsrr": SpecialDesigns({"link": 0.055}, "link"),
    "bennett": SpecialDesigns(long_runs=True),
}


def special_designs(name: str) -> SpecialDesigns:
    """Return the special designs of a catalogue mechanism."""
    return _DESIGNS.get(name, SpecialDesigns())


# crank speeds in [rad/s]
SPEED, LONG_RUN_SPEED, SINGULAR_SPEED = rpm(600.0), 20.0 * np.pi, 10.0
# ranges in which every mechanism of the catalogue must pass
REQUIRED = {"speed": (1.0, 1e5), "size": (1e-5, 1e3), "mass ratio": (1e-6, 1e6)}
# steps per revolution of a long run, and its largest number of records
STEPS, RECORDS = 100, 20_000
# smallest relative distance to a singular length at which poses must pass; distance from a change point in
# [rad]
MIN_SLACK, CHANGE_POINT_DISTANCE = 1e-10, 0.1


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
    """Mass of the coupler relative to that of the other links; MuJoCo rejects 0."""
    spec = assembled(solver.mechanism, Scene())
    body = spec.body(coupler_of(solver.mechanism))
    body.mass, body.inertia = value * body.mass, value * np.asarray(body.inertia)
    expected = _required("mass ratio", value, solver) or ("cannot assemble" if value == 0.0 else None)
    motion = _motion(solver, SPEED)
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


def drift(solver: KinematicSolver, turns: float) -> Drift:
    """Run many revolutions at a hundred steps each, and compare the last errors with the first."""
    samples = min(RECORDS, round(4 * turns))
    settings = Settings(steps_per_turn=STEPS)
    run = simulate(solver.mechanism, speed=LONG_RUN_SPEED, turns=turns, settings=settings, samples=samples)
    if run.motion.broken:
        return Drift(solver.name, turns, np.nan, np.inf)
    error = position_errors(solver, run.motion)
    count = max(8, len(error) // 100)
    return Drift(solver.name, turns, float(error[1:count].max()), float(error[-count:].max()))


def gear_ratio(solver: KinematicSolver, value: float) -> Trial:
    """A second crank geared `value` times faster, with `value` times the steps."""
    geared = solver.with_parameters(gear_ratio=float(round(value)))
    settings = Settings(steps_per_turn=500 * max(1, round(value)))
    return attempt("gear ratio", geared, value, speed=LONG_RUN_SPEED, settings=settings, samples=720)


def dead_centre(solver: KinematicSolver, value: float, method: str, beyond: bool) -> Trial:
    """A crank that swings to a distance `value` in [rad] before its dead centres, or beyond them."""
    swinging = solver.with_parameters(**special_designs(solver.name).swinging)
    low, high = swinging.crank_range().arcs[0]
    middle = 0.5 * (low + high)
    revolutions = REVOLUTION * np.round((middle - swinging.mechanism.start) / REVOLUTION)
    amplitude = 0.5 * (high - low) + (value if beyond else -value)
    return attempt(
        "beyond dead centre" if beyond else "dead centre",
        swinging,
        value,
        profile=swing(middle - revolutions, amplitude, SINGULAR_SPEED),
        method=method,
        settings=Settings(steps_per_turn=2000),
        note="" if beyond else f"by {method}",
        reachable=not beyond,
        expected="cannot assemble" if beyond else "passed" if method == "pose" else None,
    )


def near_tangent(solver: KinematicSolver, value: float, method: str) -> Trial:
    """A crank that barely makes a full revolution: a length is a fraction `value` from the limit."""
    limiting = with_limiting_length(solver, value)
    angles = np.linspace(-np.pi, np.pi, 4001)
    assert isinstance(limiting.closed_form, TwoBranchForm)
    angle = float(angles[np.argmin(limiting.closed_form.discriminant(angles))]) + np.pi
    # it starts at this angle
    motion = limiting.solve([angle])
    guess = {name: Pose(link.position[0], link.rotation[0]) for name, link in motion.links.items()}
    return attempt(
        "near tangent",
        limiting,
        value,
        limiting.mechanism.with_guess(guess, angle),
        speed=SINGULAR_SPEED,
        method=method,
        note=f"by {method}",
        reachable=True,
        expected="passed" if method == "pose" and value >= MIN_SLACK else None,
    )


def change_point(solver: KinematicSolver, which: str, swing_only: bool) -> Trial:
    """A linkage with change points: a swing between two of them, or a motion through them.

    Beyond a change point both branches are correct; any outcome that describes the run correctly passes.
    """
    solver = solver.with_parameters(**special_designs(solver.name).change_points[which])
    motion: dict[str, Any] = {"speed": SINGULAR_SPEED}
    if swing_only:
        # from one change point, at 0, to the other, at half a revolution
        middle = 0.5 * np.pi * float(np.sign(solver.mechanism.start))
        motion = {"profile": swing(middle, 0.5 * np.pi - CHANGE_POINT_DISTANCE, SINGULAR_SPEED)}
    trial = attempt(
        "change point",
        solver,
        CHANGE_POINT_DISTANCE if swing_only else 0.0,
        note=which,
        expected="passed" if swing_only else None,
        **motion,
    )
    return replace(trial, mechanism=which)


def far_start(solver: KinematicSolver, value: float, seed: int) -> Trial:
    """Assembly from a guess with errors of `value` in characteristic lengths and, for rotations, in [rad].

    The run must report the assembly mode in which it ends; the correct mode is the nearest.
    """
    random = np.random.default_rng([seed, round(1e3 * value)])
    mechanism = solver.mechanism
    guess = {
        name: _perturbed(pose, value, mechanism.characteristic_length, random)
        for name, pose in mechanism.guess.items()
    }
    trial = Trial(
        axis="far start",
        mechanism=solver.name,
        value=value,
        outcome="cannot assemble",
        right="cannot assemble",
        expected="passed" if value <= 0.01 else None,
    )
    return _assembled(trial, solver, mechanism.with_guess(guess, mechanism.start))


def _assembled(trial: Trial, solver: KinematicSolver, mechanism: Mechanism) -> Trial:
    from mechsim.verdict.crosscheck import crosscheck

    try:
        run = simulate(mechanism, method="pose", samples=12, **_motion(solver, SINGULAR_SPEED))
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
    from mechsim.analytic.loops import turned_by

    shift, rotation = value * length * random.normal(size=3), value * random.normal(size=3)
    return Pose(pose.position + shift, turned_by(pose.rotation[None], rotation[None])[0])


def with_limiting_length(solver: KinematicSolver, slack: float) -> KinematicSolver:
    """Return a mechanism with one length at a relative distance `slack` from the limit of full rotation."""
    name = special_designs(solver.name).limiting_length

    def scaled(factor: float) -> KinematicSolver:
        return solver.with_dimensions({name: factor * getattr(solver, name)})

    inside = 1.0
    outside = next(factor for factor in (0.5, 2.0, 0.1, 10.0) if not scaled(factor).crank_range().full)
    for _ in range(60):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if scaled(middle).crank_range().full else (inside, middle)
    return scaled(inside * (1.0 + slack * float(np.sign(1.0 - outside))))
