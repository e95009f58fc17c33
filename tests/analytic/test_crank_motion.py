"""The motion of a path on whatever lap its crank is counted, of what is held, and of what spins idly."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import five_bar
from mechanisms import at

from mechsim import catalog, loops
from mechsim.analytic.loops.motion import crank_path, motion_along
from mechsim.errors import AssemblyError
from mechsim.model.joints import Coupling, Joint
from mechsim.model.links import EX, GROUND, Link, Pose
from mechsim.model.mechanism import Mechanism

TURN = 2.0 * np.pi
# the crank swings about its start by less than half a radian either way
LENGTHS = {"ground": 0.1, "crank": 0.06, "coupler": 0.03, "rocker": 0.05}


def swinging(**coupling) -> Mechanism:
    """A four-bar whose crank only swings, and next to it a wheel or a slide that goes with the crank."""
    mechanism = catalog.make("four_bar", **LENGTHS).mechanism
    if not coupling:
        return mechanism
    kind = "revolute" if coupling["turns"] else "prismatic"
    beside = Joint("beside", kind, at(GROUND, (0.2, 0.0, 0.0)), at("wheel"))
    start = mechanism.start
    first = coupling["coefficients"][0] + coupling["coefficients"][1] * start
    guess = dict(mechanism.guess)
    c, s = np.cos(first), np.sin(first)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) if coupling["turns"] else np.eye(3)
    guess["wheel"] = Pose(np.array([0.2, 0.0, 0.0 if coupling["turns"] else first]), turn)
    whole = replace(
        mechanism,
        links=(*mechanism.links, Link("wheel")),
        joints=(*mechanism.joints, beside),
        couplings=(Coupling("beside", "beside", "crank", **coupling),),
    )
    return whole.with_guess(guess, start)


@pytest.mark.parametrize("laps", [1, -2])
@pytest.mark.parametrize(
    "wheel", [{}, {"turns": True, "coefficients": (0.3, 2.0)}, {"turns": True, "coefficients": (0.3, -1.0)}]
)
def test_a_swing_counted_on_another_revolution_has_the_same_motion(wheel, laps):
    mechanism = swinging(**wheel)
    angles = mechanism.start + np.array([0.5, -0.3, 0.1])
    here, there = (loops.solve(mechanism, angles + turned, 2.0, -3.0) for turned in (0.0, laps * TURN))
    for name, joint in here.joints.items():
        counted = laps * TURN if name == "crank" else 0.0
        for part in ("value", "rate", "acceleration"):
            shift = counted if part == "value" else 0.0
            wanted = getattr(joint, part) + shift
            np.testing.assert_allclose(getattr(there.joints[name], part), wanted, atol=1e-12)
    for name, link in here.links.items():
        np.testing.assert_allclose(there.links[name].position, link.position, atol=1e-14)
        np.testing.assert_allclose(there.links[name].rotation, link.rotation, atol=1e-13)


@pytest.mark.parametrize(
    ("ratio", "turns", "laps", "same"),
    [(1.5, True, 1, False), (1.5, True, -2, True), (1.0 + 1e-9, True, 1, False), (2.0, False, 1, False)],
)
def test_geared_links_must_repeat_on_another_revolution(ratio, turns, laps, same):
    mechanism = swinging(turns=turns, coefficients=(0.003, ratio))
    angles = mechanism.start + laps * TURN + np.array([0.2])
    if same:
        wheel = loops.solve(mechanism, angles).links["wheel"].rotation[0]
        np.testing.assert_allclose(wheel[:2, 0], [np.cos(0.303), np.sin(0.303)], atol=1e-14)
    else:
        with pytest.raises(AssemblyError, match="the crank cannot pass"):
            loops.solve(mechanism, angles)


def test_a_path_can_start_on_another_revolution():
    mechanism = swinging()
    path, _ = motion_along(crank_path(mechanism), *np.array([[mechanism.start + TURN], [1.0], [0.0]]))
    assert path.initial == mechanism.start + TURN
    assert path.start.values[path.loops.driven[0]] == path.initial
    assert loops.solve(mechanism, [0.1, 0.2]).speed.tolist() == [1.0, 1.0]
    assert loops.solve(mechanism, [0.1, 0.2]).acceleration.tolist() == [0.0, 0.0]


def test_a_locked_joint_keeps_its_value_at_any_crank_speed():
    mechanism = replace(five_bar(), driver="left", locked={"right": 1.2}, start=2.0, guess_coordinates={})
    motion = loops.solve(mechanism, [1.9, 2.1], 5.0, -7.0)
    for part, wanted in (("value", 1.2), ("rate", 0.0), ("acceleration", 0.0)):
        np.testing.assert_allclose(getattr(motion.joints["right"], part), wanted, atol=1e-15)
    assert motion.joints["left"].rate.tolist() == [5.0, 5.0]
    assert motion.joints["left"].acceleration.tolist() == [-7.0, -7.0]


@pytest.mark.parametrize(
    ("name", "idle"), [("rssr", {"coupler"}), ("rrsrr", set()), ("four_bar", set()), ("bennett", set())]
)
def test_links_with_a_passive_spin_are_reported(name, idle):
    drive = catalog.make(name)
    assert loops.solve(drive.mechanism, [drive.mechanism.start + 0.3]).spinning == idle


def test_a_rod_that_spins_about_a_frame_axis_is_reported():
    joints = (
        Joint("crank", "revolute", at(GROUND), at("crank")),
        Joint("A", "spherical", at("crank", (0.1, 0.0, 0.0)), at("rod")),
        Joint("B", "spherical", at("rod", (0.3, 0.0, 0.0)), at("block")),
        Joint("way", "prismatic", at(GROUND, (0.4, 0.0, 0.0), EX), at("block", (0.0, 0.0, 0.0), EX)),
    )
    guess = {
        "rod": Pose(np.array([0.1, 0.0, 0.0]), np.eye(3)),
        "block": Pose(np.array([0.4, 0.0, 0.0]), np.eye(3)),
    }
    links = tuple(Link(name) for name in ("crank", "rod", "block"))
    points = {"P": ("block", (0.0, 0.0, 0.0))}
    assert loops.solve(Mechanism("line", links, joints, "crank", points, guess=guess), [0.0]).spinning == {
        "rod"
    }
