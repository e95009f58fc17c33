"""Equality constraints of a model as joints and couplings: connect, weld, joint and fixed-tendon equality."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joints import Coupling, End, Joint
from mechsim.numerics.arrays import Array
from mechsim.simulation.equality_rows import RodPair, coincident_frames, rod_of, tendon_joints
from mechsim.simulation.mjcf_reader.kinematic_tree import FRAMES, POINTS, Carrier
from mechsim.simulation.state import is_disabled

CONNECT = int(mujoco.mjtEq.mjEQ_CONNECT)
WELD = int(mujoco.mjtEq.mjEQ_WELD)
JOINT = int(mujoco.mjtEq.mjEQ_JOINT)
TENDON = int(mujoco.mjtEq.mjEQ_TENDON)


def equalities(
    model: mujoco.MjModel, carriers: Sequence[Carrier], *, skip_others: bool = False
) -> tuple[tuple[Joint, ...], tuple[Coupling, ...], tuple[str, ...]]:
    """Return the active equality constraints of a model as joints and couplings, and remarks on the others.

    Args:
        model: the compiled model.
        carriers: carriers of its bodies.
        skip_others: whether constraints of other kinds become remarks.

    Raises:
        InputError: if a constraint has another kind, or its tendon runs through sites, and is not skipped.
    """
    joints: list[Joint] = []
    couplings: list[Coupling] = []
    remarks: list[str] = []
    off = is_disabled(model, mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    names = {model.joint(j).name for j in range(model.njnt)}
    for i in range(model.neq):
        name, kind, rod = model.equality(i).name, int(model.eq_type[i]), rod_of(model, i)
        if off or not model.eq_active0[i]:
            remarks.append(f"equality {name!r} is not active and was left out")
        elif rod or kind in (CONNECT, WELD):
            own = f"{name}_loop" if name in names else name
            joint = _rod_joint(rod, carriers, own) if rod else _closing_joint(model, i, carriers, own)
            if joint is None:
                remarks.append(f"equality {name!r} joins bodies that do not move against each other")
            else:
                joints.append(joint)
        elif skip_others and not is_readable(model, i):
            remarks.append(f"equality {name!r} is neither a joint nor a coupling and was left out")
        elif kind in (JOINT, TENDON):
            couplings.append(_coupling(model, i, name))
        else:
            what = str(mujoco.mjtEq(kind).name).removeprefix("mjEQ_").lower()
            raise InputError(
                f"equality {name!r} is of kind {what}, which joins no links; "
                "connect, weld, joint and tendon are read: leave it out or make it inactive"
            )
    return tuple(joints), tuple(couplings), tuple(remarks)


def is_readable(model: mujoco.MjModel, i: int) -> bool:
    """Whether an equality is a joint or a coupling: connect, weld, joint or fixed-tendon equality, or rod."""
    if rod_of(model, i) or int(model.eq_type[i]) in (CONNECT, WELD, JOINT):
        return True
    if int(model.eq_type[i]) != TENDON:
        return False
    tendons = [int(t) for t in (model.eq_obj1id[i], model.eq_obj2id[i]) if t >= 0]
    wraps = [int(model.tendon_adr[t]) + k for t in tendons for k in range(int(model.tendon_num[t]))]
    return bool((model.wrap_type[wraps] == mujoco.mjtWrap.mjWRAP_JOINT).all())


def _closing_joint(model: mujoco.MjModel, i: int, carried: Sequence[Carrier], name: str) -> Joint | None:
    """Return the joint of a connect or weld; None if both its bodies belong to one link."""
    bodies, points, rotations = coincident_frames(model, i)
    carriers = [carried[body] for body in bodies]
    if carriers[0].link == carriers[1].link:
        return None
    # a weld with torquescale 0 constrains the point only
    kind = FRAMES if int(model.eq_type[i]) == WELD and model.eq_data[i, 10] != 0.0 else POINTS
    a, b = (
        End(carrier.link, carrier.point(point), *(carrier.direction(axes[:, column]) for column in (2, 0)))
        for carrier, point, axes in zip(carriers, points, rotations, strict=True)
    )
    return Joint(name, kind, a, b)


def _rod_joint(rod: RodPair, carried: Sequence[Carrier], name: str) -> Joint | None:
    """Return the distance joint of a tendon between two sites; None if both belong to one link."""
    a, b = (End(carried[body].link, carried[body].point(local)) for body, local in rod.ends)
    return None if a.link == b.link else Joint(name, "distance", a, b, length=rod.length)


def _coupling(model: mujoco.MjModel, i: int, name: str) -> Coupling:
    """Return a joint or tendon equality, both sides relative to the reference configuration."""

    def side(number: int) -> tuple[dict[str, float], float]:
        """Return the weights of coordinates, and their sum in the reference configuration."""
        if number < 0:
            return {}, 0.0
        if int(model.eq_type[i]) == TENDON:
            return tendon_weights(model, number), float(model.tendon_length0[number])
        return {model.joint(number).name: 1.0}, float(model.qpos0[model.jnt_qposadr[number]])

    (dependent, first), (independent, second) = side(model.eq_obj1id[i]), side(model.eq_obj2id[i])
    return Coupling(name, dependent, independent, coefficients(model.eq_data[i, :5]), (first, second))


def coefficients(polynomial: Array) -> tuple[float, ...]:
    """Return the coefficients of a polynomial without trailing zeros."""
    last = int(np.flatnonzero(polynomial).max(initial=0))
    return tuple(polynomial[: last + 1].tolist())


def tendon_weights(model: mujoco.MjModel, t: int) -> dict[str, float]:
    """Return the joints of a fixed tendon and their weights in its length.

    Raises:
        InputError: if the tendon runs through sites.
    """
    weights: dict[str, float] = {}
    for j, weight in zip(*tendon_joints(model, t), strict=True):
        name = model.joint(int(j)).name
        weights[name] = weights.get(name, 0.0) + float(weight)
    return weights
