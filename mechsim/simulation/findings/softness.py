"""Loops that will open by what shows, time constants that MuJoCo clamps, steps too long for a loop."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.finding import Finding
from mechsim.simulation.findings.inspected import EQUALITY, OFF, Inspected, Loop, rank
from mechsim.simulation.findings.predicted_gap import HARDEST, gaps_at_rest, gaps_in, overridden
from mechsim.simulation.findings.swing import Swing, swing
from mechsim.simulation.matrices import dense_rows
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
    wide = _gaps(scene, motion)
    shown = [
        loop
        for loop in scene.loops
        if wide.get(loop.number, 0.0) > SHOWN * (scene.size if loop.closes else 1.0)
    ]
    if not shown:
        return
    hard, solref = _hardened(scene, shown)
    left = _gaps(hard, motion)
    when = "at rest where the scene starts" if motion is None else f"in {motion.said}"
    for loop in shown:
        by, after = wide[loop.number], left.get(loop.number, 0.0)
        unit = "m" if loop.closes or loop.kind == TENDON else "rad"
        remedy = f'{solref} solimp="{HARDEST:g} {HARDEST:g} 0.001 0.5 2" leaves about {after:.1g} {unit}'
        if after > 0.1 * by:
            remedy += ", for dampers that the integrator takes implicitly hold the rest back: a smaller step"
        yield Finding(
            kind="soft",
            what=loop.name,
            by=by,
            explains=0.0,
            say=f"{loop.name} is soft: its own forces will open it by {by:.2g} {unit} {when}",
            remedy=f"{remedy}; mechsim tune finds what your tolerance needs",
            **loop.place,
        )


def _gaps(scene: Inspected, motion: Swing | None) -> dict[int, float]:
    return gaps_at_rest(scene) if motion is None else gaps_in(scene, motion)


def _hardened(scene: Inspected, loops: Sequence[Loop]) -> tuple[Inspected, str]:
    """Return a scene with loops as hard as its step allows, and the time constant in words."""
    spec, hardest = scene.read.spec.copy(), SAFE * float(scene.model.opt.timestep)
    equalities = list(spec.equalities)
    for loop in loops:
        equalities[loop.number].solref = np.array([hardest, 1.0])
        equalities[loop.number].solimp = np.array([HARDEST, HARDEST, 0.001, 0.5, 2.0])
    return Inspected(replace(scene.read, spec=spec), scene.programs), f'solref="{hardest:g} 1"'


def _time_constant(scene: Inspected, loop: Loop) -> float:
    """Return the time constant of a loop in [s]; 0 where its stiffness is given directly."""
    model = scene.model
    solref = model.opt.o_solref if overridden(model) else model.eq_solref[loop.number]
    return max(float(solref[0]), 0.0)


def refsafe(scene: Inspected) -> Iterator[Finding]:
    """Yield the loops whose time constant MuJoCo raises to two steps."""
    model = scene.model
    if model.opt.disableflags & int(OFF.mjDSBL_REFSAFE):
        return
    least = SAFE * float(model.opt.timestep)
    groups: dict[float, list[Loop]] = {}
    for loop in scene.loops:
        constant = _time_constant(scene, loop)
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
            **loops[0].place,
        )


def timestep(scene: Inspected) -> Iterator[Finding]:
    """Yield the step if the stiffest loop rings or diverges with it."""
    model = scene.model
    grows = AMPLIFIED.get(int(model.opt.integrator))
    if not scene.loops or grows is None:
        return
    stiffest = _stiffest(scene)
    if stiffest is None:
        return
    matrix, loop = stiffest
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
        **loop.place,
    )


@dataclass(frozen=True, slots=True)
class _Stiff:
    """Gap's rate and acceleration of loops, linear in both: r'' = -damping r' - stiffness r, (m, m) each."""

    damping: Array
    stiffness: Array


def _stiffest(scene: Inspected) -> tuple[_Stiff, Loop] | None:
    """Return what the loops' gaps do by themselves at the start, and the stiffest loop; None if nothing."""
    model = scene.bare
    data = mujoco.MjData(model)
    data.qpos[:] = scene.read.qpos if scene.closed is None else scene.closed
    with quiet():
        mujoco.mj_forward(model, data)
    rows = data.efc_type == EQUALITY
    slope = scene.telling(dense_rows(data)[rows])
    if not slope.any():
        return None
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
