"""User-defined MJCF runs unchanged: any hinge as driver, motion laws, locked joints and welds."""

import numpy as np
import pytest
from model_files import FOLDER, model_text

import mechsim as ms
from mechsim import simulate
from mechsim.errors import MobilityError
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Link
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import make_motion_laws, steady

# a four-bar whose coupler consists of two halves connected by EQUALITY
FOUR_BAR = model_text("user_models_four_bar.xml")
# the anchor is a point of the second body at the relative pose in the first
WELDS = {
    "sites": '<weld site1="middle" site2="end"/>',
    "bodies": '<weld body1="b" body2="c" anchor="-.05 .01 0" relpose="0 .06 0 1 0 0 0" torquescale=".3"/>',
}
GRIPPER = model_text("user_models_gripper.xml")


def swept(text, **options):
    return simulate(text, turns=0.3, samples=12, **options)


def laws_by_name(states, duration):
    """Return motion laws of joints, by a mechanism of joints with these names."""
    arms = tuple(Joint(name, "revolute", End(GROUND), End(f"of {name}", (0.1, 0.0, 0.0))) for name in states)
    links = tuple(Link(f"of {name}") for name in states)
    return make_motion_laws(Mechanism("drivers", links, arms, tuple(states), {}), states, duration)


@pytest.mark.parametrize("weld", WELDS)
@pytest.mark.parametrize(("method", "tolerance"), [("pose", 1e-15), ("step", 1e-7)])
def test_a_weld_closes_the_loop_of_a_four_bar(weld, method, tolerance):
    text = FOUR_BAR.replace("EQUALITY", WELDS[weld])
    run = swept(text, drive="motor", speed=2.0, method=method)
    assert run.outcome == "passed"
    links, joints = run.motion.links, run.motion.joints
    b, c = links["b"], links["c"]
    if weld == "sites":
        gap = b.position + b.rotation @ [0.05, 0, 0] - c.position - c.rotation @ [-0.05, 0.01, 0]
    else:
        gap = b.position + b.rotation @ [0.05, 0.05, 0.0] - c.position
    assert np.abs(gap).max() < tolerance
    assert np.abs(b.rotation - c.rotation).max() < 10 * tolerance
    # a four-bar of a, the welded coupler and d by its circles
    angle = run.motion.angle
    assert angle[0] == pytest.approx(np.deg2rad(40.0), abs=1e-15)
    end = c.position[:, :2]
    offset = [0.10, -0.01] if weld == "sites" else [0.05, 0.05]
    reach = np.hypot(*offset)
    pin = 0.04 * np.stack([np.cos(angle - np.deg2rad(40.0)), np.sin(angle - np.deg2rad(40.0))], 1)
    assert np.linalg.norm(end - pin, axis=1) == pytest.approx(reach, abs=2 * tolerance)
    assert np.linalg.norm(end - [0.08, 0.01], axis=1) == pytest.approx(0.06, abs=2 * tolerance)
    assert set(joints) == {"motor", "A", "C", "D"}


def test_changes_of_a_user_model_for_stepping_are_noted():
    text = FOUR_BAR.replace("EQUALITY", WELDS["sites"])
    output = swept(text, drive="motor", speed=2.0, method="step").note
    assert "own time step" in output
    assert "virtual inertia" in output
    assert swept(text, drive="motor", speed=2.0, method="pose").note == ""


def test_tendon_couplings_of_a_gripper_are_satisfied():
    text = GRIPPER.replace("ACTIVE", "false").replace("EXTRA", "0")
    moves = laws_by_name({"left": lambda t: (0.2 * t, 0.2 + 0 * t, 0 * t)}, 1.0)
    for method in ("pose", "step"):
        joints = simulate(text, motion_laws=moves, method=method).motion.joints
        assert 2 * joints["left"].value + joints["left tip"].value == pytest.approx(0.3, abs=1e-12)
        assert -joints["right"].value == pytest.approx(0.3 + 0.5 * 0.3**2, abs=1e-9)


def test_an_overdetermined_gripper_is_rejected_with_its_driver():
    text = GRIPPER.replace("ACTIVE", "true").replace("EXTRA", ".1")
    moves = laws_by_name({"left": lambda t: (0.1 + 0.2 * t, 0.2 + 0 * t, 0 * t)}, 1.0)
    with pytest.raises(MobilityError, match="overdetermined: left cannot move"):
        simulate(text, motion_laws=moves)


def test_a_locked_joint_keeps_its_value():
    text = FOUR_BAR.replace("EQUALITY", "")
    locked = {"A": 0.4, "C": -0.2, "D": 0.3}
    for method in ("pose", "step"):
        joints = swept(text, drive="motor", speed=2.0, lock=locked, method=method).motion.joints
        for name, value in locked.items():
            assert joints[name].value == pytest.approx(value, abs=1e-12)


def test_a_run_starts_at_the_requested_keyframe():
    text = FOUR_BAR.replace("EQUALITY", WELDS["sites"])
    assert swept(text, drive="motor", speed=2.0, key="ahead").motion.angle[0] == pytest.approx(1.1)
    moves = laws_by_name({"motor": steady(1.1, 2.0)}, 0.1)
    assert simulate(text, motion_laws=moves, key="ahead").motion.joints["motor"].value[0] == pytest.approx(
        1.1
    )


CRANK, ROD, START = 0.03, 0.1, 0.13


@pytest.mark.long
def test_a_slider_on_a_tendon_and_its_follower_move_as_the_closed_form():
    """x = r cos q + sqrt(L^2 - r^2 sin^2 q), and y = 0.2 x + 5 x^2 with x from the start; differentiated.

    MuJoCo's equalities omit the velocity-product terms.
    """
    speed = 20.0 * np.pi
    run = ms.simulate(ms.load(FOLDER / "tendon_slider.xml"), speed=speed, turns=1, method="step")
    cos, sin = np.cos(run.motion.angle), np.sin(run.motion.angle)
    root = np.sqrt(ROD**2 - (CRANK * sin) ** 2)
    x = CRANK * cos + root - START
    rate = speed * (-CRANK * sin - CRANK**2 * sin * cos / root)
    second = speed**2 * (
        -CRANK * cos - CRANK**2 * (cos**2 - sin**2) / root - (CRANK**2 * sin * cos) ** 2 / root**3
    )
    slide, lift = run.motion.joints["slide"], run.motion.joints["lift"]
    assert run.outcome == "passed"
    assert slide.value == pytest.approx(x, abs=1e-10)
    assert slide.acceleration == pytest.approx(second, abs=1e-6)
    assert lift.value == pytest.approx(0.2 * x + 5.0 * x**2, abs=1e-10)
    assert lift.acceleration == pytest.approx(0.2 * second + 10.0 * (rate**2 + x * second), abs=1e-6)
