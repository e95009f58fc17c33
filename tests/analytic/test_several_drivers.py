"""The loop equations of mechanisms with several drivers, holds, couplings and every kind of joint."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.model.couplings import Coupling
from mechsim.model.mechanism import GROUND, End, Joint, Link, Mechanism, Pose
from mechsim.model.programs import Programs, programs, steady, tabled

ALONG_X, ALONG_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def waving(middle, reach, rate, phase=0.0):
    """Return a sinusoidal program."""

    def state(time):
        turned = rate * time + phase
        return (
            middle + reach * np.sin(turned),
            reach * rate * np.cos(turned),
            -reach * rate**2 * np.sin(turned),
        )

    return state


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def five_bar() -> Mechanism:
    """Arms of 50 mm on pivots 100 mm apart, rods of 90 mm that meet in P above them."""

    def joint(name, a, at_a, b, at_b=0.0):
        return Joint(name, "revolute", End(a, (at_a, 0.0, 0.0)), End(b, (at_b, 0.0, 0.0)))

    return Mechanism(
        "five-bar",
        tuple(Link(name) for name in "abcd"),
        (
            joint("left", GROUND, 0.0, "a"),
            joint("right", GROUND, 0.1, "d"),
            joint("A", "a", 0.05, "b"),
            joint("D", "d", 0.05, "c"),
            joint("P", "b", 0.09, "c", 0.09),
        ),
        ("left", "right"),
        {"P": ("b", (0.09, 0.0, 0.0))},
        guess={"b": Pose(np.array([-0.02, 0.05, 0.0]), turned(0.6))},
        counted={"left": 2.0, "right": 1.0},
    )


def where_circles_meet(left, right):
    """Return P of the five-bar, above the line of the arms' ends, (n, 2)."""
    a = 0.05 * np.stack([np.cos(left), np.sin(left)], 1)
    d = 0.05 * np.stack([np.cos(right), np.sin(right)], 1) + [0.1, 0.0]
    across = d - a
    length = np.sqrt((across**2).sum(1, keepdims=True))
    u = across / length
    return (a + d) / 2 + np.sqrt(0.09**2 - length**2 / 4) * np.stack([-u[:, 1], u[:, 0]], 1)


def at_times(form: LoopForm, count: int = 41):
    moves = form.programs
    assert moves is not None
    return form.solve(moves.pace * np.linspace(0.0, moves.duration, count), moves.pace)


def require_rates(form: LoopForm):
    """The rates of a motion are the derivatives of its places, by eighth-order differences."""
    moves = form.programs
    step, middle = 1e-3 * moves.duration, 0.4 * moves.duration
    motion = form.solve(moves.pace * (middle + step * np.arange(-4, 5)), moves.pace)
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / step
    for link in motion.links.values():
        size = np.abs(link.velocity).max() + 1e-3
        assert weights @ link.position == pytest.approx(link.velocity[4], abs=1e-9 * size)
        size = np.abs(link.acceleration).max() + 1e-3
        assert weights @ link.velocity == pytest.approx(link.acceleration[4], abs=1e-8 * size)
        spin = np.einsum("i,ijk->jk", weights, link.rotation) @ link.rotation[4].T
        size = np.abs(link.angular_velocity).max() + 1e-3
        seen = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        assert seen == pytest.approx(link.angular_velocity[4], abs=1e-9 * size)
        size = np.abs(link.angular_acceleration).max() + 1e-3
        bent = weights @ link.angular_velocity
        assert bent == pytest.approx(link.angular_acceleration[4], abs=1e-8 * size)
    return motion


def test_a_five_bar_goes_where_two_circles_meet():
    mechanism = five_bar()
    states = {"left": waving(2.0, 0.3, 6.0, 0.2), "right": waving(1.0, 0.4, 9.0, 1.0)}
    form = LoopForm(mechanism, programs=programs(mechanism, states, 2.0))
    motion = at_times(form)
    truth = where_circles_meet(motion.joints["left"].value, motion.joints["right"].value)
    assert motion.points["P"].position[:, :2] == pytest.approx(truth, abs=1e-15)
    assert motion.joints["left"].value == pytest.approx(2.0 + 0.3 * np.sin(6.0 * motion.time + 0.2))
    assert [name for name, _ in motion.columns()][:3] == ["t", "left", "right"]
    require_rates(form)


def test_it_is_solved_again_where_the_drivers_really_were():
    mechanism = five_bar()
    states = {"left": waving(2.0, 0.3, 6.0), "right": steady(1.0, 0.1)}
    form = LoopForm(mechanism, programs=programs(mechanism, states, 1.0))
    motion = at_times(form)
    left = motion.joints["left"]
    lagging = replace(motion, joints={**motion.joints, "left": replace(left, value=left.value - 1e-5)})
    again = form.solve_as(lagging)
    truth = where_circles_meet(left.value - 1e-5, motion.joints["right"].value)
    assert again.points["P"].position[:, :2] == pytest.approx(truth, abs=1e-15)


def test_what_the_drivers_leave_open_is_named():
    mechanism = replace(five_bar(), driver=("left",), counted={})
    form = LoopForm(mechanism, programs=programs(mechanism, {"left": steady(2.0, 1.0)}, 1.0))
    with pytest.raises(MobilityError, match=r"undetermined.*joint 'right'"):
        at_times(form)


def test_a_held_coordinate_is_no_freedom():
    mechanism = replace(five_bar(), driver="left", holds={"right": 1.2}, start=2.0, counted={})
    motion = LoopForm(mechanism).solve(np.linspace(1.8, 2.2, 5))
    truth = where_circles_meet(motion.angle, np.full(5, 1.2))
    assert motion.points["P"].position[:, :2] == pytest.approx(truth, abs=1e-15)


def test_drivers_that_go_where_the_loops_do_not_close_are_stopped_with_the_time():
    mechanism = five_bar()
    states = {"left": steady(2.0, 1.0), "right": steady(1.0, -1.0)}
    form = LoopForm(mechanism, programs=programs(mechanism, states, 3.0))

    def arms_apart(time):
        ends = [0.05 * np.exp(1j * (2.0 + time)), 0.1 + 0.05 * np.exp(1j * (1.0 - time))]
        return abs(ends[1] - ends[0]) - 0.18

    when = float(brentq(arms_apart, 0.1, 0.8))
    with pytest.raises(AssemblyError, match=rf"the drivers cannot pass {when:.6g}\d* s"):
        at_times(form)


@pytest.mark.parametrize(
    ("states", "said"),
    [
        ({"left": steady(0.0, 1.0)}, "no program says how right moves"),
        ({"left": steady(0.0, 0.0), "right": steady(0.0, 0.0)}, "all drivers stand still"),
        ({"left": steady(0.0, np.nan), "right": steady(0.0, 0.0)}, "program of left is not finite"),
        ({"left": steady(0.0, 1.0), "right": steady(0.0, 0.0), "A": steady(0.0, 0.0)}, "'A'.*not driven"),
    ],
)
def test_programs_that_do_not_fit_are_refused(states, said):
    with pytest.raises(InputError, match=said):
        programs(five_bar(), states, 1.0)


def test_a_table_is_a_program():
    time = np.linspace(0.0, 1.0, 41)
    value, rate, _ = tabled("left", time, 2.0 + 0.1 * time**3)(np.array([0.5]))
    assert (value[0], rate[0]) == pytest.approx((2.0 + 0.1 / 8, 0.3 / 4))


@pytest.mark.parametrize(
    "change",
    [
        {"driver": ("left", "left")},
        {"driver": "missing"},
        {"driver": ()},
        {"holds": {"left": 0.0}},
        {"holds": {"A": np.nan}},
        {"couplings": (Coupling("c", "A", "nothing", (0.0, 1.0)),)},
    ],
)
def test_what_is_no_coordinate_or_prescribed_twice_is_refused(change):
    with pytest.raises(InputError):
        replace(five_bar(), **change)


def boom(**change) -> Mechanism:
    """A boom lifted by a cylinder: the cylinder's length is what is driven."""
    whole = Mechanism(
        "boom",
        (Link("boom"), Link("barrel"), Link("rod")),
        (
            Joint("lift", "revolute", End(GROUND), End("boom")),
            Joint("foot", "revolute", End(GROUND, (0.5, -0.2, 0.0)), End("barrel")),
            Joint("stroke", "prismatic", End("barrel", axis=ALONG_X), End("rod", axis=ALONG_X)),
            Joint("head", "revolute", End("rod"), End("boom", (1.0, 0.0, 0.0))),
        ),
        "stroke",
        {"tip": ("boom", (2.0, 0.0, 0.0))},
        guess={
            "boom": Pose(np.zeros(3), turned(0.5)),
            "barrel": Pose(np.array([0.5, -0.2, 0.0]), turned(1.0)),
        },
        counted={"stroke": 0.7},
    )
    return replace(whole, **change)


def test_a_cylinder_lifts_a_boom_by_the_law_of_cosines():
    mechanism = boom()
    form = LoopForm(mechanism, programs=programs(mechanism, {"stroke": waving(0.8, 0.1, 2.0)}, 3.0))
    motion = require_rates(form)
    foot = np.hypot(0.5, 0.2)
    cosine = (1.0 + foot**2 - motion.joints["stroke"].value ** 2) / (2.0 * foot)
    assert motion.joints["lift"].value == pytest.approx(np.arccos(cosine) - np.arctan2(0.2, 0.5), abs=1e-14)


def test_a_rack_goes_as_far_as_its_pinion_rolls_and_a_polynomial_as_it_says():
    rack = Joint("rack", "prismatic", End(GROUND, axis=ALONG_X), End("bar", axis=ALONG_X))
    cam = Joint("cam", "prismatic", End(GROUND, axis=ALONG_Y), End("follower", axis=ALONG_Y))
    mechanism = Mechanism(
        "rack and cam",
        (Link("pinion"), Link("bar"), Link("follower", outline=((0.0, 0.0, 0.0), (0.05, 0.0, 0.0)))),
        (Joint("crank", "revolute", End(GROUND), End("pinion", (0.01, 0.0, 0.0))), rack, cam),
        "crank",
        {"P": ("bar", (0.0, 0.0, 0.0)), "Q": ("follower", (0.0, 0.0, 0.0))},
        couplings=(
            Coupling("mesh", "rack", "crank", (0.001, 0.02)),
            Coupling("cam", "cam", "crank", (0.0, 0.0, 0.01, 0.002, -0.001), zeros=(0.003, 0.1)),
        ),
    )
    motion = LoopForm(mechanism).solve(np.linspace(-9.0, 9.0, 37), 2.0, 0.5)
    angle = motion.angle
    law = np.polynomial.Polynomial([0.0, 0.0, 0.01, 0.002, -0.001])
    q = angle - 0.1
    assert motion.points["P"].position[:, 0] == pytest.approx(0.001 + 0.02 * angle, abs=1e-15)
    assert motion.points["Q"].position[:, 1] == pytest.approx(0.003 + law(q), rel=1e-12)
    assert motion.points["Q"].velocity[:, 1] == pytest.approx(2.0 * law.deriv()(q), rel=1e-12, abs=1e-13)
    bent = 0.5 * law.deriv()(q) + 4.0 * law.deriv(2)(q)
    assert motion.points["Q"].acceleration[:, 1] == pytest.approx(bent, rel=1e-12, abs=1e-12)


def test_a_screw_lifts_its_nut_by_its_lead_a_turn():
    mechanism = Mechanism(
        "press",
        (Link("spindle"), Link("nut")),
        (
            Joint("crank", "revolute", End(GROUND), End("spindle")),
            Joint("thread", "screw", End("spindle", (0.0, 0.0, 0.1)), End("nut"), lead=0.005),
            Joint("guide", "prismatic", End(GROUND, (0.03, 0.0, 0.0)), End("nut", (0.03, 0.0, 0.0))),
        ),
        "crank",
        {"P": ("nut", (0.0, 0.0, 0.0))},
        guess={"nut": Pose(np.array([0.0, 0.0, 0.1]), np.eye(3))},
    )
    motion = LoopForm(mechanism).solve(np.linspace(0.0, 20.0, 21))
    height = motion.points["P"].position[:, 2] - 0.1
    # the nut does not turn: against the spindle it turns back
    assert height == pytest.approx(-0.005 * motion.angle / (2.0 * np.pi), abs=1e-15)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_planar_joint_leaves_two_ways_and_a_turn(backwards):
    sides = End(GROUND, axis=(0.2, -0.1, 1.0)), End("plate", (0.02, 0.01, 0.0), axis=(0.1, 0.3, 1.0))
    plane = Joint("plane", "planar", *(sides[::-1] if backwards else sides))
    tool = Joint("tool", "revolute", End("plate", (0.1, 0.0, 0.0), (0.3, 1.0, 0.2)), End("bit"))
    mechanism = Mechanism(
        "table",
        (Link("plate"), Link("bit")),
        (plane, tool),
        ("tool",),
        {"P": ("bit", (0.01, 0.02, 0.0))},
        holds={},
        couplings=(
            Coupling("x", "plane.x", "tool", (0.01, 0.03, 0.002)),
            Coupling("y", "plane.y", {"tool": 1.0, "plane.x": 2.0}, (0.0, -0.02, 0.001)),
            Coupling("turn", "plane.turn", "tool", (0.1, 0.5)),
        ),
    )
    form = LoopForm(mechanism, programs=programs(mechanism, {"tool": waving(0.0, 1.0, 3.0)}, 2.0))
    motion = require_rates(form)
    way = motion.joints["plane.x"].value
    assert way == pytest.approx(
        np.polynomial.Polynomial([0.01, 0.03, 0.002])(motion.joints["tool"].value), abs=1e-14
    )
    assert [name for name, _ in motion.columns()][-6:-3] != []
    names = [name for name, _ in motion.columns()]
    assert {"plane.q0", "plane.q1", "plane.q2", "plane.a2", "tool.q"} <= {*names}


def test_a_platform_on_six_legs_goes_where_its_legs_were_measured():
    """The legs' lengths of a chosen motion of the platform are elementary; they lead back to it."""
    rng = np.random.default_rng(3)
    feet = [(0.5 * np.cos(a), 0.5 * np.sin(a), 0.0) for a in np.deg2rad([-8, 8, 112, 128, 232, 248])]
    heads = [(0.3 * np.cos(a), 0.3 * np.sin(a), 0.0) for a in np.deg2rad([-52, 52, 68, 172, 188, 292])]
    feet = [tuple(np.array(foot) + 0.01 * rng.normal(size=3)) for foot in feet]

    def platform(time):
        place = np.array([0.05 * np.sin(time), 0.04 * np.cos(2 * time), 0.5 + 0.06 * np.sin(1.5 * time)])
        return place, turned(0.2 * np.sin(time))

    time = np.linspace(0.0, 3.0, 121)
    lengths = np.array(
        [
            [np.linalg.norm(place + turn @ head - foot) for head, foot in zip(heads, feet, strict=True)]
            for place, turn in map(platform, time)
        ]
    )
    links, joints, guess = [Link("platform")], [], {}
    place, turn = platform(0.0)
    for i, (foot, head) in enumerate(zip(feet, heads, strict=True)):
        axis = place + turn @ head - foot
        along = axis / np.linalg.norm(axis)
        across = np.cross(along, [0.0, 0.3, 1.0])
        across /= np.linalg.norm(across)
        frame = np.column_stack([across, np.cross(along, across), along])
        links += [Link(f"barrel{i}"), Link(f"rod{i}")]
        guess[f"barrel{i}"] = Pose(np.array(foot), frame)
        guess[f"rod{i}"] = Pose(np.array(foot) + axis, frame)
        joints += [
            Joint(f"foot{i}", "universal", End(GROUND, foot, ALONG_X), End(f"barrel{i}", axis=ALONG_Y)),
            Joint(f"leg{i}", "prismatic", End(f"barrel{i}"), End(f"rod{i}")),
            Joint(f"head{i}", "spherical", End(f"rod{i}"), End("platform", head)),
        ]
    drivers = tuple(f"leg{i}" for i in range(6))
    mechanism = Mechanism(
        "platform",
        tuple(links),
        tuple(joints),
        drivers,
        {"P": ("platform", (0.0, 0.0, 0.0)), "Q": ("platform", (0.1, 0.0, 0.1))},
        guess={**guess, "platform": Pose(place, turn)},
        counted=dict(zip(drivers, lengths[0].tolist(), strict=True)),
    )
    states = {name: tabled(name, time, lengths[:, i]) for i, name in enumerate(drivers)}
    moves = programs(mechanism, states, 3.0)
    assert isinstance(moves, Programs)
    motion = LoopForm(mechanism, programs=moves).solve(moves.pace * time, moves.pace)
    truth = np.array([place for place, _ in map(platform, time)])
    assert motion.points["P"].position == pytest.approx(truth, abs=1e-13)
