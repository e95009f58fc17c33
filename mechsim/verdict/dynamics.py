"""Torque, reactions, energies and free running in MuJoCo against the analytic side, to a verdict."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics import Machine, free_run, prescribed
from mechsim.errors import InputError
from mechsim.model.efforts import Efforts
from mechsim.simulation.dynamics.free_running import SteppedFreeRun
from mechsim.simulation.dynamics.prescribed_motion import Driven
from mechsim.verdict.judge import Check, Verdict
from mechsim.verdict.tolerances import Tolerance

Array = NDArray[np.float64]
TURN = 2.0 * np.pi
# of the fastest: at less speed the crank stands, and dry friction has no direction
STANDING = 1e-7


def tolerances_driven(method: str) -> dict[str, Tolerance]:
    """Return the relative bounds of a machine under a prescribed crank, by kind, for "pose" or "step".

    The smallest mistake worth catching, a link's mass 0.1 % off, changes torque, forces and energies of
    every catalogue mechanism by more than 1e-5.
    """
    if method == "pose":
        why = "rounding: no integration; 3e-14 without springs, 3e-11 with stiff ones that balance"
        return {
            "torque": Tolerance(1e-10, "1", why),
            "reaction": Tolerance(1e-10, "1", why),
            "energy": Tolerance(1e-12, "1", "rounding: measured 1e-14"),
            "power": Tolerance(1e-10, "1", why),
            "balance": Tolerance(
                1e-8, "1", "rounding times the condition of the mass matrix; measured 1e-10"
            ),
        }
    why = "error of 1,000 steps a turn, fourth order: measured 6e-8 at the worst"
    return {
        "torque": Tolerance(1e-6, "1", why),
        "reaction": Tolerance(1e-5, "1", "as the torque, and forces that add up to none in it: 1.5e-7"),
        "energy": Tolerance(1e-8, "1", "rates of closed loops: measured 1e-9"),
        "power": Tolerance(1e-6, "1", "rates of loops closed to 1e-8: measured 4e-9"),
        "balance": Tolerance(1e-3, "1", "redundant constraints share what their softness says: 1e-4"),
    }


def tolerances_asked(tolerance: float) -> dict[str, Tolerance]:
    """Return the relative bounds of a stepped run that was asked to keep a tolerance, by kind."""
    asked = Tolerance(tolerance, "1", "asked for")
    energy = Tolerance(max(tolerance, 1e-8), "1", "as the torque; rates of closed loops: measured 1e-9")
    return tolerances_driven("step") | {
        "torque": asked,
        "reaction": asked,
        "energy": energy,
        "power": energy,
    }


def tolerances_free(turns: float, tolerance: float | None = None) -> dict[str, Tolerance]:
    """Return the bounds of a free run over some turns of the crank, or of one asked to keep a tolerance."""
    longer = max(1.0, abs(turns) / 10.0)
    why = "1e-6 over 10 turns: an energy error that grows evenly shifts the angle by its square"
    usual = {
        "angle": Tolerance(1e-6 * longer**2, "rad", why),
        "speed": Tolerance(1e-6 * longer, "1", "1e-6 over 10 turns, growing evenly"),
        "balance": Tolerance(1e-6, "1", "energy of all the turns; a frictionless run keeps it to 4e-7"),
    }
    if tolerance is None:
        return usual
    speed = "ten times the angle: speed follows the angle as inertia varies over the turn"
    work = "a hundred times the angle: work is summed over records as far apart as the steps"
    return {
        "angle": Tolerance(tolerance, "rad", "asked for"),
        "speed": Tolerance(max(usual["speed"].bound, 10.0 * tolerance), "1", speed),
        "balance": Tolerance(max(usual["balance"].bound, 100.0 * tolerance), "1", work),
    }


def crosscheck_driven(
    run: Driven, machine: Machine, *, bounds: Mapping[str, Tolerance] | None = None
) -> Verdict:
    """Compare a prescribed run with inverse dynamics at the angles, speeds and accelerations it really had.

    Args:
        run: from `simulation.dynamics.driven`.
        machine: the analytic side.
        bounds: bounds that replace those of `tolerances_driven` by kind, or of `tolerances_asked` where
            the run was stepped to a tolerance.

    Returns:
        The verdict. Forces are relative to the largest root mean square of any joint's force, moments
        to that times the mechanism's size, torque and energies to their own. Components that rigid
        links do not determine are left out, and so are forces at instants where a joint with dry
        friction stands still, and the torque where the crank does.
    """
    motion = run.motion
    if run.outcome == "diverged" or motion.broken:
        return Verdict("diverged", (), motion.broken or "MuJoCo's state went bad")
    study = prescribed(machine, motion.angle, motion.speed, motion.acceleration, time=motion.time).efforts
    usual = tolerances_driven(run.method)
    if run.promise is not None and run.method == "step":
        usual = tolerances_asked(run.promise.tolerance)
    return _judged(_driven_checks(run.efforts, study, {**usual, **(bounds or {})}))


def crosscheck_free(
    run: SteppedFreeRun, machine: Machine, *, bounds: Mapping[str, Tolerance] | None = None
) -> Verdict:
    """Compare a free run with the reduced equation from the same start, at the same instants.

    Args:
        run: from `simulation.free.free_run`.
        machine: the analytic side.
        bounds: bounds that replace those of `tolerances_free`, by kind.
    """
    motion, found = run.free, run.free
    if found.outcome == "diverged":
        return Verdict("diverged", (), found.reason)
    if len(motion) < 2:
        raise InputError("a free run of fewer than two instants says nothing; run it longer")
    exact = free_run(machine, angle=float(motion.angle[0]), speed=float(motion.speed[0]), times=motion.time)
    n = len(exact)
    if n < len(motion):
        return Verdict(
            "missed", (), f"the reduced equation ends after {exact.time[-1]:.6g} s: {exact.reason}"
        )
    turns = float(np.ptp(exact.angle)) / TURN
    asked = None if run.promise is None else run.promise.tolerance
    allowed = {**tolerances_free(turns, asked), **(bounds or {})}
    fastest = float(np.abs(exact.speed).max())
    energy = max(float(np.abs(exact.kinetic).max()), float(np.ptp(exact.potential)), float(exact.lost.max()))
    checks = [
        _check("crank angle", "rad", allowed["angle"], motion.angle - exact.angle, motion.angle),
        _check("crank speed", "rad/s", allowed["speed"], motion.speed - exact.speed, motion.angle, fastest),
        _check("energy balance", "J", allowed["balance"], found.imbalance, motion.angle, energy),
        _check(
            "work of motor and loads", "J", allowed["balance"], found.work - exact.work, motion.angle, energy
        ),
        _check("energy lost", "J", allowed["balance"], found.lost - exact.lost, motion.angle, energy),
    ]
    return _judged(checks)


def _driven_checks(found: Efforts, study: Efforts, allowed: Mapping[str, Tolerance]) -> Iterator[Check]:
    angle = study.angle
    kinetic = float(np.abs(study.kinetic).max())
    torque = max(_rms(study.torque), 1e-3 * kinetic)
    standing = study.reversing & (np.abs(study.speed) <= STANDING * np.abs(study.speed).max())
    gap = np.where(standing, 0.0, found.torque - study.torque)
    yield _check("drive torque", "N m", allowed["torque"], gap, angle, torque)
    size = study.size
    reactions = study.reactions
    largest = max(_rms(np.sqrt((one.force**2).sum(1))) for one in reactions.values()) or torque / size
    for name, exact in reactions.items():
        mine = found.reactions[name]
        for kind, unit, part, scale in (
            ("force", "N", slice(0, 3), largest),
            ("moment", "N m", slice(3, 6), largest * size),
        ):
            known = exact.known[part]
            if known.any():
                apart = (getattr(mine, kind) - getattr(exact, kind))[:, known]
                error = np.where(study.reversing, 0.0, np.sqrt((apart**2).sum(1)))
                yield _check(f"{kind} in {name}", unit, allowed["reaction"], error, angle, scale)
    for name, exact_torque in study.gears.items():
        gap = np.where(study.reversing, 0.0, found.gears[name] - exact_torque)
        yield _check(f"torque of gear {name}", "N m", allowed["reaction"], gap, angle, largest * size)
    height = float(np.abs(study.potential).max())
    yield _check("kinetic energy", "J", allowed["energy"], found.kinetic - study.kinetic, angle, kinetic)
    yield _check("potential energy", "J", allowed["energy"], found.potential - study.potential, angle, height)
    power = torque * float(np.abs(study.speed).max())
    for name in ("power_loads", "power_lost"):
        gap = getattr(found, name) - getattr(study, name)
        yield _check(name.replace("_", " "), "W", allowed["power"], gap, angle, power)
    yield _check("accelerations under these forces", "1", allowed["balance"], found.residual, angle)


def _check(
    quantity: str, unit: str, tolerance: Tolerance, error: Array, angle: Array, scale: float = 1.0
) -> Check:
    """Return a check in SI; a tolerance that is a part of something is that part of `scale`."""
    size = np.abs(error)
    # NaN counts as the worst there is
    at = int(np.argmax(np.where(np.isnan(size), np.inf, size)))
    relative = tolerance.unit == "1" and unit != "1"
    bound = tolerance.bound * (scale if relative else 1.0)
    why = f"{tolerance.bound:.0e} of {scale:.3g} {unit}; {tolerance.why}" if relative else tolerance.why
    return Check(quantity, unit, float(size[at]), float(angle[at]), _rms(size), bound, why)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _judged(checks: Iterator[Check] | list[Check]) -> Verdict:
    found = tuple(checks)
    failed = [check for check in found if not check.passed]
    if not failed:
        return Verdict("met", found)
    if not all(check.worst == check.worst for check in found):
        return Verdict("diverged", found, "an error is not a number")
    names = ", ".join(f"{check.quantity} by {check.worst / check.bound:.3g} times" for check in failed[:3])
    more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
    return Verdict("missed", found, f"beyond the bound: {names}{more}")
