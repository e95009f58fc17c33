"""Controllers: joint forces and torques as expressions of the state and of time."""

import numpy as np
import pytest

import mechsim as ms

START = {"crank.q": "40deg", "crank.v": 2.0}
STIFFNESS, REST, DAMPING = 0.1, 0.5, 2e-5
CONTROLLED = ms.Forces(
    controllers=(ms.Controller("crank", f"-{STIFFNESS}*(crank.q - {REST}) - {DAMPING}*crank.v"),)
)
SPRING = ms.Forces(
    joint_springs=(ms.JointSpring("crank", STIFFNESS, REST),), friction=(ms.Friction("crank", DAMPING),)
)


def released(forces, initial=START, **options):
    return ms.dynamics.run(
        ms.catalog.make("four_bar"), forces, initial=initial, duration=0.05, samples=20, **options
    )


def test_a_pd_controller_equals_a_spring_and_a_damper():
    controlled, sprung = released(CONTROLLED), released(SPRING)
    crank = controlled.motion.joints["crank"]
    assert crank.value == pytest.approx(sprung.motion.joints["crank"].value, abs=1e-9)
    assert np.ptp(crank.value) > 0.05
    assert controlled.energy_error < 1e-9
    # the energy of a controller is work; that of a spring and a damper is stored and lost
    assert controlled.work - controlled.work[0] == pytest.approx(
        sprung.potential[0] - sprung.potential - sprung.lost, abs=1e-9
    )


def test_modes_under_a_pd_controller_equal_those_of_spring_and_damper():
    modes = [
        ms.dynamics.modes(ms.catalog.make("four_bar"), forces, initial={"crank.q": REST})
        for forces in (CONTROLLED, SPRING)
    ]
    for controlled, sprung in zip(*modes, strict=True):
        assert controlled.frequency == pytest.approx(sprung.frequency, rel=1e-9)
        assert controlled.damping_ratio == pytest.approx(sprung.damping_ratio, rel=1e-7)
