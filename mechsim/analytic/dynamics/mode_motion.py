"""Motions along mode shapes for pictures: a vibration with visible amplitude about an equilibrium."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.dynamics.linearization import LinearModel, Mode, states_about
from mechsim.analytic.dynamics.state_quantities import motion_of
from mechsim.analytic.dynamics.statics import Equilibrium
from mechsim.errors import AssemblyError, InputError
from mechsim.model.motion import Motion
from mechsim.numerics.angles import REVOLUTION

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
    mode, linear = equilibrium.modes[number - 1], equilibrium.linear
    period = 1.0 / mode.frequency if mode.frequency > 0.0 else STILL_PERIOD
    motion = _largest_cycle(linear, mode, period, samples)
    damping = f"{mode.damping_ratio:.3g}"
    return ModeMotion(f"mode {number}: {mode.frequency:.4g} Hz, damping ratio {damping}", period, motion)


def mode_motions(equilibrium: Equilibrium, samples: int = 72) -> list[ModeMotion]:
    """Return a cycle along each mode shape; see `mode_motion`."""
    return [mode_motion(equilibrium, number, samples) for number in range(1, len(equilibrium.modes) + 1)]


def _largest_cycle(linear: LinearModel, mode: Mode, period: float, samples: int) -> Motion:
    """Return configurations along a mode shape, at the largest amplitude at which the loops close."""
    amplitude = AMPLITUDE
    for _ in range(HALVINGS):
        with suppress(AssemblyError):
            return _cycle(linear, mode, amplitude, period, samples)
        amplitude *= 0.5
    return _cycle(linear, mode, amplitude, period, samples)


def _cycle(linear: LinearModel, mode: Mode, amplitude: float, period: float, samples: int) -> Motion:
    """Return the closed configurations along a mode shape over one period."""
    equations, loops = linear.equations, linear.equations.loops
    names = {i: name for name, i in loops.tree.index_of.items()}
    shape = np.array([mode.shape[names[i]] / loops.units[i] for i in equations.free])
    independent = amplitude * (linear.basis.T @ shape)
    times = np.linspace(0.0, period, samples + 1)
    phasors = np.exp(1j * REVOLUTION * times / period)
    rate = 1j * REVOLUTION / period
    u, du = (np.asarray((factor * phasors[:, None] * independent).real, np.float64) for factor in (1.0, rate))
    states = states_about(equations, linear.q, linear.basis, u, du)
    return motion_of(equations, states, np.zeros_like(states.rates), times)
