"""Maps from motors to joints of a closed-loop model over a grid: positions, Jacobians, torques, inertia."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement
from math import comb

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.mechanism.limits import require_count
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import ROUNDING, Array
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation import closed_configurations
from mechsim.simulation.closed_configurations import BATCH, StraightPath, straight_path
from mechsim.simulation.loop_jacobian import of_dofs, products
from mechsim.simulation.mjcf_reader.pose_chains import POSITIONS, ROTATIONS, site_or_body
from mechsim.simulation.state import PointJacobians, mass_matrix, rotation_vector_rates, scalar_joints

# largest step h of a joint in central differences of fourth order, in [rad] or characteristic lengths:
# truncation h^4/30 and rounding 1e-15/h are both about 1e-12
STEP = 1e-3
# maximum number of grid points, some 10 kB each, and of terms of a polynomial
MAX_POINTS, MAX_TERMS = 200_000, 1000
# required number of reached grid points per term of a polynomial
POINTS_PER_TERM = 2
# number of random points between the grid points that measure the error of a polynomial
CHECK_SAMPLES = 2000
# names of the arrays in the output file
ARRAYS = (
    *("input", "output", "jacobian", "jacobian_derivative", "torque_map", "reflected_inertia"),
    *("holding_torque", "qpos"),
)


@dataclass(frozen=True, eq=False)
class Polynomials:
    """Polynomials of normalised inputs u = (input - centre) / half_range, one for each output.

    Attributes:
        exponents: powers of the inputs in each term, (t, k).
        coefficients: coefficients of the terms of each output, (m, t) in [m] or [rad].
        centre, half_range: centres and half ranges of the inputs, (k,) in [m] or [rad].
        position_error: largest error of each output between grid points, (m,) in [m] or [rad].
        torque_error: largest error of the Jacobian of each output between grid points, (m,): motor torque or
            force per torque or force at the output.
    """

    exponents: NDArray[np.int64]
    coefficients: Array
    centre: Array
    half_range: Array
    position_error: Array = field(default_factory=lambda: np.zeros(0))
    torque_error: Array = field(default_factory=lambda: np.zeros(0))

    def values(self, inputs: Array) -> Array:
        """Return the outputs at inputs (n, k), (n, m)."""
        return self.terms(inputs) @ self.coefficients.T

    def jacobian(self, inputs: Array) -> Array:
        """Return the derivatives of the outputs by the inputs, (n, m, k)."""
        columns = list[Array]()
        for i, half_range in enumerate(self.half_range.tolist()):
            lowered = self.exponents.copy()
            lowered[:, i] = np.maximum(lowered[:, i] - 1, 0)
            weights = self.coefficients * self.exponents[:, i] / half_range
            columns.append(self.terms(inputs, lowered) @ weights.T)
        return np.stack(columns, 2)

    def terms(self, inputs: Array, exponents: NDArray[np.int64] | None = None) -> Array:
        """Return the terms without coefficients at inputs (n, k), (n, t)."""
        u = (inputs - self.centre) / self.half_range
        powers = self.exponents if exponents is None else exponents
        return np.prod(u[:, None, :] ** powers, axis=2)


@dataclass(frozen=True, eq=False)
class JointMap:
    """The outputs of a closed-loop model over a grid of its inputs.

    Attributes:
        inputs, outputs: names of the k inputs and m outputs.
        input: positions of the inputs at the n reached grid points, (n, k) in [m] or [rad].
        output: positions of the outputs, (n, m) in [m] or [rad].
        jacobian: derivatives of the outputs by the inputs, (n, m, k). A motor torque or force of
            `jacobian.T @ t` balances torques t at the outputs.
        jacobian_derivative: derivatives of the Jacobian by the inputs, (n, m, k, k); its rate is
            `jacobian_derivative @ input_rate`.
        torque_map: least-norm torque or force at the outputs that balances a unit torque or force of each
            input, (n, m, k): the pseudo-inverse of the transposed Jacobian.
        reflected_inertia: inertia of the whole model at the inputs, (n, k, k) in [kg m2] or [kg].
        holding_torque: torque or force of the inputs that holds the model at rest against gravity and the
            springs of the file, (n, k) in [N m] or [N].
        qpos: configurations in MuJoCo's order, (n, nq).
        reached: fraction of the grid points at which the loops close within the joint limits.
        reference: positions of the inputs at the start of the paths to the grid, (k,).
        locked: hinges and slides that neither inputs nor loops determine, and their positions in the map.
        tracked: sites and bodies whose coordinates are outputs; a hinge may also be called hip.x.
        polynomials: approximation of the outputs; None if it was not requested.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input: Array
    output: Array
    jacobian: Array
    jacobian_derivative: Array
    torque_map: Array
    reflected_inertia: Array
    holding_torque: Array
    qpos: Array
    reached: float
    reference: Array
    locked: Mapping[str, float]
    tracked: tuple[str, ...] = ()
    polynomials: Polynomials | None = None

    __repr__ = short_repr

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name, with those of the polynomials as `polynomial_...`."""
        arrays = {name: getattr(self, name) for name in ARRAYS}
        arrays |= {"inputs": np.array(self.inputs), "outputs": np.array(self.outputs)}
        if self.polynomials is not None:
            arrays |= {f"polynomial_{name}": values for name, values in vars(self.polynomials).items()}
        return arrays


@dataclass(frozen=True, eq=False)
class _Outputs:
    """Joint coordinates, and positions and rotations of sites and bodies, as functions of configurations."""

    path: StraightPath
    names: tuple[str, ...]

    def evaluate(self, qpos: Array) -> tuple[Array, Array]:
        """Return the outputs, (n, m), and their derivatives by the inputs, (n, m, k)."""
        values, gradients = self.gradients(qpos)
        return values, gradients @ input_rates(self.path, qpos)

    def gradients(self, qpos: Array) -> tuple[Array, Array]:
        """Return the outputs, (n, m), and their derivatives by all DOFs, (n, m, nv)."""
        posed = self.path.loops.posed
        reference = posed.body_poses(self.path.reference[None])[1][0]
        kinematics = posed.poses(qpos)
        columns = [self._column(name, qpos, kinematics, reference) for name in self.names]
        values, gradients = (np.stack(arrays, 1) for arrays in zip(*columns, strict=True))
        return values, gradients

    def is_joint(self, name: str) -> bool:
        """Return whether an output is a hinge or slide."""
        return bool(name) and name in scalar_joints(self.path.loops.model)

    def _column(
        self, name: str, qpos: Array, kinematics: tuple[Array, Array, PointJacobians], reference: Array
    ) -> tuple[Array, Array]:
        """Return an output, (n,), and its derivatives by all DOFs, (n, nv).

        A rotation is a component of the rotation vector from the reference, (nbody, 3, 3), in world axes.
        """
        model, (position, rotation, jacobian) = self.path.loops.model, kinematics
        if self.is_joint(name):
            joint = model.joint(name).id
            unit = np.eye(model.nv)[model.jnt_dofadr[joint]]
            return qpos[:, model.jnt_qposadr[joint]], np.broadcast_to(unit, (len(qpos), model.nv))
        subject, _, suffix = name.rpartition(".")
        located = site_or_body(model, subject)
        # those of the frame do not move
        if suffix not in (*POSITIONS, *ROTATIONS) or not (located and model.body_weldid[located[0]]):
            raise InputError(
                f"there is no output {name!r}; give a hinge or slide, or NAME.x to NAME.rz of a moving site "
                "or body"
            )
        body, local = located
        point = position[:, body] + rotation[:, body] @ local
        linear, angular = jacobian(body, point)
        if suffix in POSITIONS:
            component = POSITIONS.index(suffix)
            return point[:, component], linear[:, component].copy()
        from scipy.spatial.transform import Rotation

        component = ROTATIONS.index(suffix)
        vector = Rotation.from_matrix(rotation[:, body] @ reference[body].T).as_rotvec()
        return vector[:, component], (rotation_vector_rates(vector) @ angular)[:, component]


def input_rates(path: StraightPath, qpos: Array) -> Array:
    """Return the rates of all DOFs for unit rates of each driver, (n, nv, k), that keep the loops closed."""
    jacobian, units = path.loops.linearised(qpos)[1], np.eye(path.loops.model.nv)[path.drivers]
    return np.stack([path.closing_rates(jacobian, np.tile(unit, (len(qpos), 1))) for unit in units], 2)


def map_over_grid(
    model: mujoco.MjModel,
    inputs: Sequence[str] | Mapping[str, tuple[float, float] | None],
    outputs: Sequence[str],
    *,
    points: int = 21,
    degree: int | None = None,
    progress: Progress = no_progress,
    start: Array | None = None,
    fix_base: bool = False,
) -> JointMap:
    """Return the outputs of a closed-loop model over a grid of its inputs, in the assembly of the start.

    Args:
        model: the compiled model.
        inputs: hinges or slides, such as those with motors, with their ranges in [rad] or [m]; the default
            range is the joint limits. Other joints that the loops do not determine stay at the reference.
        outputs: hinges or slides, and sites or bodies as NAME.x, NAME.y, NAME.z in [m] in the world frame, or
            NAME.rx, NAME.ry, NAME.rz, the rotation vector from the reference in [rad].
        points: grid points along each input.
        degree: total degree of polynomials that approximate the outputs; None for none.
        progress: called with a text and the finished fraction.
        start: as in `closed_qpos`.
        fix_base: whether free joints stay at the start.

    Returns:
        The map at the grid points that are reached on straight paths from the reference. Configurations
        close to 1e-12, and Jacobians are exact to rounding. Derivatives of Jacobians are exact to about 1e-12
        times the condition number of the loops.

    Raises:
        InputError: if a name is unknown, an input has no range or limits, or the grid is too large.
        AssemblyError: if no grid point is reached, or too few for the polynomials.

    Example:
        >>> table = map_over_grid(model, ["left_motor", "right_motor"], ["pitch", "roll"], degree=5)
        >>> table.jacobian.shape
        (441, 2, 2)
    """
    names = tuple(inputs)
    if not names or not outputs:
        raise InputError("a map needs one input and one output or more; name them")
    along = f"the points of the grid with {points:,} along each of {len(names)} inputs"
    require_count(along, points ** len(names), MAX_POINTS, "change --points", least=2)
    if degree is not None:
        require_count("the degrees of the polynomials", degree, MAX_TERMS, "give a lower --degree")
        terms = comb(degree + len(names), degree)
        require_count(f"the terms of degree {degree}", terms, MAX_TERMS, "give a lower --degree")
    dofs = [closed_configurations.scalar_dof(model, name) for name in names]
    path = straight_path(model, dofs, start, fix_base=fix_base)
    ranges = inputs if isinstance(inputs, Mapping) else dict.fromkeys(names)
    low, high = np.array([_range(path, i, name, ranges[name]) for i, name in enumerate(names)]).T
    axes = [np.linspace(a, b, points) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(names))
    evaluator = _Outputs(path, tuple(outputs))
    pieces: list[tuple[Array, NDArray[np.bool_]]] = []
    for first in range(0, len(grid), BATCH):
        progress(f"{first:,} of {len(grid):,} points", first / len(grid))
        pieces.append(path.reach(grid[first : first + BATCH]))
    qpos, valid = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    if not valid.any():
        raise AssemblyError("no grid point is reached from the start; begin in it by --start JOINT=VALUE")
    qpos, reached = qpos[valid], grid[valid]
    output, jacobian = evaluator.evaluate(qpos)
    inertia, holding = inertia_and_holding(path, qpos)
    table = JointMap(
        names,
        tuple(outputs),
        reached,
        output,
        jacobian,
        _jacobian_derivative(evaluator, qpos),
        np.swapaxes(np.linalg.pinv(jacobian), 1, 2).astype(np.float64),
        inertia,
        holding,
        qpos,
        len(qpos) / len(grid),
        path.reference[path.addresses],
        _locked(path),
        tuple(sorted({name.rpartition(".")[0] for name in outputs if not evaluator.is_joint(name)})),
    )
    return table if degree is None else _with_polynomials(table, evaluator, degree, low, high)


def _range(
    path: StraightPath, index: int, name: str, ends: tuple[float, float] | None
) -> tuple[float, float]:
    """Return the requested range of an input, or the limits of the joint."""
    model, joint = path.loops.model, int(path.loops.model.dof_jntid[path.drivers[index]])
    if ends is None:
        if not model.jnt_limited[joint]:
            raise InputError(f"joint {name} has no limits; give its range, as {name}=-20deg:20deg")
        low, high = (float(bounds[index]) for bounds in closed_configurations.driver_ranges(path))
    else:
        low, high = ends
    if not -np.inf < low < high < np.inf:
        raise InputError(
            f"the range of {name} is {low:g} to {high:g}; give a lower and a higher finite value"
        )
    if high - low < ROUNDING * path.loops.units[path.drivers[index]]:
        raise InputError(f"the range of {name}, {low:g} to {high:g}, is as narrow as rounding; widen it")
    return low, high


def _locked(path: StraightPath) -> dict[str, float]:
    """Return the hinges and slides that stay at the reference, and their reference positions."""
    model = path.loops.model
    moving = np.isin(np.arange(model.nv), [*path.drivers, *path.passive])
    return {
        name: float(path.reference[model.jnt_qposadr[joint]])
        for name, joint in scalar_joints(model).items()
        if not moving[model.jnt_dofadr[joint]]
    }


def _jacobian_derivative(evaluator: _Outputs, qpos: Array) -> Array:
    """Return the derivatives of the Jacobian by the inputs, (n, m, k, k).

    G r_j = 0 holds for the constraint Jacobian G and the rates r_j of all DOFs at a unit rate of input j.
    Along input i, dG/du_i r_j + G dr_j/du_i = 0. Differences are taken of G and the gradients of the outputs
    only, which vary slowly even near a singular configuration; r_j varies fast there.
    """
    path, rates = evaluator.path, input_rates(evaluator.path, qpos)
    (residual, constraint), gradients = path.loops.linearised(qpos), evaluator.gradients(qpos)[1]
    passive, columns = of_dofs(constraint, path.passive), list[Array]()
    for i in range(len(path.drivers)):
        direction = rates[:, :, i]
        step = STEP / np.abs(direction / path.loops.units).max(1)
        errors = [np.zeros_like(residual) for _ in path.drivers]
        gradient_change = np.zeros_like(gradients)
        for multiple, weight in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0)):
            displaced = path.loops.displaced(qpos, multiple * step[:, None] * direction)
            scale, jacobian = weight / (12.0 * step), path.loops.linearised(displaced)[1]
            for error, along in zip(errors, np.moveaxis(rates, 2, 0), strict=True):
                error += scale[:, None] * products(jacobian, along)
            gradient_change += scale[:, None, None] * evaluator.gradients(displaced)[1]
        passive_change = np.stack([-path.passive_solution(passive, error) for error in errors], 2)
        columns.append(gradient_change @ rates + gradients[:, :, path.passive] @ passive_change)
    return np.stack(columns, -1)


def inertia_and_holding(path: StraightPath, qpos: Array) -> tuple[Array, Array]:
    """Return inertia and holding torque at the inputs, (n, k, k) and (n, k), by virtual work."""
    model, rates = path.loops.model, input_rates(path, qpos)
    data, inputs = mujoco.MjData(model), rates.shape[2]
    inertia, forces = np.empty((len(qpos), inputs, inputs)), np.empty((len(qpos), inputs))
    for i, (state, along) in enumerate(zip(qpos, rates, strict=True)):
        data.qpos[:], data.qvel[:] = state, 0.0
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        inertia[i] = along.T @ mass_matrix(data) @ along
        forces[i] = along.T @ (data.qfrc_bias - data.qfrc_passive)
    return inertia, forces


def _with_polynomials(table: JointMap, evaluator: _Outputs, degree: int, low: Array, high: Array) -> JointMap:
    """Return a map with polynomials fitted to its grid and checked at random points between."""
    count = len(table.inputs)
    terms = [
        np.bincount(chosen, minlength=count)
        for total in range(degree + 1)
        for chosen in combinations_with_replacement(range(count), total)
    ]
    if len(table.input) < POINTS_PER_TERM * len(terms):
        raise AssemblyError(
            f"{len(table.input)} grid points are reached, too few for {len(terms)} terms; give more points "
            "or a lower degree"
        )
    fit = Polynomials(np.array(terms), np.zeros((0, 0)), 0.5 * (low + high), 0.5 * (high - low))
    coefficients: Array = np.asarray(np.linalg.lstsq(fit.terms(table.input), table.output)[0].T, dtype=float)
    fit = replace(fit, coefficients=coefficients)
    drawn = np.random.default_rng(0).uniform(low, high, (CHECK_SAMPLES, count))
    qpos, valid = evaluator.path.reach(drawn)
    if not valid.any():
        raise AssemblyError("no point between the grid points is reached; give a smaller range")
    output, jacobian = evaluator.evaluate(qpos[valid])
    position_error = np.abs(fit.values(drawn[valid]) - output).max(0)
    torque_error = np.abs(fit.jacobian(drawn[valid]) - jacobian).max((0, 2))
    fit = replace(fit, position_error=position_error, torque_error=torque_error)
    return replace(table, polynomials=fit)
