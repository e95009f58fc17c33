"""Assemblies that meet several pairs at once: coupled wheels in a row, whose rods all lie flat together."""

from dataclasses import replace

import numpy as np
import pytest
from wheel_linkages import START, assert_all_turn_alike, wheel_linkages

from mechsim import catalog, loops
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.motion import crank_path
from mechsim.errors import AssemblyError
from mechsim.model.joints import End
from mechsim.model.links import Link
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.branch_points import even_change_point

# places, velocities and accelerations, in radii: about a change point they are read off polynomials. Measured
# 1e-12, 1e-9 and 1e-8 at most, the more the more wheels; another assembly is off by 0.1
BOUNDS = (2e-12, 2e-9, 2e-8)


@pytest.mark.parametrize("wheels", [2, 3, 4, 5])
def test_coupled_wheels_rotate_equally_through_coincident_change_points(wheels):
    mechanism = wheel_linkages(wheels)
    # the change points themselves, poses close by, and a turn and a half in steps that fall between
    angle = np.r_[0.0, np.pi, np.pi + np.array([-1e-2, -1e-5, 1e-8, 3e-3]), np.arange(-1.0, 8.0, 0.173)]
    assert_all_turn_alike(mechanism, loops.solve(mechanism, angle, 3.0), BOUNDS)


@pytest.mark.parametrize("steps", [61, pytest.param(400, marks=pytest.mark.slow)])
def test_a_change_point_of_two_pairs_is_detected_for_any_step(steps):
    path = crank_path(wheel_linkages(3))
    for end in np.linspace(START, START + 2.0 * np.pi, steps):
        path.extend(end)
    assert sorted(path.change_points)[:2] == pytest.approx([np.pi, 2.0 * np.pi], abs=1e-10)


@pytest.mark.parametrize("wheels", [3, 4])
def test_coupled_wheels_have_a_period_of_one_revolution(wheels):
    form = LoopForm(wheel_linkages(wheels))
    assert form.crank_range().full
    assert form.period == 2.0 * np.pi
    # the signs tell a turn's half from its whole, wherever rounding puts the first
    assert sorted(np.cos(form.change_points())) == pytest.approx([-1.0, 1.0], abs=1e-15)


def test_two_linkages_on_one_crank_have_a_period_of_two_revolutions():
    # each is flat once a turn, and goes on in its other assembly
    item = catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.06)
    other = catalog.make("four_bar", ground=0.09, crank=0.03, coupler=0.11, rocker=0.05)
    form = LoopForm(side_by_side(item.mechanism, other.mechanism))
    assert len(form.change_points()) == 1
    assert form.period == LoopForm(item.mechanism).period == 4.0 * np.pi
    angle = np.r_[form.change_points(), np.linspace(-1.0, 12.0, 60)]
    result = form.solve(angle)
    for drive in (item, other):
        exact = drive.starting_at([drive.mechanism.start]).solve(angle)
        place = result.points["B" if drive is item else "B'"]
        np.testing.assert_allclose(place.position, exact.points["B"].position, atol=1e-12)
        np.testing.assert_allclose(place.velocity, exact.points["B"].velocity, atol=1e-10)


def side_by_side(item: Mechanism, other: Mechanism) -> Mechanism:
    """Two linkages in one plane on one crank."""
    called = {name: f"{name}'" for name in [link.name for link in other.links]} | {other.driver: item.driver}
    crank = item.crank.b.link
    called[other.crank.b.link] = crank

    def moved(end: End) -> End:
        return replace(end, link=called.get(end.link, end.link))

    joints = [
        replace(joint, name=f"{joint.name}'", a=moved(joint.a), b=moved(joint.b))
        for joint in other.joints
        if joint.name != other.driver
    ]
    return replace(
        item,
        links=(*item.links, *(Link(called[k.name]) for k in other.links if called[k.name] != crank)),
        joints=(*item.joints, *joints),
        points={"B": item.points["B"], "B'": (called[other.points["B"][0]], other.points["B"][1])},
        guess={**item.guess, **{called[k]: v for k, v in other.guess.items() if called[k] != crank}},
    )


def test_nearly_coincident_change_points_are_rejected():
    apart = wheel_linkages(3, lag=0.3)
    angle = np.r_[np.pi, np.pi + 0.3, np.arange(0.0, 6.4, 0.1)]
    assert_all_turn_alike(apart, loops.solve(apart, angle, 3.0), BOUNDS)
    with pytest.raises(AssemblyError, match=r"wheels: the pose at crank angle 3\.14\d* rad is too near"):
        loops.solve(wheel_linkages(3, lag=1e-3), [np.pi])


@pytest.mark.parametrize("pairs", [2, 4])
@pytest.mark.parametrize("at", [-0.93, -0.2, 0.4, 0.97])
def test_an_even_zero_of_the_determinant_is_detected(pairs, at):
    nodes = np.cos(np.linspace(np.pi, 0.0, 9))
    side_by_side = np.exp(0.7 * nodes) * (1.3 + 0.2 * np.sin(2.0 * nodes))
    behind = even_change_point(pairs * np.log(np.abs(nodes - at) * side_by_side))
    assert behind is not None
    assert nodes[behind] <= at <= nodes[behind + 1]
    assert even_change_point(np.log((nodes - at) ** 2 + 0.3) + pairs * np.log(side_by_side)) is None
