"""Loops replaced by what they do: each joint as a polynomial of one, fitted to the motion as Chebyshev would.

What is left out of the tree is made up for on that one joint: its reflected inertia by armature, its weight
and springs by the joint's own spring, its dampers by the joint's damping.
"""

from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.reduction.apart import body_of
from mechsim.studies.reduction.candidate import Candidate, NotThere, counted
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.rods import kept_bodies
from mechsim.studies.reduction.still_joints import joints_of

FAMILY = "loops as polynomials"
# highest degree that a joint equality of MJCF takes
DEGREE = 4
SINGLE = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
# hardest impedance, and time constant in steps, of the equalities that replace loops
HARDEST, CONSTANT = (0.9999, 0.9999, 0.001, 0.5, 2.0), 2.0
# samples by which reflected inertia and springs are fitted
SAMPLES = 41


@dataclass(frozen=True)
class OneFreedom:
    """A scene whose joints all go with one.

    Attributes:
        joint: with which the others go.
        others: joint -> its polynomial of that one's coordinate, degree 0 to 4, both counted from `qpos0`.
        low: least coordinate of the joint in the motion.
        high: largest.
    """

    joint: str
    others: dict[str, Polynomial]
    low: float
    high: float


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to replace all loops by polynomials of one joint, with the bodies needed alone or with all."""
    if not any(one.type != mujoco.mjtEq.mjEQ_JOINT for one in seen.spec.equalities):
        return []
    found: list[Candidate] = []
    for joint in _leaders(seen):
        one = one_freedom(seen, joint)
        if one is None:
            continue
        needed = _needed(seen, one)
        for kept in dict.fromkeys((needed, frozenset(one.others))):
            degrees = sorted({polynomial.degree() for name, polynomial in one.others.items() if name in kept})
            told = f"{counted(len(kept), 'joint')} by polynomials of {joint} of degrees {degrees}"
            what = f"{counted(len(seen.spec.equalities), 'loop or tie', 'loops and ties')}: {told}"
            found.append(Candidate(FAMILY, what, partial(_replaced, one=one, kept=kept)))
    return found


def _leaders(seen: Evidence) -> list[str]:
    """Return the joints that may lead: the one prescribed, or those that one actuator acts on."""
    spec, names = seen.spec, list(seen.scene.drive)
    for name in seen.scene.ctrl:
        actuator = spec.actuator(name)
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            names += joints_of(spec.tendon(actuator.target))
        elif actuator.trntype in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            names.append(actuator.target)
    if len(seen.scene.drive) + len(seen.scene.ctrl) != 1:
        return []
    return names


def one_freedom(seen: Evidence, joint: str) -> OneFreedom | None:
    """Return how all joints go with one; None where one is no hinge or slide, or no polynomial is near it."""
    spec, model = seen.spec, seen.model
    if any(one.type not in SINGLE for one in spec.joints):
        return None
    zero = {one.name: float(model.qpos0[model.joint(one.name).qposadr[0]]) for one in spec.joints}
    values = seen.values(joint) - zero[joint]
    low, high = float(values.min()), float(values.max())
    if not high - low > 0.0:
        return None
    others: dict[str, Polynomial] = {}
    for one in spec.joints:
        if one.name == joint:
            continue
        unit = seen.size if one.type == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
        fit = best_polynomial(values, seen.values(one.name) - zero[one.name], seen.bound / seen.size * unit)
        if fit is None:
            return None
        others[one.name] = fit
    return OneFreedom(joint, others, low + zero[joint], high + zero[joint])


def best_polynomial(x: Array, y: Array, bound: float) -> Polynomial | None:
    """Return the polynomial of least degree, 0 to 4, whose worst error over samples is near the least.

    It is fitted in Chebyshev polynomials with weights that grow where the error is largest (Lawson), until
    the worst error is that of the minimax polynomial to a few per cent.

    Args:
        x: samples, (n,).
        y: values, (n,).
        bound: error that is small enough; of no degree 4 and no such error the best is returned.

    Returns:
        None where the best errs by more than a hundred times the bound.
    """
    domain = [float(x.min()), float(x.max())]
    best: tuple[float, Polynomial] | None = None
    for degree in range(DEGREE + 1):
        weights = np.full(len(x), 1.0 / len(x))
        for _ in range(20):
            fit = Chebyshev.fit(x, y, degree, domain=domain, w=np.sqrt(weights))
            error = np.abs(fit(x) - y)
            worst = float(error.max())
            if best is None or worst < best[0]:
                best = worst, fit.convert(kind=Polynomial)
            if not worst > 0.1 * bound:
                break
            weights *= error + 1e-3 * worst
            weights /= weights.sum()
        assert best is not None
        if best[0] <= 0.1 * bound:
            break
    assert best is not None
    return best[1] if best[0] <= 100.0 * bound else None


def _needed(seen: Evidence, one: OneFreedom) -> frozenset[str]:
    """Return the joints above what is tracked or acted on."""
    found: set[str] = set()
    for name in kept_bodies(seen):
        body = seen.spec.body(name)
        while body is not None and body.name != "world":
            found |= {joint.name for joint in body.joints}
            body = body.parent
    return frozenset(found & set(one.others))


def _replaced(spec: mujoco.MjSpec, one: OneFreedom, kept: frozenset[str]) -> None:
    """Replace all loops by joint equalities; leave out the joints not kept with what hangs on them."""
    if spec.joint(one.joint) is None or any(spec.joint(name) is None for name in one.others):
        raise NotThere("a joint is left out already")
    whole = plainly_compiled(spec)
    before = [reflected(whole, one, value) for value in np.linspace(one.low, one.high, SAMPLES)]
    for equality in list(spec.equalities):
        spec.delete(equality)
    gone = [name for name in one.others if name not in kept]
    for name in gone:
        joint = spec.joint(name)
        if joint is not None:
            if any(name in joints_of(tendon) for tendon in spec.tendons):
                raise NotThere(f"a tendon runs over {name}")
            spec.delete(spec.body(body_of(joint)))
    for name in sorted(kept):
        made = spec.add_equality(
            name=f"{name}_of_{one.joint}",
            type=mujoco.mjtEq.mjEQ_JOINT,
            name1=name,
            name2=one.joint,
            active=True,
        )
        data = np.zeros(len(made.data))
        coefficients = one.others[name].coef
        data[: len(coefficients)] = coefficients
        made.data = data
        made.solref, made.solimp = np.array([CONSTANT * spec.option.timestep, 1.0]), np.array(HARDEST)
    if gone:
        _made_up(spec, one, before)


def _made_up(spec: mujoco.MjSpec, one: OneFreedom, before: list[Array]) -> None:
    """Give the leading joint what the scene lost: inertia, damping, and a spring for weights and springs."""
    lean = plainly_compiled(spec)
    values = np.linspace(one.low, one.high, SAMPLES)
    lost = np.array(before) - [reflected(lean, one, value) for value in values]
    joint = spec.joint(one.joint)
    joint.armature = max(0.0, float(joint.armature) + float(lost[:, 0].mean()))
    damping = np.array(joint.damping, dtype=np.float64)
    damping[0] = max(0.0, damping[0] + float(lost[:, 1].mean()))
    joint.damping = damping
    if np.any(joint.stiffness):
        raise NotThere(f"joint {one.joint} has a spring of its own")
    # a spring's force is -k (q - springref)
    slope, at_nought = np.polyfit(values, lost[:, 2], 1)
    if abs(slope) > 1e-12 * max(1.0, abs(at_nought)):
        stiffness = np.array(joint.stiffness, dtype=np.float64)
        stiffness[0] = -float(slope)
        joint.stiffness, joint.springref = stiffness, float(-at_nought / slope)


def reflected(model: mujoco.MjModel, one: OneFreedom, value: float) -> Array:
    """Return inertia, damping and force (weights, springs) of a scene on its leading joint, (3,)."""
    data, rates = mujoco.MjData(model), np.zeros(model.nv)
    lead = model.joint(one.joint)
    x = value - float(model.qpos0[lead.qposadr[0]])
    data.qpos[lead.qposadr[0]], rates[lead.dofadr[0]] = value, 1.0
    for name, polynomial in one.others.items():
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
