"""Statics of any mechanism: equilibria under its loads, and drive forces that hold a configuration."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.dynamics.dynamic_run import initial_values
from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion, equations_of_motion
from mechsim.analytic.dynamics.initial_state import initial_state, projected
from mechsim.analytic.dynamics.linearization import (
    LinearModel,
    Mode,
    displaced,
    linear_model,
    null_space,
)
from mechsim.analytic.dynamics.model import DynamicModel, dynamic_model
from mechsim.analytic.dynamics.state_quantities import change_from, displacement_of, load_displacement
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.errors import AssemblyError, InputError
from mechsim.model.forces import Forces
from mechsim.numerics.angles import REVOLUTION, wrapped
from mechsim.numerics.arrays import Array

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
    """

    q: Mapping[str, float]
    stable: bool
    potential: float
    modes: tuple[Mode, ...]
    linear: LinearModel
    reached: bool = True


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
    value at time zero.

    Args:
        source: a mechanism, or an object that has one.
        forces: applied forces; the default is those of the source.
        initial: coordinates `J.q` of the initial configuration.
        starts: number of random steps; 0, with `assemblies` 0, leaves only the initial configuration.
        assemblies: number of random configurations in any assembly mode.
        seed: seed of the random numbers.

    Raises:
        InputError: for invalid values.
        AssemblyError: where the loops do not close at the initial values.

    Accuracy: coordinates to about 1e-11 at a regular equilibrium.
    """
    equations, q = _prepared(source, forces, initial or {})
    for name, count in (("starts", starts), ("assemblies", assemblies)):
        if count < 0:
            raise InputError(f"{name} of the search are {count}; give 0 or more")
    solutions: list[Equilibrium] = []
    for start, reached in _starts(equations, q, starts, assemblies, np.random.default_rng(seed)):
        for downhill in (False, True):
            solution = _newton(equations, start, downhill=downhill)
            if solution is None:
                continue
            values = _coordinates(equations, solution)
            if not any(_same(equations, values, other.q) for other in solutions):
                solutions.append(replace(_described(equations, solution), reached=reached))
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
    """Return the modes of small vibrations about the equilibrium nearest to the initial configuration.

    Raises:
        AssemblyError: if Newton's method finds no equilibrium.

    Accuracy: frequencies to about 1e-11 of their value at a regular equilibrium.
    """
    return nearest_equilibrium(source, forces, initial=initial).modes


def nearest_equilibrium(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, float | str] | None = None
) -> Equilibrium:
    """Return the equilibrium that Newton's method reaches from the initial configuration.

    Raises:
        AssemblyError: if it reaches none.
    """
    equations, q = _prepared(source, forces, initial or {})
    solution = _newton(equations, q)
    if solution is None:
        raise AssemblyError(
            f"{equations.model.mechanism.name}: no equilibrium is found from the initial configuration; "
            "give another one (--initial J.q=VALUE), or search with --statics"
        )
    return _described(equations, solution)


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
        AssemblyError: if Newton's method finds no equilibrium.
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
    return equations, initial_state(equations, values)[0]


def _static_acceleration(equations: EquationsOfMotion, q: Coordinates, basis: Array, u: Array) -> Array:
    """Return the accelerations from rest along a basis at independent displacements u, (dof,)."""
    state = displaced(equations, q, basis, u, np.zeros(len(u)))
    none = np.zeros(len(equations.frictions))
    acceleration = equations.accelerate(state, np.zeros(1), none).acceleration
    return basis.T @ acceleration[equations.free, 0]


def _newton(equations: EquationsOfMotion, q: Coordinates, *, downhill: bool = False) -> Coordinates | None:
    """Return the equilibrium that Newton's method reaches; None if it reaches none.

    Downhill steps reverse unstable directions, so that they lead to stable equilibria.
    """
    largest = 0.0
    for _ in range(NEWTON_STEPS):
        basis = null_space(equations, q)
        dof = basis.shape[1]
        if not dof:
            return q
        zero = np.zeros(dof)
        try:
            value = _static_acceleration(equations, q, basis, zero)
            columns = [
                _static_acceleration(equations, q, basis, STEP * axis)
                - _static_acceleration(equations, q, basis, -STEP * axis)
                for axis in np.eye(dof)
            ]
            stiffness = np.stack(columns, 1) / (2.0 * STEP)
            step = _newton_step(stiffness, value, downhill)
            length = float(np.abs(step).max())
            if not np.isfinite(length):
                return None
            q = displaced(equations, q, basis, step * min(1.0, MAX_STEP / max(length, MAX_STEP)), zero).q
        except (AssemblyError, np.linalg.LinAlgError):
            return None
        largest = max(largest, float(np.abs(value).max()), float(np.abs(stiffness).max()))
        if length < CONVERGED:
            return q if np.abs(value).max() <= BALANCED * largest else None
    return None


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
    basis = null_space(equations, q)
    direction = random.normal(size=basis.shape[1])
    step = np.zeros((equations.loops.tree.count, 1))
    step[equations.free, 0] = basis @ (RANDOM_STEP * direction / max(float(np.linalg.norm(direction)), 1e-12))
    try:
        for _ in range(4):
            q, _ = projected(equations, equations.loops.displaced(q, 0.25 * step), 0.0 * step, np.zeros(1))
    except AssemblyError:
        return q
    return q
