"""Free runs compared with elliptic functions and the law of energy, and every outcome of a run."""

import numpy as np
import pytest

from mechsim import catalog, dynamics, load_profile
from mechsim.mechanism.forces import Forces, Friction


def test_the_period_without_forces_follows_from_the_reduced_inertia():
    model = dynamics.dynamic_model(catalog.make("rrsrr"), Forces())
    angle = np.arange(512) * (2.0 * np.pi / 512)
    inertia = dynamics.reduced(model, angle).inertia
    run = dynamics.run(model, initial={"crank.q": 0.0, "crank.v": 30.0}, turns=2.0, samples=2)
    exact = 2.0 * 2.0 * np.pi * np.mean(np.sqrt(inertia / inertia[0])) / 30.0
    assert run.time[-1] == pytest.approx(exact, rel=1e-11)
    assert run.motion.speed[-1] == pytest.approx(30.0, rel=1e-11)


def test_a_crank_turns_back_at_its_dead_centre():
    linkage = catalog.make("four_bar", crank=0.2, rocker=0.19, coupler=0.05, ground=0.1)
    start = linkage.mechanism.start
    model = dynamics.dynamic_model(linkage, Forces())
    run = dynamics.run(model, initial={"crank.q": start, "crank.v": 5.0}, turns=1.0, samples=4)
    assert run.outcome == "turned back"
    ahead = min((end - start) % (2.0 * np.pi) for end in linkage.dead_centres())
    assert run.motion.angle[-1] - start == pytest.approx(ahead, abs=1e-9)
    assert run.energy_error <= 1e-9


@pytest.mark.long
def test_frictions_that_hold_a_crank_together_release_it_when_their_sum_is_exceeded():
    ramp = load_profile.table([0.0, 1.0], [0.0, 0.1], over="time")
    friction = (Friction("crank", 0.0, 0.02), Friction("rocker", 0.0, 0.03), Friction("A", 0.0, 0.01))
    solver = catalog.make("four_bar")
    forces = Forces(friction=friction, crank_torque=ramp, flywheel=0.1)
    result = dynamics.run(dynamics.dynamic_model(solver, forces), initial={"crank.q": 1.0}, duration=0.5)
    joints = solver.solve(1.0, 1.0).joints
    # power of all frictions at unit speed
    torque = sum(row.coulomb * abs(joints[row.joint].rate[0]) for row in friction)
    # friction holds up to 1e-9 above its limit
    assert result.events == pytest.approx([torque / 0.1], rel=3e-9)
    assert result.motion.angle[-1] > 1.0002
