"""Steps a turn for a wanted accuracy of torque and joint forces, and the proof that they keep it.

Two estimates that know nothing of each other nor of a closed form: the same crank motion pose by pose,
whose inverse dynamics has no error of time; and half the steps, whose distance from the whole number
falls with the order observed. The worse of the two counts.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.maths.norms import rms, worst
from mechsim.model.efforts import Efforts
from mechsim.simulation.dynamics.determinacy import Known, settled
from mechsim.simulation.dynamics.efforts import required
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.settings import Settings

if TYPE_CHECKING:
    from mechsim.simulation.dynamics.prescribed_motion import Driven

Array = NDArray[np.float64]

# instants compared in a turn of a trial; halving asks for multiples of twice as many steps
TRIAL_SAMPLES = 24
# steps a turn of the two trials, the fewest taken, and the most that are spent
TRIALS, FEWEST, MOST = (96, 192), 2 * TRIAL_SAMPLES, 100_000
# orders of convergence believed; the settings are of fourth
ORDERS = (1.0, 4.0)
# part of the tolerance aimed at, for what the trials do not see
AIM = 0.5
# a torque that is a smaller part of the energy of motion counts as none
IDLE = 1e-3
# crank accelerations of two runs that are nearer than this part of the speed squared are the same
SAME = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """What was asked of a run and how it came out.

    Errors of torque are parts of its root mean square over the run; those of forces parts of the
    largest root mean square of any joint's force; those of moments parts of that times the mechanism's
    size. Each is the worst of any recorded instant.

    Attributes:
        tolerance: asked for.
        torque: error of the drive torque, against solved poses.
        reactions: largest error of any joint's force or moment that rigid links determine, likewise.
        halving: the larger of both by halving the steps.
        balance: of a run by poses, by how much the accelerations MuJoCo gets from the forces are off.
        order: at which the trials were seen to converge.
        trials: steps taken on trial runs.
        reason: one sentence where the tolerance is not kept.
    """

    tolerance: float
    torque: float = 0.0
    reactions: float = 0.0
    halving: float = 0.0
    balance: float = 0.0
    order: float | None = None
    trials: int = 0
    reason: str = ""

    @property
    def estimate(self) -> float:
        """The worst of all estimates; infinity where one is not a number."""
        return worst([self.torque, self.reactions, self.halving, self.balance])

    @property
    def met(self) -> bool:
        """Whether the estimate is within the tolerance."""
        return self.estimate <= self.tolerance

    @property
    def margin(self) -> float:
        """The tolerance over the estimate."""
        return self.tolerance / self.estimate if self.estimate > 0.0 else np.inf


def promised(
    bench: LoadedModel,
    settings: Settings,
    tolerance: float,
    whole: Callable[[Settings], "Driven"],
    trial: Callable[[Settings], "Driven"],
) -> "Driven":
    """Return a run whose torque and reactions keep a tolerance, or the best there is; with its promise.

    Args:
        bench: the mechanism.
        settings: how to step; the number of steps is replaced.
        tolerance: as in `Promise`.
        whole: settings -> the run asked for.
        trial: settings -> a run of the same crank motion, one turn of it where its speed is steady,
            recorded at `TRIAL_SAMPLES` instants a turn.
    """
    known = settled(bench)
    spent = 0

    def tried(steps: int) -> "Driven":
        nonlocal spent
        run = trial(replace(settings, steps_per_turn=steps))
        spent += run.steps
        return run

    first, second = (max(_against_poses(bench, tried(steps), known)) for steps in TRIALS)
    order = _order(first, second, TRIALS[1] / TRIALS[0])
    steps, best = _wanted(TRIALS[1], second, tolerance, order), None
    while True:
        run = whole(replace(settings, steps_per_turn=steps))
        torque, reactions = _against_poses(bench, run, known)
        gap = np.inf
        if run.outcome == "done":
            gap = _halved(bench, tried(steps // 2), tried(steps), known) / (2.0**order - 1.0)
        promise = Promise(
            tolerance=tolerance, torque=torque, reactions=reactions, halving=gap, order=order, trials=spent
        )
        gained = best is None or promise.estimate < 0.5 * best[1].estimate
        if best is None or promise.estimate < best[1].estimate:
            best = run, promise
        if promise.met or not gained or steps >= MOST:
            break
        more = max(_wanted(steps, promise.estimate, tolerance, order), _even(1.5 * steps))
        # an estimate so coarse that it foretells nothing asks for the sky
        steps = min(more, max(TRIALS[1], _even(2.0 * steps)))
    run, promise = best
    if promise.met:
        return replace(run, outcome="met", promise=replace(promise, trials=spent))
    why = _why(promise, steps)
    outcome = "diverged" if run.outcome == "diverged" else "missed"
    return replace(run, outcome=outcome, promise=replace(promise, trials=spent, reason=why))


def _why(promise: Promise, steps: int) -> str:
    """Return why a tolerance is not kept."""
    if steps >= MOST:
        return f"{MOST} steps a turn, the most that are spent, leave {promise.estimate:.2g}"
    return (
        f"{steps} steps a turn are no better than fewer: {promise.estimate:.2g} is left of rounding and of "
        "how softly loops are held; solved poses have neither (method pose)"
    )


def _against_poses(bench: LoadedModel, run: "Driven", known: Known) -> tuple[float, float]:
    """Return the errors of torque and reactions of a stepped run beside solved poses."""
    try:
        true = _posed(bench, run)
    except AssemblyError:
        # a pose that does not close says nothing of the forces there
        return np.inf, np.inf
    return _errors(bench, _gaps(bench, run.efforts, true, known), true)


def _halved(bench: LoadedModel, coarse: "Driven", fine: "Driven", known: Known) -> float:
    """Return how far torque or reactions of two runs are apart at the same instants.

    Where the drive is not steady its acceleration differs from run to run; that is no error of the
    forces, and what solved poses make of it is taken off.
    """
    if "diverged" in (coarse.outcome, fine.outcome):
        return np.inf
    gaps = _gaps(bench, coarse.efforts, fine.efforts, known)
    true = fine.efforts
    change = np.abs(coarse.motion.acceleration - fine.motion.acceleration).max()
    if change > SAME * np.abs(fine.motion.speed).max() ** 2:
        one, true = _posed(bench, coarse), _posed(bench, fine)
        driven = _gaps(bench, one, true, known)
        gaps = [(kind, gap - moved) for (kind, gap), (_, moved) in zip(gaps, driven, strict=True)]
    return max(_errors(bench, gaps, true))


def _posed(bench: LoadedModel, run: "Driven") -> Efforts:
    """Return what the crank motion of a run needs, by solved poses."""
    motion = run.motion
    if run.outcome == "diverged" or motion.time is None:
        raise AssemblyError("the run diverged")
    return required(bench, motion.time, motion.angle, motion.speed, motion.acceleration)[1]


def _gaps(bench: LoadedModel, found: Efforts, true: Efforts, known: Known) -> list[tuple[str, Array]]:
    """Return the differences of torque [N m], and of forces and moments over the size [N]; (n, k) each."""
    size = bench.mechanism.size
    # where a joint with dry friction turns round, forces jump from one value to another
    fair = (found.sliding == true.sliding).all(1)[:, None]
    gaps = [("torque", (found.torque - true.torque)[:, None])]
    for name, one in true.reactions.items():
        other = found.reactions[name]
        gaps.append(("force", np.where(known[name][:3], other.force - one.force, 0.0)))
        gaps.append(("force", np.where(known[name][3:], (other.moment - one.moment) / size, 0.0)))
    gaps += [("force", (found.gears[name] - one)[:, None] / size) for name, one in true.gears.items()]
    return [(kind, np.where(fair, gap, 0.0)) for kind, gap in gaps]


def _errors(bench: LoadedModel, gaps: list[tuple[str, Array]], true: Efforts) -> tuple[float, float]:
    """Return the largest errors of torque and of reactions, as in `Promise`."""
    torque = max(rms(true.torque), IDLE * worst(true.kinetic))
    force = max(rms(np.linalg.norm(one.force, axis=1)) for one in true.reactions.values())
    scale = {"torque": torque, "force": force or torque / bench.mechanism.size}
    found = dict.fromkeys(scale, 0.0)
    for kind, gap in gaps:
        found[kind] = max(found[kind], worst(np.linalg.norm(gap, axis=1)) / scale[kind])
    return found["torque"], found["force"]


def _order(coarse: float, fine: float, ratio: float) -> float:
    """Return the order at which an error fell, as far as it is believed."""
    if not (np.isfinite(coarse) and fine > 0.0):
        return ORDERS[0]
    return float(np.clip(np.log(coarse / fine) / np.log(ratio), *ORDERS))


def _wanted(steps: int, estimate: float, tolerance: float, order: float) -> int:
    """Return the steps a turn that should keep a tolerance."""
    if not np.isfinite(estimate):
        return _even(4.0 * steps)
    return _even(steps * (max(estimate, 1e-300) / (AIM * tolerance)) ** (1.0 / order))


def _even(steps: float) -> int:
    """Return the next number of steps that can be halved and recorded evenly."""
    return int(FEWEST * np.clip(np.ceil(steps / FEWEST - 1e-9), 1, -(-MOST // FEWEST)))
