"""The axes of a study of extremes: numbers, singular configurations, long runs."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm, TwoBranchForm
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import CrankProfile, swing
from mechsim.model.scene import Scene
from mechsim.simulation import Settings, simulate
from mechsim.simulation.source import assembled
from mechsim.studies.extremes.trial import Trial, attempt
from mechsim.units import rpm

SPEED = rpm(600.0)
# what the issue asks for; beyond it the border is looked for
ASKED = {"speed": (1.0, 1e5), "size": (1e-5, 1e3), "mass ratio": (1e-6, 1e6)}


def steps(drive: ClosedForm, value: float) -> Trial:
    """Steps in a turn; a thousand and more must meet the bound."""
    count = max(4, round(value))
    foretold = "passed" if count >= 1000 else None
    settings = Settings(steps_per_turn=count)
    return attempt("steps", drive, value, drive.mechanism, speed=SPEED, settings=settings, foretold=foretold)


def speed(drive: ClosedForm, value: float) -> Trial:
    """Crank speed in [rpm] at a thousand steps a turn."""
    foretold = "passed" if _asked("speed", value) else None
    return attempt("speed", drive, value, drive.mechanism, speed=rpm(value), foretold=foretold)


def size(drive: ClosedForm, value: float) -> Trial:
    """The whole mechanism made to measure `value` in [m] at its longest."""
    scaled = resized(drive, value / drive.mechanism.size)
    foretold = "passed" if _asked("size", value) else None
    return attempt("size", scaled, value, scaled.mechanism, speed=SPEED, foretold=foretold)


def mass_ratio(drive: ClosedForm, value: float) -> Trial:
    """The coupler's mass beside that of the other links; 0 is a massless rod, which MuJoCo refuses."""
    mechanism = drive.mechanism
    spec = assembled(mechanism, Scene())
    crank = mechanism.crank.b.link
    middle = next(
        link.name for link in mechanism.links if link.name != crank and not _on_ground(drive, link.name)
    )
    body = spec.body(middle)
    body.mass, body.inertia = value * body.mass, value * np.asarray(body.inertia)
    foretold = "passed" if _asked("mass ratio", value) else "cannot assemble" if value == 0.0 else None
    return attempt("mass ratio", drive, value, spec, speed=SPEED, samples=72, foretold=foretold)


def resized(drive: ClosedForm, factor: float) -> ClosedForm:
    """Return the drive with every length multiplied."""
    values: dict[str, Any] = {}
    for field in fields(drive):
        if field.metadata["unit"] == "m":
            value = getattr(drive, field.name)
            many = isinstance(value, tuple)
            values[field.name] = tuple(factor * part for part in value) if many else factor * value
    return replace(drive, **values)


def _on_ground(drive: ClosedForm, link: str) -> bool:
    return any(
        {joint.a.link, joint.b.link} == {"ground", link} and KINDS[joint.kind].hinge
        for joint in drive.mechanism.joints
    )


def _asked(axis: str, value: float) -> bool:
    low, high = ASKED[axis]
    return low <= value <= high


LONG_RUN_SPEED = 20.0 * np.pi
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
        mechanism, speed=LONG_RUN_SPEED, turns=turns, settings=Settings(steps_per_turn=STEPS), samples=samples
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
    return attempt(
        "gear ratio", drive, value, drive.mechanism, speed=LONG_RUN_SPEED, settings=settings, samples=720
    )


SINGULAR_SPEED = 10.0


def dead_centre(drive: ClosedForm, value: float, method: str, beyond: bool) -> Trial:
    """A crank that swings to `value` in [rad] from its dead centres, or as far beyond them."""
    swinging = replace(drive, **drive.swinging)
    low, high = swinging.crank_range().arcs[0]
    start = swinging.mechanism.start
    turn = 2.0 * np.pi * np.round((0.5 * (low + high) - start) / (2.0 * np.pi))
    reach = 0.5 * (high - low) + (value if beyond else -value)
    profile = swing(0.5 * (low + high) - turn, reach, SINGULAR_SPEED)
    return attempt(
        "beyond dead centre" if beyond else "dead centre",
        swinging,
        value,
        swinging.mechanism,
        profile=profile,
        method=method,
        settings=Settings(steps_per_turn=2000),
        note="" if beyond else f"by {method}",
        reachable=not beyond,
        foretold="cannot assemble" if beyond else "passed" if method == "pose" else None,
    )


def tangent(drive: ClosedForm, value: float, method: str) -> Trial:
    """A crank that just turns: a length is `value` of itself from where the crank would stop."""
    near = on_the_brink(drive, value)
    closest = np.linspace(-np.pi, np.pi, 4001)
    angle = float(closest[np.argmin(near.margin(closest))]) + np.pi
    return attempt(
        "near tangent",
        near,
        value,
        started(near, angle),
        speed=SINGULAR_SPEED,
        method=method,
        note=f"by {method}",
        reachable=True,
        foretold="passed" if method == "pose" and value >= 1e-10 else None,
    )


def change_point(drive: ClosedForm, which: str, swing_only: bool) -> Trial:
    """A linkage whose assemblies meet: on one side of the change point, then through it.

    Through it, what follows is nobody's choice: any outcome will do that is true of the run.
    """
    drive = replace(drive, **drive.laid_flat[which])
    start, near = drive.mechanism.start, 0.1
    profile: CrankProfile | None = None
    if swing_only:
        # from one change point, at 0, to the other, at a half turn
        middle = 0.5 * np.pi * np.sign(start)
        profile = swing(float(middle), 0.5 * np.pi - near, SINGULAR_SPEED)
    made = attempt(
        "change point",
        drive,
        near if swing_only else 0.0,
        drive.mechanism,
        profile=profile,
        speed=None if profile else SINGULAR_SPEED,
        note=which,
        foretold="passed" if swing_only else None,
    )
    return replace(made, mechanism=which)


def far_start(drive: ClosedForm, value: float, seed: int) -> Trial:
    """Assembly from a guess thrown off by `value` of the size and, in [rad], in every link's direction.

    Whatever it is assembled in, the judge must say so; the truth is the nearest of all assemblies.
    """
    random = np.random.default_rng([seed, round(1e3 * value)])
    mechanism = drive.mechanism
    thrown = {name: _thrown(pose, value, mechanism.size, random) for name, pose in mechanism.guess.items()}
    made = Trial(
        axis="far start",
        mechanism=drive.name,
        value=value,
        outcome="cannot assemble",
        right="cannot assemble",
        foretold="passed" if value <= 0.01 else None,
    )
    return _assembled(made, drive, mechanism.with_guess(thrown, mechanism.start))


def _assembled(made: Trial, drive: ClosedForm, mechanism: Mechanism) -> Trial:
    from mechsim.simulation import simulate
    from mechsim.verdict.judge import crosscheck

    try:
        run = simulate(mechanism, speed=SINGULAR_SPEED, method="pose", samples=12)
    except AssemblyError:
        return made
    judged = crosscheck(run.motion, drive)
    begun, own = run.motion, drive.solve(run.motion.angle[:1])
    off = {name: begun.points[name].position[0] - point.position[0] for name, point in own.points.items()}
    apart = max(float(np.linalg.norm(gap)) for gap in off.values()) / mechanism.size
    # a hinge put together the other way round may leave every point in its place and turn only links
    turned = any(
        np.abs(begun.links[name].rotation[0] - link.rotation[0]).max() > 1e-6
        for name, link in own.links.items()
        if name in begun.links and name not in own.spinning
    )
    right = "changed assembly" if apart > 1e-9 else "failed" if turned else "passed"
    return replace(made, outcome=judged.outcome, right=right, error=apart)


def _thrown(pose: Pose, value: float, size: float, random: np.random.Generator) -> Pose:
    from mechsim.analytic.loops import turned_by

    shift, turn = value * size * random.normal(size=3), value * random.normal(size=3)
    return Pose(pose.position + shift, turned_by(pose.rotation[None], turn[None])[0])


def on_the_brink(drive: ClosedForm, slack: float) -> TwoBranchForm:
    """Return a drive with one length moved until its crank turns fully by that part of it only."""
    assert isinstance(drive, TwoBranchForm)
    name = drive.critical
    length = getattr(drive, name)

    def at(factor: float) -> TwoBranchForm:
        return replace(drive, **{name: factor * length})

    inside, outside = (
        1.0,
        next(factor for factor in (0.5, 2.0, 0.1, 10.0) if not at(factor).crank_range().full),
    )
    for _ in range(60):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if at(middle).crank_range().full else (inside, middle)
    return at(inside * (1.0 + slack * float(np.sign(1.0 - outside))))


def started(drive: ClosedForm, angle: float) -> Mechanism:
    """Return the mechanism with assembly begun at a crank angle in [rad]."""
    motion = drive.solve([angle])
    guess = {name: Pose(link.position[0], link.rotation[0]) for name, link in motion.links.items()}
    return drive.mechanism.with_guess(guess, angle)
