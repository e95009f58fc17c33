"""The main job: a mechanism by every road, compared and judged."""

import time as clock
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim.analytic import closure
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.errors import AssemblyError
from mechsim.maths.angles import TURN
from mechsim.model.crank_profile import CrankProfile, arc_around, swing, within_range
from mechsim.model.mechanism import Pose
from mechsim.model.motion import Motion, taken
from mechsim.model.outcome import Outcome, gravest
from mechsim.simulation import Run, Settings, simulate
from mechsim.verdict.checks import Check, Verdict, allowances, check_of, checks_of, concluded
from mechsim.verdict.judge import crosscheck
from mechsim.verdict.quantities import QUANTITIES, motion_scales, reach_of, stroke_of
from mechsim.verdict.tolerances import EPS, Asked, Tolerance

# bound on places in a stepped run, in units of the stroke: at 1,000 steps a turn it is missed by no
# catalogue mechanism (measured 2.6e-9 at the worst), and a link 0.1 % long exceeds it 1e5 times; one that by
# its own account misses it, near a dead centre, is stepped with as many as keep it
STEP_PLACE = 1e-8
STEPS = 1000
# so near to a change point, in [rad], neither steps nor rates from the loops are looked at
KEPT_OFF = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A mechanism's validation: what was compared, how it came out, and the motions for pictures.

    Attributes:
        drive: the mechanism.
        outcome: the worst outcome of all roads.
        reason: one sentence where the outcome is not "met".
        checks: of all roads and variants.
        exact: closed form over the range, evenly spread.
        poses: the run by solved poses.
        run: the stepped run.
        seconds: for the whole case.
    """

    drive: Form
    outcome: Outcome
    reason: str
    checks: tuple[Check, ...]
    exact: Motion
    poses: Run
    run: Run
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether every quantity of every road is within its bound."""
        return self.outcome == "met"

    def as_dict(self) -> dict[str, Any]:
        """Return the case as `mechsim validate --json` prints it."""
        return {
            "passed": self.passed,
            "outcome": self.outcome,
            "reason": self.reason,
            "checks": [check.as_dict() for check in self.checks],
            "steps": self.run.steps,
            "seconds": self.seconds,
        }


def validate(drive: Form, *, speed: float = 20.0 * np.pi) -> Case:
    """Validate one mechanism: closed form against loop equations, solved poses and a stepped run.

    One without a closed form: loop equations against MuJoCo's.

    Args:
        drive: the mechanism.
        speed: crank speed in [rad/s]; a crank that cannot turn fully swings with this as its fastest.

    Raises:
        AssemblyError: if the loops close nowhere.
    """
    case = _validated(drive, speed)
    for name, variant in drive.variants().items():
        # a variant that cannot stand says nothing against the mechanism
        with suppress(AssemblyError):
            case = _with_variant(case, name, _validated(variant, speed))
    return case


def _with_variant(case: Case, name: str, variant: Case) -> Case:
    """Return a case that holds a variant's checks too, each with the variant's name."""
    checks = tuple(replace(check, variant=name) for check in variant.checks)
    worse = gravest([case.outcome, variant.outcome]) == 1
    return replace(
        case,
        outcome=variant.outcome if worse else case.outcome,
        reason=f"{name}, {variant.reason}" if worse else case.reason,
        checks=case.checks + checks,
        seconds=case.seconds + variant.seconds,
    )


def _validated(drive: Form, speed: float) -> Case:
    begin = clock.perf_counter()
    profile = within_range(drive.mechanism, drive.crank_range(), speed, drive.period / TURN)
    angles = profile.state(np.linspace(0.0, profile.duration, 73))[0]
    exact = drive.solve(angles, speed)
    # only a crank at constant speed has a drive whose error means something
    wanted = speed if profile.steady else None
    mechanism = drive.mechanism
    poses = simulate(mechanism, profile=profile, method="pose")
    place = STEP_PLACE * stroke_of(exact)
    stepped = _decided(drive, profile, speed)
    run = simulate(mechanism, profile=stepped, settings=Settings(steps_per_turn=STEPS))
    if run.outcome != "diverged" and run.estimate > place:
        run = simulate(mechanism, profile=stepped, tolerance=place)
    steady = speed if stepped.steady else None
    verdicts = [
        ("pose", crosscheck(poses.motion, drive, speed=wanted)),
        ("step", crosscheck(run.motion, drive, tolerance=place, speed=steady)),
    ]
    if run.outcome == "diverged":
        verdicts[-1] = ("step", Verdict("diverged", (), "MuJoCo warned of a bad state"))
    if isinstance(drive, ClosedForm):
        verdicts = [("closed form", _against_loops(drive, exact)), *verdicts]
    checks = tuple(replace(check, road=road) for road, verdict in verdicts for check in verdict.checks)
    outcome, reason = _worst(verdicts)
    return Case(
        drive=drive,
        outcome=outcome,
        reason=reason,
        checks=checks,
        exact=exact,
        poses=poses,
        run=run,
        seconds=clock.perf_counter() - begin,
    )


def _decided(drive: Form, profile: CrankProfile, speed: float) -> CrankProfile:
    """Return the motion that can be stepped: a swing between change points, which dynamics do not decide."""
    start, points = drive.mechanism.start, np.array(drive.change_points())
    if not len(points):
        return profile
    arc = arc_around(drive.crank_range(), start)
    low, high = (start - TURN, start + TURN) if arc is None or drive.crank_range().full else arc
    around = points + TURN * np.round((start - points) / TURN) + TURN * np.array([[-1.0], [0.0], [1.0]])
    low = max([low, *(around[around < start] + KEPT_OFF)])
    high = min([high, *(around[around > start] - KEPT_OFF)])
    return swing(0.5 * (low + high), 0.49 * (high - low), speed)


def _worst(verdicts: Sequence[tuple[str, Verdict]]) -> tuple[Outcome, str]:
    road, verdict = verdicts[gravest(verdict.outcome for _, verdict in verdicts)]
    return verdict.outcome, f"{road}: {verdict.reason}" if verdict.reason else ""


def _against_loops(drive: ClosedForm, exact: Motion) -> Verdict:
    """Check the closed form by the loop equations, which know nothing of it."""
    mechanism = drive.mechanism
    poses = {name: Pose(link.position, link.rotation) for name, link in exact.links.items()}
    points = np.array(drive.change_points())
    if len(points):
        # at a change point the loops give no rates; there the poses' road is asked
        off = np.abs(np.exp(1j * exact.angle[:, None]) - np.exp(1j * points)).min(1) > KEPT_OFF
        exact = taken(exact, off)
        poses = {name: pose.at(off) for name, pose in poses.items()}
    open_by, turned_by = closure.residual_norms(mechanism, poses, exact.angle)
    loops = closure.rates(mechanism, poses, exact.angle, exact.speed, exact.acceleration)
    closed = Tolerance(8 * EPS * mechanism.size, "m", "8 ulp of the longest link")
    turned = Tolerance(32 * EPS, "rad", "8 ulp of a turn of 4 rad")
    checks = [
        check_of("loop", "", open_by, exact.angle, closed),
        check_of("axes and gears", "", turned_by, exact.angle, turned),
    ]
    scales = motion_scales(stroke_of(exact), float(np.abs(exact.speed).max()), reach_of(exact))
    for kind in ("velocity", "acceleration"):
        rows = (QUANTITIES[kind],)
        allowed = allowances(rows, "closed form", scales, Asked())
        checks += checks_of(rows, loops, exact, allowed, drive.conditioning(exact))
    return concluded(checks)


def validate_all(
    drives: Iterable[Form],
    *,
    speed: float = 20.0 * np.pi,
    done: Callable[[Case], None] = lambda _: None,
) -> dict[str, Case]:
    """Validate several mechanisms; `done` is called after each."""
    cases = {}
    for drive in drives:
        cases[drive.name] = validate(drive, speed=speed)
        done(cases[drive.name])
    return cases
