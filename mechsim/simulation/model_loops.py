"""The loops of a compiled model: how far they stand open, for many states at once, and closing them.

MuJoCo gives the kinematics and the Jacobians; the equations solved are the model's own equality
constraints. No closed form is near.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.maths.arrays import Array
from mechsim.model.motion import ChangePointPolicy
from mechsim.simulation import followers
from mechsim.simulation.drivers import CLOCK, Drive, Law
from mechsim.simulation.loop_constraints import Coupled, constraints
from mechsim.simulation.numerical_rank import FLOOR, RANK_TOLERANCE, telling
from mechsim.simulation.posed_bodies import PosedBodies, carried

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


class ModelLoops:
    """The equality constraints of a model with a crank, evaluated and solved in batches.

    Where programs move several drivers, or one that is no hinge, the crank is their clock, and what they
    should be by it stands among the equations.

    Attributes:
        model: the compiled model.
        crank: index of the crank among the degrees of freedom.
        crank_place: its index in qpos.
        drive: the drivers that follow a clock; None where a crank alone is driven.
        free: indices of all other degrees of freedom than the crank.
        passive: indices of those that are neither crank nor driver.
        passing: how a path of poses goes on where two assemblies meet.
        sizes: yardsticks of lengths in the model, in [m], (n,); of one where states share its fields.
        hinges: for each number of qpos whether it is the angle of a hinge.
        quaternions: where quaternions begin in qpos.
        turning: for each number of qpos whether it is one of a quaternion's.
        posed: where the model's bodies stand, and which fields of it each state has of its own.
    """

    def __init__(self, model: mujoco.MjModel, crank: str = "crank", drive: Drive | None = None):
        self.model = model
        self.posed = PosedBodies(model)
        crank = crank if drive is None else CLOCK
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, crank)
        if joint < 0 or model.jnt_type[joint] != HINGE:
            names = [model.joint(i).name for i in range(model.njnt)]
            raise InputError(
                f"the model has no hinge joint called {crank!r} (it has {', '.join(names) or 'none'}); "
                f"name the driven hinge {crank!r}"
            )
        self.crank = int(model.jnt_dofadr[joint])
        self.crank_place = int(model.jnt_qposadr[joint])
        self.drive = drive
        self.passing: ChangePointPolicy = "smooth"
        found = constraints(model)
        self.pairs, self.frames, self.couplings = found.pairs, found.frames, found.couplings
        self.name = model.names.partition(b"\0")[0].decode() or "model"
        self.free = np.array([i for i in range(model.nv) if i != self.crank], dtype=np.int64)
        self.passive = np.array([i for i in self.free if i not in self._driven], dtype=np.int64)
        self._angles = _is_angle(model)
        self.angular = self._angles[self.free]
        reach = [np.linalg.norm(local) for pair in self.pairs for local in pair.local]
        steps = np.linalg.norm(model.body_pos[1:], axis=1)
        self.sizes = np.array([max([*reach, *steps], default=0.0) or _spread_of(model)])
        self.scale = self._scale()
        self.quaternions = [
            int(place) + (3 if kind == FREE else 0)
            for kind, place in zip(model.jnt_type, model.jnt_qposadr, strict=True)
            if kind in (BALL, FREE)
        ]
        self.turning = np.zeros(model.nq, dtype=np.bool_)
        for place in self.quaternions:
            self.turning[place : place + 4] = True
        self.hinges = np.zeros(model.nq, dtype=np.bool_)
        self.hinges[model.jnt_qposadr[model.jnt_type == HINGE]] = True
        self._basis: tuple[Array, Array, Array] | None = None
        self._level: float | None = None

    def _scale(self) -> Array:
        """Return the factors that make residuals free of units, (m,); (n, m) where states have fields."""
        if self.posed.fields:
            return np.repeat(1.0 / self.sizes[:, None], 3 * len(self.pairs), 1)
        coupled = [1.0 if self._angles[one.left.dofs].all() else 1.0 / self.size for one in self.couplings]
        driven = [] if self.drive is None else np.where(self.drive.slides, 1.0 / self.size, 1.0)
        lengths = np.full(3 * len(self.pairs), 1.0 / self.size)
        return np.concatenate([lengths, np.ones(3 * len(self.frames)), coupled, driven])

    @property
    def size(self) -> float:
        """Yardstick of lengths in the model, in [m], where all states share its fields."""
        (size,) = self.sizes.tolist()
        return size

    @property
    def units(self) -> Array:
        """Units of the freedoms in [rad] and [m], (nv,): one, and the size."""
        return np.where(self._angles, 1.0, self.size)

    @property
    def rounding(self) -> float:
        """Below which slopes, in [m] or [rad] by [m] or [rad], are rounding."""
        return FLOOR * max(1.0, float(self.sizes.max()))

    @property
    def turned_rows(self) -> slice:
        """Which residuals are of frames that should be parallel."""
        return slice(3 * len(self.pairs), 3 * (len(self.pairs) + len(self.frames)))

    @property
    def coupled_rows(self) -> slice:
        """Which residuals are of coupled coordinates."""
        first = self.turned_rows.stop
        return slice(first, first + len(self.couplings))

    @property
    def driven_rows(self) -> slice:
        """Which residuals are of what programs drive: the last."""
        first = self.coupled_rows.stop
        return slice(first, first + (0 if self.drive is None else len(self.drive.dofs)))

    @cached_property
    def followers(self) -> list[Coupled]:
        """The couplings of coordinates that follow from those driven, but not in a straight line."""
        return [one for one in self._chain if one.bends]

    @property
    def driven_dofs(self) -> NDArray[np.int64]:
        """The crank or all drivers."""
        return np.array(self._driven, dtype=np.int64)

    @cached_property
    def moved_dofs(self) -> NDArray[np.int64]:
        """The freedoms that forces move in steps: the crank or all drivers, then what bends with them."""
        bent = [int(one.left.dofs[0]) for one in self.followers]
        return np.array([*self._driven, *bent], dtype=np.int64)

    def moved_rates(self, angle: Array, speed: Array) -> Array:
        """Return the rates of `moved_dofs` at angles of the crank or clock, (n,), and its speeds, (n, k)."""
        values, speeds = {self.crank_place: angle}, {self.crank: speed}
        if self.drive is not None:
            value, slope, _ = self.drive.law(angle)
            values |= dict(zip(self.drive.places.tolist(), value, strict=True))
            speeds |= dict(zip(self.drive.dofs.tolist(), slope * speed, strict=True))
        found = followers.rates(self._chain, values, speeds)
        return np.stack([found[int(dof)] for dof in self.moved_dofs], 1)

    @property
    def _driven(self) -> list[int]:
        return [self.crank] if self.drive is None else self.drive.dofs.tolist()

    @cached_property
    def _chain(self) -> list[Coupled]:
        return followers.chained(self.couplings, self._driven)

    def under(self, law: Law, said: Callable[[float], str]) -> "ModelLoops":
        """Return the same loops, their drivers under another law of the clock."""
        assert self.drive is not None
        other = copy.copy(self)
        other.drive = self.drive.under(law, said)
        return other

    def standing(self, values: Array) -> "ModelLoops":
        """Return the same loops, their drivers held at values, (k,) or (k, n) for n states."""
        assert self.drive is not None
        other = copy.copy(self)
        other.drive = self.drive.standing(values)
        return other

    def said(self, angle: float) -> str:
        """Return where the crank or the drivers are, in words."""
        return f"crank angle {angle:.6g} rad" if self.drive is None else self.drive.said(angle)

    def with_fields(self, fields: Mapping[str, Array]) -> "ModelLoops":
        """Return the loops of n states of which each has fields of the model of its own, name -> (n, ...).

        Its methods then take n states. Only loops that points of sites close may be so; which of their rows
        say something is that of the model itself.
        """
        other = copy.copy(self)
        other.posed, other._level = PosedBodies(self.model, fields), None
        sites = fields["site_pos"]
        closing = zip(self.pairs, self.model.eq_obj1id, self.model.eq_obj2id, strict=True)
        other.pairs = [replace(pair, local=(sites[:, a], sites[:, b])) for pair, a, b in closing]
        reach = [np.linalg.norm(local, axis=1) for pair in other.pairs for local in pair.local]
        steps = np.linalg.norm(fields["body_pos"][:, 1:], axis=2).T
        other.sizes = np.max([*reach, *steps], axis=0)
        other.scale = other._scale()
        return other

    def over_copy(self) -> "ModelLoops":
        """Return the same loops over a copy of the model that may be set up for stepping."""
        other = copy.copy(self)
        other.model = copy.copy(self.model)
        return other

    def residual(self, qpos: Array) -> Array:
        """Return how far the constraints stand open, (n, m) in [m] or [rad]."""
        return self._look(qpos)[0]

    def linearise(self, qpos: Array) -> tuple[Array, Array]:
        """Return the constraint residuals, (n, m) in [m] or [rad], and their Jacobian, (n, m, nv)."""
        residual, jacobian = self._look(qpos)
        return residual, jacobian()

    def _look(self, qpos: Array) -> tuple[Array, Callable[[], Array]]:
        """Return the residuals, and what computes their Jacobian as long as nothing else is looked at."""
        position, rotation, slope = self.posed.at(qpos)
        n, nv = len(qpos), self.model.nv
        ends = [
            [(body, position[:, body] + carried(rotation[:, body], local)) for body, local in pair.ends]
            for pair in self.pairs
        ]
        turned = [pair.apart(*(rotation[:, body] for body in pair.bodies)) for pair in self.frames]
        coupled = [coupling.gap(qpos)[:, None] for coupling in self.couplings]
        drive, law = self.drive, None
        if drive is not None:
            law = drive.law(qpos[:, self.crank_place])
            coupled.append(qpos[:, drive.places] - law[0].T)
        parts = [np.zeros((n, 0)), *(a[1] - b[1] for a, b in ends), *(apart for apart, _ in turned), *coupled]

        def jacobian() -> Array:
            parts = [np.zeros((n, 0, nv))]
            none = np.zeros((n, 3, nv))
            for (a, at_a), (b, at_b) in ends:
                parts.append((slope(a, at_a)[0] if a else 0.0) - (slope(b, at_b)[0] if b else none))
            for pair, (_, rate) in zip(self.frames, turned, strict=True):
                a, b = (slope(body, position[:, body])[1] if body else none for body in pair.bodies)
                parts.append(rate @ (a - b))
            parts += [coupling.slope(qpos, nv)[:, None] for coupling in self.couplings]
            if drive is not None and law is not None:
                rows = np.zeros((n, len(drive.dofs), nv))
                rows[:, np.arange(len(drive.dofs)), drive.dofs] = 1.0
                rows[:, :, self.crank] = -law[1].T
                parts.append(rows)
            return np.concatenate(parts, 1)

        return np.concatenate(parts, 1), jacobian

    def bodies(self, qpos: Array) -> tuple[Array, Array]:
        """Return the places and rotations of all bodies at n states, (n, nbody, 3) and (n, nbody, 3, 3)."""
        position, rotation, _ = self.posed.many(qpos)
        return position.copy(), rotation.copy()

    def sites(self, qpos: Array) -> Array:
        """Return the places of all sites at n states, (n, nsite, 3) in [m]."""
        position, rotation, _ = self.posed.many(qpos)
        bodies, local = self.model.site_bodyid, self.posed.fields.get("site_pos", self.model.site_pos)
        return position[:, bodies] + (rotation[:, bodies] @ local[..., None])[..., 0]

    def centres(self, qpos: Array) -> Array:
        """Return the centres of mass of all bodies at n states, (n, nbody, 3) in [m]."""
        position, rotation, _ = self.posed.many(qpos)
        return position + (rotation @ self.model.body_ipos[..., None])[..., 0]

    def places(self, qpos: Array) -> Array:
        """Return the places of all sites and of all points that close loops at n states, (n, k, 3) in [m]."""
        position, rotation, _ = self.posed.many(qpos)
        ends = [end for pair in self.pairs for end in pair.ends]
        points = [position[:, body] + rotation[:, body] @ local for body, local in ends]
        return np.concatenate([np.stack(points, 1) if points else position[:, :0], self.sites(qpos)], 1)

    def gap(self, residual: Array) -> Array:
        """Return the worst opening of each state in units of the model's size and in [rad], (n,)."""
        return np.abs(residual * self.scale).max(1, initial=0.0)

    def held(self, jacobian: Array) -> Array:
        """Return the slopes by all freedoms but the crank, (n, m, nv - 1); nought where all are rounding."""
        held = jacobian[:, :, self.free]
        if np.abs(held).max(initial=0.0) <= self.rounding:
            held[:] = 0.0
        return held

    def solve(self, jacobian: Array, right: Array) -> Array:
        """Return the least-norm x (n, nv - 1, k) of J x = right (n, m, k) in all freedoms but the crank."""
        held = self.held(jacobian)
        rows = self._independent(held)
        if rows is None:
            return np.linalg.pinv(held, rcond=RANK_TOLERANCE) @ right
        if rows.shape[1] < rows.shape[0]:
            held, right = rows.T @ held, rows.T @ right
        if held.shape[1] == held.shape[2]:
            return np.asarray(np.linalg.solve(held, right), dtype=np.float64)
        turned = np.swapaxes(held, -1, -2)
        return turned @ np.linalg.solve(held @ turned, right)

    def _independent(self, held: Array) -> Array | None:
        """Return a basis, (m, rank), of the rows that say something new; None if it changes with the pose.

        A planar loop's third row says nothing anywhere; in an overconstrained loop such as Bennett's
        every row counts, and which repeat others changes from pose to pose.
        """
        if self._basis is None:
            # a model may have thousands of freedoms that no loop holds, and needs no basis of those
            left, values, right = np.linalg.svd(held[0], full_matrices=held.shape[1] > held.shape[2])
            rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
            self._basis = left[:, :rank], left[:, rank:], right[:rank]
        rows, idle, _ = self._basis
        told = np.abs(idle.T @ held).max(initial=0.0)
        if told > RANK_TOLERANCE * np.abs(held).max(initial=0.0):
            return None
        return rows

    @property
    def spins(self) -> bool:
        """Whether the loops leave freedoms open beside the crank, as was seen when they were last solved."""
        return self._basis is not None and len(self._basis[2]) < len(self.free)

    def side(self, jacobian: Array) -> Array:
        """Return on which side of the dead centres states lie, (n,): +1 or -1; 0 where that is not known.

        It is the sign of the Jacobian's determinant with the crank held: two assemblies that meet at a
        dead centre have opposite signs, and from one dead centre to the next it stays.
        """
        held = self.held(jacobian)
        rows = self._independent(held)
        return np.zeros(len(held)) if rows is None else np.linalg.slogdet(self._square(held, rows))[0]

    def crossed(self, before: Array, beyond: Array) -> NDArray[np.bool_]:
        """Return whether states lie on other sides than those near by from which they were reached, (n,).

        Where which rows say something changes with the pose, in the rows that do so before.

        Args:
            before, beyond: Jacobians, (n, m, nv).
        """
        sides = self.side(before) * self.side(beyond)
        for i in np.flatnonzero(sides == 0.0):
            sides[i] = self.determinant(np.stack([before[i], beyond[i]]))[1]
        return sides < 0.0

    def determinant(self, jacobian: Array) -> Array:
        """Return the determinant whose sign is the side, (n,), in a unit of its own.

        Where which rows say something changes with the pose, it is that of the rows that do so in the first
        state, and positive there: states in one call are then on the same side, or not.
        """
        held = self.held(jacobian)
        rows = self._independent(held)
        turned = 1.0
        if rows is None:
            assert self._basis is not None
            rows = np.linalg.svd(held[0], full_matrices=False)[0][:, : len(self._basis[2])]
            turned = np.linalg.slogdet(self._square(held[:1], rows))[0]
        side, size = np.linalg.slogdet(self._square(held, rows))
        if self._level is None:
            self._level = float(size[0]) if np.isfinite(size[0]) else 0.0
        return turned * side * np.exp(np.minimum(size - self._level, 300.0))

    def loosest(self, jacobian: Array) -> Array:
        """Return the direction in which the loops of one state, (1, m, nv), hold it least, (nv,).

        The crank is held; of freedoms that no row holds there is no part in it.
        """
        held = self.held(jacobian)
        self._independent(held)
        assert self._basis is not None
        told = self._basis[2]
        return self._spread(np.linalg.svd(held @ told.T)[2][:, len(told) - 1] @ told, 0.0)[0]

    def _square(self, held: Array, rows: Array) -> Array:
        # freedoms that no row holds (a passive spin) are left out: as rows of their own they would stand for
        # themselves, and change no determinant
        assert self._basis is not None
        return (rows.T @ held) @ self._basis[2].T

    def conditioning(self, jacobian: Array) -> Array:
        """Return how far states are from singular ones with the crank held, (n,), 0 to about 1.

        The smallest singular value in units of the model's size; those that are nought at every state, of
        rows that repeat others and freedoms that nothing holds, do not count.
        """
        lengths = self.sizes[:, None, None]
        held = jacobian[:, :, self.passive] * np.where(self._angles[self.passive], 1.0, lengths)
        held *= self.scale[..., None]
        values = np.linalg.svd(held, compute_uv=False).astype(np.float64, copy=False)
        if not values.size:
            return np.ones(len(held))
        rank = int(telling(values).sum(1).max())
        return values[:, rank - 1] if rank else np.ones(len(held))

    def fastest(self, rates: Array) -> float:
        """Return the largest of rates (n, nv), of angles in [rad] and of displacements in sizes."""
        return float(np.abs(rates / self.units).max(initial=0.0))

    def tangent(self, jacobian: Array) -> Array:
        """Return the rates of all freedoms per radian of the crank, (n, nv), that keep the loops closed."""
        driven = -jacobian[:, :, [self.crank]]
        rates = self.solve(jacobian, driven)
        # least norm comes by normal equations, which square the condition; what they left undone mends that
        rates += self.solve(jacobian, driven - jacobian[:, :, self.free] @ rates)
        return self._spread(rates[..., 0], 1.0)

    def newton(self, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """Return the step that closes the linearised loops, the crank held, and the tangent; (n, nv) each."""
        both = self.solve(jacobian, np.stack([-residual, -jacobian[:, :, self.crank]], -1))
        step = both[..., 0]
        # a turn of more than half a radian at once is beyond the linear model
        longest = np.abs(step).max(1, initial=0.0, where=self.angular)
        step *= (0.5 / np.maximum(0.5, longest))[:, None]
        return self._spread(step, 0.0), self._spread(both[..., 1], 1.0)

    def _spread(self, held: Array, crank: float) -> Array:
        """Return rates of all freedoms from those of all but the crank."""
        rates = np.empty((len(held), self.model.nv))
        rates[:, self.crank], rates[:, self.free] = crank, held
        return rates

    def close(self, qpos: Array, *, most_steps: int = 50) -> Array:
        """Return n states with their loops closed, their cranks held, by Newton's method.

        Args:
            qpos: rough states, (n, nq).
            most_steps: Newton steps before giving up.

        Raises:
            AssemblyError: where a loop does not close.
        """
        return self.closed(qpos, most_steps)[0]

    def closed(self, qpos: Array, most_steps: int = 50) -> tuple[Array, Array | None]:
        """Return n states closed as `close` does, and the Jacobian of the last Newton step, (n, m, nv).

        None for the Jacobian where the states came closed.
        """
        qpos, before, slope = qpos.copy(), np.inf, None
        gap = np.full(len(qpos), np.inf)
        for _ in range(most_steps):
            residual, jacobian = self._look(qpos)
            gap = self.gap(residual)
            worst = gap.max(initial=0.0)
            # stop at rounding: below the bound, or no better than the step before
            if worst <= CLOSED or (worst < 1e-11 and worst >= 0.5 * before):
                return qpos, slope
            before, slope = worst, jacobian()
            try:
                step, _ = self.newton(residual, slope)
            except np.linalg.LinAlgError:
                break
            qpos = self.moved(qpos, step)
            if not np.isfinite(qpos).all():
                break
        worst = int(np.argmax(gap))
        raise AssemblyError(
            f"{self.name}: the loops do not close at {self.said(float(qpos[worst, self.crank_place]))}: "
            f"a gap of {gap[worst]:.3g} of the longest link is left; change the dimensions, "
            f"{'the crank angle' if self.drive is None else 'where the drivers are'} or the start"
        )

    def moved(self, qpos: Array, step: Array) -> Array:
        """Return states displaced by a step in the freedoms, (n, nq): mj_integratePos for many at once."""
        model, out = self.model, qpos.copy()
        if len(out) == 1:
            mujoco.mj_integratePos(model, out[0], step[0], 1.0)
            return out
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


def _spread_of(model: mujoco.MjModel) -> float:
    """Return how far sites, joints and centres of mass lie from their bodies' origins; 1 m if nowhere."""
    places = np.concatenate([model.site_pos, model.jnt_pos, model.body_ipos])
    return float(np.linalg.norm(places, axis=1).max(initial=0.0)) or 1.0


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


def _is_angle(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Say of each freedom whether it is an angle; of the six of a free joint the first three are lengths."""
    kinds = model.jnt_type[model.dof_jntid]
    order = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
    return (kinds != SLIDE) & ~((kinds == FREE) & (order < 3))
