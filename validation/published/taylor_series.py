"""Free runs against Taylor series: a pendulum, a released four-bar, and the impacts of a crank on its stop.

The other integrator is heyoka, which sums the Taylor series of equations to rounding and locates events as
roots of their polynomials. The equations are written here by hand in one coordinate q, with the angles of
coupler and rocker along: I(q) q'' + I'(q) q'^2 / 2 = Q(q), of rods of 1 kg under their weight.

Source: F. Biscani, D. Izzo, Monthly Notices of the Royal Astronomical Society 504 (2021) 2614-2628.

Run: pip install heyoka; python validation/published/taylor_series.py
"""

import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from table import Row, show

import mechsim as ms
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.masses import slender_rod

# tolerances of mechsim, and of the series
GRAVITY, TOLERANCE, EXACT, DURATION = 9.81, 1e-14, 1e-17, 5.0
WEIGHT = Forces(gravity=(0.0, -GRAVITY, 0.0))
TIMES = np.linspace(0.0, DURATION, 201)
# lengths of the four-bar in [m], and angles of coupler and rocker at the crank's start, in [rad]
GROUND, CRANK, COUPLER, ROCKER, START = 0.5, 0.2, 0.5, 0.4, 0.5
STOP, RESTITUTION, IMPACTS = -2.0, 0.8, 8


def pendulum(limits: str = "") -> Any:
    """Return a rod on a pivot, with the limits of its joint in TOML."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pendulum.toml"
        path.write_text(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8") + limits)
        return ms.load(path, still=True)


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


def assembled(q: float) -> tuple[float, float]:
    """Return the angles of coupler and rocker at a crank angle, with the rocker's pin above, in [rad]."""
    pin = CRANK * np.exp(1j * q)
    gap = GROUND - pin
    at_pin = np.arccos((COUPLER**2 + abs(gap) ** 2 - ROCKER**2) / (2.0 * COUPLER * abs(gap)))
    coupler = np.angle(gap) + at_pin
    return float(coupler), float(np.angle(pin + COUPLER * np.exp(1j * coupler) - GROUND))


def swing_errors(hy: Any) -> dict[str, float]:
    """Return the largest difference of the crank angle of each mechanism, in [rad]."""
    settings: Any = {"duration": DURATION, "samples": len(TIMES) - 1, "tolerance": TOLERANCE}
    run = ms.dynamics.run(pendulum(), WEIGHT, **settings)
    system, _, _ = pendulum_system(hy)
    series = hy.taylor_adaptive(system, [0.0, 0.0], tol=EXACT).propagate_grid(TIMES)[-1]
    errors = {"pendulum": float(np.abs(run.motion.joints["crank"].value - series[:, 0]).max())}
    run = ms.dynamics.run(four_bar(), initial={"crank.q": START}, **settings)
    coupler, rocker = assembled(START)
    exact = hy.taylor_adaptive(four_bar_system(hy), [START, coupler, rocker, 0.0], tol=EXACT)
    series = exact.propagate_grid(TIMES)[-1]
    errors["four-bar"] = float(np.abs(run.motion.joints["crank"].value - series[:, 0]).max())
    return errors


def impact_error(hy: Any) -> float:
    """Return the largest difference of the instants of impacts of the pendulum on a stop, in [s]."""
    model = pendulum(f'limits = {{ lower = "{STOP!r} rad", restitution = {RESTITUTION} }}')
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
        Row(f"crank angle of the {name} over {DURATION:g} s", error, 1e-12, "rad", reason)
        for name, error in swing_errors(hy).items()
    ]
    return [*errors, Row("instants of the first impacts", impact_error(hy), 1e-12, "s", "the same")]


if __name__ == "__main__":
    sys.exit(show("Free runs against Taylor series", rows()))
