import mechanisms
import pytest
from driven import press

from mechsim import catalog, simulate
from mechsim.errors import InputError
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, Link
from mechsim.model.mechanism import Mechanism
from mechsim.simulation.mjcf.loop_cuts import cut_loops


def chain(*joints: Joint, driver: str = "crank") -> Mechanism:
    links = {end.link for joint in joints for end in (joint.a, joint.b)} - {GROUND}
    return Mechanism("chain", tuple(Link(name) for name in sorted(links)), joints, driver, {})


def test_the_spatial_four_bar_is_cut_at_the_spherical_joint_far_from_the_crank() -> None:
    assert [joint.name for joint in cut_loops(catalog.make("rssr").mechanism).cuts] == ["P3"]


def test_a_guided_coupler_is_cut_at_its_only_spherical_joint() -> None:
    assert [joint.name for joint in cut_loops(catalog.make("rssr", guide=True).mechanism).cuts] == ["P3"]


@pytest.mark.parametrize("name", ["four_bar", "slider_crank"])
def test_planar_loops_are_cut_at_a_joint_that_is_not_the_crank(name: str) -> None:
    mechanism = catalog.make(name).mechanism
    (cut,) = cut_loops(mechanism).cuts
    assert cut.kind == "revolute"
    assert cut.name != mechanism.driver


@pytest.mark.parametrize("mechanism", mechanisms.everything(), ids=lambda m: m.name)
def test_every_link_hangs_on_the_tree_once_and_parents_come_first(mechanism: Mechanism) -> None:
    tree = cut_loops(mechanism)
    placed = [GROUND]
    for branch in tree.branches:
        assert branch.parent.link in placed
        assert branch.child.link not in placed
        placed.append(branch.child.link)
    assert sorted(placed) == sorted([GROUND, *(link.name for link in mechanism.links)])
    assert len(tree.cuts) == len(mechanism.joints) - len(mechanism.links)


def test_a_cut_that_was_asked_for_is_made() -> None:
    mechanism = catalog.make("four_bar").mechanism
    for name in ("A", "B", "rocker"):
        assert [joint.name for joint in cut_loops(mechanism, (name,)).cuts] == [name]


@pytest.mark.parametrize(
    ("cut", "sentence"),
    [
        (("Q",), "there is no joint 'Q' to cut; known are crank, A, B, rocker"),
        (("crank",), "joint 'crank' is driven and cannot be cut"),
        (("A", "B"), "cutting A, B does not leave a tree"),
        ((), "cutting no joint does not leave a tree"),
    ],
)
def test_bad_cuts_are_refused_in_one_sentence(cut: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as told:
        cut_loops(catalog.make("four_bar").mechanism, cut)
    assert "\n" not in str(told.value)


def test_a_joint_that_no_constraint_closes_is_refused_as_a_cut() -> None:
    with pytest.raises(InputError, match="cut at prismatic joint 'slide', which no MuJoCo constraint closes"):
        cut_loops(catalog.make("slider_crank").mechanism, ("slide",))


def test_a_geared_joint_is_never_cut() -> None:
    mechanism = mechanisms.geared_five_bar()
    assert {joint.name for joint in cut_loops(mechanism).cuts}.isdisjoint({"shaft", "second"})
    with pytest.raises(InputError, match="joint 'second' is geared and cannot be cut"):
        cut_loops(mechanism, ("second",))


def test_links_that_nothing_joins_to_the_frame_are_named() -> None:
    apart = chain(
        Joint("crank", "revolute", End(GROUND), End("crank")), Joint("x", "revolute", End("a"), End("b"))
    )
    with pytest.raises(InputError, match="no chain of joints leads from the frame to a, b"):
        cut_loops(apart)


def test_a_loop_without_a_joint_that_can_be_cut_is_refused() -> None:
    slides = chain(
        Joint("crank", "revolute", End(GROUND), End("crank")),
        Joint("way", "prismatic", End("crank"), End("slider")),
        Joint("sleeve", "cylindrical", End(GROUND), End("slider")),
    )
    with pytest.raises(InputError, match="have a revolute or spherical joint in every loop"):
        cut_loops(slides)


def test_a_loop_without_a_joint_that_points_close_is_split_and_welded():
    tree = cut_loops(press(), splits=True)
    assert [joint.kind for joint in tree.cuts] == ["fixed"]
    assert len(tree.mechanism.links) == len(press().links) + 1
    with pytest.raises(InputError, match=r"prismatic joint 'guide', which no MuJoCo constraint closes"):
        cut_loops(press())
    motion = simulate(press(), speed=1.0, turns=0.1).motion
    assert set(motion.links) == {"spindle", "nut"}
