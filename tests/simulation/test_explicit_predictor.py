import numpy as np
import pytest

from mechsim import catalog
from mechsim.model.scene import Scene
from mechsim.simulation.model_loops import ModelLoops, read_loops
from mechsim.simulation.poses import follow
from mechsim.simulation.poses.follow import explicit_trace
from mechsim.simulation.source import assembled

TURN = 2.0 * np.pi
# of the longest link: 48 steps of fourth order leave 2e-5 on the worst of these
ROUGH = 1e-4
SURE = ("four_bar", "slider_crank", "rssr", "rrsrr", "warp_knitter", "looper")


def loops_of(name: str, **changed: float) -> ModelLoops:
    mechanism = catalog.make(name, **changed).mechanism
    return read_loops(assembled(mechanism, Scene(level="pose")).compile())


def sprinted(loops: ModelLoops, turns: float) -> np.ndarray | None:
    start = loops.model.qpos0
    jacobian = loops.linearise(start[None])[1]
    return explicit_trace(loops, start, float(start[loops.crank_address]) + TURN * turns, jacobian)


def numbers(loops: ModelLoops) -> list[np.ndarray]:
    model = loops.model
    kept = (model.qpos0, model.body_invweight0, model.dof_armature, model.eq_solref)
    return [values.copy() for values in kept]


@pytest.mark.parametrize("turns", [0.3, 1.0, -1.0])
@pytest.mark.parametrize("name", SURE)
def test_a_predictor_ends_where_the_closed_form_is(name: str, turns: float) -> None:
    drive = catalog.make(name)
    loops = loops_of(name)
    states = sprinted(loops, turns)
    assert states is not None
    exact = drive.solve(states[:, loops.crank_address], speed=1.0)
    places = loops.posed.site_positions(states)
    for point in drive.mechanism.points:
        gap = places[:, loops.model.site(point).id] - exact.points[point].position
        assert np.abs(gap).max() < ROUGH * loops.characteristic_length


def test_a_predictor_leaves_the_model_as_it_was() -> None:
    loops = loops_of("rssr")
    before = numbers(loops)
    sprinted(loops, 1.0)
    assert all(np.array_equal(a, b) for a, b in zip(before, numbers(loops), strict=True))


@pytest.mark.parametrize("slack", [1e-4, 1e-8, 1e-12])
def test_a_predictor_past_an_almost_dead_centre_is_not_trusted_and_the_walk_passes_it(slack: float) -> None:
    # the longest rocker that lets this crank turn fully is ground - crank + coupler
    sizes = {"ground": 0.08, "crank": 0.03, "coupler": 0.07}
    drive = catalog.make("four_bar", **sizes, rocker=0.12 * (1.0 - slack))
    loops = loops_of("four_bar", **sizes, rocker=0.12 * (1.0 - slack))
    assert sprinted(loops, 1.0) is None
    start = loops.model.qpos0
    angles = start[loops.crank_address] + np.linspace(0.0, TURN, 50)
    place = loops.posed.site_positions(follow.follow(loops, start, angles))[:, loops.model.site("B").id]
    exact = drive.solve(angles, speed=1.0).points["B"].position
    # the square root of the distance from the dead centre is all that is left of rounding there
    assert np.abs(place - exact).max() < 1e-7 * loops.characteristic_length


def test_a_predictor_beyond_the_dead_centre_of_a_crank_that_only_swings_is_not_trusted() -> None:
    assert sprinted(loops_of("four_bar", ground=0.08, crank=0.03, coupler=0.07, rocker=0.125), 1.0) is None


def test_a_loop_whose_side_is_not_known_is_walked() -> None:
    assert sprinted(loops_of("bennett"), 1.0) is None
