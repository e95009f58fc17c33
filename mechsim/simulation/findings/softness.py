"""Loops that will open by what shows, time constants that MuJoCo clamps, steps too long for a loop."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.finding import Finding
from mechsim.simulation.findings.inspected import EQUALITY, OFF, Inspected, Loop, rank
from mechsim.simulation.findings.predicted_gap import HARDEST, gaps_at_rest, gaps_in, overridden
from mechsim.simulation.findings.swing import swing
from mechsim.simulation.mjcf.silence import quiet
from mechsim.simulation.mjcf_reader.equality_rows import TENDON

# a gap that shows, in parts of the size or in [rad]
SHOWN = 1e-4
# a step that takes a gap to the other side by more than this part of it rings
RINGS = 0.25
# steps in a time constant below which `refsafe` clamps
SAFE = 2.0


def soft(scene: Inspected) -> Iterator[Finding]:
    """Yield the loops that will open by what shows, under a motion where the drivers settle one."""
    if not scene.loops:
        return
    motion = swing(scene)
    wide = gaps_at_rest(scene) if motion is None else gaps_in(scene, motion)
    when = "at rest where the scene starts" if motion is None else f"in {motion.said}"
    for loop in scene.loops:
        by, yardstick = wide.get(loop.number, 0.0), scene.size if loop.closes else 1.0
        if by > SHOWN * yardstick:
            unit = "m" if loop.closes or loop.kind == TENDON else "rad"
            yield Finding(
                kind="soft",
                what=loop.name,
                by=by,
                explains=0.0,
                say=f"{loop.name} is soft: its own forces will open it by {by:.2g} {unit} {when}",
                remedy=_harder(scene, loop, by, unit),
                line=loop.line,
            )


def _harder(scene: Inspected, loop: Loop, by: float, unit: str) -> str:
    """Return the hardest that the step allows, and what it will leave of a gap."""
    model = scene.bare
    step = float(model.opt.timestep)
    (constant, ratio), solimp = timing(scene, loop)
    high = min(float(solimp[1]), HARDEST)
    hardest = max(SAFE * step, 1e-12)
    # the gap goes with (1 - d) / d^2 and with the square of the time constant that impedance scales
    part = (1.0 - HARDEST) / (1.0 - high) * (high / HARDEST) ** 2
    if constant > 0.0:
        part *= (hardest / (constant * ratio)) ** 2 * (HARDEST / high) ** 2
    left = f"leaves about {by * part:.1g} {unit}"
    return (
        f'solref="{hardest:g} 1" solimp="{HARDEST:g} {HARDEST:g} 0.001 0.5 2" {left}; '
        "mechsim tune finds what your tolerance needs"
    )


def timing(scene: Inspected, loop: Loop) -> tuple[tuple[float, float], Array]:
    """Return time constant in [s] and damping ratio of a loop, 0 and 0 if given directly, and its solimp."""
    model = scene.bare
    whole = overridden(model)
    solref = model.opt.o_solref if whole else model.eq_solref[loop.number]
    solimp = model.opt.o_solimp if whole else model.eq_solimp[loop.number]
    first, second = (float(value) for value in solref)
    return ((first, second) if first > 0.0 else (0.0, 0.0)), solimp


def refsafe(scene: Inspected) -> Iterator[Finding]:
    """Yield the loops whose time constant MuJoCo raises to two steps."""
    model = scene.model
    if model.opt.disableflags & int(OFF.mjDSBL_REFSAFE):
        return
    least = SAFE * float(model.opt.timestep)
    groups: dict[float, list[Loop]] = {}
    for loop in scene.loops:
        (constant, _), _ = timing(scene, loop)
        if 0.0 < constant < least * (1.0 - 1e-9):
            groups.setdefault(constant, []).append(loop)
    for constant, loops in groups.items():
        names = ", ".join(loop.name for loop in loops)
        yield Finding(
            kind="refsafe",
            what=names,
            by=least / constant,
            explains=0.0,
            say=f"the time constant {constant:g} s of {names} is raised to {least:g} s, two steps: "
            f"gaps are {(least / constant) ** 2:.3g} times wider than the file asks for",
            remedy=f"take a step of {constant / SAFE:g} s, or a time constant of {least:g} s",
            line=loops[0].line,
        )


def timestep(scene: Inspected) -> Iterator[Finding]:
    """Yield the step if the stiffest loop rings or diverges with it."""
    model = scene.model
    grows = AMPLIFIED.get(int(model.opt.integrator))
    if not scene.loops or grows is None:
        return
    matrix, loop = _stiffest(scene)
    step = float(model.opt.timestep)
    values = np.linalg.eigvals(grows(matrix, step))
    worst, turned = float(np.abs(values).max()), float(values.real.min())
    if worst <= 1.0 + 1e-9 and turned >= -RINGS:
        return
    fits = _fitting(grows, matrix, step)
    ends = (
        f"grows {worst:.3g}-fold a step" if worst > 1.0 + 1e-9 else f"rings: {-turned:.2g} of it comes back"
    )
    yield Finding(
        kind="timestep",
        what=loop.name,
        by=step / fits,
        explains=0.0,
        say=f"the step of {step:g} s is too long for the stiffest loop, {loop.name}: a gap {ends}",
        remedy=f"take a step of {fits:.2g} s, or make the loop {step / fits:.2g} times slower",
        line=loop.line,
    )


@dataclass(frozen=True, slots=True)
class _Stiff:
    """Gap's rate and acceleration of loops, linear in both: r'' = -damping r' - stiffness r, (m, m) each."""

    damping: Array
    stiffness: Array


def _stiffest(scene: Inspected) -> tuple[_Stiff, Loop]:
    """Return what the loops' gaps do by themselves at the start, and the stiffest loop."""
    model = scene.bare
    data = mujoco.MjData(model)
    data.qpos[:] = scene.read.qpos if scene.closed is None else scene.closed
    with quiet():
        mujoco.mj_forward(model, data)
    rows = data.efc_type == EQUALITY
    slope = data.efc_J.reshape(-1, model.nv)[rows]
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    light = slope @ np.linalg.solve(inertia, slope.T)
    # part of an asked acceleration that the softness of the loops lets through
    part = light @ np.linalg.inv(light + np.diag(data.efc_R[rows]))
    k, b, d, _ = data.efc_KBIP.reshape(-1, 4)[rows].T
    number = int(data.efc_id[rows][int(np.argmax(np.maximum(b, np.sqrt(k * d))))])
    loop = next(one for one in scene.loops if one.number == number)
    # rows that repeat others open with them
    seen = np.linalg.svd(slope)[0][:, : rank(slope)]
    return _Stiff(seen.T @ (part * b) @ seen, seen.T @ (part * (k * d)) @ seen), loop


def _by_steps(matrix: _Stiff, step: float) -> Array:
    """Return what a step does to gaps and their rates by MuJoCo's Euler: rates first, then gaps."""
    one = np.eye(len(matrix.damping))
    rate, gap = one - step * matrix.damping, -step * matrix.stiffness
    return np.block([[rate, gap], [step * rate, one + step * gap]])


def _by_runge(matrix: _Stiff, step: float) -> Array:
    """Return what a step of Runge and Kutta does to gaps and their rates."""
    one = np.eye(len(matrix.damping))
    whole = step * np.block([[-matrix.damping, -matrix.stiffness], [one, 0.0 * one]])
    total = term = np.eye(len(whole))
    for order in range(1, 5):
        term = term @ whole / order
        total = total + term
    return total


Amplified = Callable[[_Stiff, float], Array]
# integrators under which the forces of loops are those at the beginning of a step
AMPLIFIED: dict[int, Amplified] = {
    int(mujoco.mjtIntegrator.mjINT_EULER): _by_steps,
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): _by_steps,
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): _by_steps,
    int(mujoco.mjtIntegrator.mjINT_RK4): _by_runge,
}


def _fitting(grows: Amplified, matrix: _Stiff, step: float) -> float:
    """Return a step that neither rings nor diverges, found by going down in parts of a tenth."""
    for _ in range(200):
        values = np.linalg.eigvals(grows(matrix, step))
        if np.abs(values).max() <= 1.0 + 1e-9 and values.real.min() >= -RINGS:
            break
        step *= 0.9
    return step
