"""The equality constraints that close a model's loops, read from the compiled model."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from mechsim.errors import InputError
from mechsim.maths.arrays import Array


@dataclass(frozen=True, slots=True)
class PointPair:
    """A `connect` constraint: two points, each fixed in a body, that should coincide."""

    bodies: tuple[int, int]
    local: tuple[Array, Array]

    @property
    def ends(self) -> tuple[tuple[int, Array], tuple[int, Array]]:
        """Body and point, twice."""
        return (self.bodies[0], self.local[0]), (self.bodies[1], self.local[1])


@dataclass(frozen=True, slots=True)
class Coupled:
    """A `joint` constraint: one coordinate is a polynomial of another, both counted from qpos0."""

    dofs: tuple[int, int]
    places: tuple[int, int]
    zeros: tuple[float, float]
    polynomial: Array


def constraints(model: mujoco.MjModel) -> tuple[Sequence[PointPair], Sequence[Coupled]]:
    """Return the points that should coincide, and the coordinates that depend on others."""
    pairs: list[PointPair] = []
    couplings: list[Coupled] = []
    for i in range(model.neq):
        if not model.eq_active0[i]:
            continue
        first, second = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        if model.eq_type[i] == int(mujoco.mjtEq.mjEQ_CONNECT):
            pairs.append(_point_pair(model, i, first, second))
        elif model.eq_type[i] == int(mujoco.mjtEq.mjEQ_JOINT):
            couplings.append(_coupling(model, i, first, second))
        else:
            raise InputError(
                f"equality {model.equality(i).name or i!r} is of a kind that closes no loop here; "
                "close loops by connect constraints, gears by joint constraints"
            )
    return pairs, couplings


def _point_pair(model: mujoco.MjModel, i: int, first: int, second: int) -> PointPair:
    if model.eq_objtype[i] == int(mujoco.mjtObj.mjOBJ_SITE):
        bodies = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        return PointPair(bodies, (model.site_pos[first].copy(), model.site_pos[second].copy()))
    data = model.eq_data[i]
    return PointPair((first, max(second, 0)), (data[0:3].copy(), data[3:6].copy()))


def _coupling(model: mujoco.MjModel, i: int, first: int, second: int) -> Coupled:
    place, dof = int(model.jnt_qposadr[first]), int(model.jnt_dofadr[first])
    polynomial = model.eq_data[i, :5].copy()
    if second < 0:
        return Coupled((dof, -1), (place, -1), (float(model.qpos0[place]), 0.0), polynomial)
    other = int(model.jnt_qposadr[second])
    zeros = float(model.qpos0[place]), float(model.qpos0[other])
    return Coupled((dof, int(model.jnt_dofadr[second])), (place, other), zeros, polynomial)
