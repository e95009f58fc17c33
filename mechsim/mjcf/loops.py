"""The loops of a compiled model: how far they stand open, for many states at once, and closing them.

MuJoCo gives the kinematics and the Jacobians; the equations solved are the model's own equality
constraints. No closed form is near.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError

Array = NDArray[np.float64]

FREE, BALL, SLIDE, HINGE = (
    int(kind)
    for kind in (
        mujoco.mjtJoint.mjJNT_FREE,
        mujoco.mjtJoint.mjJNT_BALL,
        mujoco.mjtJoint.mjJNT_SLIDE,
        mujoco.mjtJoint.mjJNT_HINGE,
    )
)

# closed to rounding: what Newton's method leaves on a well-conditioned loop, with a margin of a few
CLOSED = 1e-14


@dataclass(frozen=True, slots=True)
class PointPair:
    """A `connect` constraint: two points, each fixed in a body, that should coincide."""

    bodies: tuple[int, int]
    local: tuple[Array, Array]


@dataclass(frozen=True, slots=True)
class Coupling:
    """A `joint` constraint: one coordinate is a polynomial of another, both counted from qpos0."""

    dofs: tuple[int, int]
    places: tuple[int, int]
    zeros: tuple[float, float]
    polynomial: Array


class Loops:
    """The equality constraints of a model with a crank, evaluated and solved in batches.

    Attributes:
        model: the compiled model.
        crank: index of the crank among the degrees of freedom.
        size: yardstick of lengths in the model, in [m].
    """

    def __init__(self, model: mujoco.MjModel):
        self.model = model
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, "crank")
        if joint < 0 or model.jnt_type[joint] != HINGE:
            names = [model.joint(i).name for i in range(model.njnt)]
            raise InputError(
                f"the model has no hinge joint called 'crank' (it has {', '.join(names) or 'none'}); "
                "name the driven hinge 'crank'"
            )
        self.crank = int(model.jnt_dofadr[joint])
        self.crank_place = int(model.jnt_qposadr[joint])
        self.pairs, self.couplings = _constraints(model)
        self.name = model.names.split(b"\0", 1)[0].decode() or "model"
        self.free = np.array([i for i in range(model.nv) if i != self.crank])
        reach = [np.linalg.norm(local) for pair in self.pairs for local in pair.local]
        steps = np.linalg.norm(model.body_pos[1:], axis=1)
        self.size = float(max([*reach, *steps, 1e-300]))
        self.quaternions = [
            int(place) + (3 if kind == FREE else 0)
            for kind, place in zip(model.jnt_type, model.jnt_qposadr, strict=True)
            if kind in (BALL, FREE)
        ]
        self._batches: dict[int, batch.Batch] = {}
        self._basis: Array | None = None

    def batch(self, n: int) -> batch.Batch:
        """Return a batch of n simulations of the model, made once for each n."""
        if n not in self._batches:
            if len(self._batches) > 8:
                self._batches.clear()
            self._batches[n] = batch.Batch(self.model, n)
        return self._batches[n]

    def linearise(self, qpos: Array) -> tuple[Array, Array]:
        """Return the constraint residuals, (n, m) in [m] or [rad], and their Jacobian, (n, m, nv)."""
        sims = self.batch(len(qpos))
        position, matrix = sims.bind("xpos"), sims.bind("xmat")
        sims.bind("qpos")[:] = qpos
        sims.forward(stage=int(mujoco.mjtStage.mjSTAGE_POS))
        residuals, jacobians = [], []
        for pair in self.pairs:
            ends, slopes = [], []
            for body, local in zip(pair.bodies, pair.local, strict=True):
                frame = matrix[:, body].reshape(-1, 3, 3)
                point = position[:, body] + frame @ local
                ends.append(point)
                slopes.append(sims.jac(body, point)[0] if body else 0.0)
            residuals.append(ends[0] - ends[1])
            jacobians.append(slopes[0] - slopes[1])
        for coupling in self.couplings:
            value, slope = self._coupled(coupling, qpos)
            residuals.append(value[:, None])
            jacobians.append(slope[:, None])
        if not residuals:
            return np.zeros((len(qpos), 0)), np.zeros((len(qpos), 0, self.model.nv))
        return np.concatenate(residuals, 1), np.concatenate(jacobians, 1)

    def sites(self, qpos: Array) -> Array:
        """Return the places of all sites at n states, (n, nsite, 3) in [m]."""
        sims = self.batch(len(qpos))
        places = sims.bind("site_xpos")
        sims.bind("qpos")[:] = qpos
        sims.forward(stage=int(mujoco.mjtStage.mjSTAGE_POS))
        return places.copy()

    def _coupled(self, coupling: Coupling, qpos: Array) -> tuple[Array, Array]:
        (y, x), (y0, x0) = coupling.places, coupling.zeros
        slope = np.zeros((len(qpos), self.model.nv))
        slope[:, coupling.dofs[0]] = 1.0
        if x < 0:
            return qpos[:, y] - y0 - coupling.polynomial[0], slope
        turned = qpos[:, x] - x0
        polynomial = np.polynomial.Polynomial(coupling.polynomial)
        slope[:, coupling.dofs[1]] = -polynomial.deriv()(turned)
        return qpos[:, y] - y0 - polynomial(turned), slope

    def gap(self, residual: Array) -> Array:
        """Return the worst opening of each state in units of the model's size and in [rad], (n,)."""
        scale = np.ones(residual.shape[1])
        scale[: 3 * len(self.pairs)] /= self.size
        return np.abs(residual * scale).max(1, initial=0.0)

    def solve(self, jacobian: Array, right: Array) -> Array:
        """Return the least-norm x, (n, nv - 1), of J x = right over all freedoms but the crank's.

        Redundant rows (a planar loop's third) are left out by a basis of the row space found once.
        """
        held = jacobian[:, :, self.free]
        if self._basis is None or self._basis.shape[0] != held.shape[1]:
            left, values, _ = np.linalg.svd(held[0])
            rank = int((values > 1e-9 * values.max(initial=0.0)).sum())
            self._basis = left[:, :rank]
        rows = self._basis.T @ held
        right = right @ self._basis
        if rows.shape[1] == rows.shape[2]:
            return np.linalg.solve(rows, right[..., None])[..., 0]
        square = rows @ np.swapaxes(rows, -1, -2)
        return (np.swapaxes(rows, -1, -2) @ np.linalg.solve(square, right[..., None]))[..., 0]

    def tangent(self, jacobian: Array) -> Array:
        """Return the rates of all freedoms per radian of the crank, (n, nv), that keep the loops closed."""
        rates = np.zeros((len(jacobian), self.model.nv))
        rates[:, self.crank] = 1.0
        rates[:, self.free] = self.solve(jacobian, -jacobian[:, :, self.crank])
        return rates

    def close(self, qpos: Array, *, most_steps: int = 50) -> tuple[Array, Array, Array]:
        """Close the loops of n states with their cranks held, by Newton's method.

        Args:
            qpos: rough states, (n, nq).
            most_steps: Newton steps before giving up.

        Returns:
            The closed states (n, nq); their worst openings in units of the size, (n,); and the
            Jacobian (n, m, nv) at the last step, which is that of the closed states to rounding.

        Raises:
            AssemblyError: where a loop does not close.
        """
        qpos, before = qpos.copy(), np.inf
        for _ in range(most_steps):
            residual, jacobian = self.linearise(qpos)
            gap = self.gap(residual)
            worst = gap.max(initial=0.0)
            # stop at rounding: below the bound, or no better than the step before
            if worst <= CLOSED or (worst < 1e-11 and worst >= 0.5 * before):
                return qpos, gap, jacobian
            before = worst
            try:
                step = self.solve(jacobian, -residual)
            except np.linalg.LinAlgError:
                break
            # a turn of more than half a radian at once is beyond the linear model
            longest = np.abs(step).max(1, initial=0.0, where=self._angular[self.free])
            step *= (0.5 / np.maximum(0.5, longest))[:, None]
            full = np.zeros((len(qpos), self.model.nv))
            full[:, self.free] = step
            qpos = self.moved(qpos, full)
            if not np.isfinite(qpos).all():
                break
        worst = int(np.argmax(gap))
        raise AssemblyError(
            f"{self.name}: the loops do not close at crank angle "
            f"{qpos[worst, self.crank_place]:.6g} rad: a gap of {gap[worst]:.3g} of the longest link is left; "
            "change the dimensions, the crank angle or the start"
        )

    @property
    def _angular(self) -> NDArray[np.bool_]:
        kinds = self.model.jnt_type[self.model.dof_jntid]
        free = kinds == FREE
        # of the six freedoms of a free joint the first three are lengths
        order = np.arange(self.model.nv) - self.model.jnt_dofadr[self.model.dof_jntid]
        return (kinds != SLIDE) & ~(free & (order < 3))

    def moved(self, qpos: Array, step: Array) -> Array:
        """Return states displaced by a step in the freedoms, (n, nq): mj_integratePos for many at once."""
        model, out = self.model, qpos.copy()
        for kind, place, dof in zip(model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True):
            if kind in (HINGE, SLIDE):
                out[:, place] += step[:, dof]
                continue
            if kind == FREE:
                out[:, place : place + 3] += step[:, dof : dof + 3]
                place, dof = place + 3, dof + 3
            turned = _quaternion_turned(out[:, place : place + 4], step[:, dof : dof + 3])
            out[:, place : place + 4] = turned
        return out


def _quaternion_turned(quaternion: Array, vector: Array) -> Array:
    """Return unit quaternions turned by rotation vectors given in their own frames, (n, 4)."""
    angle = np.sqrt((vector * vector).sum(1))
    half = 0.5 * angle
    factor = np.where(angle > 1e-8, np.sin(half) / np.where(angle > 1e-8, angle, 1.0), 0.5)
    w, x, y, z = quaternion.T
    a, (b, c, d) = np.cos(half), (factor[:, None] * vector).T
    turned = np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        1,
    )
    return turned / np.sqrt((turned * turned).sum(1))[:, None]


def _constraints(model: mujoco.MjModel) -> tuple[Sequence[PointPair], Sequence[Coupling]]:
    pairs, couplings = [], []
    for i in range(model.neq):
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


def _coupling(model: mujoco.MjModel, i: int, first: int, second: int) -> Coupling:
    place, dof = int(model.jnt_qposadr[first]), int(model.jnt_dofadr[first])
    polynomial = model.eq_data[i, :5].copy()
    if second < 0:
        return Coupling((dof, -1), (place, -1), (float(model.qpos0[place]), 0.0), polynomial)
    other = int(model.jnt_qposadr[second])
    zeros = float(model.qpos0[place]), float(model.qpos0[other])
    return Coupling((dof, int(model.jnt_dofadr[second])), (place, other), zeros, polynomial)
