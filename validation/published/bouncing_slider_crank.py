"""A slider-crank released under its weight whose slider bounces off a stop.

The reference is the reduced equation of the crank, derived by hand: J a'' + J' a'^2 / 2 + V' = 0.
At the stop the slider's rate is reversed and multiplied by the coefficient of restitution, and with it the
crank's. DOP853 at a relative tolerance of 1e-13, with the impacts as events.

Run: python validation/published/bouncing_slider_crank.py
"""

from dataclasses import dataclass, replace
from time import process_time

import numpy as np
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.analytic.solvers import KinematicSolver
from mechsim.model.forces import Forces
from mechsim.model.links import Inertia
from mechsim.numerics.arrays import Array

CRANK, ROD, GRAVITY = 0.05, 0.16, 9.81
# masses in [kg] and moments about the middle in [kg m2] of crank, rod and slider
MASSES, MOMENTS = (0.3, 0.5, 0.8), (8e-5, 1.1e-3, 1e-4)
START, STOP, RESTITUTION = np.deg2rad(40.0), 0.125, 0.7
# imaginary step of derivatives
STEP = 1e-30


def slider_crank() -> KinematicSolver:
    """Return the mechanism with the stop of its slider."""
    mechanism = ms.catalog.make("slider_crank", crank=CRANK, rod=ROD, offset=0.0).mechanism
    centres = ((0.5 * CRANK, 0.0, 0.0), (0.5 * ROD, 0.0, 0.0), (0.0, 0.0, 0.0))
    links = tuple(
        replace(link, inertia=Inertia(mass, centre, np.diag([moment] * 3)))
        for link, mass, centre, moment in zip(mechanism.links, MASSES, centres, MOMENTS, strict=True)
    )
    return KinematicSolver(replace(mechanism, links=links), ranges={"slide": (STOP, 1.0)})


def energies(angle: Array | complex) -> tuple[Array, Array, Array]:
    """Return moment of inertia and potential at crank angles, and the slider's position."""
    rod_angle = -np.arcsin(CRANK * np.sin(angle) / ROD)
    rod_rate = -CRANK * np.cos(angle) / (ROD * np.cos(rod_angle))
    along = -CRANK * np.sin(angle) - 0.5 * ROD * np.sin(rod_angle) * rod_rate
    across = CRANK * np.cos(angle) + 0.5 * ROD * np.cos(rod_angle) * rod_rate
    slide = -CRANK * np.sin(angle) - ROD * np.sin(rod_angle) * rod_rate
    moment = MOMENTS[0] + MASSES[0] * (0.5 * CRANK) ** 2 + MASSES[1] * (along**2 + across**2)
    moment = moment + MOMENTS[1] * rod_rate**2 + MASSES[2] * slide**2
    height = MASSES[0] * 0.5 * CRANK * np.sin(angle)
    height = height + MASSES[1] * (CRANK * np.sin(angle) + 0.5 * ROD * np.sin(rod_angle))
    return moment, GRAVITY * height, CRANK * np.cos(angle) + ROD * np.cos(rod_angle)


def rates(_: float, state: Array) -> list[float]:
    """Return the rates of crank angle and rate."""
    moment, potential, _ = energies(state[0] + 1j * STEP)
    gradient, pull = np.imag(moment) / STEP, np.imag(potential) / STEP
    return [state[1], float(-(0.5 * gradient * state[1] ** 2 + pull) / np.real(moment))]


def clearance(_: float, state: Array) -> float:
    """Return the distance of the slider from the stop, in [m]."""
    return float(energies(state[0])[2]) - STOP


clearance.terminal, clearance.direction = True, -1.0  # type: ignore[attr-defined]


def reference(times: Array, restitution: float) -> tuple[Array, list[float]]:
    """Return crank angles at times, and the times of the impacts."""
    angles, impacts = np.full(len(times), np.nan), list[float]()
    time, state = 0.0, np.array([START, 0.0])
    while time < times[-1]:
        options = {"rtol": 1e-13, "atol": 1e-14, "dense_output": True, "events": clearance}
        arc = solve_ivp(rates, (time, times[-1]), state, "DOP853", **options)
        within = (times >= time) & (times <= arc.t[-1])
        angles[within] = arc.sol(times[within])[0]
        time, state = arc.t[-1], arc.y[:, -1] * np.array([1.0, -restitution])
        if arc.status == 1:
            impacts.append(float(time))
    return angles, impacts


@dataclass(frozen=True)
class Comparison:
    """Errors of a run.

    Attributes:
        angle: largest error of the crank, in [rad].
        impact: largest error of the time of an impact, in [s].
        impacts: number of impacts.
    """

    angle: float
    impact: float
    impacts: int


def compare(duration: float = 1.0, restitution: float = RESTITUTION) -> Comparison:
    """Return the errors of a run; `restitution` is that of the reference."""
    run = ms.dynamics.run(
        slider_crank(),
        Forces(gravity=(0.0, -GRAVITY, 0.0)),
        initial={"crank.q": float(START)},
        duration=duration,
        restitution=RESTITUTION,
        samples=200,
    )
    angles, impacts = reference(run.time, restitution)
    count = min(len(impacts), len(run.events))
    impact_error = np.abs(np.array(impacts[:count]) - np.array(run.events[:count])).max(initial=0.0)
    if len(impacts) != len(run.events):
        impact_error = np.inf
    return Comparison(
        float(np.abs(run.motion.joints["crank"].value - angles).max()), float(impact_error), len(run.events)
    )


if __name__ == "__main__":
    start = process_time()
    result = compare()
    print(
        f"bouncing slider-crank, 1 s, {result.impacts} impacts: crank {result.angle:.1e} rad, times of "
        f"impacts {result.impact:.1e} s, {process_time() - start:.1f} s of processor time"
    )
