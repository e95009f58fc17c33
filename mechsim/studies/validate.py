"""The main job: a mechanism by every road, compared and judged."""

import time as clock
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic import closure
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.crank_profile import within_range
from mechsim.model.mechanism import Pose
from mechsim.model.motion import Motion
from mechsim.model.outcome import Outcome, gravest
from mechsim.simulation import Run, Settings, simulate
from mechsim.verdict.judge import Check, Verdict, crosscheck
from mechsim.verdict.tolerances import EPS, Tolerance

Array = NDArray[np.float64]

# bound on places in a stepped run, in units of the stroke: at 1,000 steps a turn it is missed by no
# catalogue mechanism (measured 2.6e-9 at the worst), and a link 0.1 % long exceeds it 1e5 times
STEP_PLACE = 1e-8
STEPS = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A mechanism's validation: what was compared, how it came out, and the motions for pictures.

    Attributes:
        drive: the mechanism.
        outcome: the worst outcome of all roads.
        reason: one sentence where the outcome is not "met".
        checks: of all roads, the road named in front.
        exact: closed form over the range, evenly spread.
        poses: the run by solved poses.
        run: the stepped run.
        seconds: for the whole case.
    """

    drive: ClosedForm
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


def validate(drive: ClosedForm, *, speed: float = 20.0 * np.pi) -> Case:
    """Validate one mechanism: closed form against loop equations, solved poses and a stepped run.

    Args:
        drive: the mechanism.
        speed: crank speed in [rad/s]; a crank that cannot turn fully swings with this as its fastest.

    Raises:
        AssemblyError: if the loops close nowhere.
    """
    case = _validated(drive, speed)
    for name, variant in drive.variants().items():
        case = _with_variant(case, name, _validated(variant, speed))
    return case


def _with_variant(case: Case, name: str, variant: Case) -> Case:
    """Return a case that holds a variant's checks too, each with the variant's name in front."""
    checks = tuple(replace(check, quantity=f"{name}, {check.quantity}") for check in variant.checks)
    worse = gravest([case.outcome, variant.outcome]) == 1
    return replace(
        case,
        outcome=variant.outcome if worse else case.outcome,
        reason=f"{name}, {variant.reason}" if worse else case.reason,
        checks=case.checks + checks,
        seconds=case.seconds + variant.seconds,
    )


def _validated(drive: ClosedForm, speed: float) -> Case:
    begin = clock.perf_counter()
    profile = within_range(drive, speed)
    angles = profile.state(np.linspace(0.0, profile.duration, 73))[0]
    exact = drive.solve(angles, speed)
    # only a crank at constant speed has a drive whose error means something
    wanted = speed if profile.steady else None
    mechanism = drive.mechanism
    poses = simulate(mechanism, profile=profile, method="pose")
    run = simulate(mechanism, profile=profile, settings=Settings(steps_per_turn=STEPS))
    verdicts = [
        ("closed form", _against_loops(drive, exact)),
        ("pose", crosscheck(poses.motion, drive, speed=wanted)),
        ("step", crosscheck(run.motion, drive, tolerance=STEP_PLACE * _stroke(exact), speed=wanted)),
    ]
    if run.outcome == "diverged":
        verdicts[2] = ("step", Verdict("diverged", (), "MuJoCo warned of a bad state"))
    checks = tuple(
        replace(check, quantity=f"{road}: {check.quantity}")
        for road, verdict in verdicts
        for check in verdict.checks
    )
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


def _worst(verdicts: Sequence[tuple[str, Verdict]]) -> tuple[Outcome, str]:
    road, verdict = verdicts[gravest(verdict.outcome for _, verdict in verdicts)]
    return verdict.outcome, f"{road}: {verdict.reason}" if verdict.reason else ""


def _stroke(exact: Motion) -> float:
    return 0.5 * float(max(np.ptp(point.position, axis=0).max() for point in exact.points.values()))


def _against_loops(drive: ClosedForm, exact: Motion) -> Verdict:
    """Check the closed form by the loop equations, which know nothing of it."""
    mechanism = drive.mechanism
    poses = {name: Pose(link.position, link.rotation) for name, link in exact.links.items()}
    open_by, turned_by = closure.residual_norms(mechanism, poses, exact.angle)
    longest = mechanism.size
    loops = closure.rates(mechanism, poses, exact.angle, exact.speed, exact.acceleration)
    checks = [
        _check(
            "loop residual",
            open_by,
            exact.angle,
            Tolerance(8 * EPS * longest, "m", "8 ulp of the longest link"),
        ),
        _check(
            "axes and gears", turned_by, exact.angle, Tolerance(32 * EPS, "rad", "8 ulp of a turn of 4 rad")
        ),
    ]
    speed, stroke = float(np.abs(exact.speed).max()), _stroke(exact)
    for kind, unit, power in (("velocity", "m/s", 1), ("acceleration", "m/s2", 2)):
        for name, point in exact.points.items():
            gap = getattr(point, kind) - getattr(loops.points[name], kind)
            bound = 1e-10 * stroke * speed**power
            why = "1e-10 of crank speed: a linear solve away from dead centres"
            error = np.sqrt((gap**2).sum(1))
            checks.append(_check(f"{kind} of {name}", error, exact.angle, Tolerance(bound, unit, why)))
    failed = [check.quantity for check in checks if not check.passed]
    reason = f"beyond the bound: {', '.join(failed)}" if failed else ""
    return Verdict("missed" if failed else "met", tuple(checks), reason)


def _check(quantity: str, error: Array, angle: Array, tolerance: Tolerance) -> Check:
    at = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
    rms = float(np.sqrt(np.mean(error**2)))
    return Check(
        quantity, tolerance.unit, float(error[at]), float(angle[at]), rms, tolerance.bound, tolerance.why
    )


def validate_all(
    drives: Iterable[ClosedForm],
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
