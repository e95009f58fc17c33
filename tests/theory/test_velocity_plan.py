from dataclasses import replace

import numpy as np
import pytest
from two_cranks import velocities

from mechsim.analytic.catalog.warp_knitter import WarpKnitter
from mechsim.errors import AssemblyError
from mechsim.theory.velocity_plan import velocity_plan

TURN = 2 * np.pi
DRIVES = {
    "default": WarpKnitter(),
    "other assembly": WarpKnitter(assembly=1),
    "other sense": WarpKnitter(gear_ratio=1.5, phase=-0.4),
}
# relative to the fastest point, as the paper's method is to agree with the loop equations
AGREEMENT = 1e-12


def fastest(velocities) -> float:
    return max(float(np.linalg.norm(v)) for v in velocities.values())


@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
@pytest.mark.parametrize("speed", [3.0, -40.0])
def test_velocity_plans_agree_with_the_loop_equations(drive, speed):
    angles = np.linspace(0.0, TURN, 73)
    exact = drive.solve(angles, speed, links=False)
    for i, f in enumerate(angles):
        plan = velocity_plan(drive, f, speed)
        gaps = {name: plan.velocities[name] - p.velocity[i] for name, p in exact.points.items()}
        assert fastest(gaps) <= AGREEMENT * fastest(plan.velocities)


def test_each_plan_agrees_with_one_crank_stopped():
    drive, f = WarpKnitter(), 1.1
    f2 = drive.gear_ratio * f + drive.phase
    plan = velocity_plan(drive, f, 3.0, 7.0)
    for part, speeds in ((plan.crank2_stopped, (3.0, 0.0)), (plan.crank1_stopped, (0.0, 7.0))):
        exact = velocities(drive, f, f2, *speeds)
        gaps = {name: part.velocities[name] - v[0] for name, v in exact.items()}
        assert fastest(gaps) <= AGREEMENT * fastest(part.velocities)
    assert plan.speeds == (3.0, 7.0)


@pytest.mark.parametrize("first", [1e-3, 250.0, -2.0])
def test_the_length_of_the_first_vector_does_not_matter(first):
    item = velocity_plan(WarpKnitter(), 0.3, 3.0)
    other = velocity_plan(WarpKnitter(), 0.3, 3.0, first=first)
    gaps = {name: item.velocities[name] - v for name, v in other.velocities.items()}
    assert fastest(gaps) <= AGREEMENT * fastest(item.velocities)
    assert np.linalg.norm(other.crank2_stopped.vectors["c"]) == pytest.approx(abs(first))
    assert np.linalg.norm(other.crank1_stopped.vectors["b"]) == pytest.approx(abs(first))


def test_vectors_of_the_plan_are_perpendicular_to_their_links():
    drive = WarpKnitter()
    for f in np.linspace(0.0, 6.0, 13):
        at = {name: place[0, :2] for name, place in drive.positions([f]).items()}
        at |= {"O1": np.zeros(2), "O2": np.array(drive.pivot2), "E": np.array(drive.pivot_rocker)}
        plan = velocity_plan(drive, f, 3.0)
        # each vector or line of the plan, and the link it stands across
        first = [("pole", "c", "DC"), ("c", "k", "CK"), ("pole", "k", "EK"), ("b", "a", "AB")]
        second = [("pole", "b", "AB"), ("b", "k", "BK"), ("pole", "k", "EK"), ("c", "d", "CD")]
        for part, rules in ((plan.crank2_stopped, first), (plan.crank1_stopped, second)):
            ends = {"pole": part.pole, **part.vectors}
            for start, end, link in rules:
                line, bar = ends[end] - ends[start], at[link[1]] - at[link[0]]
                assert abs(line @ bar) <= 1e-12 * np.linalg.norm(line) * np.linalg.norm(bar)
        pin1, pin2 = plan.crank2_stopped.vectors["a"], plan.crank1_stopped.vectors["d"]
        assert abs(pin1 @ at["A"]) <= 1e-12 * np.linalg.norm(pin1) * drive.crank1
        assert abs(pin2 @ (at["D"] - at["O2"])) <= 1e-12 * np.linalg.norm(pin2) * drive.crank2


def test_the_velocity_image_is_similar_to_the_base_link():
    drive = WarpKnitter()
    points = drive.positions([0.9])
    plan = velocity_plan(drive, 0.9, 3.0)
    for part in (plan.crank2_stopped, plan.crank1_stopped):
        sides = [
            np.linalg.norm(part.vectors[p] - part.vectors[q])
            / np.linalg.norm(points[p.upper()] - points[q.upper()])
            for p, q in ("bc", "ck", "kb")
        ]
        assert np.ptp(sides) <= 1e-12 * max(sides)


def test_the_scale_gives_the_speed_of_the_crank_pin():
    drive = WarpKnitter()
    plan = velocity_plan(drive, 2.0, 3.0)
    item, two = plan.crank2_stopped, plan.crank1_stopped
    assert item.scale * np.linalg.norm(item.vectors["a"]) == pytest.approx(3.0 * drive.crank1, rel=1e-14)
    assert two.scale * np.linalg.norm(two.vectors["d"]) == pytest.approx(6.0 * drive.crank2, rel=1e-14)
    assert (item.stopped, item.driver, two.stopped, two.driver) == ("crank2", "rod5", "crank1", "rod3")
    assert {end for line in item.lines for end in line} <= set(item.vectors)


def test_both_velocities_of_k_have_the_same_direction():
    drive = WarpKnitter()
    plan = velocity_plan(drive, 0.6, 3.0)
    arm = drive.positions([0.6])["K"][0, :2] - drive.pivot_rocker
    along = np.array([-arm[1], arm[0]]) / np.linalg.norm(arm)
    parts = [part.velocities["K"][:2] @ along for part in (plan.crank2_stopped, plan.crank1_stopped)]
    assert sum(parts) == pytest.approx(plan.velocities["K"][:2] @ along, rel=1e-13)
    assert abs(sum(parts)) == pytest.approx(np.linalg.norm(plan.velocities["K"]), rel=1e-13)


def test_cranks_at_rest_give_plans_of_scale_zero():
    plan = velocity_plan(WarpKnitter(), 0.6, 0.0)
    assert plan.crank2_stopped.scale == plan.crank1_stopped.scale == 0.0
    assert fastest(plan.velocities) == 0.0


@pytest.mark.parametrize(
    "wrong",
    [WarpKnitter(gear_ratio=-2.02), WarpKnitter(assembly=1), WarpKnitter(rod5=0.049 * 1.001)],
    ids=["a tooth in a hundred", "another assembly", "a rod 0.1 % long"],
)
def test_a_wrong_mechanism_disagrees(wrong):
    exact = WarpKnitter().solve([0.9], 3.0)
    plan = velocity_plan(wrong, 0.9, 3.0)
    gaps = {name: plan.velocities[name] - p.velocity[0] for name, p in exact.points.items()}
    assert fastest(gaps) > 1e6 * AGREEMENT * fastest(plan.velocities)


def test_a_plan_with_parallel_lines_is_rejected():
    # K on the line from E to C at crank angle 0: V_K and V_KC then have one direction
    drive = WarpKnitter()
    points = {name: place[0, :2] for name, place in drive.positions([0.0]).items()}
    pivot = points["K"] + 0.7 * (points["K"] - points["C"])
    wrong = replace(
        drive,
        pivot_rocker=tuple(pivot.tolist()),
        rocker=float(np.linalg.norm(points["K"] - pivot)),
        assembly=1,
    )
    same = [
        other
        for other in wrong.assemblies(0.0)
        if np.abs(other.positions([0.0])["K"][0, :2] - points["K"]).max() < 1e-9
    ]
    with pytest.raises(AssemblyError, match="KC lies along KE"):
        velocity_plan(same[0], 0.0, 3.0)
