"""Controllers: joint forces and torques as expressions of the state and of time."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.studies.dynamics_check import crosscheck_forward

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


@pytest.mark.long
@pytest.mark.parametrize(
    "options", [{}, pytest.param({"drive": {"left": "2rad+0.3rad*sin(2*pi*t)"}}, marks=pytest.mark.slow)]
)
def test_mujoco_agrees_on_controllers_and_rejects_another_gain(options):
    def model(gain):
        forces = ms.Forces(
            controllers=(ms.Controller("right", f"-{gain}*(right.q - 1) + 0.1*sin(9*t) - 0.01*left.v"),)
        )
        return ms.dynamics.dynamic_model(ms.load("five_bar", **options), forces)

    initial = {"right.v": 1.0}
    controlled = model(0.05)
    run = ms.dynamics.run(
        controlled, initial=initial, prescribed=list(options.get("drive", ())), duration=0.03, samples=6
    )
    start = initial_values(controlled, initial)
    verdict = crosscheck_forward(run, controlled, start)
    assert verdict.passed, verdict
    assert not crosscheck_forward(run, model(0.0501), start).passed


def test_controllers_round_trip_through_a_file(file):
    text = to_toml(ms.catalog.make("four_bar"))
    text += f'\n[forces]\ncontrollers.crank = "{CONTROLLED.controllers[0].text}"\n'
    path = file(text)
    loaded = ms.load(path)
    assert loaded.forces.controllers == CONTROLLED.controllers
    assert CONTROLLED.controllers[0].text in to_toml(loaded)


@pytest.mark.long
def test_a_body_that_only_translates_agrees_with_mujoco_and_another_spring_is_rejected(tmp_path):
    path = tmp_path / "block.toml"

    def model(stiffness):
        path.write_text(
            "name = 'block'\n[links.block]\noutline = [[0, 0, 0], [0.1, 0, 0]]\n"
            "inertia = { mass = 2, centre = [0, 0, 0], moments = [0.01, 0.02, 0.03] }\n"
            "[joints.free]\nkind = 'floating'\na.link = 'ground'\nb.link = 'block'\n"
            "[forces.bushings.mount]\na.link = 'ground'\nb.link = 'block'\n"
            f"stiffness = [{stiffness}, 8000, 2000, 4, 4, 4]\n"
        )
        loaded = ms.load(path, still=True)
        return ms.dynamics.dynamic_model(loaded, loaded.forces)

    initial = {"free.x": 0.01}
    run = ms.dynamics.run(model(1000), initial=initial, duration=0.1, samples=6)
    start = initial_values(model(1000), initial)
    verdict = crosscheck_forward(run, model(1000), start)
    assert verdict.passed, verdict
    assert not crosscheck_forward(run, model(1001), start).passed
