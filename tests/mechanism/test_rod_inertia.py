import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from model_files import FOLDER, stated_mechanism

import mechsim as ms
from mechsim.mechanism.links import GROUND, Inertia, combine
from mechsim.mechanism.masses import RELATIVE_DIAMETER, STEEL, masses_of, round_rod, summary, with_inertia


def test_the_inertia_of_a_round_rod_is_that_of_a_solid_cylinder():
    """I = m r^2/2 along the axis and m (3 r^2 + l^2)/12 across it (Meriam & Kraige, table D/4)."""
    start, end, radius = np.array([0.1, 0.2, -0.1]), np.array([0.4, -0.1, 0.3]), 0.025
    rod, length = round_rod(tuple(start), tuple(end), 2000.0, 2.0 * radius), np.linalg.norm(end - start)
    assert rod.mass == pytest.approx(2000.0 * np.pi * radius**2 * length, rel=1e-14)
    assert rod.centre == pytest.approx(0.5 * (start + end), rel=1e-14)
    line = (end - start) / length
    along, across = 0.5 * rod.mass * radius**2, rod.mass * (3.0 * radius**2 + length**2) / 12.0
    exact = across * np.eye(3) + (along - across) * np.outer(line, line)
    np.testing.assert_allclose(rod.matrix, exact, rtol=1e-12)


def test_explicit_inertias_are_kept():
    mechanism = stated_mechanism("rod_inertia_arm.toml")
    kept = with_inertia(mechanism)
    assert kept.links[0].inertia is mechanism.links[0].inertia
    # a link of one point is a pin along its joint's axis, twice as long as thick
    thick = RELATIVE_DIAMETER * 0.2
    assert kept.links[1].inertia == round_rod((0.0, -thick, 0.0), (0.0, thick, 0.0), STEEL, thick)


def test_collinear_points_are_one_rod_and_triangles_two():
    ends = [ms.End("bar", point) for point in ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.1, 0.0, 0.0))]
    joints = [
        ms.Joint("crank", "revolute", ms.End(GROUND), ends[0]),
        *(
            ms.Joint(f"j{i}", "spherical", ms.End(GROUND, (0.1 * i, 0.0, 0.0)), end)
            for i, end in enumerate(ends[1:])
        ),
    ]
    straight = with_inertia(ms.Mechanism("bar", (ms.Link("bar"),), tuple(joints), "crank", {}), 1000.0, 0.01)
    whole = round_rod((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), 1000.0, 0.01)
    assert straight.links[0].inertia.mass == pytest.approx(whole.mass, rel=1e-13)
    assert straight.links[0].inertia.centre == pytest.approx(whole.centre, rel=1e-13)
    curved = ms.Mechanism("bar", (ms.Link("bar", ((0.3, 0.4, 0.0),)),), (joints[0], joints[1]), "crank", {})
    inertia = with_inertia(curved, 1000.0, 0.01).links[0].inertia
    assert inertia.mass == pytest.approx(1000.0 * np.pi / 4.0 * 1e-4 * 0.7, rel=1e-13)


def test_the_rod_of_a_pendulum_ends_at_its_tracked_point():
    joint = ms.Joint("hinge", "revolute", ms.End(GROUND), ms.End("rod"))
    pendulum = ms.Mechanism("pendulum", (ms.Link("rod"),), (joint,), "hinge", {"P": ("rod", (0.6, 0.8, 0.0))})
    inertia = with_inertia(pendulum, 1000.0, 0.01).links[0].inertia
    assert inertia.mass == pytest.approx(1000.0 * np.pi / 4.0 * 1e-4, rel=1e-13)
    assert inertia.centre == pytest.approx((0.3, 0.4, 0.0), rel=1e-13)


def test_a_cam_without_an_inertia_is_a_disc_of_its_base_radius():
    cam = next(link for link in with_inertia(ms.load("cam_follower").mechanism).links if link.name == "cam")
    # base radius 30 mm and roller 8 mm: characteristic length 38 mm, pin 1.9 mm thick and 3.8 mm long
    solids = [(0.0019 / 2, 0.0038), (0.03, 0.0038)]
    masses = [STEEL * np.pi * radius**2 * length for radius, length in solids]
    moment = sum(mass * radius**2 / 2 for mass, (radius, _) in zip(masses, solids, strict=True))
    assert cam.inertia.mass == pytest.approx(sum(masses), rel=1e-13)
    assert cam.inertia.matrix[2][2] == pytest.approx(moment, rel=1e-13)
    assert cam.inertia.rods.disc == 0.03


centres = st.tuples(*[st.integers(-999, 999).map(lambda value: (value + 0.37) * 1e-3)] * 3)


@given(st.lists(st.tuples(st.floats(0.1, 5.0), centres), min_size=1, max_size=4))
def test_combined_bodies_have_the_sum_of_moments(masses_and_centres):
    bodies = [Inertia(mass, centre, (0.4, 0.5, 0.6)) for mass, centre in masses_and_centres]
    whole = combine(bodies)
    about = np.sum([body.about((0.3, -0.2, 0.7)) for body in bodies], axis=0)
    assert np.allclose(whole.about((0.3, -0.2, 0.7)), about, rtol=1e-12, atol=1e-12)
    assert whole.mass == pytest.approx(sum(mass for mass, _ in masses_and_centres), rel=1e-14)


def test_a_massless_link_of_a_scene_is_listed_as_zero():
    # a massless link next to one with mass
    solver = ms.load(FOLDER / "masses_scene.xml", lock={"tip": 0.0})
    assert {item.link: item.source for item in masses_of(solver.mechanism)} == {"arm": "given", "tip": "zero"}
    assert summary(masses_of(solver.mechanism)) == "masses: arm given, 2 kg; tip zero in the file"


def test_rods_of_another_material_are_listed_with_their_density():
    mechanism = with_inertia(ms.catalog.make("four_bar").mechanism, 2700.0)
    assert "2700 kg/m3 rods" in summary(masses_of(mechanism))
    assert "steel" in summary(masses_of(with_inertia(ms.catalog.make("four_bar").mechanism)))
