from dataclasses import replace
from itertools import pairwise, permutations

import mechanisms
import numpy as np
import pytest
from driven_mechanisms import press
from model_files import model_text

import mechsim as ms
from mechsim.mechanism.links import GROUND
from mechsim.simulation.mjcf.loop_cuts import cut_loops, turning_with


def chain(*joints: ms.Joint, driver: str = "crank") -> ms.Mechanism:
    links = {end.link for joint in joints for end in (joint.a, joint.b)} - {GROUND}
    return ms.Mechanism("chain", tuple(ms.Link(name) for name in sorted(links)), joints, driver, {})


def rows(text: str) -> list[ms.Joint]:
    """Joints of lines such as "A revolute crank-coupler"."""
    split = [line.replace("-", " ").split() for line in text.strip().splitlines()]
    return [ms.Joint(name, kind, ms.End(a), ms.End(b)) for name, kind, a, b in split]


def cut_in(mechanism: ms.Mechanism, *cut: str, **options: object) -> list[str]:
    return [joint.name for joint in cut_loops(mechanism, cut or None, **options).cuts]


FOUR_BAR = """
crank revolute ground-crank
A revolute crank-coupler
B revolute coupler-rocker
C revolute ground-rocker
"""
# a four-bar on a rotating arm; B and C are reversed, and A and the shoulder turn about minus z
ON_AN_ARM = model_text("loop_cuts_on_an_arm.toml")


@pytest.mark.parametrize("mechanism", mechanisms.everything(), ids=lambda m: m.name)
def test_every_link_is_in_the_tree_once_after_its_parent(mechanism: ms.Mechanism) -> None:
    tree = cut_loops(mechanism)
    placed = [GROUND]
    for branch in tree.branches:
        assert branch.parent.link in placed
        assert branch.child.link not in placed
        placed.append(branch.child.link)
    assert sorted(placed) == sorted([GROUND, *(link.name for link in mechanism.links)])
    assert len(tree.cuts) == len(mechanism.joints) - len(mechanism.links)


def test_a_geared_joint_is_never_cut() -> None:
    mechanism = mechanisms.geared_five_bar()
    assert {joint.name for joint in cut_loops(mechanism).cuts}.isdisjoint({"shaft", "second"})
    with pytest.raises(ms.InputError, match="joint 'second' is geared and cannot be cut"):
        cut_loops(mechanism, ("second",))


def test_a_joint_with_an_actuator_is_never_cut() -> None:
    mechanism = ms.catalog.make("four_bar").mechanism
    for acting in (["A"], ["rocker", "B"]):
        assert {joint.name for joint in cut_loops(mechanism, acting=acting).cuts}.isdisjoint(acting)
        with pytest.raises(
            ms.InputError, match=f"joint '{acting[-1]}' is moved by an actuator or a spring and cannot"
        ):
            cut_loops(mechanism, (acting[-1],), acting=acting)
    # with one on each joint, a joint is split instead
    tree = cut_loops(mechanism, acting=["crank", "A", "B", "rocker"])
    assert len(tree.branches) == 4
    assert [joint.kind for joint in tree.cuts] == ["fixed"]


def test_disconnected_links_are_rejected_by_name() -> None:
    disconnected = chain(
        ms.Joint("crank", "revolute", ms.End(GROUND), ms.End("crank")),
        ms.Joint("x", "revolute", ms.End("a"), ms.End("b")),
    )
    with pytest.raises(ms.InputError, match="no chain of joints leads from the frame to a, b"):
        cut_loops(disconnected)


def test_a_loop_without_point_constraints_is_split_and_welded():
    tree = cut_loops(press())
    assert [joint.kind for joint in tree.cuts] == ["fixed"]
    assert len(tree.mechanism.links) == len(press().links) + 1
    motion = ms.simulate(press(), speed=1.0, turns=0.1).motion
    assert set(motion.links) == {"spindle", "nut"}


def test_the_cut_joint_is_farthest_from_the_crank_in_any_joint_order():
    for joints in permutations(rows(FOUR_BAR)):
        tree = cut_loops(chain(*joints))
        assert [joint.name for joint in tree.cuts] == ["B"]
        directions = {item.joint.name: item.direction for item in tree.branches}
        assert directions == {"crank": 1, "A": 1, "C": 1}
        backwards = cut_loops(chain(*(replace(joint, a=joint.b, b=joint.a) for joint in joints)))
        assert [joint.name for joint in backwards.cuts] == ["B"]
        assert {item.direction for item in backwards.branches} == {-1}
        parents = {item.child.link: item.parent.link for item in backwards.branches}
        assert parents == {"crank": "ground", "coupler": "crank", "rocker": "ground"}


def test_the_distance_of_a_joint_is_counted_along_moving_links():
    ring = ["crank", "one", "two", "three", "four", "ground"]
    joints = [ms.Joint("crank", "revolute", ms.End(GROUND), ms.End("crank"))]
    joints += [ms.Joint(f"to {b}", "revolute", ms.End(a), ms.End(b)) for a, b in pairwise(ring)]
    # counted through the frame, joint "to two" would be as distant as "to four"
    assert cut_in(chain(*joints[::-1])) == ["to four"]


def test_the_cut_with_the_fewest_constraints_avoids_protected_joints():
    joints = rows(FOUR_BAR.replace("A revolute", "A spherical"))
    assert cut_in(chain(*joints)) == ["A"]
    assert cut_in(chain(*joints), keep=("A",)) == ["B"]
    assert cut_in(chain(*joints), keep=("A", "B", "C")) == ["A"]
    slides = rows(FOUR_BAR.replace("B revolute", "B prismatic").replace("C revolute", "C cylindrical"))
    assert cut_in(chain(*slides), keep=("A",)) == ["A"]


def test_a_requested_cut_has_priority_over_a_floating_joint():
    mechanism = chain(
        *rows("crank revolute ground-crank\nfly floating ground-plate\npin revolute crank-plate")
    )
    assert cut_in(mechanism) == ["fly"]
    assert cut_in(mechanism, "pin") == ["pin"]


def test_a_loop_without_a_passive_joint_is_split_and_welded():
    with_locks = replace(chain(*rows(FOUR_BAR)), locked={"A": 0.3, "B": -0.2})
    with pytest.raises(ms.InputError, match="joint 'B' is held and cannot be cut; cut another"):
        cut_loops(with_locks, ("B",))
    assert cut_in(with_locks) == ["C"]
    immobile = cut_loops(replace(with_locks, locked={"A": 0.3, "B": -0.2, "C": 0.1}))
    assert [joint.kind for joint in immobile.cuts] == ["fixed"]


@pytest.mark.parametrize("cut", ["A", "B", "C"])
def test_the_rate_of_a_cut_hinge_is_a_sum_of_tree_joint_rates(cut, file):
    arm = ms.load(file(ON_AN_ARM))
    result = turning_with(arm.mechanism, tree := cut_loops(arm.mechanism, (cut,)), tree.cuts[0])
    assert len(result) == 3
    joints = arm.solve(t=np.linspace(0.0, 1.0, 4)).joints
    reported = sum(share * joints[name].rate for name, share in result.items())
    np.testing.assert_allclose(reported, joints[cut].rate, rtol=0, atol=1e-12)
