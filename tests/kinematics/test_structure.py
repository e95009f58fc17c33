"""Mobility and Assur groups: laws on random chains, exchanged drivers, and groups by exhaustive search."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mechsim import catalog
from mechsim.errors import InputError
from mechsim.kinematics.assur import assur_groups
from mechsim.kinematics.mobility_count import mobility
from mechsim.mechanism.joints import End, Gear, Joint
from mechsim.mechanism.links import EX, EZ, GROUND, IDENTITY, Link
from mechsim.mechanism.mechanism import Mechanism

JointPositions = Mapping[str, tuple[str, str, tuple[float, float]]]


def planar(joint_positions: JointPositions) -> Mechanism:
    """Return a planar mechanism with geared cranks; link frames are the ground frame at the start."""
    names = dict.fromkeys(link for a, b, _ in joint_positions.values() for link in (a, b) if link != GROUND)
    joints = []
    for name, (a, b, (x, y)) in joint_positions.items():
        point = (1e-3 * x, 1e-3 * y, 0.0)
        joints.append(Joint(name, "revolute", End(a, point, EZ, EX), End(b, point, EZ, EX)))
    links, gears = tuple(Link(name) for name in names), (Gear("crank", "crank2", 1.5),)
    guess = dict.fromkeys(names, IDENTITY)
    return Mechanism("drawn", links, tuple(joints), "crank", {}, gears=gears, guess=guess)


def knitter() -> Mechanism:
    return catalog.make("warp_knitter").mechanism


def groups_of(mechanism: Mechanism) -> list[tuple]:
    groups = assur_groups(mechanism).groups
    return [(group.class_, group.order, set(group.links)) for group in groups]


def test_the_gear_pair_of_the_warp_knitter_removes_a_dof():
    loose = mobility(replace(knitter(), gears=()))
    assert (loose.actual, loose.grubler) == (2, 2)
    assert loose.undetermined == ("crank2",)


# with a crank locked, driven from the rod on its pin
@pytest.mark.parametrize(
    ("locked", "driver", "groups"),
    [
        ("crank2", "D", ["rod5", {"base", "rocker"}, {"crank1", "rod3"}]),
        ("crank", "A", ["rod3", {"base", "rocker"}, {"crank2", "rod5"}]),
    ],
)
def test_a_warp_knitter_driven_by_a_rod_consists_of_dyads(locked, driver, groups):
    exchanged = replace(knitter(), driver=driver, gears=(), locked={locked: 0.0})
    chosen, (rod, *dyads) = assur_groups(exchanged), groups
    assert groups_of(exchanged) == [(2, 2, links) for links in dyads]
    assert (chosen.drivers, chosen.class_) == ((rod,), 2)


def test_the_rocker_of_the_warp_knitter_can_be_its_driver():
    chosen = assur_groups(replace(knitter(), driver=("rocker", "crank2"), gears=()))
    assert chosen.drivers == ("rocker", "crank2")
    assert [group.class_ for group in chosen.groups] == [2, 2]


def test_welded_links_have_the_structure_of_single_links():
    whole = knitter()
    # side b of every joint belongs to a separate piece, welded to the link
    welds = {joint.name: f"piece of {joint.name}" for joint in whole.joints if joint.name != whole.driver}
    joints = [
        replace(joint, b=replace(joint.b, link=welds.get(joint.name, joint.b.link))) for joint in whole.joints
    ]
    for name, piece in welds.items():
        joints.append(Joint(f"weld of {name}", "fixed", End(whole.joint(name).b.link), End(piece)))
    # and a loose plate lies on the plane
    joints.append(Joint("plate", "planar", End(GROUND), End("plate")))
    links = (*whole.links, *(Link(piece) for piece in welds.values()), Link("plate"))
    guess = {**whole.guess, "plate": IDENTITY}
    guess |= {welds[j.name]: whole.guess[j.b.link] for j in whole.joints if j.name in welds}
    pieces = replace(whole, links=links, joints=tuple(joints), guess=guess)
    own, of_pieces = mobility(whole), mobility(pieces)
    assert of_pieces.grubler == own.grubler + 3
    assert of_pieces.actual == own.actual + 3
    assert of_pieces.redundant_in_plane == own.redundant_in_plane
    # without the plate, which nothing drives
    del guess["plate"]
    pieces = replace(pieces, links=links[:-1], joints=tuple(joints[:-1]), guess=guess)
    names = {link.name for link in whole.links}
    groups = [(g.class_, g.order, names & {*g.links}) for g in assur_groups(pieces).groups]
    assert groups == [(g.class_, g.order, {*g.links}) for g in assur_groups(whole).groups]


def test_the_links_of_a_driven_joint_between_moving_links_count_as_one():
    # crank1 and rod3 as one link, and rod3 and base: both dyads hang on the frame
    chosen = assur_groups(replace(knitter(), driver=("A", "B"), gears=()))
    assert (chosen.drivers, chosen.inner) == ((), ("A", "B"))
    assert [set(group.links) for group in chosen.groups] == [{"crank1", "rocker"}, {"crank2", "rod5"}]
    with pytest.raises(InputError, match="leave 1 degree of freedom to crank1"):
        assur_groups(replace(knitter(), driver="A", gears=()))


@st.composite
def generated_chains(draw: st.DrawFn, most: int = 3) -> tuple[Mechanism, list[tuple[int, set[str]]]]:
    """Return a planar chain grown group by group on a frame, a crank and a geared crank, and its groups."""
    seed = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    positions: dict[str, tuple[str, str, tuple[float, float]]] = {}

    def join(name: str, a: str, b: str) -> None:
        x, y = seed.uniform(-100.0, 100.0, 2).tolist()
        positions[name] = (a, b, (x, y))

    join("crank", GROUND, "crank")
    join("crank2", GROUND, "crank2")
    placed, groups = [GROUND, "crank", "crank2"], []
    for i, kind in enumerate(draw(st.lists(st.sampled_from([2, 3, 4]), min_size=1, max_size=most))):
        links = [f"{letter}{i}" for letter in "abcd"[: 2 if kind == 2 else 4]]
        inner = {2: ["ab"], 3: ["ab", "ac", "ad"], 4: ["ab", "bc", "cd", "da"]}[kind]
        outer = {2: "ab", 3: "bcd", 4: "ac"}[kind]
        for item, other in inner:
            join(f"{item}{other}{i}", f"{item}{i}", f"{other}{i}")
        for item in outer:
            join(f"{item}{i}", draw(st.sampled_from(placed)), f"{item}{i}")
        placed += links
        groups.append((kind, set(links)))
    shuffled = draw(st.permutations(list(positions)))
    return planar({name: positions[name] for name in shuffled}), groups


@given(generated_chains())
def test_a_generated_chain_has_the_groups_it_was_built_from(chain):
    mechanism, grown_from = chain
    answer = assur_groups(mechanism)
    assert sorted((g.class_, sorted(g.links)) for g in answer.groups) == sorted(
        (kind, sorted(links)) for kind, links in grown_from
    )
    assert len(answer.drivers) + sum(len(g.links) for g in answer.groups) == len(mechanism.links)
    assert all(3 * len(g.links) == 2 * g.pairs for g in answer.groups)


@settings(max_examples=8)
@given(generated_chains(most=2))
def test_rank_and_grubler_count_agree_for_generic_chains(chain):
    mechanism, _ = chain
    m = mobility(mechanism)
    assert m.actual == m.grubler == 1
    assert m.redundant_in_plane == 0
