"""Statics of any mechanism: equilibria under its loads, and drive forces that hold a configuration."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.dynamics.dynamic_run import initial_values, require_inertia, require_regular
from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion, equations_of_motion
from mechsim.analytic.dynamics.initial_state import initial_state, projected
from mechsim.analytic.dynamics.linearization import (
    LinearModel,
    Mode,
    displaced_states,
    independent_rates,
    linear_model,
)
from mechsim.analytic.dynamics.model import DynamicModel, dynamic_model
from mechsim.analytic.dynamics.state_quantities import (
    change_from,
    displacement_of,
    joined_configurations,
    load_displacement,
)
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.errors import AssemblyError, InputError
from mechsim.model.forces import Forces
from mechsim.numerics.angles import REVOLUTION, wrapped
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import significant

# default number of starts, reached by random steps along the motion of the mechanism
STARTS = 20
# number of additional random configurations for mechanisms without loops
RANDOM_CONFIGURATIONS = 10
# length of one of these random steps, in [rad] or characteristic lengths
RANDOM_STEP = 0.7
# largest number of Newton steps from each start, and largest step
NEWTON_STEPS, MAX_STEP = 60, 0.3
# step below which Newton's method has converged
CONVERGED = 1e-12
# residual acceleration at an equilibrium, as a fraction of the largest so far, or of the largest change per
# radian
BALANCED = 1e-8
# stiffnesses below this fraction of the largest are zero: passive degrees of freedom, such as the rotation of
# a rod between two balls; differences have an error of 1e-9
SINGULAR = 1e-6
# difference of coordinates in [rad] or characteristic lengths below which equilibria are equal
SAME_EQUILIBRIUM = 1e-6
# step of the central difference for Newton's method
STEP = 1e-5
# acceleration in [1/s2] below which a configuration is at rest: a motion of 0.1 rad then takes 12 hours
AT_REST = 1e-10


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """A configuration at rest under the loads.

    Attributes:
        q: joint coordinate -> value in [m] or [rad]; angles within (-pi, pi].
        stable: whether small motions about it do not grow.
        potential: potential energy of gravity and springs, in [J].
        modes: modes of small vibrations about it.
        linear: the linear model about it.
        reached: whether the search along the motion from the initial configuration found it; otherwise it may
            be in another assembly mode.
        everywhere: whether every configuration of the search is an equilibrium, as without loads.
    """

    q: Mapping[str, float]
    stable: bool
    potential: float
    modes: tuple[Mode, ...]
    linear: LinearModel
    reached: bool = True
    everywhere: bool = False


def equilibria(
    source: Any,
    forces: Forces | None = None,
    *,
    initial: Mapping[str, float | str] | None = None,
    starts: int = STARTS,
    assemblies: int = 0,
    seed: int = 0,
) -> tuple[Equilibrium, ...]:
    """Return the equilibria found by a random search, by increasing potential.

    Newton's method starts at the initial configuration, at `starts` others, each a random step along the
    motion from the one before, and at `assemblies` random configurations that close the loops in any assembly
    mode; without loops, at ten random configurations. Coulomb friction is ignored; loads over time have their
    value at time zero. If every configuration of the search is an equilibrium, the initial one is returned.

    Args:
        source: a mechanism, or an object that has one.
        forces: applied forces; the default is those of the source.
        initial: coordinates `J.q` of the initial configuration.
        starts: number of random steps; 0, with `assemblies` 0, leaves only the initial configuration.
        assemblies: number of random configurations in any assembly mode.
        seed: seed of the random numbers.

    Raises:
        InputError: for invalid values, and for a singular initial configuration without loads.
        AssemblyError: where the loops do not close at the initial values.

    Accuracy: coordinates to about 1e-11 at a regular equilibrium.
    """
    equations, initial_q = _prepared(source, forces, initial or {})
    for name, count in (("starts", starts), ("assemblies", assemblies)):
        if count < 0:
            raise InputError(f"{name} of the search are {count}; give 0 or more")
    starting = [*_starts(equations, initial_q, starts, assemblies, np.random.default_rng(seed))]
    configurations = joined_configurations([q for q, _ in starting])
    if _all_at_rest(equations, configurations):
        require_regular(equations, initial_q, np.zeros_like(initial_q.values))
        return (replace(_described(equations, initial_q), everywhere=True),)
    solutions: list[Equilibrium] = []
    downhill = np.repeat([False, True], len(starting))
    ends = _newton(equations, configurations.repeated(2), downhill)
    # those along the motion first
    order = np.arange(len(ends)).reshape(2, -1).T.ravel().tolist()
    for k in order:
        q, reached = ends[k], starting[k % len(starting)][1]
        if q is None:
            continue
        values = _coordinates(equations, q)
        if not any(_same(equations, values, other.q) for other in solutions):
            solutions.append(replace(_described(equations, q), reached=reached))
    return tuple(sorted(solutions, key=lambda equilibrium: equilibrium.potential))


def _starts(
    equations: EquationsOfMotion,
    q: Coordinates,
    starts: int,
    assemblies: int,
    random: np.random.Generator,
) -> Iterator[tuple[Coordinates, bool]]:
    """Yield configurations, and whether they are reached along the motion from the first."""
    yield q, True
    for _ in range(starts):
        q = _random_step(equations, q, random)
        yield q, True
    for _ in range(assemblies if equations.loops.rows else RANDOM_CONFIGURATIONS if starts else 0):
        closed = _random_configuration(equations, q, random)
        if closed is not None:
            # without loops there is only one assembly mode
            yield closed, not equations.loops.rows


def modes(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, float | str] | None = None
) -> tuple[Mode, ...]:
    """Return the modes of small vibrations about an equilibrium; see `nearest_equilibrium`.

    Raises:
        AssemblyError: if there is no equilibrium.

    Accuracy: frequencies to about 1e-11 of their value at a regular equilibrium.
    """
    return nearest_equilibrium(source, forces, initial=initial).modes


def nearest_equilibrium(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, float | str] | None = None
) -> Equilibrium:
    """Return the equilibrium that Newton's method reaches from the initial configuration.

    If it reaches none and `initial` is empty, return the stable equilibrium of least potential energy that
    `equilibria` finds.

    Raises:
        AssemblyError: if there is no such equilibrium.
    """
    equations, q = _prepared(source, forces, initial or {})
    (solution,) = _newton(equations, q, np.zeros(1, dtype=np.bool_))
    if solution is not None:
        return _described(equations, solution)
    stable = [each for each in equilibria(source, forces) if each.stable] if not initial else []
    if not stable:
        raise AssemblyError(
            f"{equations.model.mechanism.name}: no equilibrium is found from the initial configuration; "
            "give another one (--initial J.q=VALUE), or search with --statics"
        )
    return stable[0]


def response(
    source: Any,
    load: str,
    output: str,
    frequencies: ArrayLike,
    forces: Forces | None = None,
    *,
    initial: Mapping[str, float | str] | None = None,
) -> NDArray[np.complex128]:
    """Return the frequency response from a unit load to a quantity about the nearest equilibrium, (n,).

    Args:
        source: a mechanism, or an object that has one.
        load: displacement on which the load does work: a joint coordinate "J" (torque or force in the
            joint), a component "P.x" of a point (force on it in that direction), or "distance:P,Q" (forces
            that push both points apart).
        output: quantity of the response: a displacement, its velocity or its acceleration, such as P.x or
            J.v.
        frequencies: (n,) in [Hz].
        forces: other applied forces; the default is those of the source.
        initial: coordinates `J.q` near the equilibrium.

    Returns:
        Output in SI per [N] or [N m].

    Raises:
        InputError: for an unknown name.
        AssemblyError: if there is no equilibrium.
    """
    linear = nearest_equilibrium(source, forces, initial=initial).linear
    equations = linear.equations
    mechanism = equations.model.mechanism
    displacement = load_displacement(load, mechanism)
    quantity, order = displacement_of(output, mechanism)
    at_rest = equations.kinematics(linear.q, np.zeros((equations.loops.tree.count, 1)))
    entry, reading = (change_from(equations, at_rest, each) for each in (displacement, quantity))
    frequencies = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    derivative = np.asarray((2j * np.pi * frequencies) ** order, dtype=np.complex128)
    return derivative * linear.response(entry, reading, frequencies)


def holding(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, float | str] | None = None
) -> dict[str, float]:
    """Return the drive force of each driver that holds the initial configuration at rest, in [N m] or [N].

    For redundant drivers it is the minimum-norm solution.
    """
    equations, q = _prepared(source, forces, initial or {})
    tree = equations.loops.tree
    indices = [tree.index_of[name] for name in equations.model.mechanism.drivers]
    state = equations.kinematics(q, np.zeros((tree.count, 1)))
    none = np.zeros(len(equations.frictions))
    drive_forces = equations.accelerate(state, np.zeros(1), none, (), indices).contact[:, 0]
    scaled = drive_forces / equations.loops.units[indices]
    return dict(zip(equations.model.mechanism.drivers, scaled.tolist(), strict=True))


def _prepared(
    source: Any, forces: Forces | None, initial: Mapping[str, float | str]
) -> tuple[EquationsOfMotion, Coordinates]:
    model: DynamicModel = source if isinstance(source, DynamicModel) else dynamic_model(source, forces)
    values = initial_values(model, initial)
    equations = equations_of_motion(model, values.coordinates)
    q, rates = initial_state(equations, values)
    require_inertia(equations, q, rates)
    return equations, q


def _all_at_rest(equations: EquationsOfMotion, q: Coordinates) -> bool:
    """Return whether nothing accelerates a mechanism from rest in any of n configurations."""
    at_rest = equations.kinematics(q, np.zeros_like(q.values))
    none = np.zeros(len(equations.frictions))
    acceleration = equations.accelerate(at_rest, np.zeros(len(q)), none).acceleration
    return bool(np.abs(acceleration).max(initial=0.0) <= AT_REST)


def _newton(
    equations: EquationsOfMotion, q: Coordinates, downhill: NDArray[np.bool_]
) -> list[Coordinates | None]:
    """Return the equilibria that Newton's method reaches from n configurations; None where it reaches none.

    Downhill steps (n,) reverse unstable directions, so that they lead to stable equilibria.
    """
    q = Coordinates(q.values.copy(), q.turns.copy())
    active, reached = np.ones(len(q), dtype=np.bool_), np.zeros(len(q), dtype=np.bool_)
    largest = np.zeros(len(q))
    for _ in range(NEWTON_STEPS):
        indices = np.flatnonzero(active)
        if not indices.size:
            break
        dofs, right = _null_spaces(equations, q.select(indices))
        for dof in np.unique(dofs).tolist():
            which = indices[dofs == dof]
            basis = np.swapaxes(right[dofs == dof, right.shape[1] - dof :], 1, 2)
            step, value, scale = _newton_steps(equations, q.select(which), basis, downhill[which])
            largest[which] = np.fmax(largest[which], scale)
            length = np.abs(step).max(1, initial=0.0)
            # an unbounded step ends the search
            step = np.where(np.isfinite(length)[:, None], step, 0.0)
            step *= np.minimum(1.0, MAX_STEP / np.fmax(length, MAX_STEP))[:, None]
            moved, closed = displaced_states(equations, q.select(which), basis, step, np.zeros_like(step))
            q.values[:, which], q.turns[..., which] = moved.q.values, moved.q.turns
            converged = closed & (length < CONVERGED)
            reached[which] = converged & (value <= BALANCED * largest[which])
            active[which] = closed & np.isfinite(length) & ~converged
    return [q.select(np.array([i])) if reached[i] else None for i in range(len(q))]


def _null_spaces(equations: EquationsOfMotion, q: Coordinates) -> tuple[NDArray[np.intp], Array]:
    """Return the dof of n configurations, (n,), and right singular vectors of their loops, (n, free, free).

    The last `dof` rows are a basis of the rates that satisfy the loops.
    """
    jacobian = equations.loops.linearise(q)[1][:, equations.free].transpose(2, 0, 1)
    free = jacobian.shape[2]
    if not jacobian.size:
        return np.full(len(q), free), np.broadcast_to(np.eye(free), (len(q), free, free))
    _, values, right = np.linalg.svd(jacobian)
    return free - significant(values).sum(1), right.astype(np.float64)


def _newton_steps(
    equations: EquationsOfMotion, q: Coordinates, basis: Array, downhill: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Return Newton steps (n, dof), and the magnitudes (n,) of accelerations and of these or their changes.

    Steps are NaN if the loops do not close next to a configuration. `basis` is (n, free, dof).
    """
    n, _, dof = basis.shape
    offsets = STEP * np.concatenate([np.zeros((1, dof)), np.eye(dof), -np.eye(dof)])
    which = np.repeat(np.arange(n), len(offsets))
    u = np.tile(offsets, (n, 1))
    state, closed = displaced_states(equations, q.select(which), basis[which], u, np.zeros_like(u))
    none = np.zeros(len(equations.frictions))
    acceleration = equations.accelerate(state, np.zeros(len(u)), none).acceleration[equations.free]
    values = (acceleration.T[:, None] @ basis[which])[:, 0].reshape(n, len(offsets), dof)
    stiffness = (values[:, 1 : 1 + dof] - values[:, 1 + dof :]).transpose(0, 2, 1) / (2.0 * STEP)
    step = np.full((n, dof), np.nan)
    for i in np.flatnonzero(closed.reshape(n, -1).all(1)).tolist():
        with suppress(np.linalg.LinAlgError):
            step[i] = _newton_step(stiffness[i], values[i, 0], bool(downhill[i]))
    value = np.abs(values[:, 0]).max(1, initial=0.0)
    return step, value, np.fmax(value, np.abs(stiffness).max((1, 2), initial=0.0))


def _newton_step(jacobian: Array, value: Array, downhill: bool) -> Array:
    """Return -jacobian^-1 value; downhill with the real parts of all eigenvalues taken as negative."""
    if not downhill:
        return -np.asarray(np.linalg.lstsq(jacobian, value, rcond=SINGULAR)[0], np.float64)
    values, vectors = np.linalg.eig(jacobian)
    steep = -np.maximum(np.abs(values), SINGULAR * np.abs(values).max(initial=1e-300))
    with np.errstate(over="ignore", invalid="ignore"):
        # an unbounded step ends the search
        return np.real(-vectors @ (np.linalg.solve(vectors, value.astype(np.complex128)) / steep))


def _described(equations: EquationsOfMotion, q: Coordinates) -> Equilibrium:
    linear = linear_model(equations, q)
    at_rest = np.zeros((equations.loops.tree.count, 1))
    _, potential = equations.energy(equations.kinematics(q, at_rest))
    return Equilibrium(_coordinates(equations, q), linear.stable, potential, linear.modes(), linear)


def _coordinates(equations: EquationsOfMotion, q: Coordinates) -> dict[str, float]:
    """Return joint coordinates in [m] and [rad], angles within (-pi, pi]."""
    tree = equations.loops.tree
    return {
        name: float(q.values[i, 0] if tree.slides[i] else wrapped(q.values[i, 0]))
        for name, i in tree.index_of.items()
    }


def _same(equations: EquationsOfMotion, q: Mapping[str, float], other: Mapping[str, float]) -> bool:
    tree = equations.loops.tree
    units = {name: equations.loops.units[i] for name, i in tree.index_of.items()}
    slides = {name: tree.slides[i] for name, i in tree.index_of.items()}
    for name, value in q.items():
        difference = value - other[name]
        if not slides[name]:
            difference -= REVOLUTION * np.round(difference / REVOLUTION)
        if abs(difference) > SAME_EQUILIBRIUM * units[name]:
            return False
    return True


def _random_configuration(
    equations: EquationsOfMotion, q: Coordinates, random: np.random.Generator
) -> Coordinates | None:
    """Return a configuration in any assembly mode: random coordinates closed by Newton's method; or None."""
    from scipy.spatial.transform import Rotation

    tree = equations.loops.tree
    values = (np.where(tree.slides, tree.length, np.pi) * random.uniform(-1.0, 1.0, tree.count))[:, None]
    turns = q.turns.copy()
    for k in range(len(turns)):
        turns[k, ..., 0] = Rotation.random(rng=random).as_matrix()
    try:
        return projected(equations, Coordinates(values, turns), 0.0 * values, np.zeros(1))[0]
    except (AssemblyError, np.linalg.LinAlgError):
        return None


def _random_step(equations: EquationsOfMotion, q: Coordinates, random: np.random.Generator) -> Coordinates:
    """Return a configuration after a random step along the motion; shorter if the loops do not close."""
    basis = independent_rates(equations, q)
    direction = random.normal(size=basis.shape[1])
    step = np.zeros((equations.loops.tree.count, 1))
    step[equations.free, 0] = basis @ (RANDOM_STEP * direction / max(float(np.linalg.norm(direction)), 1e-12))
    try:
        for _ in range(4):
            q, _ = projected(equations, equations.loops.displaced(q, 0.25 * step), 0.0 * step, np.zeros(1))
    except AssemblyError:
        return q
    return q
