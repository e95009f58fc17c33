"""Motions of several drivers; laws/test_motion.py has their rates, and joints and couplings of every kind."""

import numpy as np
import pytest
from driven_mechanisms import five_bar
from scipy.optimize import brentq

from mechsim.errors import AssemblyError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import make_motion_laws, steady, tabled


def test_drivers_out_of_reach_are_rejected_with_the_time():
    mechanism = five_bar()
    states = {"left": steady(2.0, 1.0), "right": steady(1.0, -1.0)}
    solver = KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 3.0))

    def arms_apart(time):
        ends = [0.05 * np.exp(1j * (2.0 + time)), 0.1 + 0.05 * np.exp(1j * (1.0 - time))]
        return abs(ends[1] - ends[0]) - 0.18

    when = float(brentq(arms_apart, 0.1, 0.8))
    with pytest.raises(AssemblyError, match=rf"the drivers cannot pass {when:.6g}\d* s"):
        solver.solve(t=np.linspace(0.0, 3.0, 41))


def test_a_table_is_a_motion_law():
    time = np.linspace(0.0, 1.0, 41)
    value, rate, _ = tabled("left", time, 2.0 + 0.1 * time**3)(np.array([0.5]))
    assert (value[0], rate[0]) == pytest.approx((2.0 + 0.1 / 8, 0.3 / 4))
