"""Assembly with an incomplete guess: any configuration that satisfies the loop equations is accepted."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from model_files import stated_mechanism

import mechsim as ms
from mechsim import loops
from mechsim.kinematics.loops.constraints import tree_loops
from mechsim.kinematics.loops.kinematics import link_poses
from mechsim.kinematics.loops.start import all_closed, assembled, disturbed, start_poses
from mechsim.mechanism.link_poses import guessed_poses


@pytest.mark.long
def test_an_open_loop_reports_a_driver_position_at_which_it_closes():
    def press(rod: float, start: float) -> ms.Mechanism:
        return stated_mechanism("assembly_without_guess_press.toml", rod=rod, start=start)

    # a slide that starts out of reach of the rod, and a rod too short for every slide position
    with pytest.raises(
        ms.AssemblyError, match=r"drive = 0.9 m: .* from the guess they close at drive = "
    ) as output:
        assembled(press(0.35, 0.9))
    value = float(re.search(r"close at drive = ([-\d.e]+) m: start there", str(output.value))[1])
    loops, q = assembled(press(0.35, value))
    assert np.abs(loops.linearise(q)[0]).max() < 1e-12
    with pytest.raises(ms.AssemblyError, match=r"and 48 damped starts leave \w+ open; change"):
        assembled(press(0.2, 0.9))


@pytest.mark.parametrize(
    ("lead", "initial_position", "start_position"),
    [(0.008, 0.05, 0.048), (-0.008, 0.053, 0.056), (0.03, 0.001, 0.0)],
)
def test_the_guess_selects_the_revolution_of_the_screw(lead, initial_position, start_position):
    jack = stated_mechanism("assembly_without_guess_jack.toml", lead=lead, initial=initial_position)
    angle = np.linspace(0.0, 20.0, 9)
    exact = start_position - lead * angle / (2.0 * np.pi)
    position = loops.solve(jack, angle).points["P"].position[:, 0]
    np.testing.assert_allclose(position, exact, atol=1e-15)
    run = ms.simulate(jack, speed=2.0, turns=2.0).motion
    np.testing.assert_allclose(
        run.points["P"].position[:, 0], start_position - lead * run.angle / (2.0 * np.pi), atol=1e-14
    )


def test_a_universal_joint_starts_with_crossed_axes():
    mechanism = ms.load("stewart_gough").mechanism
    bare = replace(mechanism, guess={"plate": mechanism.guess["plate"]})
    initial = guessed_poses(bare)
    for joint in bare.joints:
        if joint.kind == "universal":
            own = initial[joint.b.link].rotation @ np.asarray(joint.b.axis)
            assert abs(own @ np.asarray(joint.a.axis)) < 1e-12
    reported, expected = start_poses(bare)[1], start_poses(mechanism)[1]
    assert {name: pytest.approx(value, abs=1e-9) for name, value in expected.items()} == reported


LEGS = 6


def test_chains_that_end_in_welds_close_from_far_away():
    # legs of six hinges hold a plate by welds, whose equations antiparallel axes satisfy, too
    axes = np.eye(3)[[2, 1, 0, 1, 2, 0]]
    links, joints = [ms.Link("plate")], []
    for leg in range(LEGS):
        names = ["ground", *(f"l{leg}{i}" for i in range(6))]
        foot = (np.cos(leg), np.sin(leg), 0.0)
        for i, (a, b) in enumerate(pairwise(names)):
            point = foot if i == 0 else (0.0, 0.2, 0.6)
            axis, reference = tuple(axes[i]), tuple(np.roll(axes[i], 1))
            ends = ms.End(a, point, axis, reference), ms.End(b, (0.0,) * 3, axis, reference)
            joints.append(ms.Joint(f"j{leg}{i}", "revolute", *ends))
        links += [ms.Link(name) for name in names[1:]]
        ends = ms.End(names[-1], (0.3, 0.0, 0.0)), ms.End("plate", foot, axis=(0.0, 0.0, (-1.0) ** leg))
        joints.append(ms.Joint(f"weld{leg}", "fixed", *ends))
    mechanism = ms.Mechanism("legs", tuple(links), tuple(joints), (), {"P": ("plate", (0.0,) * 3)})
    loops, initial = tree_loops(mechanism, guessed_poses(mechanism), {})
    closed = all_closed(loops, disturbed(loops, initial))
    # with the equations alone 34 of 48 starts end in an assembly, of some robots none
    assert len(closed) == 48
    poses = link_poses(loops.tree, closed)
    plate = poses.by_link(loops.tree.links)["plate"]
    for leg in range(LEGS):
        last, foot = poses.by_link(loops.tree.links)[f"l{leg}5"], np.array([np.cos(leg), np.sin(leg), 0.0])
        ends = last.position + last.rotation @ [0.3, 0.0, 0.0], plate.position + plate.rotation @ foot
        assert np.abs(ends[0] - ends[1]).max() < 1e-11
        assert np.abs(last.rotation[:, :, 2] - (-1.0) ** leg * plate.rotation[:, :, 2]).max() < 1e-11
