"""Loops replaced by joint equalities: each joint as a minimax polynomial of one leading joint.

Removed bodies are compensated at that joint: reflected inertia by armature, weight and springs by a joint
spring, dampers by joint damping.
"""

from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.plain_settings import LOWEST_COMPLIANCE_SOLIMP
from mechsim.simulation.state import SCALAR
from mechsim.studies.reduction.candidates.bodies import (
    NotApplicable,
    RemovalCandidate,
    body_of,
    count_text,
    existing,
    joints_of,
)
from mechsim.studies.reduction.candidates.rods import kept_bodies
from mechsim.studies.reduction.reduced_scene import Evidence

POLYNOMIALS = "loops as polynomials"
# highest degree that an MJCF joint equality accepts
DEGREE = 4
# time constant of the equalities that replace loops, in steps
TIME_CONSTANT_STEPS = 2.0
# number of samples for the fit of reflected inertia and springs
FIT_SAMPLES = 41
# number of iterations of Lawson's algorithm
LAWSON_ITERATIONS = 20


@dataclass(frozen=True)
class JointPolynomials:
    """Polynomials of all joints of a scene in one leading joint.

    Attributes:
        joint: the leading joint.
        others: joint -> polynomial of the leading coordinate, degree 0 to 4, both relative to `qpos0`.
        low: smallest coordinate of the leading joint in the motion.
        high: largest coordinate of the leading joint in the motion.
    """

    joint: str
    others: dict[str, Polynomial]
    low: float
    high: float


def loops_as_polynomials(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to replace all loops by polynomials of one joint, with all bodies or only necessary ones."""
    if not any(relations.type != mujoco.mjtEq.mjEQ_JOINT for relations in observed.spec.equalities):
        return []
    candidates: list[RemovalCandidate] = []
    for joint in _leaders(observed):
        relations = joint_polynomials_of(observed, joint)
        if relations is None:
            continue
        needed = _needed(observed, relations)
        for kept in dict.fromkeys((needed, frozenset(relations.others))):
            degrees = sorted(
                {polynomial.degree() for name, polynomial in relations.others.items() if name in kept}
            )
            text = f"{count_text(len(kept), 'joint')} by polynomials of {joint} of degrees {degrees}"
            what = f"{count_text(len(observed.spec.equalities), 'equality', 'equalities')}: {text}"
            candidates.append(
                RemovalCandidate(POLYNOMIALS, what, partial(_replaced, relations=relations, kept=kept))
            )
    return candidates


def _leaders(observed: Evidence) -> list[str]:
    """Return the possible leading joints: the prescribed one, or those of the only actuator."""
    spec, joints = observed.spec, list(observed.scene.joint_laws)
    for name in observed.scene.ctrl:
        actuator = spec.actuator(name)
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            joints += joints_of(spec.tendon(actuator.target))
        elif actuator.trntype in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            joints.append(actuator.target)
    if len(observed.scene.joint_laws) + len(observed.scene.ctrl) != 1:
        return []
    return joints


def joint_polynomials_of(observed: Evidence, joint: str) -> JointPolynomials | None:
    """Return all joints as polynomials of one; None if one is not a hinge or slide, or no polynomial fits."""
    spec, model = observed.spec, observed.model
    if any(other.type not in SCALAR for other in spec.joints):
        return None
    zero = {other.name: float(model.qpos0[model.joint(other.name).qposadr[0]]) for other in spec.joints}
    values = observed.values(joint) - zero[joint]
    low, high = float(values.min()), float(values.max())
    if not high - low > 0.0:
        return None
    others: dict[str, Polynomial] = {}
    for other in spec.joints:
        if other.name == joint:
            continue
        unit = observed.length if other.type == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
        fit = best_polynomial(
            values,
            observed.values(other.name) - zero[other.name],
            observed.tolerance / observed.length * unit,
        )
        if fit is None:
            return None
        others[other.name] = fit
    return JointPolynomials(joint, others, low + zero[joint], high + zero[joint])


def best_polynomial(x: Array, y: Array, tolerance: float) -> Polynomial | None:
    """Return the polynomial of lowest sufficient degree, 0 to 4, with a nearly minimal largest error.

    Args:
        x: samples, (n,).
        y: values, (n,).
        tolerance: the lowest degree with at most a tenth of this error is returned, otherwise the best.

    Returns:
        The polynomial; None if the best error exceeds a hundred tolerances.
    """
    fits: list[tuple[float, Polynomial]] = []
    for degree in range(DEGREE + 1):
        fits.append(_minimax_polynomial(x, y, degree, 0.1 * tolerance))
        if fits[-1][0] <= 0.1 * tolerance:
            break
    error, polynomial = min(fits, key=lambda fit: fit[0])
    return polynomial if error <= 100.0 * tolerance else None


def _minimax_polynomial(x: Array, y: Array, degree: int, sufficient: float) -> tuple[float, Polynomial]:
    """Return a polynomial and its largest error over samples: sufficient, or minimal to a few per cent.

    The fit uses Chebyshev polynomials with weights that grow where the error is largest (Lawson).
    """
    fits: list[tuple[float, Polynomial]] = []
    weights = np.full(len(x), 1.0 / len(x))
    for _ in range(LAWSON_ITERATIONS):
        fit = Chebyshev.fit(x, y, degree, domain=[float(x.min()), float(x.max())], w=np.sqrt(weights))
        errors = np.abs(fit(x) - y)
        fits.append((float(errors.max()), fit.convert(kind=Polynomial)))
        if fits[-1][0] <= sufficient:
            break
        weights *= errors + 1e-3 * fits[-1][0]
        weights /= weights.sum()
    return min(fits, key=lambda fit: fit[0])


def _needed(observed: Evidence, relations: JointPolynomials) -> frozenset[str]:
    """Return the joints between the world and the tracked or actuated bodies."""
    above: set[str] = set()
    for name in kept_bodies(observed):
        body = observed.spec.body(name)
        while body is not None and body.name != "world":
            above |= {joint.name for joint in body.joints}
            body = body.parent
    return frozenset(above & set(relations.others))


def _replaced(spec: mujoco.MjSpec, relations: JointPolynomials, kept: frozenset[str]) -> None:
    """Replace all loops by joint equalities; remove the other joints with their subtrees."""
    existing(spec, "joint", relations.joint, *relations.others)
    whole = plainly_compiled(spec)
    before = [
        reflected(whole, relations, value)
        for value in np.linspace(relations.low, relations.high, FIT_SAMPLES)
    ]
    for equality in list(spec.equalities):
        spec.delete(equality)
    removed = [name for name in relations.others if name not in kept]
    for name in removed:
        joint = spec.joint(name)
        if joint is not None:
            if any(name in joints_of(tendon) for tendon in spec.tendons):
                raise NotApplicable(f"a tendon acts on {name}")
            spec.delete(spec.body(body_of(joint)))
    for name in sorted(kept):
        constraint = spec.add_equality(
            name=f"{name}_of_{relations.joint}",
            type=mujoco.mjtEq.mjEQ_JOINT,
            name1=name,
            name2=relations.joint,
            active=True,
        )
        data = np.zeros(len(constraint.data))
        coefficients = relations.others[name].coef
        data[: len(coefficients)] = coefficients
        constraint.data = data
        constraint.solref, constraint.solimp = (
            np.array([TIME_CONSTANT_STEPS * spec.option.timestep, 1.0]),
            np.array(LOWEST_COMPLIANCE_SOLIMP),
        )
    if removed:
        _compensate_losses(spec, relations, before)


def _compensate_losses(spec: mujoco.MjSpec, relations: JointPolynomials, before: list[Array]) -> None:
    """Add the removed inertia and damping to the leading joint, and a spring for weights and springs."""
    reduced_model = plainly_compiled(spec)
    values = np.linspace(relations.low, relations.high, FIT_SAMPLES)
    lost = np.array(before) - [reflected(reduced_model, relations, value) for value in values]
    joint = spec.joint(relations.joint)
    joint.armature = max(0.0, float(joint.armature) + float(lost[:, 0].mean()))
    damping = np.array(joint.damping, dtype=np.float64)
    damping[0] = max(0.0, damping[0] + float(lost[:, 1].mean()))
    joint.damping = damping
    if np.any(joint.stiffness):
        raise NotApplicable(f"joint {relations.joint} has a spring of its own")
    # a spring's force is -k (q - springref)
    rate, offset = np.polyfit(values, lost[:, 2], 1)
    if abs(rate) > 1e-12 * max(1.0, abs(offset)):
        stiffness = np.array(joint.stiffness, dtype=np.float64)
        stiffness[0] = -float(rate)
        joint.stiffness, joint.springref = stiffness, float(-offset / rate)


def reflected(model: mujoco.MjModel, relations: JointPolynomials, value: float) -> Array:
    """Return inertia, damping and force (weights, springs) reflected to the leading joint, (3,)."""
    data, rates = mujoco.MjData(model), np.zeros(model.nv)
    lead = model.joint(relations.joint)
    x = value - float(model.qpos0[lead.qposadr[0]])
    data.qpos[lead.qposadr[0]], rates[lead.dofadr[0]] = value, 1.0
    for name, polynomial in relations.others.items():
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) < 0:
            continue
        joint = model.joint(name)
        data.qpos[joint.qposadr[0]] = float(model.qpos0[joint.qposadr[0]]) + float(polynomial(x))
        rates[joint.dofadr[0]] = float(polynomial.deriv()(x))
    mujoco.mj_forward(model, data)
    moved = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, moved, rates)
    damped = float(rates @ (model.dof_damping * rates))
    return np.array([float(rates @ moved), damped, float(rates @ (data.qfrc_spring - data.qfrc_bias))])
