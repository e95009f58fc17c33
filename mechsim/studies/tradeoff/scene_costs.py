"""What each thing in a user's scene costs: turned on or off alone, timed, and how the motion changes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.reduction.bench import Bench
from mechsim.studies.reduction.candidate import Candidate, NotThere, changed, counted
from mechsim.studies.reduction.evidence import Evidence, evidence
from mechsim.studies.reduction.spelled_out import spelled_out
from mechsim.studies.reduction.table import ORNAMENTS
from mechsim.studies.scenes import UserScene, step_times

OFF, ON = mujoco.mjtDisableBit, mujoco.mjtEnableBit
INTEGRATORS = ("EULER", "IMPLICITFAST", "IMPLICIT", "RK4")
SOLVERS = ("NEWTON", "CG", "PGS")
ROUNDS = 11


@dataclass(frozen=True, slots=True)
class SceneCost:
    """What one thing costs.

    Attributes:
        what: is changed, in words; the first of a table is the scene as it is.
        freedoms: of the model.
        rows: of constraints at the start.
        step: processor time of a step, in [us].
        ratio: of the time to that of the scene as it is.
        error: worst distance of a tracked point from the scene as it is, in [m].
    """

    what: str
    freedoms: int
    rows: int
    step: float
    ratio: float
    error: float


@quiet()
def scene_costs(
    scene: UserScene,
    spec: mujoco.MjSpec,
    rounds: int = ROUNDS,
    tell: Callable[[float], None] = lambda _: None,
) -> list[SceneCost]:
    """Return what each thing in a scene costs over its motion, the scene as it is first.

    Args:
        scene: and its motion.
        spec: of its file; not changed.
        rounds: of timing; each runs everything once.
        tell: told what part of the timing is done.

    Raises:
        InputError: for a scene that diverges.
    """
    full = spelled_out(spec)
    named = plainly_compiled(full.copy())
    tracked = {name: (named.body(body).name, place) for name, (body, place) in scene.places.items()}
    bench = Bench(scene, full, tracked)
    if bench.run.broken:
        raise InputError(f"{scene.path} diverges: {bench.run.broken}; mend the scene, or ask for less")
    seen = evidence(full, bench.full, frozenset(body for body, _ in tracked.values()), 0.0)
    tried = {"as it is": bench.full}
    for one in _things(seen):
        try:
            tried[one.what] = bench.lean(changed(full, one))
        except (NotThere, ValueError):
            continue
    times = step_times([(one, one.model) for one in tried.values()], rounds, tell)
    return [
        SceneCost(
            what,
            int(one.model.nv),
            _rows(one.model, one.start[0]),
            1e6 * float(seconds * one.model.opt.timestep),
            float(seconds / times[0]),
            bench.errors(one, all_of_them=False).trajectory,
        )
        for (what, one), seconds in zip(tried.items(), times, strict=True)
    ]


def _things(seen: Evidence) -> list[Candidate]:
    """Return all that can be turned on or off, or left out, in a scene."""
    option = seen.spec.option
    found = [
        _flag("contacts", "disableflags", int(OFF.mjDSBL_CONTACT), option.disableflags, off=True),
        _flag("islands", "disableflags", int(OFF.mjDSBL_ISLAND), option.disableflags, off=True),
        _flag("energy", "enableflags", int(ON.mjENBL_ENERGY), option.enableflags, off=False),
    ]
    if seen.spec.sensors:
        found.append(_flag("sensors", "disableflags", int(OFF.mjDSBL_SENSOR), option.disableflags, off=True))
    for propose in ORNAMENTS:
        found += [replace(one, what=f"without {one.what}") for one in propose(seen)]
    sparse = mujoco.mj_isSparse(seen.model)
    kind = mujoco.mjtJacobian.mjJAC_DENSE if sparse else mujoco.mjtJacobian.mjJAC_SPARSE
    found.append(_set(f"{'dense' if sparse else 'sparse'} matrices", "jacobian", kind))
    for field, names, kinds, prefix in (
        ("integrator", INTEGRATORS, mujoco.mjtIntegrator, "mjINT_"),
        ("solver", SOLVERS, mujoco.mjtSolver, "mjSOL_"),
    ):
        for name in names:
            value = getattr(kinds, prefix + name)
            if int(getattr(option, field)) != int(value):
                found.append(_set(f"{field} {name}", field, value))
    loops = [one.name for one in seen.spec.equalities if one.active]
    if loops:
        what = f"without {counted(len(loops), 'loop')}: none of their rows"
        found.append(Candidate("rows", what, _no_loops))
    return found


def _flag(what: str, field: str, bit: int, flags: int, *, off: bool) -> Candidate:
    """Return the turning of a flag; `off` where it is one that disables."""
    there = bool(flags & bit) != off

    def turned(spec: mujoco.MjSpec) -> None:
        setattr(spec.option, field, getattr(spec.option, field) ^ bit)

    return Candidate("flags", f"{what} {'off' if there else 'on'}", turned)


def _set(what: str, field: str, value: object) -> Candidate:
    return Candidate("options", what, partial(_put, field=field, value=value))


def _put(spec: mujoco.MjSpec, field: str, value: object) -> None:
    setattr(spec.option, field, value)


def _no_loops(spec: mujoco.MjSpec) -> None:
    for equality in list(spec.equalities):
        spec.delete(equality)


def _rows(model: mujoco.MjModel, qpos: np.ndarray) -> int:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return int(data.nefc)
