"""Two roads to forces and free running, to a verdict: MuJoCo's against the reduced equation's."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mechsim.crosscheck import Check, Verdict
from mechsim.dynamics import Machine, Study, free_run, prescribed
from mechsim.simulation.dynamics import Driven
from mechsim.simulation.free import FreeRun

Array = NDArray[np.float64]

# parts of the largest value over the turn, for solved poses and for stepped runs; a mass 0.1 % off
# changes what the masses need by 1e-4 to 1e-3, and the whole torque by less where loads are large
POSE_TORQUE, POSE_REACTION = 1e-9, 1e-9
STEP_TORQUE, STEP_REACTION = 1e-6, 1e-5
WHY = {
    "pose": "1e-9 of the largest: no integration; measured 1e-13",
    "step": "1e-6 of the largest torque, 1e-5 of the largest reaction: default steps; measured 1e-9",
}
# of a free run: crank angle in [rad] a turn, speed and energy as parts of the largest
FREE_ANGLE, FREE_SPEED, FREE_ENERGY = 1e-6, 1e-6, 1e-6


def check_driven(found: Driven, machine: Machine) -> Verdict:
    """Compare drive torque, joint reactions and energies under a prescribed crank.

    The analytic side is taken at the crank angles, speeds and accelerations that MuJoCo really had.
    Components of reactions that rigid links leave open are not compared, nor reactions at an instant
    at which a joint with dry friction turns round.
    """
    if found.outcome == "diverged":
        return Verdict("diverged", (), found.motion.broken or "the stepped run diverged")
    motion = found.motion
    study = prescribed(machine, motion.angle, motion.speed, motion.acceleration, time=motion.time)
    return _verdict(tuple(_driven_checks(found, study)))


def check_free(found: FreeRun, machine: Machine) -> Verdict:
    """Compare a free run with the reduced equation at the same instants, and its energy with itself."""
    motion = found.motion
    if found.outcome == "diverged":
        return Verdict("diverged", (), found.reason)
    assert motion.time is not None
    if len(motion.time) < 2:
        return Verdict("met", ())
    exact = free_run(machine, angle=float(motion.angle[0]), speed=float(motion.speed[0]), times=motion.time)
    n = len(exact)
    if n < len(motion.time):
        return Verdict("missed", (), f"the reduced equation ends at {exact.time[-1]:.6g} s: {exact.reason}")
    turns = max(1.0, float(np.abs(exact.angle - exact.angle[0]).max()) / (2.0 * np.pi))
    fastest = float(np.abs(exact.speed).max())
    errors = (
        ("crank angle", "rad", motion.angle - exact.angle, FREE_ANGLE * turns, "1e-6 rad a turn"),
        ("crank speed", "rad/s", motion.speed - exact.speed, FREE_SPEED * turns * fastest, "1e-6 a turn"),
        (
            "energy balance",
            "1",
            np.full(n, found.energy_error),
            FREE_ENERGY,
            "1e-6 of the energy turned over",
        ),
    )
    return _verdict(tuple(_check(*error, angle=motion.angle) for error in errors))


def _driven_checks(found: Driven, study: Study) -> Iterator[Check]:
    efforts, angle, why = found.efforts, study.angle, WHY[found.method]
    pose = found.method == "pose"
    torque = POSE_TORQUE if pose else STEP_TORQUE
    reaction = POSE_REACTION if pose else STEP_REACTION
    size = study.machine.mechanism.size
    force = max(float(np.abs(one.force).max()) for one in study.balance.reactions.values())
    most = max(float(np.abs(study.torque).max()), float(np.abs(study.load).max()), 1e-6 * force * size)
    yield _check("drive torque", "N m", efforts.torque - study.torque, torque * most, why, angle=angle)
    for name, exact in study.balance.reactions.items():
        gap = efforts.reactions[name]
        for what, unit, error, known, scale in (
            ("force", "N", gap.force - exact.force, exact.determined[:3], force),
            ("moment", "N m", gap.moment - exact.moment, exact.determined[3:], force * size),
        ):
            if known.any():
                # where dry friction turns round, the two roads may stand on either side of the jump
                miss = np.where(study.reversing, 0.0, np.sqrt((error[:, known] ** 2).sum(1)))
                yield _check(f"{what} in {name}", unit, miss, reaction * scale, why, angle=angle)
    for name, exact in study.balance.gears.items():
        error = efforts.gears[name] - exact
        yield _check(f"torque of gear {name}", "N m", error, reaction * force * size, why, angle=angle)
    stored = float(np.abs(study.kinetic).max() + np.ptp(study.potential))
    for name, error in (
        ("kinetic energy", efforts.kinetic - study.kinetic),
        ("potential energy", efforts.potential - study.potential),
    ):
        yield _check(name, "J", error, torque * stored, why, angle=angle)
    lost, turned = efforts.power_lost - study.power_lost, float(np.abs(study.power_lost).max())
    most_power = max(turned, float(np.abs(study.power_stored).max()))
    yield _check("power lost", "W", lost, torque * most_power, why, angle=angle)


def _check(quantity: str, unit: str, error: Array, bound: float, why: str, *, angle: Array) -> Check:
    size = np.abs(error)
    at = int(np.argmax(np.where(np.isnan(size), np.inf, size)))
    rms = float(np.sqrt(np.mean(size**2)))
    return Check(quantity, unit, float(size[at]), float(angle[at]), rms, bound, why)


def _verdict(checks: tuple[Check, ...]) -> Verdict:
    failed = [check for check in checks if not check.passed]
    if not failed:
        return Verdict("met", checks)
    if not all(check.worst == check.worst for check in checks):
        return Verdict("diverged", checks, "an error is not a number")
    names = ", ".join(f"{check.quantity} by {check.worst / check.bound:.3g} times" for check in failed[:3])
    more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
    return Verdict("missed", checks, f"beyond the bound: {names}{more}")
