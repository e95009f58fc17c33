import numpy as np
import pytest
from two_cranks import velocities
from velocity_plan import velocity_plans

from mechsim import catalog

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
        _, _, drawn = velocity_plans(linkage, f, speed)
        differences = {name: drawn[name] - p.velocity[i] for name, p in exact.points.items()}
        assert fastest(differences) <= AGREEMENT * fastest(drawn)


def test_each_plan_agrees_with_one_crank_stopped():
    linkage, f = catalog.make("warp_knitter"), 1.1
    f2 = linkage.gear_ratio * f + linkage.phase
    first, second, _ = velocity_plans(linkage, f, 3.0, 7.0)
    for single, speeds in ((first, (3.0, 0.0)), (second, (0.0, 7.0))):
        exact = velocities(linkage, f, f2, *speeds)
        differences = {name: single.velocities[name] - v[0] for name, v in exact.items()}
        assert fastest(differences) <= AGREEMENT * fastest(single.velocities)


def test_vectors_of_the_plan_are_perpendicular_to_their_links():
    linkage = catalog.make("warp_knitter")
    for f in np.linspace(0.0, 6.0, 13):
        points = {name: position[0, :2] for name, position in linkage.positions([f]).items()}
        points |= {"1": np.zeros(2), "2": np.array(linkage.pivot2), "E": np.array(linkage.pivot_rocker)}
        # each vector or line of the plans, and the link it is perpendicular to
        rules = ("0C DC, CK CK, 0K EK, BA AB, 0A 1A", "0B AB, BK BK, 0K EK, CD CD, 0D 2D")
        for single, lines in zip(velocity_plans(linkage, f, 3.0)[:2], rules, strict=True):
            ends = {"0": np.zeros(2), **single.vectors}
            for (start, end), link in (pair.split() for pair in lines.split(", ")):
                line, bar = ends[end] - ends[start], points[link[1]] - points[link[0]]
                assert abs(line @ bar) <= 1e-12 * np.linalg.norm(line) * np.linalg.norm(bar)


def test_the_velocity_image_is_similar_to_the_base_link():
    linkage = catalog.make("warp_knitter")
    points = linkage.positions([0.9])
    for single in velocity_plans(linkage, 0.9, 3.0)[:2]:
        sides = [
            np.linalg.norm(single.vectors[p] - single.vectors[q]) / np.linalg.norm(points[p] - points[q])
            for p, q in ("BC", "CK", "KB")
        ]
        assert np.ptp(sides) <= 1e-12 * max(sides)


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
    _, _, drawn = velocity_plans(wrong, 0.9, 3.0)
    differences = {name: drawn[name] - p.velocity[0] for name, p in exact.points.items()}
    assert fastest(differences) > 1e6 * AGREEMENT * fastest(drawn)
