"""Visible loop-closure errors, time constants that MuJoCo clamps, and steps too long for a loop."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mechsim.mechanism.finding import Finding
from mechsim.numerics.arrays import Array
from mechsim.simulation.findings.inspected import OFF, Inspected, Loop, Swing, driver_swing, loop_rank
from mechsim.simulation.findings.predicted_gap import MAX_IMPEDANCE, gaps_at_rest, gaps_in, overridden
from mechsim.simulation.state import data_at, dense_rows, is_disabled, mass_matrix

# smallest visible gap, as a fraction of the characteristic length or in [rad]
VISIBLE_GAP = 1e-4
# largest gap that is predicted, as a fraction of the characteristic length or in [rad]: the prediction takes
# geometry and forces of closed loops, and a gap of this size turns links by 0.1 rad
MAX_PREDICTED = 0.1
# a gap rings if a time step reverses its sign and leaves more than this fraction of it
RINGING = 0.25
# reduction of the step in the search of a stable one, and largest number of reductions
REDUCTION, MAX_REDUCTIONS = 0.9, 200
# smallest time constant that `refsafe` allows, in time steps
MIN_STEPS = 2.0


def compliant_loops(scene: Inspected) -> Iterator[Finding]:
    """Yield the loops that open visibly in a motion of the drivers, or at rest if there is no such motion."""
    if not scene.loops:
        return
    motion = driver_swing(scene)
    widest = _gaps(scene, motion)
    lengths = {loop.number: scene.length if scene.in_metres(loop) else 1.0 for loop in scene.loops}
    visible = [
        loop for loop in scene.loops if widest.get(loop.number, 0.0) > VISIBLE_GAP * lengths[loop.number]
    ]
    if not visible:
        return
    # as stiff as the time step allows
    spec, hardest = scene.read.spec.copy(), MIN_STEPS * float(scene.model.opt.timestep)
    equalities = list(spec.equalities)
    for loop in visible:
        equalities[loop.number].solref = np.array([hardest, 1.0])
        equalities[loop.number].solimp = np.array([MAX_IMPEDANCE, MAX_IMPEDANCE, 0.001, 0.5, 2.0])
    remaining = _gaps(Inspected(replace(scene.read, spec=spec), scene.motion_laws), motion)
    settings = f'solref="{hardest:g} 1" solimp="{MAX_IMPEDANCE:g} {MAX_IMPEDANCE:g} 0.001 0.5 2"'
    when = "at rest at the start" if motion is None else f"in {motion.description}"
    for loop in visible:
        by, after = widest[loop.number], remaining.get(loop.number, 0.0)
        unit, limit = "m" if scene.in_metres(loop) else "rad", MAX_PREDICTED * lengths[loop.number]
        gap = f"gap of {by:.2g} {unit}" if by <= limit else f"large gap, of more than {limit:.2g} {unit},"
        remainder = f"about {after:.1g}" if after <= limit else f"more than {limit:.2g}"
        remedy = f"{settings} leaves {remainder} {unit}"
        if after > 0.1 * by:
            remedy += ", for dampers that the integrator takes implicitly hold the rest back: a smaller step"
        message = f"{loop.name} is soft: its forces open a {gap} {when}"
        remedy += "; mechsim tune finds the settings for your tolerance"
        yield scene.finding("soft", loop.element, min(by, limit), message, remedy)


def _gaps(scene: Inspected, motion: Swing | None) -> dict[int, float]:
    return gaps_at_rest(scene) if motion is None else gaps_in(scene, motion)


def refsafe(scene: Inspected) -> Iterator[Finding]:
    """Yield the loops whose time constant MuJoCo raises to two time steps."""
    model = scene.model
    if is_disabled(model, OFF.mjDSBL_REFSAFE):
        return
    least = MIN_STEPS * float(model.opt.timestep)
    groups: dict[float, list[Loop]] = {}
    for loop in scene.loops:
        # the time constant of a loop in [s]; 0 if the file gives its stiffness directly
        solref = model.opt.o_solref if overridden(model) else model.eq_solref[loop.number]
        constant = max(float(solref[0]), 0.0)
        if 0.0 < constant < least * (1.0 - 1e-9):
            groups.setdefault(constant, []).append(loop)
    for constant, loops in groups.items():
        names = ", ".join(loop.name for loop in loops)
        message = (
            f"the time constant {constant:g} s of {names} is raised to {least:g} s, two steps: "
            f"gaps are {(least / constant) ** 2:.3g} times wider than the file asks for"
        )
        remedy = f"take a step of {constant / MIN_STEPS:g} s, or a time constant of {least:g} s"
        yield scene.finding("refsafe", loops[0].element, least / constant, message, remedy, names)


def timestep(scene: Inspected) -> Iterator[Finding]:
    """Yield a finding if the stiffest loop rings or diverges with the time step."""
    amplification = AMPLIFICATION.get(int(scene.model.opt.integrator))
    stiffest = _stiffest(scene) if scene.loops and amplification is not None else None
    if amplification is None or stiffest is None:
        return
    (matrix, loop), step = stiffest, float(scene.model.opt.timestep)

    def extremes(step: float) -> tuple[float, float]:
        values = np.linalg.eigvals(amplification(matrix, step))
        return float(np.abs(values).max()), float(values.real.min())

    def rests(worst: float, most_negative: float) -> bool:
        return worst <= 1.0 + 1e-9 and most_negative >= -RINGING

    worst, most_negative = extremes(step)
    if rests(worst, most_negative):
        return
    stable = stable_step(lambda shorter: rests(*extremes(shorter)), step)
    ends = f"oscillates: {-most_negative:.2g} of it returns with the opposite sign"
    if worst > 1.0 + 1e-9:
        ends = f"grows {worst:.3g}-fold a step"
    message = f"the step of {step:g} s is too long for the stiffest loop, {loop.name}: a gap {ends}"
    remedy = f"take a step of {stable:.2g} s, or make the loop {step / stable:.2g} times slower"
    yield scene.finding("timestep", loop.element, step / stable, message, remedy)


@dataclass(frozen=True, slots=True)
class GapDynamics:
    """Linear dynamics of the gaps r of loops: r'' = -damping r' - stiffness r, with (m, m) matrices."""

    damping: Array
    stiffness: Array


def _stiffest(scene: Inspected) -> tuple[GapDynamics, Loop] | None:
    """Return the gap dynamics at the start, and the stiffest loop; None if no joint changes the loops."""
    data = data_at(scene.loops_only, scene.read.qpos if scene.closed is None else scene.closed)
    rows = scene.loop_rows(data)
    jacobian = scene.without_rounding(dense_rows(data)[rows])
    if not jacobian.any():
        return None
    mobility = jacobian @ np.linalg.solve(mass_matrix(data), jacobian.T)
    # fraction of a requested acceleration that the compliance of the loops transmits
    transmitted = mobility @ np.linalg.inv(mobility + np.diag(data.efc_R[rows]))
    k, b, d, _ = data.efc_KBIP.reshape(-1, 4)[rows].T
    number = int(data.efc_id[rows][int(np.argmax(np.maximum(b, np.sqrt(k * d))))])
    loop = next(loop_ for loop_ in scene.loops if loop_.number == number)
    # redundant rows have the gaps of the rows on which they depend
    range_ = np.linalg.svd(jacobian)[0][:, : loop_rank(jacobian)]
    damping, stiffness = (range_.T @ (transmitted * factors) @ range_ for factors in (b, k * d))
    return GapDynamics(damping, stiffness), loop


def _euler_step(matrix: GapDynamics, step: float) -> Array:
    """Return the amplification matrix of MuJoCo's semi-implicit Euler step: rates first, then gaps."""
    identity = np.eye(len(matrix.damping))
    rate, gap = identity - step * matrix.damping, -step * matrix.stiffness
    return np.block([[rate, gap], [step * rate, identity + step * gap]])


def _runge_kutta_step(matrix: GapDynamics, step: float) -> Array:
    """Return the amplification matrix of a Runge-Kutta step of order 4 for rates and gaps."""
    identity = np.eye(len(matrix.damping))
    whole = step * np.block([[-matrix.damping, -matrix.stiffness], [identity, 0.0 * identity]])
    total = term = np.eye(len(whole))
    for order in range(1, 5):
        term = term @ whole / order
        total = total + term
    return total


# integrators that evaluate loop forces explicitly -> amplification matrix
AMPLIFICATION: dict[int, Callable[[GapDynamics, float], Array]] = {
    int(mujoco.mjtIntegrator.mjINT_EULER): _euler_step,
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): _euler_step,
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): _euler_step,
    int(mujoco.mjtIntegrator.mjINT_RK4): _runge_kutta_step,
}


def stable_step(is_stable: Callable[[float], bool], step: float) -> float:
    """Return a stable time step below an unstable one, by repeated reduction."""
    for _ in range(MAX_REDUCTIONS):
        step *= REDUCTION
        if is_stable(step):
            break
    return step
