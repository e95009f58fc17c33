"""Forward dynamics from any initial state against exact solutions."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pendulums import WEIGHT, slider

import mechsim as ms
from mechsim.kinetics.right_hand_side import crossing

sys.path.insert(0, str(Path(__file__).parents[2] / "validation" / "published"))
import a02_four_bars
import a04_bricard


def test_coupled_four_bars_pass_a_singular_configuration():
    run = ms.dynamics.run(a02_four_bars.chain(2), WEIGHT, initial={"A0.v": -1.0}, duration=2.0, samples=20)
    angle, _ = a02_four_bars.exact(2, run.time[1:])
    assert np.abs(run.motion.points["B0"].position[1:, :2] - a02_four_bars.tip(angle)).max() <= 1e-10


@pytest.mark.long
def test_a_row_of_thirty_loops_runs_in_c():
    start, options = {"A0.v": -1.0}, {"duration": 0.3, "samples": 3, "tolerance": 1e-10}
    run = ms.dynamics.run(a02_four_bars.chain(30), WEIGHT, initial=start, **options)
    angle, _ = a02_four_bars.exact(30, run.time)
    assert run.executed == "C"
    for name in ("A0", "A30"):
        assert np.abs(run.motion.joints[name].value - angle).max() < 1e-9


# the coupled four-bars reach their first singular configuration after 0.63743126 s
FLAT = 0.63743126


@pytest.mark.parametrize("later", [-2e-3, 0.0, 2e-3])
def test_a_run_ends_at_its_duration_near_a_singular_configuration(later):
    duration = FLAT + later
    run = ms.dynamics.run(
        a02_four_bars.chain(2), WEIGHT, initial={"A0.v": -1.3}, duration=duration, samples=3
    )
    assert run.time[-1] == pytest.approx(duration, abs=1e-15)


@pytest.mark.parametrize("height", [1e-3, 0.0, -1e-3])
def test_an_event_near_a_singular_configuration_ends_the_run(height):
    start, until = {"A0.v": -1.3}, f"B0.y={height}"
    run = ms.dynamics.run(a02_four_bars.chain(2), WEIGHT, initial=start, duration=1.0, until=until, samples=3)
    assert run.motion.points["B0"].position[-1, 1] == pytest.approx(height, abs=1e-11)
    assert run.time[-1] < 0.7


@dataclass
class Oscillator:
    """x'' = -x as equations of motion; the loops are x = 0 less a distance, singular at t = 0.05 s."""

    distance: float
    layout: object = field(default_factory=lambda: SimpleNamespace(positions=1))

    def conditioning(self, state):
        return abs(np.arcsin(min(1.0, state[0])) - 0.05)

    def on_loops(self, times, states):
        return np.stack([states[:, 1], -states[:, 0]], 1)

    def nearest_on_loops(self, times, states):
        return states + np.array([self.distance, 0.0])


@pytest.mark.parametrize(("distance", "crosses"), [(0.0, True), (1e-6, False)])
def test_a_crossing_that_violates_the_loop_equations_is_rejected(distance, crosses):
    def ahead(times):
        return np.stack([np.sin(times), np.cos(times)], 1)

    solution = crossing(Oscillator(distance), 0.0, np.array([0.0, 1.0]), 0.05, ahead)
    assert (solution is not None) == crosses
    if solution is not None:
        assert solution.duration == pytest.approx(0.1)
        assert solution(0.1) == pytest.approx([np.sin(0.1), np.cos(0.1)], abs=1e-13)


def test_bricards_overconstrained_linkage_keeps_its_energy():
    run = ms.dynamics.run(a04_bricard.bricard(), WEIGHT, duration=0.5, samples=20)
    assert run.outcome == "done"
    assert run.energy_error <= 1e-10


def test_a_parallelogram_passes_its_change_point_as_one():
    parallelogram = ms.catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.1, rocker=0.04)
    run = ms.dynamics.run(parallelogram, WEIGHT, initial={"crank.q": "20deg"}, duration=0.3, samples=30)
    assert run.outcome == "done"
    crank, rocker = (run.motion.joints[name].value for name in ("crank", "rocker"))
    assert crank.min() < -0.1
    assert np.ptp(np.abs(crank) - np.abs(rocker)) < 1e-7


def test_a_growing_load_overcomes_static_friction():
    push = ms.load_profile.table([0.0, 1.0, 2.0], [[0.0] * 3, [0.0] * 3, [8.0, 0.0, 0.0]], over="time")
    forces = ms.Forces(loads=(ms.Load("P", push),), friction=(ms.Friction("s", coulomb=2.0),))
    run = ms.dynamics.run(slider(), forces, duration=2.0, samples=8)
    # the load passes 2 N at 1.25 s; from there 2 x'' = 8 (t - 1.25)
    late = np.maximum(run.time - 1.25, 0.0)
    assert run.motion.joints["s"].value == pytest.approx(2.0 / 3.0 * late**3, abs=1e-9)


def test_a_brief_load_is_integrated():
    """2 kg pushed by 8 N for 0.02 s in a run of 2 s: 0.08 m/s."""
    times = [0.0, 1.0, 1.001, 1.02, 1.021, 2.0]
    push = ms.load_profile.table(
        times, [[force, 0.0, 0.0] for force in (0.0, 0.0, 8.0, 8.0, 0.0, 0.0)], over="time"
    )
    run = ms.dynamics.run(slider(), ms.Forces(loads=(ms.Load("P", push),)), duration=2.0, samples=4)
    assert run.motion.joints["s"].rate[-1] == pytest.approx(8.0 * 0.02 / 2.0, rel=1e-9)


@pytest.mark.parametrize("right", [60.0, 50.0])
def test_independent_coordinates_without_initial_values_keep_their_start_at_rest(right):
    named = {"left.q": "100deg", "left.v": 1.0} | ({} if right == 60.0 else {"right.q": f"{right}deg"})
    motion = ms.dynamics.run(ms.load("five_bar"), initial=named, duration=0.01, samples=1).motion
    start = {name: (joint.value[0], joint.rate[0]) for name, joint in motion.joints.items()}
    # rates solve linear equations of the loops: rounding was 1.2e-15 with AVX-512 kernels, 6e-16 with others
    assert start["left"] == pytest.approx((np.deg2rad(100.0), 1.0), abs=4e-15)
    assert start["right"] == pytest.approx((np.deg2rad(right), 0.0), abs=4e-15)
    # both forearms keep their lengths; elbows are 60 mm from pivots 60 mm apart
    (point,) = motion.points.values()
    for pivot, (angle, rate) in ((-0.03, start["left"]), (0.03, start["right"])):
        direction = np.array([np.cos(angle), np.sin(angle)])
        forearm = point.position[0, :2] - [pivot, 0.0] - 0.06 * direction
        assert np.linalg.norm(forearm) == pytest.approx(0.08, abs=1e-14)
        elbow_velocity = 0.06 * rate * np.array([-direction[1], direction[0]])
        assert forearm @ (point.velocity[0, :2] - elbow_velocity) == pytest.approx(0.0, abs=1e-14)


def test_singular_configurations_in_a_run_are_those_with_both_forearms_in_line():
    run = ms.dynamics.run(ms.load("five_bar"), WEIGHT, initial={"left.v": 1.0}, duration=0.3, samples=6000)
    left, right = (run.motion.joints[name].value for name in ("left", "right"))
    gap = np.hypot(0.06 + 0.06 * (np.cos(right) - np.cos(left)), 0.06 * (np.sin(right) - np.sin(left)))
    # stretched to 2 x 80 mm, or folded onto each other
    distance = np.minimum(0.16 - gap, gap)
    rows = [int(np.argmin(np.abs(run.time - instant))) for instant in run.singular]
    assert len(rows) == 2
    assert distance[rows].max() < 1e-4 < np.median(distance)
    quiet = ms.dynamics.run(ms.load("five_bar"), WEIGHT, initial={"left.v": 1.0}, duration=0.05)
    assert quiet.singular == ()


def test_a_model_that_runs_again_gives_what_a_new_one_gives():
    solver = ms.load("four_bar")
    model = ms.dynamics.dynamic_model(solver, WEIGHT)
    for angle in (0.4, 2.5, -1.0):
        again = ms.dynamics.run(model, initial={"crank.q": angle}, duration=0.3, samples=3)
        new = ms.dynamics.run(solver, WEIGHT, initial={"crank.q": angle}, duration=0.3, samples=3)
        np.testing.assert_array_equal(again.motion.points["B"].position, new.motion.points["B"].position)
        assert again.executed == new.executed


@pytest.mark.parametrize("name", ["four_bar", "rssr"])
def test_distant_initial_values_are_in_the_assembly_mode_of_the_start(name):
    solver = ms.load(name)
    for angle in (-2.9, -0.3, 1.7, 3.1):
        run = ms.dynamics.run(solver, initial={"crank.q": angle}, duration=1e-3, samples=1)
        rocker = solver.solve([angle]).joints["rocker"].value[0]
        assert run.motion.joints["rocker"].value[0] == pytest.approx(rocker, abs=1e-12)


def test_steps_do_not_become_short_where_a_light_coupler_amplifies_rounding():
    motor = ms.Forces(gravity=(0.0, -9.81, 0.0), motor=ms.motors.TorqueSpeedLine(0.2, 30.0), flywheel=0.01)
    settings = {"initial": {"crank.v": 5.0}, "duration": 1.5, "samples": 5}
    model = ms.dynamics.dynamic_model(ms.load("rssr"), motor)
    run, rougher = (ms.dynamics.run(model, **settings, tolerance=value) for value in (3e-13, 1e-10))
    assert run.outcome == "done"
    assert run.energy_error <= 1e-12
    assert run.motion.angle == pytest.approx(rougher.motion.angle, abs=1e-11)
