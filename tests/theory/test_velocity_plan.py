import numpy as np
import pytest
from two_cranks import velocities

from mechsim import catalog
from mechsim.errors import AssemblyError
from mechsim.theory.velocity_plan import velocity_plan

REVOLUTION = 2 * np.pi
LINKAGES = {
    "default": catalog.make("warp_knitter"),
    "other assembly mode": catalog.make("warp_knitter", assembly=1),
    "other direction": catalog.make("warp_knitter", gear_ratio=1.5, phase=-0.4),
}
# allowed difference from the loop equations, relative to the fastest point
AGREEMENT = 1e-12


def fastest(velocities) -> float:
    return max(float(np.linalg.norm(v)) for v in velocities.values())


@pytest.mark.parametrize("linkage", LINKAGES.values(), ids=LINKAGES)
@pytest.mark.parametrize("speed", [3.0, -40.0])
def test_velocity_plans_agree_with_the_loop_equations(linkage, speed):
    angles = np.linspace(0.0, REVOLUTION, 73)
    exact = linkage.solve(angles, speed)
    for i, f in enumerate(angles):
        plan = velocity_plan(linkage, f, speed)
        differences = {name: plan.velocities[name] - p.velocity[i] for name, p in exact.points.items()}
        assert fastest(differences) <= AGREEMENT * fastest(plan.velocities)


def test_each_plan_agrees_with_one_crank_stopped():
    linkage, f = catalog.make("warp_knitter"), 1.1
    f2 = linkage.gear_ratio * f + linkage.phase
    plan = velocity_plan(linkage, f, 3.0, 7.0)
    for single, speeds in ((plan.crank2_stopped, (3.0, 0.0)), (plan.crank1_stopped, (0.0, 7.0))):
        exact = velocities(linkage, f, f2, *speeds)
        differences = {name: single.velocities[name] - v[0] for name, v in exact.items()}
        assert fastest(differences) <= AGREEMENT * fastest(single.velocities)
    assert plan.speeds == (3.0, 7.0)


def test_vectors_of_the_plan_are_perpendicular_to_their_links():
    linkage = catalog.make("warp_knitter")
    for f in np.linspace(0.0, 6.0, 13):
        points = {name: position[0, :2] for name, position in linkage.positions([f]).items()}
        points |= {"O1": np.zeros(2), "O2": np.array(linkage.pivot2), "E": np.array(linkage.pivot_rocker)}
        plan = velocity_plan(linkage, f, 3.0)
        # each vector or line of the plan, and the link it is perpendicular to
        first = [("pole", "c", "DC"), ("c", "k", "CK"), ("pole", "k", "EK"), ("b", "a", "AB")]
        second = [("pole", "b", "AB"), ("b", "k", "BK"), ("pole", "k", "EK"), ("c", "d", "CD")]
        for single, rules in ((plan.crank2_stopped, first), (plan.crank1_stopped, second)):
            ends = {"pole": single.pole, **single.vectors}
            for start, end, link in rules:
                line, bar = ends[end] - ends[start], points[link[1]] - points[link[0]]
                assert abs(line @ bar) <= 1e-12 * np.linalg.norm(line) * np.linalg.norm(bar)
        pin1, pin2 = plan.crank2_stopped.vectors["a"], plan.crank1_stopped.vectors["d"]
        assert abs(pin1 @ points["A"]) <= 1e-12 * np.linalg.norm(pin1) * linkage.crank1
        assert abs(pin2 @ (points["D"] - points["O2"])) <= 1e-12 * np.linalg.norm(pin2) * linkage.crank2


def test_the_velocity_image_is_similar_to_the_base_link():
    linkage = catalog.make("warp_knitter")
    points = linkage.positions([0.9])
    plan = velocity_plan(linkage, 0.9, 3.0)
    for single in (plan.crank2_stopped, plan.crank1_stopped):
        sides = [
            np.linalg.norm(single.vectors[p] - single.vectors[q])
            / np.linalg.norm(points[p.upper()] - points[q.upper()])
            for p, q in ("bc", "ck", "kb")
        ]
        assert np.ptp(sides) <= 1e-12 * max(sides)


def test_cranks_at_rest_give_plans_of_scale_zero():
    plan = velocity_plan(catalog.make("warp_knitter"), 0.6, 0.0)
    assert plan.crank2_stopped.scale == plan.crank1_stopped.scale == 0.0
    assert fastest(plan.velocities) == 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        catalog.make("warp_knitter", gear_ratio=-2.02),
        catalog.make("warp_knitter", assembly=1),
        catalog.make("warp_knitter", rod5=0.049 * 1.001),
    ],
    ids=["gear ratio 1 % off", "another assembly mode", "rod 0.1 % longer"],
)
def test_a_wrong_mechanism_disagrees(wrong):
    exact = catalog.make("warp_knitter").solve([0.9], 3.0)
    plan = velocity_plan(wrong, 0.9, 3.0)
    differences = {name: plan.velocities[name] - p.velocity[0] for name, p in exact.points.items()}
    assert fastest(differences) > 1e6 * AGREEMENT * fastest(plan.velocities)


def test_a_plan_with_parallel_lines_is_rejected():
    # K on the line from E to C at crank angle 0: V_K and V_KC then have one direction
    linkage = catalog.make("warp_knitter")
    points = {name: position[0, :2] for name, position in linkage.positions([0.0]).items()}
    pivot = points["K"] + 0.7 * (points["K"] - points["C"])
    wrong = linkage.with_parameters(
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
