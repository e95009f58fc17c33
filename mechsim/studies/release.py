"""A mechanism released from an initial state: its run, vibrations and frequency response."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.kinetics import DynamicModel, DynamicRun, nearest_equilibrium, run
from mechsim.kinetics.dynamic_run import Initial
from mechsim.kinetics.linearization import LinearModel, Mode, states_about
from mechsim.kinetics.prescribed_motion import InverseDynamics, prescribed
from mechsim.kinetics.state_quantities import motion_of
from mechsim.kinetics.statics import Equilibrium, response_about
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.quantities import coordinate_units, moving_points, numeric_quantity
from mechsim.mechanism.quantity import TRANSMISSION, Quantity, record_columns, unwrapped
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.resources import Progress, no_progress

# largest displacement of a coordinate, in [rad] or characteristic lengths, and number of times it can be
# halved
AMPLITUDE, HALVINGS = 0.25, 6
# duration in [s] of a cycle of a mode that does not oscillate
STILL_PERIOD = 1.0


@dataclass(frozen=True, slots=True)
class ModeMotion:
    """A cycle along a mode shape.

    Attributes:
        title: number, frequency and damping ratio in words.
        period: period of the cycle in [s].
        motion: one period from the largest displacement, without damping; closed at every instant.
    """

    title: str
    period: float
    motion: Motion


def mode_motion(equilibrium: Equilibrium, number: int, samples: int = 72) -> ModeMotion:
    """Return a cycle along a mode shape, with a visible amplitude.

    Args:
        equilibrium: the equilibrium with its modes.
        number: number of the mode, from 1.
        samples: number of intervals of the cycle.

    Raises:
        InputError: for an unknown mode.
        AssemblyError: if the loops close at no visible amplitude.
    """
    count = len(equilibrium.modes)
    if not 1 <= number <= count:
        raise InputError(f"there is no mode {number}; this equilibrium has modes 1 to {count}")
    mode = equilibrium.modes[number - 1]
    period = 1.0 / mode.frequency if mode.frequency > 0.0 else STILL_PERIOD
    motion = _largest_cycle(equilibrium.linear, mode, period, samples)
    # relative to 1, critical damping, less than 1e-12 is rounding
    damping = f"{round(mode.damping_ratio, 12) + 0.0:.3g}"
    return ModeMotion(f"mode {number}: {mode.frequency:.4g} Hz, damping ratio {damping}", period, motion)


def mode_motions(equilibrium: Equilibrium, samples: int = 72) -> list[ModeMotion]:
    """Return a cycle along each mode shape; see `mode_motion`."""
    return [mode_motion(equilibrium, number, samples) for number in range(1, len(equilibrium.modes) + 1)]


def _largest_cycle(linear: LinearModel, mode: Mode, period: float, samples: int) -> Motion:
    """Return a period along a mode shape, at the largest amplitude at which the loops close."""
    equations, loops = linear.equations, linear.equations.loops
    names = {i: name for name, i in loops.tree.index_of.items()}
    shape = linear.basis.T @ np.array([mode.shape[names[i]] / loops.units[i] for i in equations.free])
    times = np.linspace(0.0, period, samples + 1)
    phasors = np.exp(1j * REVOLUTION * times / period)[:, None]
    rate = 1j * REVOLUTION / period

    def cycle(amplitude: float) -> Motion:
        independent = amplitude * shape
        u, du = (np.asarray((factor * phasors * independent).real, np.float64) for factor in (1.0, rate))
        states = states_about(equations, linear.q, linear.basis, u, du)
        return motion_of(equations, states, np.zeros_like(states.rates), times)

    for halving in range(HALVINGS):
        with suppress(AssemblyError):
            return cycle(AMPLITUDE * 0.5**halving)
    return cycle(AMPLITUDE * 0.5**HALVINGS)


# difference of the kinetic energies, relative to the largest, above which drivers do not determine the motion
SAME_MOTION = 1e-6


def joint_forces(model: DynamicModel, run: DynamicRun) -> InverseDynamics:
    """Return the joint forces, and the drive forces of the motors, at the instants of a run.

    Raises:
        InputError: if the drivers do not determine the motion of all links.
        AssemblyError: where the loops do not close at the instants.

    Accuracy: without motor and load torque the drive forces are zero to rounding.
    """
    motion = run.motion
    controlled = {controller.coordinate for controller in model.forces.controllers}
    if controlled <= {*model.mechanism.drivers}:
        # drive forces include those of the controllers
        model = replace(model, forces=replace(model.forces, controllers=()))
    if not model.solver.motion_laws.crank:
        # drivers are prescribed as functions of time, with rate 1
        zero = np.zeros_like(run.time)
        motion = replace(motion, angle=run.time, speed=zero + 1.0, acceleration=zero)
    state = motion.angle, motion.speed, motion.acceleration
    with np.errstate(all="ignore"):
        study = prescribed(model, *state, time=run.time, as_run=motion)
    change = np.abs(study.forces.kinetic - run.kinetic).max(initial=0.0)
    if not change <= SAME_MOTION * max(float(run.kinetic.max(initial=0.0)), np.finfo(float).tiny):
        raise InputError(
            f"{model.mechanism.name}: joint forces over a run need drivers that determine "
            "the motion of all links; name a quantity of positions, velocities or energies"
        )
    return study


# number of frequencies, and their range relative to the lowest and highest natural frequency
FREQUENCIES, MIN_FREQUENCY_RATIO, MAX_FREQUENCY_RATIO = 200, 0.1, 10.0


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """A frequency response.

    Attributes:
        load: name of the unit load.
        quantity: the response.
        unit: of the quantity per unit load.
        frequency: (n,) in [Hz].
        values: complex, (n,).
    """

    load: str
    quantity: str
    unit: str
    frequency: Array
    values: NDArray[np.complex128]

    def columns(self) -> dict[str, Array]:
        """Return frequency in [Hz], magnitude and phase in [rad], without jumps of revolutions."""
        phase = np.unwrap(np.angle(self.values))
        return {"frequency": self.frequency, "magnitude": np.abs(self.values), "phase": phase}


def frequency_response(
    model: DynamicModel, text: str, initial: Mapping[str, Initial] | None = None
) -> FrequencyResponse:
    """Return the frequency response of a text such as "crank:P.x" or "P.y:distance:P,Q".

    Args:
        model: of the mechanism.
        text: load, colon, quantity, as in `mechsim.dynamics.response`.
        initial: coordinates near the equilibrium.

    Raises:
        InputError: for other text.
        AssemblyError: without an equilibrium.
    """
    load, colon, output = text.partition(":")
    if load in ("distance", "angle"):
        # the pair of names ends at the next colon
        pair, colon, output = output.partition(":")
        load = f"{load}:{pair}"
    if not (load and colon and output):
        raise InputError(f"response is {text!r}; give LOAD:QUANTITY, as in crank:P.x")
    nearest = nearest_equilibrium(model, initial=initial)
    natural = [mode.frequency for mode in nearest.modes if mode.frequency > 0.0] or [1.0]
    frequency = np.geomspace(
        MIN_FREQUENCY_RATIO * min(natural), MAX_FREQUENCY_RATIO * max(natural), FREQUENCIES
    )
    values = response_about(nearest, load, output, frequency)
    load_unit, unit = (numeric_quantity(name, model.mechanism).unit for name in (load, output))
    effort = "N" if load_unit == "m" else "(N m)"
    return FrequencyResponse(load, output, f"{unit}/{effort}", frequency, values)


# default duration of a run in [s]
DURATION = 1.0
# outcomes of runs that are drawn
SHOWN = ("done", "stopped", "time over")


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """A dynamic model, its initial state, and the end of a run.

    Attributes:
        model: mechanism, masses and forces.
        initial: `J.q` and `J.v` at the start, as in `mechsim.dynamics.run`.
        prescribed: coordinates that follow the motion laws of the model; the others are free.
        duration: longest time in [s]; infinite with `turns` for as long as they take.
        turns: of the crank that end the run; None for no crank.
        until: event that ends the run; None for no event.
        restitution: at the limits of joints.
        budget: largest number of states that a run evaluates; None for the default.
    """

    model: DynamicModel
    initial: Mapping[str, Initial] = field(default_factory=dict[str, Initial])
    prescribed: tuple[str, ...] = ()
    duration: float = DURATION
    turns: float | None = None
    until: str | None = None
    restitution: float = 0.0
    budget: int | None = None

    @property
    def title(self) -> str:
        """The initial state in words, such as "released at crank = 30deg"."""
        state = ", ".join(f"{name.removesuffix('.q')} = {value}" for name, value in self.initial.items())
        return f"released at {state}" if state else "released"

    def run(self, samples: int, progress: Progress = no_progress) -> DynamicRun:
        """Return the run at instants after the first."""
        return run(
            self.model,
            initial=self.initial,
            prescribed=self.prescribed,
            duration=self.duration if self.duration < np.inf else None,
            until=self.until,
            turns=self.turns,
            samples=samples,
            restitution=self.restitution,
            budget=self.budget,
            progress=progress,
        )

    def quantities(self, names: Sequence[str]) -> list[Quantity]:
        """Return the quantities of a run with these names.

        Raises:
            InputError: for an unknown name, or a quantity that a run does not have.
        """
        mechanism = self.model.mechanism
        quantities = [numeric_quantity(name, mechanism) for name in names]
        for quantity in quantities:
            if quantity.kind == TRANSMISSION:
                subjects = dict.fromkeys([*moving_points(mechanism), *coordinate_units(mechanism)])
                raise InputError(
                    f"a run from an initial state has no quantity {quantity.name}; choose from points and "
                    f"joints ({', '.join(subjects)}) and names such as P.x, J.v, torque:J, distance:P,Q"
                )
        return quantities

    def columns(self, result: DynamicRun, quantities: Sequence[Quantity]) -> dict[str, Array]:
        """Return the columns of a run, with those of joint forces if quantities need them.

        Raises:
            InputError: for forces of drivers that do not determine the motion.
        """
        columns = record_columns(result.motion, quantities) | dict(result.columns())
        if any(column.name not in columns for quantity in quantities for column in quantity.columns):
            columns |= dict(joint_forces(self.model, result).columns())
        return columns

    def values(self, result: DynamicRun, names: Sequence[str]) -> dict[Quantity, Array]:
        """Return quantities over a run, (n,) each; for vectors the length."""
        quantities = self.quantities(names)
        columns = self.columns(result, quantities)
        if missing := [q.name for q in quantities if any(c.name not in columns for c in q.columns)]:
            raise InputError(f"a run from an initial state has no quantity {missing[0]}; leave it out")
        numbers = {quantity: quantity.number(columns) for quantity in quantities}
        return {quantity: unwrapped(n) if quantity.angle else n for quantity, n in numbers.items()}

    def shown_run(self, samples: int) -> DynamicRun:
        """Return the run to draw.

        Raises:
            InputError: for a run that failed.
        """
        result = self.run(samples)
        if result.outcome not in SHOWN:
            raise InputError(
                f"{self.model.mechanism.name}: the run ended early ({result.outcome}): {result.reason}"
            )
        return result

    def cycle(self, number: int, samples: int = 72) -> ModeMotion:
        """Return a cycle along a mode shape about the equilibrium next to the initial configuration."""
        return mode_motion(nearest_equilibrium(self.model, initial=self.initial), number, samples)
