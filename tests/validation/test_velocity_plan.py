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
