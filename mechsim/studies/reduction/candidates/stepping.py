"""Time stepping of a scene: solver, matrices, integrator and step, with compensation for longer steps."""

from functools import partial

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.plain_settings import PlainSettings, option_value, settings_of
from mechsim.studies.reduction.candidates.bodies import (
    NotApplicable,
    RemovalCandidate,
    joints_of,
)
from mechsim.studies.reduction.reduced_scene import Evidence

# names of the categories: cheaper steps, and longer steps
CHEAPER_STEPS, LONGER_STEPS = "stepping", "steps"
EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICIT)
IMPLICITFAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
# time steps tried, relative to the scene's own
STEP_RATIOS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40, 50, 64, 80, 100)
# fraction of a step by which the forces of dampers and of actuators act early (+) or late (-)
FORCE_DELAYS = {
    EULER: (0.5, -0.5),
    IMPLICIT: (0.5, 0.5),
    IMPLICITFAST: (0.5, 0.5),
    RK4: (0.0, 0.0),
}
# cost of a step of RK4 relative to the other integrators
RK4_COST = 3.3
# largest stable stiffness of a constraint times step squared, and largest stable damping times step
MAX_STIFFNESS, MAX_DAMPING = 1.0, 1.0
# range of impedances that MuJoCo accepts
IMPEDANCES = (1e-4, 0.9999)


def cheaper_steps(observed: Evidence) -> list[RemovalCandidate]:
    """Propose settings that reduce the cost of a step without changing its result."""
    own = settings_of(observed.model)
    changes = {
        "the solver: Newton": (own.solver != "Newton", PlainSettings(solver="Newton")),
        "sparse matrices: dense": (mujoco.mj_isSparse(observed.model), PlainSettings(jacobian="dense")),
        "the energy flag": (own.energy, PlainSettings(energy=False)),
        "island detection": (own.island, PlainSettings(island=False)),
    }
    candidates = [
        RemovalCandidate(CHEAPER_STEPS, what, settings.put_into)
        for what, (applies, settings) in changes.items()
        if applies
    ]
    if observed.spec.option.iterations > 1:
        what, edit = "iterations of the solver after the first", PlainSettings(iterations=1).put_into
        candidates.append(RemovalCandidate(CHEAPER_STEPS, what, edit, only_if_faster=True))
    return candidates


def longer_steps(observed: Evidence) -> list[RemovalCandidate]:
    """Propose longer steps and other integrators; the least expensive is first."""
    own, step = int(observed.spec.option.integrator), float(observed.spec.option.timestep)
    candidates: list[tuple[float, RemovalCandidate]] = []
    for times in STEP_RATIOS:
        for integrator in (IMPLICITFAST, EULER, RK4):
            if times == 1 and integrator in (own, RK4):
                continue
            for compensated in (True, False):
                change = partial(set_stepping, times=times, integrator=integrator, compensated=compensated)
                cost = (RK4_COST if integrator == RK4 else 1.0) / times
                before, after = (option_value("integrator", value) for value in (own, integrator))
                what = f"steps of {step:g} s, {before}: {step * times:g} s, {after}"
                what += ", its damping compensated by armature" if compensated else ""
                candidates.append((cost, RemovalCandidate(LONGER_STEPS, what, change)))
    return [candidate for _, candidate in sorted(candidates, key=lambda pair: pair[0])]


def set_stepping(spec: mujoco.MjSpec, times: int, integrator: int, compensated: bool) -> None:
    """Multiply the step; loops and limits keep their compliance.

    Args:
        spec: changed in place.
        times: ratio of the new step to the old.
        integrator: integrator of the new steps.
        compensated: whether armature compensates for dampers that act a fraction of a step early or late.
    """
    before, after = float(spec.option.timestep), times * float(spec.option.timestep)
    if compensated:
        _compensate_damping(spec, int(spec.option.integrator), integrator, before, after)
    if times > 1:
        keep_stiffness(spec, before, after)
    spec.option.timestep, spec.option.integrator = after, integrator


def _compensate_damping(spec: mujoco.MjSpec, old: int, new: int, before: float, after: float) -> None:
    """Add armature that compensates for dampers that act a fraction of a step early or late.

    A damping force -c v with a delay s equals -c v + c s a: the inertia appears smaller by c s. Armature is
    limited below by zero.
    """
    delay = [
        old_shift * before - new_shift * after
        for old_shift, new_shift in zip(FORCE_DELAYS[old], FORCE_DELAYS[new], strict=True)
    ]
    changed = False
    for element in (*spec.joints, *spec.tendons):
        damping = float(np.atleast_1d(element.damping)[0])
        if damping:
            element.armature += damping * delay[0]
            changed = True
    for actuator in spec.actuators:
        strength = -float(actuator.biasprm[2]) if actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE else 0.0
        for joint, share in _targets(spec, actuator).items() if strength else ():
            joint.armature += strength * float(actuator.gear[0]) ** 2 * share * delay[1]
            changed = True
    if not changed:
        raise NotApplicable("there is no damper")
    for element in (*spec.joints, *spec.tendons):
        element.armature = max(0.0, element.armature)


def _targets(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> dict[mujoco.MjsJoint, float]:
    """Return the joints on which an actuator acts, and the share of a tendon's inertia of each.

    A tendon's own armature acts only between joints of one branch of the tree. Joints of several branches
    move together, as the fingers of a gripper do.
    """
    if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
        weights = joints_of(spec.tendon(actuator.target))
        total = sum(weights.values())
        return {spec.joint(name): weight * total for name, weight in weights.items()}
    if actuator.trntype in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        return {spec.joint(actuator.target): 1.0}
    return {}


def keep_stiffness(spec: mujoco.MjSpec, before: float, after: float) -> None:
    """Keep the compliance of loops and limits with another step.

    MuJoCo's constraints become more compliant with the step. A row with stiffness s and impedance d gives
    (1 - d) dmax^2 / (d^2 s) times the acceleration that it prevents (computation chapter of MuJoCo's
    documentation). More impedance compensates for the smaller stiffness that a longer step permits.
    """
    safe = not spec.option.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)
    for equality in spec.equalities:
        # loop-closure errors are smaller than the width over which impedance changes
        equality.solref, equality.solimp = _limited_reference(
            equality.solref, equality.solimp, equality.solimp[0], before, after, safe
        )
    for element in (*spec.joints, *spec.tendons):
        element.solref_limit, element.solimp_limit = _limited_reference(
            element.solref_limit, element.solimp_limit, element.solimp_limit[1], before, after, safe
        )


def _limited_reference(
    solref: Array, solimp: Array, impedance: float, before: float, after: float, safe: bool
) -> tuple[Array, Array]:
    """Return `solref` as negative stiffness and damping, which MuJoCo does not scale, and `solimp`.

    Args:
        solref: `solref` of the scene, (2,).
        solimp: `solimp` of the scene, (5,).
        impedance: typical impedance of the constraint.
        before: time step of the scene in [s].
        after: new time step in [s].
        safe: whether time constants of the scene are at least two steps.
    """
    if solref[0] <= 0.0:
        stiffness, damping = -float(solref[0]), -float(solref[1])
    else:
        constant = max(float(solref[0]), 2.0 * before) if safe else float(solref[0])
        stiffness, damping = 1.0 / (constant * float(solref[1])) ** 2, 2.0 / constant
    carried = min(stiffness, MAX_STIFFNESS / after**2)
    reference = np.array([-carried, -min(damping, MAX_DAMPING / after)])
    if carried == stiffness:
        return reference, solimp
    compliance = (1.0 - impedance) * float(solimp[1]) ** 2 / (impedance**2 * stiffness)
    hard = float(np.clip(1.0 - compliance * carried, *IMPEDANCES))
    return reference, np.array([hard, hard, *solimp[2:]])
