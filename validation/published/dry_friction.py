"""Error of MuJoCo's stepped dry friction, compared with the exact reduced equation.

A crank is released at a speed, with dry friction in a hinge, a ball joint and the joints of a spatial loop.
It moves for half a revolution, or comes to rest. Error: the largest of the crank angle, for two time steps.

Run: python validation/published/dry_friction.py [NUMBER OF CASES]
"""

import sys
from dataclasses import dataclass

import numpy as np

from mechsim import catalog, dynamics
from mechsim.mechanism.forces import Forces, Friction
from mechsim.simulation.dynamics.forward_run import stepped_run

STEPS = (1e-4, 2.5e-5)
TILTED = (0.3, -9.81, 0.5)


@dataclass(frozen=True, slots=True)
class Case:
    """A released crank and its friction."""

    title: str
    name: str
    joints: tuple[str, ...]
    torque: float
    flywheel: float
    speed: float
    duration: float
    gravity: tuple[float, float, float]


MOVING = {"flywheel": 1e-3, "speed": 60.0, "duration": 0.05, "gravity": TILTED}
RESTING = {"flywheel": 1e-4, "speed": 20.0, "duration": 0.3, "gravity": (0.0, 0.0, 0.0)}
LOOP = ("crank", "A", "B", "rocker")
CASES = (
    Case("hinge (four_bar, rocker), moving", "four_bar", ("rocker",), 2e-3, **MOVING),
    Case("ball (rrsrr, S), moving", "rrsrr", ("S",), 4e-4, **MOVING),
    Case("cut in space (bennett, all joints), moving", "bennett", LOOP, 2e-3, **MOVING),
    Case("hinge, brought to rest", "four_bar", ("rocker",), 5e-2, **RESTING),
    Case("ball, brought to rest", "rrsrr", ("S",), 2e-2, **RESTING),
)


def error(case: Case, timestep: float) -> float:
    """Return the largest error of the crank angle, in [rad]."""
    friction = tuple(Friction(joint, 0.0, case.torque) for joint in case.joints)
    forces = Forces(gravity=case.gravity, friction=friction, flywheel=case.flywheel)
    model = dynamics.dynamic_model(catalog.make(case.name), forces)
    exact = dynamics.run(model, initial={"crank.v": case.speed}, duration=case.duration, samples=50)
    name = model.mechanism.crank.name
    start = {name: float(exact.motion.angle[0])}, {name: case.speed}
    run = stepped_run(model.mechanism, forces, *start, exact.time, round(exact.time[1] / timestep))
    return float(np.abs(run.motion.angle - exact.motion.angle).max())


def main(count: int = len(CASES)) -> None:
    for case in CASES[:count]:
        errors = ", ".join(f"{error(case, step):.1e} rad at {step:g} s" for step in STEPS)
        print(f"{case.title:<44}{errors}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
