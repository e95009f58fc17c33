"""Dynamics in MuJoCo against the formulas: the true answer at what the run really did, and the verdict."""

from collections.abc import Callable, Mapping

from mechsim.analytic.dynamics import Machine, free_run, prescribed
from mechsim.simulation.dynamics.free_motion import SteppedFreeRun
from mechsim.simulation.result import Driven
from mechsim.verdict.checks import Verdict
from mechsim.verdict.judge import judge_efforts, judge_free_run
from mechsim.verdict.tolerances import Tolerance


def crosscheck_driven(
    run: Driven,
    machine: Machine,
    *,
    bounds: Mapping[str, Tolerance] | None = None,
    watch: Callable[[str, float], None] = lambda _, __: None,
) -> Verdict:
    """Compare a prescribed run with inverse dynamics at the angles, speeds and accelerations it really had.

    Args:
        run: from `simulation.dynamics.prescribed_motion.driven`.
        machine: the analytic side.
        bounds: as in `judge_efforts`.
        watch: told now and then how far it has come, in words and as a part of the whole.
    """
    motion = run.motion
    if run.outcome == "diverged" or motion.broken:
        return Verdict("diverged", (), motion.broken or "MuJoCo's state went bad")
    at = (motion.angle, motion.speed, motion.acceleration)
    study = prescribed(machine, *at, time=motion.time, as_run=motion, watch=watch)
    tolerance = (
        None if run.tolerance_report is None or run.method == "pose" else run.tolerance_report.tolerance
    )
    return judge_efforts(
        run.efforts,
        study.efforts,
        method=run.method,
        tolerance=tolerance,
        bounds=bounds,
        conditioning=machine.drive.conditioning(motion),
    )


def crosscheck_free(
    run: SteppedFreeRun, machine: Machine, *, bounds: Mapping[str, Tolerance] | None = None
) -> Verdict:
    """Compare a free run with the reduced equation from the same start, at the same instants.

    Args:
        run: from `simulation.dynamics.free_running.free_run`.
        machine: the analytic side.
        bounds: as in `judge_free_run`.
    """
    found = run.free
    if found.outcome == "diverged" or len(found) < 2:
        return judge_free_run(found, found)
    exact = free_run(machine, angle=float(found.angle[0]), speed=float(found.speed[0]), times=found.time)
    tolerance = None if run.tolerance_report is None else run.tolerance_report.tolerance
    return judge_free_run(found, exact, tolerance=tolerance, bounds=bounds)
