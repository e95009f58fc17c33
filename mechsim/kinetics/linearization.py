"""Linear dynamics about an equilibrium: stability, natural frequencies, damping, mode shapes, response.

In independent coordinates u along a basis N of the constraint null space, M u'' + C u' + K u = 0. The
matrices are exact derivatives by complex steps: with Q + J' lambda = 0 at the equilibrium,
K = -N' d(Q + J' lambda)/dq N at constant lambda, and C = -N' dQ/dv N.

Source: K. Ogata, Modern Control Engineering (2010), chapter 9 (state space); E. E. Zajac, The Kelvin-Tait-
Chetaev theorem and extensions, Journal of the Astronautical Sciences 11 (1964) 46-49 (stability).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses
from mechsim.kinematics.loops.start import CLOSED, close_nearest
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.mechanism.motion import join
from mechsim.numerics.arrays import Array
from mechsim.numerics.differences import extrapolated_derivative
from mechsim.numerics.jets import change_of, stepped
from mechsim.numerics.quadratic_roots import ROUNDING, Roots, quadratic_roots
from mechsim.numerics.rank import SPARSE, least_norm, pseudo_inverse, right_vectors, significant

if TYPE_CHECKING:
    from mechsim.numerics.banded import LeastNormSystems

# displacements in [rad] or characteristic lengths by which the stiffness is evaluated next to an equilibrium:
# the rounding of its coordinates; their number; and the multiple of the largest change that bounds the error
NEIGHBOUR, NEIGHBOURS, SAFETY = 1e-13, 6, 8.0
# largest displacement in a direction in which the force stays below its rounding: a potential of order four
FLAT = 1e-4

# singular values of the loops below this fraction of the largest are zero: loops of a singular configuration
# close to 1e-8 only
NEAR_SINGULAR = 1e-6
# number of links of all states whose forces are evaluated together: a few MB, which a cache holds; ten times
# as many, or as few, take 1.3 or 1.9 times as long (`validation/speed/loop_speed.py`)
LINK_STATES = 10_000

Complex = NDArray[np.complex128]
# a function of n states with values (n,)
Quantity = Callable[[Kinematics], Array]


@dataclass(frozen=True, slots=True)
class Mode:
    """A mode of free motion.

    Attributes:
        frequency: undamped natural frequency |s| / 2 pi of the eigenvalue s, in [Hz].
        damping_ratio: -Re s / |s|; 1 for a mode that decays without oscillation, -1 for one that grows.
        eigenvalue: s in [1/s].
        error: bound of the error of s from rounding, in [1/s].
        shape: joint coordinate -> complex amplitude in [m] or [rad]; the largest, in characteristic lengths
            and radians, is 1.
    """

    frequency: float
    damping_ratio: float
    eigenvalue: complex
    error: float
    shape: Mapping[str, complex]


@dataclass(frozen=True)
class LinearModel:
    """The linear equations M u'' + C u' + K u = 0 about a configuration at rest.

    Attributes:
        equations: equations of motion.
        q: the configuration.
        basis: basis of the null space of the loop constraints in the free coordinates in units, (free, dof).
        mass: M, (dof, dof).
        damping: C, (dof, dof).
        stiffness: K, (dof, dof).
        stiffness_error: bounds of the errors of K, (dof, dof).
    """

    equations: EquationsOfMotion
    q: Coordinates
    basis: Array
    mass: Array
    damping: Array
    stiffness: Array
    stiffness_error: Array

    @property
    def matrix(self) -> Array:
        """A in x' = A x with x = (u, u'), (2 dof, 2 dof)."""
        dof = len(self.mass)
        lower = -np.linalg.solve(self.mass, np.concatenate([self.stiffness, self.damping], 1))
        return np.asarray(np.concatenate([np.eye(dof, 2 * dof, dof), lower]), np.float64)

    def without(self, names: Iterable[str]) -> "LinearModel":
        """The linear model in which some coordinates rest, as on stops."""
        index_of = self.equations.loops.tree.index_of
        rows = self.basis[np.isin(self.equations.free, [index_of[name] for name in names])]
        (dof,), (right,) = directions_within(rows[None])
        along = right[len(right) - dof :].T
        mass, damping, stiffness = (
            along.T @ each @ along for each in (self.mass, self.damping, self.stiffness)
        )
        error = np.abs(along.T) @ self.stiffness_error @ np.abs(along)
        return LinearModel(self.equations, self.q, self.basis @ along, mass, damping, stiffness, error)

    @cached_property
    def conservative(self) -> bool:
        """Whether K is symmetric within its error, C symmetric and nowhere negative."""
        stiffness = self.stiffness - self.stiffness.T
        damping, scale = self.damping - self.damping.T, float(np.linalg.norm(self.damping))
        lowest = np.linalg.eigvalsh(self.damping + self.damping.T).min(initial=0.0)
        return bool(
            (np.abs(stiffness) <= self.stiffness_error + self.stiffness_error.T).all()
            and (np.abs(damping) <= ROUNDING * scale).all()
            and lowest >= -ROUNDING * scale
        )

    @cached_property
    def principal(self) -> tuple[Array, Array, Array]:
        """Values x' K x, (dof,), of vectors x' M x = 1 that diagonalise K's symmetric part; errors; vectors.

        The values are quotients of the vectors, so that their errors are those of K in the directions of the
        vectors, not of its largest entry: a low stiffness next to a high one is kept.
        """
        inverse = np.asarray(np.linalg.inv(np.linalg.cholesky(self.mass)), np.float64)
        symmetric = 0.5 * (self.stiffness + self.stiffness.T)
        _, vectors = np.linalg.eigh(inverse @ symmetric @ inverse.T)
        shapes = inverse.T @ vectors.astype(np.float64)
        values = np.einsum("ik,ij,jk->k", shapes, symmetric, shapes)
        error = self.stiffness_error + ROUNDING * np.abs(symmetric)
        return values, np.einsum("ik,ij,jk->k", np.abs(shapes), error, np.abs(shapes)), shapes

    @cached_property
    def neutral(self) -> Array:
        """Directions without restoring force within the error of K, (dof, k)."""
        if self.conservative:
            values, errors, shapes = self.principal
            return shapes[:, np.abs(values) <= errors]
        _, values, right = np.linalg.svd(self.stiffness)
        return right[values <= np.linalg.norm(self.stiffness_error)].T

    @cached_property
    def roots(self) -> Roots:
        """The eigenvalues s of s2 M + s C + K; those of directions without restoring force are 0."""
        values, errors, shapes = self.principal
        damping, stiffness = (shapes.T @ matrix @ shapes for matrix in (self.damping, self.stiffness))
        error = np.abs(shapes.T) @ self.stiffness_error @ np.abs(shapes)
        if not self.conservative:
            return quadratic_roots(damping, stiffness, error, self._zero_roots)
        neutral = np.abs(values) <= errors
        values = np.where(neutral, 0.0, values)
        if not self.damping.any():
            positive = np.sqrt(-values.astype(np.complex128))
            with np.errstate(divide="ignore", invalid="ignore"):
                errors = np.where(neutral, 0.0, 0.5 * errors / np.abs(positive))
            unit = np.tile(np.eye(len(values), dtype=np.complex128), (2, 1))
            return Roots(np.concatenate([positive, -positive]), np.tile(errors, 2), unit)
        error = np.diag(np.where(neutral, 0.0, errors))
        return quadratic_roots(damping, np.diag(values), error, self._zero_roots)

    @property
    def _zero_roots(self) -> int:
        """Number of roots that are 0: two for each direction without restoring force, one if it is damped."""
        force, scale = self.damping @ self.neutral, float(np.linalg.norm(self.damping))
        braked = np.linalg.matrix_rank(force, ROUNDING * scale) if force.size and scale else 0
        return 2 * self.neutral.shape[1] - int(braked)

    def stable(self, in_family: bool = False) -> bool | None:
        """Return whether small motions do not grow; None if the errors of the eigenvalues do not decide it.

        If C is positive semidefinite and K symmetric, as many eigenvalues have a positive real part as K has
        negative ones, whatever the damping (Kelvin, Tait, Chetaev). In a family of equilibria directions
        without restoring force are motions along it.
        """
        values, errors, _ = self.principal
        if not self.conservative:
            values, errors = -self.roots.values.real, self.roots.errors
        if (values < -errors).any():
            return False
        decided = values > errors
        zeros = (self.neutral.shape[1] if self.conservative else self._zero_roots) if in_family else 0
        return True if np.count_nonzero(~decided) <= zeros else None

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """The modes by increasing frequency.

        A complex pair of eigenvalues is one mode, and so is a displacement without restoring force.
        """
        roots, (_, _, shapes) = self.roots, self.principal
        modes = [Mode(0.0, 0.0, 0j, 0.0, self._by_name(along)) for along in self.neutral.T]
        for i in np.argsort(np.abs(roots.values)).tolist():
            value, scale = complex(roots.values[i]), abs(roots.values[i])
            if value.imag >= 0.0 and scale > 0.0:
                shape, ratio = self._by_name(shapes @ roots.vectors[i]), float(-value.real / scale + 0.0)
                error = float(roots.errors[i])
                modes.append(Mode(float(scale / (2.0 * np.pi)), ratio, value, error, shape))
        return tuple(modes)

    def _by_name(self, displacement: NDArray[np.complexfloating | np.floating]) -> dict[str, complex]:
        loops, free = self.equations.loops, self.equations.free
        scaled: Complex = self.basis @ displacement.astype(np.complex128)
        amplitude = np.zeros(loops.tree.count, np.complex128)
        amplitude[free] = scaled / scaled[np.argmax(np.abs(scaled))] * loops.units[free]
        return {name: complex(amplitude[i]) for name, i in loops.tree.index_of.items()}

    def response(self, load: Quantity, output: Quantity, frequencies: ArrayLike) -> Complex:
        """Return the complex frequency response from a unit load to an output, (n,).

        Args:
            load: displacement on which the load does work: the coordinate of a joint for its torque, the
                component of a point for a force; its gradient is the load's generalised force.
            output: the quantity of the response.
            frequencies: (n,) in [Hz].
        """
        forces, readings = (
            gradient(self.equations, self.q, self.basis, quantity) for quantity in (load, output)
        )
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequencies, dtype=np.float64))[:, None, None]
        matrices = s**2 * self.mass + s * self.damping + self.stiffness
        return np.linalg.solve(matrices, forces.astype(np.complex128)[:, None])[..., 0] @ readings


def linear_model(equations: EquationsOfMotion, q: Coordinates, *, isolated: bool = True) -> LinearModel:
    """Return the linear model about an equilibrium.

    The error of K is bounded by its changes over the configurations that rounding of coordinates and forces
    does not distinguish from the equilibrium. Coulomb friction is ignored: it has no derivative at rest.
    Loads over time have their values at time zero.

    Args:
        equations: equations of motion.
        q: the configuration.
        isolated: whether it is determined by its forces; in a family of equilibria it is arbitrary.
    """
    basis = independent_rates(equations, q)
    dof, random = basis.shape[1], np.random.default_rng(0)
    exact = reduced_forces(equations, q, basis[None])
    stiffness = exact.stiffness[0]
    steps = np.zeros((equations.loops.tree.count, NEIGHBOURS))
    steps[equations.free] = NEIGHBOUR * random.choice([-1.0, 1.0], (len(equations.free), NEIGHBOURS))
    if isolated:
        values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
        radii = FLAT / np.maximum(FLAT * np.abs(values) / max(exact.rounding[0], 1e-300), 1.0)
        signs = random.choice([-1.0, 1.0], (dof, NEIGHBOURS))
        steps[equations.free] += basis @ (vectors @ (radii[:, None] * signs))
    neighbours = equations.loops.displaced(q.repeated(NEIGHBOURS), steps)
    around = reduced_forces(equations, neighbours, np.broadcast_to(basis, (NEIGHBOURS, *basis.shape)))
    error = SAFETY * np.abs(around.stiffness - stiffness).max(0, initial=0.0) + exact.stiffness_rounding[0]
    rates = np.zeros((equations.loops.tree.count, dof))
    rates[equations.free] = basis
    moving = equations.kinematics(q.repeated(dof), rates)
    twist = equations.of_links(moving.twist)
    twist, momentum = (
        each.reshape(dof, 6 * len(equations.links))
        for each in (twist, (moving.inertia @ twist[..., None])[..., 0])
    )
    mass = twist @ momentum.T + basis.T @ equations.rotors @ basis
    rates = stepped(0.0 * rates, rates)
    still = equations.loops.displaced(q.repeated(dof), 0.0 * rates)
    forces, _ = equations.smooth_forces(equations.kinematics(still, rates))
    return LinearModel(equations, q, basis, mass, -basis.T @ change_of(forces).T, stiffness, error)


@dataclass(frozen=True, slots=True)
class ReducedForces:
    """Generalised forces at rest along independent directions in n configurations.

    Attributes:
        force: N' Q, (n, dof).
        stiffness: K, minus its derivative along the closed loops, (n, dof, dof).
        stiffness_rounding: bound of its rounding, (n, dof, dof).
        rounding: bound of the rounding of the force, (n,).
    """

    force: Array
    stiffness: Array
    stiffness_rounding: Array
    rounding: Array


def reduced_forces(equations: EquationsOfMotion, q: Coordinates, basis: Array) -> ReducedForces:
    """Return the generalised forces of n configurations along bases (n, free, dof) of their null spaces."""
    n, free, dof = basis.shape
    together = max(1, LINK_STATES // max(1, dof * len(equations.links)))
    if n > together:
        chunks = [np.arange(first, min(first + together, n)) for first in range(0, n, together)]
        each = [reduced_forces(equations, q.select(chunk), basis[chunk]) for chunk in chunks]
        return join(each)
    step = np.zeros((equations.loops.tree.count, n * dof))
    step[equations.free] = basis.transpose(1, 0, 2).reshape(free, -1)
    at_rest = equations.kinematics(q, np.zeros_like(q.values))
    force, magnitude = equations.smooth_forces(at_rest)
    repeated = q.select(np.repeat(np.arange(n), dof))
    state = equations.kinematics(equations.loops.displaced(repeated, stepped(0.0 * step, step)), 0.0 * step)
    forces, terms = equations.smooth_forces(state)
    reaction, sizes = np.zeros((2, equations.loops.tree.count, n * dof))
    if equations.loops.rows and dof:
        multipliers = _multipliers(equations, at_rest, force)
        bending = equations.loops.sparse(state.q, state.poses)[1]
        terms_of_rows = change_of(bending.values) * np.repeat(multipliers, dof, 0).T[bending.rows]
        np.add.at(reaction, bending.columns, terms_of_rows)
        np.add.at(sizes, bending.columns, np.abs(terms_of_rows))
    sizes = change_of(terms) + sizes[equations.free].T
    change = (change_of(forces) + reaction[equations.free].T).reshape(n, dof, free)
    along = np.swapaxes(basis, 1, 2)
    stiffness = -along @ np.swapaxes(change, 1, 2)
    sizes = np.abs(along) @ np.swapaxes(sizes.reshape(n, dof, free), 1, 2)
    # coordinates have the rounding of the links' distances from the origin
    distance = max(1.0, np.abs(at_rest.poses.position).max(initial=0.0) / equations.loops.tree.length)
    # directions that satisfy loops have the rounding of a unit vector, also where they have no component
    closed_loops = equations.loops.rows or equations.prescribed
    reach = np.ones_like(along) if closed_loops else np.abs(along)
    magnitudes = (reach @ magnitude[..., None]).max((1, 2), initial=0.0)
    rounding = ROUNDING * (magnitudes + distance * sizes.max((1, 2), initial=0.0))
    return ReducedForces((along @ force[..., None])[..., 0], stiffness, ROUNDING * sizes, rounding)


def _multipliers(equations: EquationsOfMotion, state: Kinematics, force: Array) -> Array:
    """Return the multipliers of the loops, (n, rows), that balance forces (n, free) of n states at rest."""
    loops, unsolved = equations.loops, np.ones(len(force), dtype=np.bool_)
    multipliers = np.zeros((len(force), loops.rows))
    systems = _systems(equations, state.q, state.poses)
    if systems is not None and systems.null_bases[1].any():
        unsolved = ~systems.null_bases[1]
        multipliers[:, systems.rows] = systems.solved(-force[None])[1][0]
    if unsolved.any():
        jacobian = equations.kinematics(state.q.select(unsolved), state.rates[:, unsolved]).jacobian
        inverse = pseudo_inverse(jacobian.transpose(0, 2, 1), NEAR_SINGULAR)
        multipliers[unsolved] = -(inverse @ force[unsolved, :, None])[:, : loops.rows, 0]
    return multipliers


def _systems(
    equations: EquationsOfMotion, q: Coordinates, poses: LinkPoses | None = None
) -> "LeastNormSystems | None":
    """Return the loops as sparse systems; None for few coordinates, prescribed ones, or a wide band."""
    loops = equations.loops
    if len(loops.unknown) < SPARSE or not loops.rows or equations.prescribed:
        return None
    from mechsim.kinematics.loops.sparse_loops import loop_systems

    return loop_systems(loops, q, poses)[1]


def independent_rates(equations: EquationsOfMotion, q: Coordinates) -> Array:
    """Return an orthonormal basis of the free coordinates' rates that satisfy the loops, (free, dof)."""
    return null_directions(equations, q)[1][0]


def null_directions(equations: EquationsOfMotion, q: Coordinates) -> tuple[NDArray[np.intp], Array]:
    """Return the degrees of freedom (n,) and bases of the rates that satisfy the loops, (n, free, most).

    The last vectors of each basis, as many as its degrees of freedom, are orthonormal, the others zero.
    """
    systems = _systems(equations, q)
    if systems is None:
        return _null_bases(equations, q)
    bases, independent = systems.null_bases
    dofs = np.full(len(q), bases.shape[2])
    if independent.all():
        return dofs, bases
    dofs[~independent], others = _null_bases(equations, q.select(~independent))
    most = int(dofs.max())
    padded = np.zeros((*bases.shape[:2], most))
    for which, own in ((independent, bases[independent]), (~independent, others)):
        padded[which, :, most - own.shape[2] :] = own
    return dofs, padded


def _null_bases(equations: EquationsOfMotion, q: Coordinates) -> tuple[NDArray[np.intp], Array]:
    dofs, right = directions_within(equations.loops.linearise(q)[1][:, equations.free].transpose(2, 0, 1))
    most = int(dofs.max(initial=0))
    bases = right[:, right.shape[1] - most :] * (np.arange(most) >= most - dofs[:, None])[..., None]
    return dofs, np.swapaxes(bases, 1, 2)


def directions_within(jacobian: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the degrees of freedom (n,) and right singular vectors (n, free, free) of constraint Jacobians.

    The last vectors, as many as degrees of freedom, are a basis of the rates that satisfy the constraints.
    """
    n, _, free = jacobian.shape
    if not jacobian.size:
        return np.full(n, free), np.broadcast_to(np.eye(free), (n, free, free))
    values, right = right_vectors(jacobian)
    return free - significant(values, NEAR_SINGULAR).sum(1), right.astype(np.float64)


def displaced_states(
    equations: EquationsOfMotion, q: Coordinates, basis: Array, u: Array, rates: Array | None = None
) -> tuple[Kinematics, NDArray[np.bool_]]:
    """Return states at independent displacements and rates from n configurations, and which are closed.

    Args:
        equations: equations of motion.
        q: n configurations, or one.
        basis: bases of their independent coordinates, (n, free, dof), or (free, dof) of one.
        u: displacements, (n, dof).
        rates: rates, (n, dof); None at rest.
    """
    loops, free, n = equations.loops, equations.free, len(u)
    q, basis = (q if len(q) == n else q.repeated(n)), np.broadcast_to(basis, (n, *basis.shape[-2:]))
    step = np.zeros((loops.tree.count, n))
    step[free] = (basis @ u[..., None])[..., 0].T
    moved, gap = close_nearest(loops, loops.displaced(q, step))
    velocity = np.zeros((loops.tree.count, n))
    if rates is not None and rates.any():
        jacobian = loops.linearise(moved)[1][:, free].transpose(2, 0, 1)
        rows = np.concatenate([jacobian, np.swapaxes(basis, 1, 2)], 1)
        velocity[free] = least_norm(rows, np.concatenate([np.zeros((n, loops.rows)), rates], 1)).T
    return equations.kinematics(moved, velocity), gap <= CLOSED


def states_about(
    equations: EquationsOfMotion, q: Coordinates, basis: Array, u: Array, rates: Array
) -> Kinematics:
    """Return the closed states at independent displacements and rates, (n, dof) each, from one configuration.

    Raises:
        AssemblyError: if the loops of a state do not close.
    """
    state, closed = displaced_states(equations, q, basis, u, rates)
    if not closed.all():
        name = equations.model.mechanism.name
        raise AssemblyError(f"{name}: the loops do not close next to the equilibrium")
    return state


def gradient(equations: EquationsOfMotion, q: Coordinates, basis: Array, quantity: Quantity) -> Array:
    """Return the derivative of a quantity of the state by the independent coordinates, (dof,)."""
    dof = basis.shape[1]

    def difference(step: float) -> Array:
        u = step * np.concatenate([np.eye(dof), -np.eye(dof)])
        values = quantity(states_about(equations, q, basis, u, np.zeros_like(u)))
        return (values[:dof] - values[dof:]) / (2.0 * step)

    return extrapolated_derivative(difference)[0]
