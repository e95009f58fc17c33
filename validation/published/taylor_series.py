"""Free runs against Taylor series: pendulum, released four-bar, squeezer, and impacts of a crank on its stop.

The other integrator is heyoka, which sums the Taylor series of equations to rounding and locates events as
roots of their polynomials. The equations are written here by hand in one coordinate q, with the angles of the
other links along: I(q) q'' + I'(q) q'^2 / 2 = Q(q), of rods of 1 kg under their weight, and Andrews' bodies.

Source: F. Biscani, D. Izzo, Monthly Notices of the Royal Astronomical Society 504 (2021) 2614-2628.

Run: pip install heyoka; python validation/published/taylor_series.py
"""

import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import a03_squeezer as andrews
from table import Row, show

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.masses import slender_rod

# tolerances of mechsim, and of the series
GRAVITY, TOLERANCE, EXACT, DURATION = 9.81, 1e-14, 1e-17, 5.0
WEIGHT = Forces(gravity=(0.0, -GRAVITY, 0.0))
# lengths of the four-bar in [m], and angles of coupler and rocker at the crank's start, in [rad]
GROUND, CRANK, COUPLER, ROCKER, START = 0.5, 0.2, 0.5, 0.4, 0.5
STOP, RESTITUTION, IMPACTS = -2.0, 0.8, 8


def pendulum(**limits: Any) -> KinematicSolver:
    """Return a rod on a pivot, with the limits of its joint."""
    link = ms.Link("crank", inertia=slender_rod((0.0, 0.0, 0.0), (CRANK, 0.0, 0.0), 1.0))
    joint = ms.Joint("crank", "revolute", ms.End("ground"), ms.End("crank"))
    return KinematicSolver(ms.Mechanism("pendulum", (link,), (joint,), "crank", {}), **limits)


def four_bar() -> ms.dynamics.DynamicModel:
    """Return the four-bar of the catalogue with thin rods."""
    solver = ms.catalog.make("four_bar", ground=GROUND, crank=CRANK, coupler=COUPLER, rocker=ROCKER)
    lengths = {"crank": CRANK, "coupler": COUPLER, "rocker": ROCKER}
    links = tuple(
        replace(link, inertia=slender_rod((0.0, 0.0, 0.0), (lengths[link.name], 0.0, 0.0), 1.0))
        for link in solver.mechanism.links
    )
    return ms.dynamics.dynamic_model(solver, WEIGHT, mechanism=replace(solver.mechanism, links=links))


def pendulum_system(hy: Any) -> tuple[Any, Any, Any]:
    """Return a rod on a pivot: I q'' = -m g l cos(q) / 2, with I = m l^2 / 3 and l = CRANK."""
    q, v = hy.make_vars("q", "v")
    return [(q, v), (v, -1.5 * GRAVITY / CRANK * hy.cos(q))], q, v


def four_bar_system(hy: Any) -> Any:
    """Return the four-bar in the angles of crank, coupler and rocker and the crank's rate."""
    q, c, r, v = hy.make_vars("q", "c", "r", "v")
    # rates of coupler and rocker per rate of the crank: the loop a e(q) + b e(c) = d + r e(r), differentiated
    sine = hy.sin(c - r)
    ratio = (CRANK / COUPLER * hy.sin(r - q) / sine, CRANK / ROCKER * hy.sin(c - q) / sine)
    inertia = (
        CRANK**2 / 3.0
        + CRANK**2
        + COUPLER**2 * ratio[0] ** 2 / 3.0
        + CRANK * COUPLER * ratio[0] * hy.cos(q - c)
        + ROCKER**2 * ratio[1] ** 2 / 3.0
    )
    rate = hy.diff(inertia, q) + hy.diff(inertia, c) * ratio[0] + hy.diff(inertia, r) * ratio[1]
    heights = (
        1.5 * CRANK * hy.cos(q) + 0.5 * COUPLER * hy.cos(c) * ratio[0] + 0.5 * ROCKER * hy.cos(r) * ratio[1]
    )
    change = (-GRAVITY * heights - 0.5 * rate * v**2) / inertia
    return [(q, v), (c, ratio[0] * v), (r, ratio[1] * v), (v, change)]


def squeezer_system(hy: Any) -> Any:
    """Return Andrews' squeezer in the angles of its bodies against the ground and the first one's rate.

    The links to E, the end of K2, are L e(a) and l e(b) from a point; with E' = x', y' per rate of K1,
    a' = E'.e(b) / (L sin(b - a)) and b' = E'.e(a) / (l sin(a - b)).
    """
    *a, v = hy.make_vars(*(f"a{i}" for i in range(1, 8)), "v")
    # rates of the bodies per rate of the first one
    right, w = np.pi / 2.0, [1.0] * 7

    def along(angle: Any, length: Any = 1.0) -> np.ndarray:
        return length * np.array([hy.cos(angle), hy.sin(angle)])

    def rates(arms: tuple[float, float], angles: tuple[Any, Any], end: np.ndarray) -> list[Any]:
        """Return a' and b' of two links."""
        (first, second), sine = angles, hy.sin(angles[1] - angles[0])
        return [end @ along(second) / (arms[0] * sine), end @ along(first) / (-arms[1] * sine)]

    crank = along(a[0] + right, andrews.RR)
    w[1], w[2] = rates((-andrews.D, -andrews.SS), (a[1], a[2] - right), -crank)
    end = crank - along(a[1] + right, andrews.D) * w[1]
    w[4], w[3] = rates((andrews.ZT, andrews.E), (a[4], a[3] - right), end)
    w[6], w[5] = rates((andrews.U, andrews.ZF), (a[6] - right, a[5]), end)
    # velocities of the bodies' origins per rate of the first one
    origins = {1: crank, 3: along(a[4] + right, andrews.ZT) * w[4], 5: along(a[6], andrews.U) * w[6]}
    inertia: Any = 0.0
    for i, (x, y) in enumerate(andrews.CENTRES):
        centre = origins.get(i, 0.0) + w[i] * (along(a[i] + right, x) - along(a[i], y))
        inertia += andrews.MASSES[i] * (centre @ centre) + andrews.INERTIAS[i] * w[i] ** 2
    pivots = np.array([andrews.XB - andrews.XC, andrews.YB - andrews.YC])
    spring = pivots + along(a[2], andrews.SD) + along(a[2] + right, -andrews.SC)
    potential = 0.5 * andrews.STIFFNESS * (hy.sqrt(spring @ spring) - andrews.REST) ** 2
    effort = andrews.TORQUE - hy.diff(potential, a[2]) * w[2]
    change = sum(hy.diff(inertia, angle) * rate for angle, rate in zip(a, w, strict=True))
    system = [(angle, rate * v) for angle, rate in zip(a, w, strict=True)]
    return [*system, (v, (effort - 0.5 * change * v**2) / inertia)]


def assembled(q: float) -> tuple[float, float]:
    """Return the angles of coupler and rocker at a crank angle, with the rocker's pin above, in [rad]."""
    pin = CRANK * np.exp(1j * q)
    gap = GROUND - pin
    at_pin = np.arccos((COUPLER**2 + abs(gap) ** 2 - ROCKER**2) / (2.0 * COUPLER * abs(gap)))
    coupler = np.angle(gap) + at_pin
    return float(coupler), float(np.angle(pin + COUPLER * np.exp(1j * coupler) - GROUND))


def swing_errors(hy: Any) -> dict[str, float]:
    """Return the largest difference of the first angle of each mechanism, in [rad]."""
    beta, theta, gamma, phi, delta, omega, epsilon = andrews.START
    bodies = [beta, beta + theta, gamma, phi + delta, delta, omega + epsilon, epsilon]
    squeezer = ms.dynamics.dynamic_model(andrews.squeezer(), andrews.forces())
    swinging = ms.dynamics.dynamic_model(pendulum(), WEIGHT)
    cases: dict[str, tuple[Any, dict[str, Any], Any, list[float], float]] = {
        "pendulum": (swinging, {}, pendulum_system(hy)[0], [0.0], DURATION),
        "four-bar": (
            four_bar(),
            {"crank.q": START},
            four_bar_system(hy),
            [START, *assembled(START)],
            DURATION,
        ),
        "squeezer": (squeezer, {}, squeezer_system(hy), bodies, andrews.END),
    }
    errors = dict[str, float]()
    for name, (model, initial, system, angles, duration) in cases.items():
        times = np.linspace(0.0, duration, 201)
        run = ms.dynamics.run(model, initial=initial, duration=duration, samples=200, tolerance=TOLERANCE)
        series = hy.taylor_adaptive(system, [*angles, 0.0], tol=EXACT).propagate_grid(times)[-1]
        errors[f"{name} over {duration:g} s"] = float(np.abs(run.motion.angle - series[:, 0]).max())
    return errors


def impact_error(hy: Any) -> float:
    """Return the largest difference of the instants of impacts of the pendulum on a stop, in [s]."""
    model = pendulum(ranges={"crank": (STOP, np.inf)}, restitution={"crank": RESTITUTION})
    run = ms.dynamics.run(model, WEIGHT, duration=DURATION, tolerance=TOLERANCE)
    system, q, _ = pendulum_system(hy)
    instants: list[float] = []

    def bounce(integrator: Any, _: int) -> bool:
        instants.append(float(integrator.time))
        integrator.state[1] *= -RESTITUTION
        return len(instants) < IMPACTS

    event = hy.t_event(q - STOP, callback=bounce, direction=hy.event_direction.negative)
    hy.taylor_adaptive(system, [0.0, 0.0], tol=EXACT, t_events=[event]).propagate_until(DURATION)
    return float(np.abs(np.array(run.events[:IMPACTS]) - instants).max())


def rows() -> list[Row]:
    hy: Any = import_module("heyoka")
    reason = "rounding of both over a thousand steps"
    errors = [
        Row(f"first angle of the {name}", error, 1e-12, "rad", reason)
        for name, error in swing_errors(hy).items()
    ]
    return [*errors, Row("instants of the first impacts", impact_error(hy), 1e-12, "s", "the same")]


if __name__ == "__main__":
    sys.exit(show("Free runs against Taylor series", rows()))
