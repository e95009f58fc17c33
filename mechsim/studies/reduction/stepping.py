"""How a scene is stepped: solver, matrices, integrator and step, what a longer step adds made good."""

from functools import partial

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.studies.reduction.candidate import Candidate, NotThere
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.still_joints import joints_of

# what makes a step cheaper; longer steps
FAMILY, LONGER_STEPS = "stepping", "steps"
EULER, RK4, IMPLICIT, IMPLICITFAST = (
    mujoco.mjtIntegrator.mjINT_EULER,
    mujoco.mjtIntegrator.mjINT_RK4,
    mujoco.mjtIntegrator.mjINT_IMPLICIT,
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
)
CALLED = {int(EULER): "Euler", int(RK4): "RK4", int(IMPLICIT): "implicit", int(IMPLICITFAST): "implicitfast"}
# times as long as the scene's own step
LONGER = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40, 50, 64, 80, 100)
# by what part of a step forces that go with rates come early (+) or late (-): of dampers, of actuators
SHIFT = {
    int(EULER): (0.5, -0.5),
    int(IMPLICIT): (0.5, 0.5),
    int(IMPLICITFAST): (0.5, 0.5),
    int(RK4): (0.0, 0.0),
}
# what a step of RK4 costs in steps of the others
FOUR = 3.3
# stiffest spring of a row that a step carries, and strongest damper, by the step
STIFF, DAMPED = 1.0, 1.0
# that MuJoCo takes
IMPEDANCES = (1e-4, 0.9999)


def cheaper(seen: Evidence) -> list[Candidate]:
    """Propose settings by which a step costs less and its result stays what it is."""
    found: list[Candidate] = []
    option = seen.spec.option
    if option.solver != mujoco.mjtSolver.mjSOL_NEWTON:
        found.append(Candidate(FAMILY, "the solver: Newton", _newton))
    if mujoco.mj_isSparse(seen.model):
        found.append(Candidate(FAMILY, "sparse matrices: dense", _dense))
    if option.enableflags & int(mujoco.mjtEnableBit.mjENBL_ENERGY):
        found.append(Candidate(FAMILY, "the energy flag", _no_energy))
    if not option.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ISLAND):
        found.append(Candidate(FAMILY, "looking for islands", _no_islands))
    if option.iterations > 1:
        found.append(Candidate(FAMILY, "iterations of the solver after the first", _once, pays=True))
    return found


def coarser(seen: Evidence) -> list[Candidate]:
    """Propose longer steps and cheaper integrators, the cheapest first."""
    own = int(seen.spec.option.integrator)
    found: list[tuple[float, Candidate]] = []
    for times in LONGER:
        for integrator in (int(IMPLICITFAST), int(EULER), int(RK4)):
            if times == 1 and integrator in (own, int(RK4)):
                continue
            for made_good in (True, False):
                change = partial(set_stepping, times=times, integrator=integrator, made_good=made_good)
                cost = (FOUR if integrator == int(RK4) else 1.0) / times
                what = _what(seen, times, integrator, made_good)
                found.append((cost, Candidate(LONGER_STEPS, what, change)))
    return [one for _, one in sorted(found, key=lambda pair: pair[0])]


def stepped_so(spec: mujoco.MjSpec, times: int, integrator: int) -> None:
    """Make steps so many times as long, damping made good where there is any."""
    try:
        set_stepping(spec, times, integrator, made_good=True)
    except NotThere:
        set_stepping(spec, times, integrator, made_good=False)


def _what(seen: Evidence, times: int, integrator: int, made_good: bool) -> str:
    step = float(seen.spec.option.timestep)
    said = f"steps of {step:g} s, {CALLED[int(seen.spec.option.integrator)]}: {step * times:g} s, "
    return said + CALLED[integrator] + (", its damping made good by armature" if made_good else "")


def _newton(spec: mujoco.MjSpec) -> None:
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON


def _dense(spec: mujoco.MjSpec) -> None:
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _no_energy(spec: mujoco.MjSpec) -> None:
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_ENERGY)


def _once(spec: mujoco.MjSpec) -> None:
    spec.option.iterations = 1


def _no_islands(spec: mujoco.MjSpec) -> None:
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)


def set_stepping(spec: mujoco.MjSpec, times: int, integrator: int, made_good: bool) -> None:
    """Make steps so many times as long, loops and limits as soft as they were.

    Args:
        spec: changed in place.
        times: as long.
        integrator: of them.
        made_good: whether armature makes up for dampers that act a part of a step early or late.
    """
    before, after = float(spec.option.timestep), times * float(spec.option.timestep)
    if made_good:
        _make_good(spec, int(spec.option.integrator), integrator, before, after)
    if times > 1:
        keep_stiffness(spec, before, after)
    spec.option.timestep, spec.option.integrator = after, integrator


def _make_good(spec: mujoco.MjSpec, old: int, new: int, before: float, after: float) -> None:
    """Add the armature by which a damper that acts early or late by a part of a step is as it was.

    A force -c v taken a time s late is -c v + c s a, as if the inertia were less by c s; where
    there is not so much armature, what there is.
    """
    late = [one * before - other * after for one, other in zip(SHIFT[old], SHIFT[new], strict=True)]
    changed = False
    for part in (*spec.joints, *spec.tendons):
        damping = float(np.atleast_1d(part.damping)[0])
        if damping:
            part.armature += damping * late[0]
            changed = True
    for actuator in spec.actuators:
        strength = -float(actuator.biasprm[2]) if actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE else 0.0
        for joint, share in _targets(spec, actuator).items() if strength else ():
            joint.armature += strength * float(actuator.gear[0]) ** 2 * share * late[1]
            changed = True
    if not changed:
        raise NotThere("there is no damper")
    for part in (*spec.joints, *spec.tendons):
        part.armature = max(0.0, part.armature)


def _targets(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> dict[mujoco.MjsJoint, float]:
    """Return the joints that an actuator acts on, and how much of a tendon's inertia each then has.

    A tendon's own armature acts only between joints of one branch of the tree; joints of several that it
    drives move alike, as the fingers of a gripper.
    """
    if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
        weights = joints_of(spec.tendon(actuator.target))
        whole = sum(weights.values())
        return {spec.joint(name): weight * whole for name, weight in weights.items()}
    if actuator.trntype in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        return {spec.joint(actuator.target): 1.0}
    return {}


def keep_stiffness(spec: mujoco.MjSpec, before: float, after: float) -> None:
    """Let loops and limits give as much as before under the same load, with steps of another length.

    Left alone MuJoCo softens rows with the step. A row with stiffness s and impedance d gives
    (1 - d) dmax^2 / (d^2 s) times the acceleration it holds back (computation chapter of MuJoCo's
    documentation): where a step carries less stiffness, more impedance makes up for it.
    """
    safe = not spec.option.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)
    for equality in spec.equalities:
        # loops stand open by less than the width over which impedance changes
        equality.solref, equality.solimp = _carried(
            equality.solref, equality.solimp, equality.solimp[0], before, after, safe
        )
    for part in (*spec.joints, *spec.tendons):
        part.solref_limit, part.solimp_limit = _carried(
            part.solref_limit, part.solimp_limit, part.solimp_limit[1], before, after, safe
        )


def _carried(
    solref: Array, solimp: Array, impedance: float, before: float, after: float, safe: bool
) -> tuple[Array, Array]:
    """Return the reference of rows as minus stiffness and damping, which MuJoCo leaves alone, and impedance.

    Args:
        solref: as the scene has it, (2,).
        solimp: likewise, (5,).
        impedance: at which its rows mostly are.
        before: the step of the scene in [s].
        after: the step to be, in [s].
        safe: whether the scene's references are kept from being shorter than two steps.
    """
    if solref[0] <= 0.0:
        stiffness, damping = -float(solref[0]), -float(solref[1])
    else:
        constant = max(float(solref[0]), 2.0 * before) if safe else float(solref[0])
        stiffness, damping = 1.0 / (constant * float(solref[1])) ** 2, 2.0 / constant
    carried = min(stiffness, STIFF / after**2)
    reference = np.array([-carried, -min(damping, DAMPED / after)])
    if carried == stiffness:
        return reference, solimp
    gives = (1.0 - impedance) * float(solimp[1]) ** 2 / (impedance**2 * stiffness)
    hard = float(np.clip(1.0 - gives * carried, *IMPEDANCES))
    return reference, np.array([hard, hard, *solimp[2:]])
