"""pylinkage: planar linkages only, each dyad by intersection of circles in compiled code (numba).

Inside the time: `Linkage.step_fast`, all configurations of the revolution. Outside: the linkage and its
compilation.
"""

import math
import time

import numpy as np
from problem import REVOLUTION, Positions, Problem
from protocol import Setting
from pylinkage.actuators import Crank
from pylinkage.components import Ground
from pylinkage.dyads import FixedDyad, RRRDyad
from pylinkage.simulation import Linkage

POSES = (20, 100, 1000, 10_000)


def settings(problem: Problem) -> list[Setting]:
    return [Setting("pylinkage", n, poses=True) for n in POSES] if problem.planar else []


class Solver:
    """A compiled linkage that starts each run from the same configuration."""

    def __init__(self, problem: Problem, setting: Setting):
        self.steps, self.start = setting.steps, problem.initial_motion.points
        o, o4 = (problem.hinge(link).position for link in ("crank", "rocker"))
        (at_crank, coupler_start), (coupler_end, at_rocker) = problem.coupler_ends
        crank = Crank(
            anchor=Ground(o[0], o[1]),
            radius=float(np.linalg.norm(at_crank)),
            angular_velocity=REVOLUTION / setting.steps,
            initial_angle=problem.start,
        )
        a, b, c = (self.start[name].position[0] for name in "ABC")
        rod, arm = float(np.linalg.norm(coupler_end - coupler_start)), float(np.linalg.norm(at_rocker))
        rocker = RRRDyad(crank.output, Ground(o4[0], o4[1]), rod, arm)
        to_b, to_c = (math.atan2(*(end - a)[1::-1]) for end in (b, c))
        point = FixedDyad(crank.output, rocker, float(np.linalg.norm(c - a)), to_c - to_b)
        self.linkage = Linkage([crank.anchor, rocker.anchor2, crank, rocker, point])
        self.initial_positions = [(o[0], o[1]), (o4[0], o4[1]), tuple(a[:2]), tuple(b[:2]), tuple(c[:2])]
        self.linkage.set_coords(self.initial_positions)
        self.linkage.compile()

    def run(self) -> tuple[float, Positions]:
        self.linkage.set_coords(self.initial_positions)
        begin = time.process_time()
        path = self.linkage.step_fast(self.steps)
        seconds = time.process_time() - begin
        positions = {}
        for i, name in enumerate("ABC", 2):
            flat = np.concatenate([self.start[name].position[:, :2], path[:, i]])
            positions[name] = np.column_stack([flat, np.zeros(len(flat))])
        return seconds, positions

    def torque(self) -> None:
        """No masses, no torque."""


build = Solver
