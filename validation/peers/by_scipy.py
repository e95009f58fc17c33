"""scipy: the angle of the rocker as a differential equation in the crank's, derived by hand.

The loop |P3(rocker) - P2(crank)| = coupler, differentiated once, gives d rocker / d crank; DOP853 integrates
it with step control. The problem has no masses.

Inside the time: `solve_ivp`, interpolation to the samples included.
"""

import math
import time
from dataclasses import dataclass

import numpy as np
from problem import SAMPLES, Positions, Problem
from protocol import Setting
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class StepControl(Setting):
    """The relative tolerance of a turn; the absolute one in [rad] is the same."""

    tolerance: float = 1e-3


def settings(problem: Problem) -> list[StepControl]:
    return [StepControl("scipy DOP853, loop by hand", 0, tolerance=10.0**-n) for n in (3, 5, 7, 9, 11, 13)]


class Solver:
    """The differential equation, with its constants computed once."""

    def __init__(self, problem: Problem, setting: StepControl):
        self.problem, self.setting = problem, setting
        (at_crank, _), (_, at_rocker) = problem.coupler_ends
        crank, rocker = problem.hinge("crank"), problem.hinge("rocker")
        # positions of the coupler's ends are centre + across cos + along sin
        self.crank = _circle(crank.position, crank.frame, crank.in_frame(at_crank))
        self.rocker = _circle(rocker.position, rocker.frame, rocker.in_frame(at_rocker))
        self.start, self.angles = rocker.angle, problem.angles(SAMPLES)

    def run(self) -> tuple[float, Positions]:
        begin, tolerance = time.process_time(), self.setting.tolerance
        bounds = {"rtol": tolerance, "atol": tolerance}
        result = solve_ivp(
            self.derivative, self.angles[[0, -1]], [self.start], method="DOP853", t_eval=self.angles, **bounds
        )
        seconds = time.process_time() - begin
        return seconds, self.problem.positions(self.angles, result.y[0]) if result.success else {}

    def torque(self) -> None:
        """No masses, no torque."""

    def derivative(self, angle: float, rocker: np.ndarray) -> tuple[float]:
        """Return d rocker / d crank."""
        c, s = math.cos(angle), math.sin(angle)
        u, w = math.cos(rocker[0]), math.sin(rocker[0])
        by_crank = by_rocker = 0.0
        for (p, a, b), (q, d, e) in zip(self.crank, self.rocker, strict=True):
            rod = q + d * u + e * w - p - a * c - b * s
            by_crank -= rod * (b * c - a * s)
            by_rocker += rod * (e * u - d * w)
        return (-by_crank / by_rocker,)


def _circle(position: np.ndarray, frame: np.ndarray, tip: np.ndarray) -> list[tuple[float, float, float]]:
    x, y, z = frame.T
    columns = position + tip[2] * z, tip[0] * x + tip[1] * y, tip[0] * y - tip[1] * x
    return [tuple(row) for row in np.column_stack(columns).tolist()]


build = Solver
