"""Poses and rates at many instants together: in any order, and off the motion laws of their drivers."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import five_bar, waving, where_circles_meet
from mechanisms import at

from mechsim import catalog, loops
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.motion import crank_path, motion_along
from mechsim.analytic.loops.path_rates import CHUNK, rates_of_polynomial, regularised
from mechsim.errors import AssemblyError
from mechsim.model.joints import Joint
from mechsim.model.links import EX, GROUND, Link
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion
from mechsim.model.motion_laws import make_motion_laws

STEP = 1e-3
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / STEP
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]) / STEP**2
RATES = {"left": (1.7, -2.3), "right": (-0.9, 3.1)}


def form() -> LoopForm:
    mechanism = five_bar()
    states = {"left": waving(2.0, 0.3, 6.0, 0.2), "right": waving(1.0, 0.4, 9.0, 1.0)}
    return LoopForm(mechanism, motion_laws=make_motion_laws(mechanism, states, 1.0))


def off_by(form: LoopForm, off):
    """Return the motion where drivers stand off their programs, (left, right), at rates of their own."""
    assert not form.motion_laws.crank
    motion = form.solve(t=np.linspace(0.0, 1.0, 12))
    joints = {
        name: JointMotion(
            motion.joints[name].value + by, *(item * np.ones(12) for item in RATES[name]), "rad"
        )
        for name, by in zip(RATES, off, strict=True)
    }
    return form.solve_as(replace(motion, joints={**motion.joints, **joints}))


@pytest.mark.parametrize("off", [(1e-10, -1e-10), (5e-4, -9e-4), (2e-3, 0.0), (0.05, -0.11), (-0.3, 0.2)])
def test_drivers_off_their_motion_laws_have_the_exact_motion(off):
    result = off_by(form(), off)
    times = STEP * np.arange(-4, 5)
    left, right = (
        result.joints[name].value[:, None] + rate * times + 0.5 * bend * times**2
        for name, (rate, bend) in RATES.items()
    )
    near = where_circles_meet(left.ravel(), right.ravel()).reshape(12, 9, 2)
    point = result.points["P"]
    # measured 6e-17, 5e-14 and 3e-10
    np.testing.assert_allclose(point.position[:, :2], near[:, 4], rtol=0, atol=5e-16)
    np.testing.assert_allclose(point.velocity[:, :2], np.tensordot(near, FIRST, (1, 0)), rtol=0, atol=5e-13)
    np.testing.assert_allclose(
        point.acceleration[:, :2], np.tensordot(near, SECOND, (1, 0)), rtol=0, atol=3e-9
    )


def test_drivers_out_of_reach_are_rejected_with_the_time():
    for off in ((0.9, -0.9), (1.5, 0.0)):
        with pytest.raises(AssemblyError, match=r"the pose at .* s is too near"):
            off_by(form(), off)


def test_conditioning_is_the_smallest_scaled_singular_value():
    motion = form().solve(t=np.linspace(0.0, 1.0, 9))
    rods = []
    for pivot, arm, turn in ((0.0, 0.05, "left"), (0.1, 0.05, "right")):
        angle = motion.joints[turn].value
        end = np.stack([pivot + arm * np.cos(angle), arm * np.sin(angle)], 1)
        rods.append((motion.points["P"].position[:, :2] - end) / 0.09)
    cosine = (rods[0] * rods[1]).sum(1)
    # of two unit vectors side by side
    exact = 0.09 / five_bar().characteristic_length * np.sqrt(1.0 - np.abs(cosine))
    np.testing.assert_allclose(motion.conditioning, exact, rtol=1e-12)


def twice(mechanism):
    """A mechanism whose crank moves all the rest twice over."""
    crank = mechanism.crank.b.link
    names = {link.name: f"{link.name}2" for link in mechanism.links if link.name != crank}
    links = [replace(link, name=names[link.name]) for link in mechanism.links if link.name in names]
    joints = [
        replace(
            joint,
            name=f"{joint.name}2",
            a=replace(joint.a, link=names.get(joint.a.link, joint.a.link)),
            b=replace(joint.b, link=names.get(joint.b.link, joint.b.link)),
        )
        for joint in mechanism.joints
        if joint is not mechanism.crank
    ]
    guess = {names[name]: pose for name, pose in mechanism.guess.items() if name in names}
    both = replace(mechanism, links=(*mechanism.links, *links), joints=(*mechanism.joints, *joints))
    return both.with_guess({**mechanism.guess, **guess}, mechanism.start)


def test_polynomial_rates_agree_with_the_loop_equations():
    path = crank_path(twice(catalog.make("rssr").mechanism))
    angle = path.initial + np.linspace(0.1, 2.0, 7)
    _, motion = motion_along(path, angle, np.ones(7), np.zeros(7))
    assert len(path.loops.tree.balls) == 2
    first, second = (
        rates.T * path.loops.units for rates in rates_of_polynomial(path, path.loops.tree, angle)
    )
    # measured 3.5e-9 and 2.8e-7
    np.testing.assert_allclose(first, motion.rates, rtol=0, atol=4e-8)
    np.testing.assert_allclose(second, motion.second, rtol=0, atol=3e-6)


def test_singular_matrices_are_replaced_by_the_identity():
    whole, blind = np.arange(8.0).reshape(2, 2, 2), np.array([False, True])
    assert np.array_equal(regularised(whole, blind), [whole[0], np.eye(2)])
    assert regularised(whole, ~blind & blind) is whole


def test_several_chunks_keep_the_order_of_instants():
    drive = catalog.make("four_bar")
    angles = np.random.default_rng(22).uniform(-7.0, 7.0, 2 * CHUNK + 300)
    result, exact = (
        loops.solve(drive.mechanism, angles, 2.0, -3.0).points["B"],
        drive.solve(angles, 2.0, -3.0).points["B"],
    )
    # measured 8e-17, 8e-17 and 4e-16
    for part, most in (("position", 1e-15), ("velocity", 1e-15), ("acceleration", 4e-15)):
        np.testing.assert_allclose(getattr(result, part), getattr(exact, part), rtol=0, atol=most)


def test_a_slide_on_a_rotating_arm_has_its_coriolis_acceleration():
    joints = (
        Joint("turn", "revolute", at(GROUND), at("arm")),
        Joint("way", "prismatic", at("arm", axis=EX), at("block", axis=EX)),
    )
    points = {"P": ("block", (0.3, 0.0, 0.0))}
    arm = Mechanism("arm", (Link("arm"), Link("block")), joints, ("turn", "way"), points)
    states = {"turn": waving(2.0, 0.3, 6.0, 0.2), "way": waving(0.02, 0.4, 9.0, 1.0)}
    form = LoopForm(arm, motion_laws=make_motion_laws(arm, states, 1.0))
    times = np.linspace(0.0, 1.0, 12)
    motion = form.solve(t=times)
    (turn, spin, spun), (way, speed, gain) = (np.array(states[name](times)) for name in ("turn", "way"))
    out = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], 1)
    across = np.cross([0.0, 0.0, 1.0], out)
    radius = (0.3 + way)[:, None] * out
    rated = speed[:, None] * out + (spin * (0.3 + way))[:, None] * across
    bent = (gain - (0.3 + way) * spin**2)[:, None] * out
    bent += ((0.3 + way) * spun + 2.0 * speed * spin)[:, None] * across
    result = motion.points["P"]
    for part, wanted in (("position", radius), ("velocity", rated), ("acceleration", bent)):
        np.testing.assert_allclose(getattr(result, part), wanted, rtol=0, atol=1e-12, err_msg=part)
