"""Closed configurations of a user's own MuJoCo model, in its order of qpos: prescribed or random."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError, InputError, first_names
from mechsim.mechanism.limits import require_count
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import ROUNDING, Array, unique
from mechsim.numerics.graphs import components
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import RANK_TOLERANCE, least_squares, pivot_columns
from mechsim.numerics.resources import Progress
from mechsim.simulation import loop_jacobian
from mechsim.simulation.loop_jacobian import Jacobian, LoopEquations, of_dofs, products
from mechsim.simulation.mjcf_reader.parsed_file import initial_qpos
from mechsim.simulation.model_loops import ModelLoops, loops_with_crank
from mechsim.simulation.state import FREE, SCALAR, limited_joints, scalar_joints

# largest step of a driver on the path from the reference, in [rad] or characteristic lengths
DRIVER_STEP = 0.1
# largest distance of a driver from the reference in the same units: 16 revolutions, a thousand steps
FARTHEST = 100.0
# largest component of a Newton step, in [rad] or [m]
MAX_STEP = 0.5
# number of Newton steps at the end of the path
LAST_ITERATIONS = 8
# closure errors in characteristic lengths or [rad]: above the first, the path is lost (ten times the error of
# the extrapolation for a curvature of 2); below the second, the last configuration is closed
LOST_ERROR, CLOSED_ERROR = 0.1, 1e-12
# Redundant constraints whose dimensions are rounded agree only to rounding, with singular values below
# ROUNDED_RANK of the largest (2e-9 to 5e-7 in the files of validation/public_models). Their least-squares
# configuration counts as closed: closure error below ROUNDED_ERROR, singular values of the passive DOFs above
# ROUNDED_RANK of the largest, and a Gauss-Newton step below CONVERGED, in [rad] or characteristic lengths
ROUNDED_RANK, ROUNDED_ERROR, CONVERGED = 1e-5, 1e-4, 1e-8
# number of trial configurations for the joints of each group of loops
PROBES = 3
# largest number of draws for each requested configuration, and of configurations followed at once
MAX_DRAWS, BATCH = 50, 4096
# largest number of degrees of freedom followed at once, some 2 kB each in a row of loops
FOLLOWED_DOFS = 200_000
# largest number of states, all in memory with their Jacobians: some 1 to 10 kB each
MAX_STATES = 1_000_000
# weight of actuated and free joints, so small that the loops determine the other joints
ACTUATED_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Sample:
    """Closed states of a model.

    Attributes:
        qpos: configurations in MuJoCo's order, (n, nq).
        qvel: velocities in [m/s] or [rad/s] that keep the loops closed, (n, nv).
        residual: closure error of each configuration in characteristic lengths or [rad], (n,).
        accepted: fraction of the drawn configurations that close within the joint limits; the
            smallest one of loops that share no joint.
    """

    qpos: Array
    qvel: Array
    residual: Array
    accepted: float

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class StraightPath:
    """Straight paths of drivers from a closed reference; the loops determine the passive DOFs.

    Drivers are DOFs of hinges and slides, by their coordinates, or of balls and free joints, by their
    displacements from the reference.
    """

    loops: ModelLoops
    reference: Array
    drivers: NDArray[np.int64]
    passive: NDArray[np.int64]

    @cached_property
    def addresses(self) -> NDArray[np.int64]:
        """Addresses of the drivers in qpos."""
        model = self.loops.model
        return model.jnt_qposadr[model.dof_jntid[self.drivers]].astype(np.int64)

    @property
    def origin(self) -> Array:
        """Positions of the drivers at the reference, (k,)."""
        scalar = np.isin(self.loops.model.jnt_type[self.loops.model.dof_jntid[self.drivers]], SCALAR)
        return np.where(scalar, self.reference[self.addresses], 0.0)

    def _passive_step(self, jacobian: Jacobian, scaled_residual: Array) -> Array:
        step = np.zeros((len(scaled_residual), self.loops.model.nv))
        residual = scaled_residual / self.loops.scale
        step[:, self.passive] = self.passive_solution(of_dofs(jacobian, self.passive), residual)
        return step

    def passive_solution(self, matrix: Jacobian, right: Array) -> Array:
        """Return the passive DOFs, (n, k), that give right sides (n, m) with their part of the Jacobian."""
        if isinstance(matrix, np.ndarray):
            return least_squares(matrix, right)
        return matrix.least_squares(right, self.loops.bands)

    def follow(self, targets: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return configurations with drivers at targets, (n, k), and which of them close in this assembly.

        Each step extrapolates the previous step and is corrected once; the last step is iterated.
        """
        displacements = targets - self.origin
        scaled = np.abs(displacements / self.loops.units[self.drivers]).max(1, initial=0.0)
        if not scaled.max(initial=0.0) < FARTHEST:
            raise InputError(
                f"a driver is {scaled.max():.3g} rad or characteristic lengths from the reference; give "
                f"positions within {FARTHEST:g}"
            )
        if len(targets) > (most := max(1, FOLLOWED_DOFS // max(1, self.loops.model.nv))):
            pieces = [self.follow(targets[first : first + most]) for first in range(0, len(targets), most)]
            qpos, closed = zip(*pieces, strict=True)
            return np.concatenate(qpos), np.concatenate(closed)
        counts = np.maximum(1, np.ceil(scaled / DRIVER_STEP)).astype(np.int64)
        qpos, lost = np.repeat(self.reference[None], len(targets), 0), np.zeros(len(targets), dtype=np.bool_)
        jacobian = self.loops.linearised(qpos)[1]
        moved = np.zeros((len(targets), self.loops.model.nv))
        moved[:, self.drivers] = displacements / counts[:, None]
        rates = products(of_dofs(jacobian, self.drivers), moved[:, self.drivers])
        before = of_dofs(jacobian, self.passive)
        moved[:, self.passive] = -self.passive_solution(before, rates)
        for i in range(counts.max(initial=0)):
            moved[i >= counts] = 0.0
            qpos = self.loops.displaced(qpos, moved)
            residual, jacobian = self.loops.linearised(qpos)
            matrix = of_dofs(jacobian, self.passive)
            lost |= ~(self.loops.closure_error(residual) < LOST_ERROR) | self._turned_over(before, matrix)
            step = np.zeros_like(moved)
            step[:, self.passive] = -self.passive_solution(matrix, residual)
            step *= MAX_STEP / np.maximum(MAX_STEP, np.abs(step).max(1, keepdims=True))
            qpos, moved, before = self.loops.displaced(qpos, step), moved + step, matrix
            qpos[lost], moved[lost] = self.reference, 0.0
        settings = NewtonSettings(max_iterations=LAST_ITERATIONS, max_step=MAX_STEP)
        result = newton(LoopEquations(self.loops, self._passive_step), qpos, settings)
        matrix = of_dofs(result.linearised.matrix, self.passive)
        lost |= self._turned_over(before, matrix)
        return result.q, ~lost & self._closed(matrix, result.linearised.rhs)

    def _closed(self, matrix: Jacobian, scaled_residual: Array) -> NDArray[np.bool_]:
        """Return which configurations close, with redundant constraints as well as rounding allows."""
        error, units = np.abs(scaled_residual).max(1, initial=0.0), self.loops.units[self.passive]
        closed = error < CLOSED_ERROR
        if len(self.loops.scale) <= len(self.passive) or not (~closed & (error < ROUNDED_ERROR)).any():
            return closed
        step = self.passive_solution(matrix, scaled_residual / self.loops.scale) / units
        rounded = np.flatnonzero(~closed & (error < ROUNDED_ERROR) & (np.abs(step).max(1) < CONVERGED))
        whole = matrix[rounded] if isinstance(matrix, np.ndarray) else matrix.whole(rounded)
        values = np.linalg.svd(whole * self.loops.scale[:, None] * units, compute_uv=False)
        closed[rounded] = values[:, -1] > ROUNDED_RANK * values[:, 0]
        return closed

    def _turned_over(self, before: Jacobian, after: Any) -> NDArray[np.bool_]:
        """Return a mask of states, (n,), that passed a singularity between two Jacobians, (n, m, k) each.

        Between assemblies the determinant of a group of loops changes its sign. With redundant constraints it
        is the determinant of the product with the previous Jacobian, whose range is similar.
        """
        if isinstance(before, np.ndarray):
            product = np.swapaxes(before, 1, 2) @ after
            signs = [np.linalg.slogdet(product[:, group[:, None], group])[0] for group in self.groups]
        else:
            pairs = [(before.restricted(group), after.restricted(group)) for group in self.groups]
            signs = [first.product_signs(second, self.loops.bands) for first, second in pairs]
        return ~np.all([sign > 0.0 for sign in signs], axis=0)

    @property
    def joints(self) -> NDArray[np.int32]:
        """Indices of the joints that move."""
        return unique(self.loops.model.dof_jntid[[*self.drivers, *self.passive]])

    @cached_property
    def groups(self) -> list[NDArray[np.intp]]:
        """Disjoint groups of passive DOFs that belong to common loops, as columns of `passive`."""
        matrix = _influence(self.loops, self.reference)[:, self.passive]
        return [np.array(sorted(group), dtype=np.intp) for group in _coupled(matrix)]

    def independent_paths(self) -> list["StraightPath"]:
        """Return the paths of loops that share no joint; the other drivers stay at the reference."""
        model, dofs = self.loops.model, np.concatenate([self.drivers, self.passive])
        # the DOFs of a ball or a free joint belong together
        joints = model.dof_jntid[dofs, None] == np.arange(model.njnt)
        matrix = _influence(self.loops, self.reference)[:, dofs]
        groups = _coupled(np.vstack([matrix, matrix.max(initial=0.0) * joints.T]))
        # joints outside loops are drawn together
        negligible = matrix.max(0) <= ROUNDED_ERROR * matrix.max(initial=0.0)
        alone = {i for group in groups if negligible[[*group]].all() for i in group}
        groups = [*([alone] if alone else []), *(group for group in groups if not group & alone)]
        members = [dofs[[*group]] for group in groups]
        return [
            replace(
                self,
                drivers=np.intersect1d(self.drivers, own, assume_unique=True),
                passive=np.intersect1d(self.passive, own, assume_unique=True),
            )
            for own in members
        ]

    def closing_rates(self, jacobian: Jacobian, rates: Array) -> Array:
        """Return rates (n, nv) with those of the passive DOFs that keep the loops (n, m, nv) closed."""
        matrix = of_dofs(jacobian, self.passive)
        for _ in range(2):  # the second iteration removes rounding errors
            rates[:, self.passive] -= self.passive_solution(matrix, products(jacobian, rates))
        return rates

    def reach(self, targets: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the configurations of `follow`, and which of them close within the joint limits."""
        qpos, closed = self.follow(targets)
        return qpos, closed & ~outside_limits(self.loops.model, qpos).any(1)


def _influence(loops: ModelLoops, reference: Array, probes: Array | None = None) -> Array:
    """Return the largest effects of DOFs on the equations of loops near a closed configuration, (m, nv)."""
    # in a singular reference some joints do not affect a loop to first order; rotations of a floating base
    # affect open loops only
    probes = _probes(loops, reference, np.arange(loops.model.nv)) if probes is None else probes
    return np.abs(loops.linearise(np.concatenate([reference[None], probes]))[1] * loops.units).max(0)


def _probes(loops: ModelLoops, reference: Array, dofs: NDArray[np.int64]) -> Array:
    """Return closed configurations around a reference, displaced at random in some DOFs, (n, nq)."""
    steps, units = np.zeros((PROBES, loops.model.nv)), loops.units[dofs]
    steps[:, dofs] = np.random.default_rng(0).normal(size=(PROBES, len(dofs))) * DRIVER_STEP * units
    return _closed_nearby(loops, loops.displaced(np.repeat(reference[None], PROBES, 0), steps), dofs, units)


def _coupled(matrix: Array) -> list[set[int]]:
    """Return the disjoint groups of columns of a matrix, (m, k), with common rows."""
    share = (matrix.T @ matrix) > RANK_TOLERANCE * np.abs(matrix).max(initial=0.0) ** 2
    return [{*group} for group in components(range(len(share)), zip(*np.nonzero(share), strict=True))]


def closed_qpos(model: mujoco.MjModel, values: Mapping[str, ArrayLike], start: Array | None) -> Array:
    """Return closed configurations in MuJoCo's order of qpos, (n, nq), in the assembly of the start.

    Args:
        model: the compiled model.
        values: hinge or slide -> positions in [rad] or [m], scalar or (n,). Undetermined joints keep their
            reference values.
        start: configuration from which paths start, (nq,); None is the reference, or a closed keyframe.

    Raises:
        InputError: if a joint is unknown or outside its limits, or positions have different lengths.
        AssemblyError: if a loop does not close on the path.
    """
    dofs = [scalar_dof(model, name) for name in values]
    try:
        columns = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, dtype=float)) for v in values.values()))
    except ValueError:
        raise InputError("positions of joints have different lengths; give one or n each") from None
    if not columns or columns[0].ndim != 1 or not np.isfinite(columns).all():
        raise InputError("positions must be finite numbers, one or n for each of one or more joints")
    path = straight_path(model, dofs, start)
    qpos, closed = path.follow(np.stack(columns, 1))
    if not closed.all():
        i = int(np.argmin(closed))
        raise AssemblyError(f"the loops do not close in this assembly at row {i}; give reachable positions")
    rows, joints = np.nonzero(outside_limits(model, qpos))
    if len(rows):
        name = model.joint(int(joints[0])).name
        raise InputError(f"joint {name} is outside its limits at row {rows[0]}; give other positions")
    return qpos


def sample(
    model: mujoco.MjModel,
    n: int,
    seed: int,
    progress: Progress,
    start: Array | None,
    *,
    fix_base: bool,
    lock_others: bool,
) -> Sample:
    """Return n closed states of a model, drawn at random within joint limits in one assembly.

    Drivers are drawn uniformly within their limits, or within a revolution or a characteristic length if they
    have none; balls and free joints of loops likewise. The states lie on straight paths from the start; drawn
    configurations without such a path are rejected, for each of the loops that share no joint. Redundant
    constraints with rounded dimensions close as well as their rounding allows; `residual` states how well.
    Velocities of drivers have a normal distribution with a standard deviation of 1 rad/s or 1 characteristic
    length per second.

    Args:
        model: as in `closed_qpos`.
        n: number of states.
        seed: seed of the random numbers; the same seed gives the same states.
        progress: called with a text and the finished fraction.
        start: as in `closed_qpos`.
        fix_base: whether free joints stay at the start.
        lock_others: whether joints without an actuator that the loops do not determine stay at the start.

    Raises:
        InputError: if n is below 1 or too large, or the model has no loops.
        AssemblyError: if the start does not close, or too few draws are accepted.
    """
    require_count("the states", n, MAX_STATES, "draw them in parts with other seeds")
    if seed < 0:
        raise InputError(f"the seed is {seed}; give 0 or more")
    random = np.random.default_rng(seed)
    path = straight_path(model, None, start, fix_base=fix_base)
    if lock_others:
        drivers = path.drivers[np.isin(path.drivers, _actuated_dofs(model))]
        if not len(drivers):
            raise InputError("no actuator moves a joint, so that --lock others leaves none to draw")
        path = replace(path, drivers=drivers)
    paths = path.independent_paths()
    outside = outside_limits(model, path.reference[None])[0]
    for each in paths:
        outside[each.joints] &= not len(each.drivers)
    if outside.any():
        name = model.joint(int(np.argmax(outside))).name
        raise AssemblyError(
            f"joint {name} stays at the start, which is outside its limits; start within them, by "
            f"--start {name}=VALUE"
        )
    qpos, accepted = np.repeat(path.reference[None], n, 0), 1.0
    for i, each in enumerate(paths):
        low, high = driver_ranges(each)
        states, count, drawn = list[Array](), 0, 0
        while count < n:
            if drawn >= MAX_DRAWS * max(n, 100):
                raise AssemblyError(f"{count} of {drawn} drawn configurations close within the joint limits")
            progress(f"{count:,} of {n:,} states", (i + count / n) / len(paths))
            # estimated from the fraction accepted so far
            expected = (n - count) * (min(drawn / max(count, 1), MAX_DRAWS) if drawn else 1.0)
            batch = int(np.clip(expected, 64, BATCH))
            reached, closed = each.follow(random.uniform(low, high, (batch, len(low))))
            # joints of other paths are at the start, which may be beyond their limits
            valid = closed & ~outside_limits(model, reached)[:, each.joints].any(1)
            states.append(reached[valid])
            count, drawn = count + int(valid.sum()), drawn + batch
        accepted = min(accepted, count / drawn)
        joints = np.isin(model.jnt_qposadr.searchsorted(np.arange(model.nq), "right") - 1, each.joints)
        qpos[:, joints] = np.concatenate(states)[:n, joints]
    residual, jacobian = path.loops.linearised(qpos)
    qvel = np.zeros((n, path.loops.model.nv))
    qvel[:, path.drivers] = random.normal(size=(n, len(path.drivers))) * path.loops.units[path.drivers]
    return Sample(qpos, path.closing_rates(jacobian, qvel), path.loops.closure_error(residual), accepted)


def keyframe(model: mujoco.MjModel, key: str | None) -> Array | None:
    """Return the coordinates of a keyframe, (nq,); None without a name."""
    return None if key is None else initial_qpos("the model", model, key)


def straight_path(
    model: mujoco.MjModel, drivers: list[int] | None, start: Array | None = None, *, fix_base: bool = False
) -> StraightPath:
    """Return the paths from the closed configuration at a start, by default the reference or a keyframe."""
    loops = loops_with_crank(model, 0)
    if not (loops.pairs or loops.rods or loops.frames or loops.couplings):
        raise InputError(
            "the model has no loops: joints of an open chain take any value within their limits; add "
            "equality constraints that close its loops"
        )
    kinds = model.jnt_type[model.dof_jntid]
    if fix_base and not (kinds == FREE).any():
        raise InputError("no body has a free joint; leave out --fix-base")
    weights = np.where(kinds == FREE, ACTUATED_WEIGHT, 1.0)
    weights[_actuated_dofs(model)] = ACTUATED_WEIGHT
    if drivers is None:
        # of coupled joints the one whose whole range the others can follow is the driver
        sides = [side for row in loops.couplings for side in (row.left, row.right) if side is not None]
        for dof in {int(dof) for side in sides for dof in side.dofs}:
            joint = int(model.dof_jntid[dof])
            if joint in limited_joints(model):
                weights[dof] *= np.ptp(model.jnt_range[joint]) / loops.units[dof]
    free = np.flatnonzero(~(fix_base & (kinds == FREE)))
    others = np.setdiff1d(free, drivers or [], assume_unique=True).astype(np.int64)
    starts = start[None] if start is not None else np.concatenate([model.qpos0[None], model.key_qpos])
    closed = _closed_reference(loops, starts, others, loops.units[others] * weights[others])
    rank, jacobian = _rank(loops, closed[None], free), loops.linearise(closed[None])[1][0] * loops.units
    probes = _probes(loops, closed, free)
    if _rank(loops, probes, free) > rank:
        raise InputError(
            "the model starts in a singular configuration, where assemblies meet; start away from it with "
            "--start JOINT=VALUE"
        )
    order, pivots = pivot_columns(jacobian[:, others] * weights[others])
    # a pivot has the weight of its column
    passive, sizes = np.sort(others[order[:rank]]), pivots / weights[others[order[: len(pivots)]]]
    if int((sizes > ROUNDED_RANK * sizes.max(initial=0.0)).sum()) < rank:
        names = ", ".join(model.joint(int(model.dof_jntid[dof])).name for dof in drivers or [])
        raise InputError(
            f"{names} cannot move independently where the model starts: the loops couple them, or the "
            "configuration is singular; give fewer joints, or another start"
        )
    if drivers is None:
        influence = _influence(loops, closed, None if fix_base else probes).max(0)
        in_loops = model.dof_jntid[influence > ROUNDED_ERROR * influence.max(initial=0.0)]
        drawn = np.isin(kinds, SCALAR) | np.isin(model.dof_jntid, in_loops)
        drivers = np.setdiff1d(free[drawn[free]], passive, assume_unique=True).tolist()
    return StraightPath(loops, closed, np.array(drivers, dtype=np.int64), passive)


def _actuated_dofs(model: mujoco.MjModel) -> NDArray[np.int32]:
    """Return the DOFs on whose hinges and slides actuators act."""
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    return model.jnt_dofadr[model.actuator_trnid[on_joint, 0]]


def _closed_reference(loops: ModelLoops, starts: Array, dofs: NDArray[np.int64], weights: Array) -> Array:
    """Return the closed configuration nearest to the first start, (n, nq), within the joint limits, (nq,).

    Starts come in the order of their closure errors, those within the limits first. Without a configuration
    within the limits it is the first that closes. DOFs with small weights move least.

    Raises:
        AssemblyError: if no start leads to a closed configuration.
    """
    # closure errors of rounding are equal: then the reference comes first
    errors = np.maximum(loops.closure_error(loops.residual(starts)), CLOSED_ERROR)
    starts = starts[np.argsort(errors, kind="stable")]
    starts = starts[np.argsort(outside_limits(loops.model, starts).any(1), kind="stable")]
    closed = _closed_nearby(loops, starts, dofs, weights)
    if not len(closed):
        raise AssemblyError("the loops do not close near the start; mechsim show states what was tried")
    return closed[np.argmin(outside_limits(loops.model, closed).any(1))]


def _closed_nearby(loops: ModelLoops, starts: Array, dofs: NDArray[np.int64], weights: Array) -> Array:
    """Return the configurations nearest to starts, (n, nq), for those that close."""
    step = loop_jacobian.nearest_steps(loops, dofs, weights, ROUNDED_RANK)
    settings = NewtonSettings(max_iterations=20, max_step=MAX_STEP)
    result = newton(LoopEquations(loops, step), starts, settings)
    remaining = step(result.linearised.matrix, result.linearised.rhs) / loops.units
    rounded = (result.residual < ROUNDED_ERROR) & (np.abs(remaining).max(1, initial=0.0) < CONVERGED)
    return result.q[(result.residual < CLOSED_ERROR) | rounded]


def _rank(loops: ModelLoops, qpos: Array, dofs: NDArray[np.int64]) -> int:
    """Return the largest rank of the loop Jacobian by some DOFs at configurations (n, nq)."""
    jacobians = (loops.linearise(qpos)[1] * loops.units)[:, :, dofs]
    scale = np.linalg.norm(jacobians, axis=(1, 2))
    return int(np.linalg.matrix_rank(jacobians, tol=ROUNDED_RANK * scale).max(initial=0))


def outside_limits(model: mujoco.MjModel, qpos: Array) -> NDArray[np.bool_]:
    """Return whether each joint is outside its limits at configurations (n, nq), (n, njnt)."""
    limited = np.isin(np.arange(model.njnt), limited_joints(model))
    values, (low, high) = qpos[:, model.jnt_qposadr], model.jnt_range.T
    return limited & ((values < low - ROUNDING) | (values > high + ROUNDING))


def driver_ranges(path: StraightPath) -> tuple[Array, Array]:
    """Return the limits of the drivers, (k,) each; by default for a revolution or a characteristic length.

    Both limits are at most FARTHEST from the reference.
    """
    model, dofs = path.loops.model, path.drivers
    joints, start = model.dof_jntid[dofs], path.origin
    reach = np.where(path.loops.angular_dofs[dofs], np.pi, path.loops.characteristic_length)
    limited = np.isin(joints, limited_joints(model))
    low, high = model.jnt_range[joints].T
    reach = np.where(limited, 0.5 * FARTHEST * path.loops.units[dofs], reach)
    low, high = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
    return np.maximum(low, start - reach), np.minimum(high, start + reach)


def scalar_dof(model: mujoco.MjModel, name: str) -> int:
    """Return the degree of freedom of a hinge or slide."""
    joints = scalar_joints(model)
    if name not in joints:
        raise InputError(f"there is no hinge or slide {name!r}; joints are {first_names(joints) or 'none'}")
    return int(model.jnt_dofadr[joints[name]])
