"""The equations of motion as a differential equation of first order, and motion across its singularities."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mechsim.errors import AssemblyError, FrictionError, InputError
from mechsim.kinetics.contacts import ContactMode, Contacts
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.kinetics.initial_state import StateLayout, projected
from mechsim.kinetics.linearization import directions_within
from mechsim.numerics.arrays import Array
from mechsim.numerics.gauss_collocation import StepSolution, collocated, node_times

# times (n,) in [s] and states (n, size) -> derivatives (n, size)
Derivatives = Callable[[Array, Array], Array]
# step of forward differences, relative to the scale of a component
FORWARD_STEP = 1e-7


@dataclass(slots=True)
class RightHandSide:
    """Derivatives of states by time; their packing is `layout`.

    Attributes:
        equations: equations of motion.
        contacts: frictions and stops.
        layout: layout of the state vectors.
        mode: frictions that slide or stick, and stops in contact.
        nearest: smallest singular value of the loop constraints below which derivatives are NaN.
        blocked: whether a state had a smaller singular value.
        evaluations: number of states evaluated.
        unsolved: the last state whose friction by the load has no unique solution; None if there is none.
    """

    equations: EquationsOfMotion
    contacts: Contacts
    layout: StateLayout
    mode: ContactMode
    nearest: float = 0.0
    blocked: bool = field(default=False, init=False)
    evaluations: int = field(default=0, init=False)
    unsolved: FrictionError | None = field(default=None, init=False)

    def kinematics(self, states: Array) -> Kinematics:
        """Return constraints and links at states (n, size)."""
        self.evaluations += len(states)
        return self.equations.kinematics(*self.layout.unpack_states(states), self.layout.activation(states))

    def conditioning(self, state: Array) -> float:
        """Return the smallest singular value of the loop constraints at a state."""
        return float(self.kinematics(state[None]).conditioning[0])

    def derivatives(self, times: Array, states: Array) -> Array:
        """Return the derivatives of n states.

        They are NaN if one is too close to a singular configuration, or has no finite loop equations.
        """
        if not np.isfinite(states).all():
            return np.full_like(states, np.nan)
        kinematics = self.kinematics(states)
        if not np.isfinite(kinematics.jacobian).all():
            return np.full_like(states, np.nan)
        if self.nearest and (kinematics.conditioning < self.nearest).any():
            # the integrator then rejects the step
            self.blocked = True
            return np.full_like(states, np.nan)
        try:
            dynamics = self.contacts.accelerate(kinematics, times, self.mode)
        except FrictionError as error:
            # a state of a step that the integrator may reject
            self.unsolved = error
            return np.full_like(states, np.nan)
        except np.linalg.LinAlgError:
            # the mass matrix of an iteration that diverges
            return np.full_like(states, np.nan)
        return self.layout.derivatives(states, kinematics, dynamics)

    def on_loops(self, times: Array, states: Array) -> Array:
        """Return the derivatives at the nearest states that satisfy the loops; NaN without such states."""
        try:
            return self.derivatives(times, self.nearest_on_loops(times, states))
        except AssemblyError:
            return np.full_like(states, np.nan)

    def nearest_on_loops(self, times: Array, states: Array) -> Array:
        """Return the nearest states that satisfy the loops, with contacts at rest, (n, size).

        Raises:
            AssemblyError: if Newton's method does not close the loops.
        """
        resting = self.contacts.indices(self.mode)
        return self.layout.replaced(
            states, *projected(self.equations, *self.layout.unpack_states(states), times, resting)
        )

    def jacobians(self, times: Array, states: Array, rate: float) -> Array:
        """Return the derivatives by the state, (n, size, size), by forward differences at a rate."""
        n, columns = states.shape
        # nothing depends on work and loss
        count = columns - 2
        scale = self.layout.scale(rate)[:count] * FORWARD_STEP
        steps = np.concatenate([np.zeros((1, columns)), np.eye(count, columns) * scale[:, None]])
        displaced = (states[:, None] + steps).reshape(-1, columns)
        values = self.derivatives(np.repeat(times, count + 1), displaced).reshape(n, count + 1, columns)
        jacobians = np.zeros((n, columns, columns))
        jacobians[:, :, :count] = (values[:, 1:] - values[:, :1]).transpose(0, 2, 1) / scale
        return jacobians

    def fastest_decay(
        self, time: float, state: Array, loops: Array, rate: float, derivatives: Derivatives
    ) -> float:
        """Return the fastest decay of free rates and of states of actuators, in [1/s].

        It is the largest eigenvalue of the derivative of their rates of change by them, by forward
        differences of the derivatives at a rate. `loops` is the Jacobian of the loops, (1, rows, free).
        """
        (dof,), (right,) = directions_within(loops)
        tangents = right[len(right) - dof :].T
        free, rates = tangents.shape[1], self.layout.positions
        states = np.arange(rates + self.layout.count, len(state) - 2)
        directions = np.zeros((free + len(states), len(state)))
        directions[:free, rates + self.equations.free] = tangents.T
        directions[free:, states] = np.eye(len(states))
        steps = np.repeat([rate, 1.0], [free, len(states)])[:, None] * FORWARD_STEP
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            displaced = state + np.concatenate([np.zeros((1, len(state))), steps * directions])
            values = derivatives(np.full(len(displaced), time), displaced)
            reduced = directions @ ((values[1:] - values[0]) / steps).T
        if not np.isfinite(reduced).all():
            forces = self.equations.model.forces
            names = ", ".join(
                [controller.coordinate for controller in forces.controllers]
                + [actuator.name for actuator in forces.actuators]
            )
            blamed = f"; the controllers or actuators {names} are not finite there" if names else ""
            raise InputError(f"the forces at {time:.6g} s are too large or not finite{blamed}; correct them")
        return float(np.abs(np.linalg.eigvals(reduced)).max(initial=0.0))


# number of nodes; even, so that none lies in the middle, at the singular configuration
NODES = 12
# relative change of the solution at convergence, and multiple of it up to which a change may be rounding
CONVERGED, ROUNDING = 1e-13, 1e5
# distance of the nodes from the loops, in characteristic lengths or [rad], above which the path does not
# cross
ON_LOOPS = 1e-9
# smallest singular value in the middle relative to that at the start, above which the path does not cross
PASSING = 0.3
# largest number of trial durations for a crossing, each 1.5 times the one before
CROSSINGS = 12


def crossing(
    equations: RightHandSide,
    time: float,
    state: Array,
    approach: float,
    ahead: Callable[[Array], Array],
) -> StepSolution | None:
    """Return the solution across the next singular configuration; None if the path does not cross it.

    Args:
        equations: equations of motion.
        time: initial time in [s].
        state: initial state, (size,).
        approach: time in [s] to the singular configuration at the present rate of approach.
        ahead: times (n,) in [s] -> extrapolated states (n, size).
    """
    start, duration = equations.conditioning(state), 2.0 * approach
    for _ in range(CROSSINGS):
        beyond = equations.conditioning(ahead(np.array([time + duration]))[0])
        if beyond > start:
            break
        duration *= 1.5
    else:
        return None
    # the smallest singular value is proportional to the distance on both sides: the singular configuration
    # lies in the middle of this duration
    duration = duration * 2.0 * start / (start + beyond)
    times = node_times(time, duration, NODES)
    tolerance = CONVERGED * (1.0 + np.abs(state))
    result = collocated(equations.on_loops, time, state, duration, ahead(times), tolerance, ROUNDING)
    if result is None:
        return None
    solution, _ = result
    if equations.conditioning(solution(time + 0.5 * duration)) > PASSING * start:
        return None
    nodes = solution(times)
    distance = np.abs(nodes - equations.nearest_on_loops(times, nodes))[:, : equations.layout.positions]
    return solution if distance.max() <= ON_LOOPS else None
