"""Curves and cams are drawn where they are."""

from pathlib import Path

import numpy as np
from model_files import model_text

import mechsim as ms
from mechsim.shapes.joints import link_shapes
from mechsim.shapes.shape import STEEL
from mechsim.shapes.springs import spring_ends, torsion_springs

ELEMENTS = Path(__file__).parents[2] / "docs/elements"
MODEL = model_text("guides_model.toml")


def test_profiles_curves_and_rollers_are_drawn_without_the_links_of_their_equations(tmp_path):
    (tmp_path / "drawn.toml").write_text(MODEL)
    mechanism = ms.load(str(tmp_path / "drawn.toml"), still=True).mechanism
    shapes = link_shapes(mechanism)
    assert [name for name, drawn in shapes.items() if name.startswith("~") and drawn] == []
    # points of the ellipse, and the ends of the lift
    rail = np.array([shape.frm[:2] for shape in shapes["ground"] if shape.kind == "capsule"])
    assert np.abs(((rail - [0.1, 0.0]) / [0.01, 0.02]) ** 2 @ [1.0, 1.0] - 1.0).max() < 1e-12
    profile = np.array([shape.frm[:2] for shape in shapes["cam"] if shape.kind == "capsule"])
    assert len(profile) == len(rail) == 90
    # lowest and highest radius of the profile: 25 and 35 mm
    assert np.abs(profile[0] - [0.0, 0.025]).max() < 1e-12
    assert np.abs(profile[45] - [0.0, -0.035]).max() < 1e-12
    assert profile[20, 0] > 0.0
    assert [shape.sizes[0] for shape in shapes["ram"] if shape.kind == "cylinder"] == [0.006]


def test_a_cam_is_a_plate_within_its_profile():
    shapes = link_shapes(ms.load("cam_follower").mechanism)["cam"]
    (plate,) = (shape.facets for shape in shapes if shape.kind == "facets")
    a, b, c = (plate.vertices[plate.faces[:, k]] for k in range(3))
    # a closed surface has no resulting area; its volume is that of the profile's polygon times its thickness
    assert np.abs(np.cross(b - a, c - a).sum(0)).max() < 1e-15
    x, y = plate.vertices[:90, :2].T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    volume = (a * np.cross(b, c)).sum() / 6.0
    assert abs(abs(volume) - abs(area) * np.ptp(plate.vertices[:, 2])) < 1e-15


def test_the_falls_of_a_rope_reach_from_the_drum_to_the_hook():
    mechanism = ms.load("hoist").mechanism
    shapes = link_shapes(mechanism, travel={"hook": (0.0, 0.15)})
    upper, lower = (
        [shape for shape in shapes[link] if shape.kind == "capsule" and shape.rgba[0] < 0.2]
        for link in ("ground", "hook")
    )
    # on both sides of the hook; at its lowest 0.5 m below the drum, at its highest 0.35 m
    assert np.abs(np.array([shape.frm[0] for shape in upper]) - [0.05, 0.1]).max() < 1e-15
    for above, below in zip(upper, lower, strict=True):
        assert abs(above.to[1] + 0.35) < 1e-15
        for hook in (-0.5, -0.35):
            assert below.to[1] + hook >= above.to[1]
            assert below.frm[1] + hook <= above.to[1]


def test_a_polygon_is_drawn_in_the_order_of_its_corners():
    mechanism = ms.load("geneva_drive").mechanism
    corners = next(link.outline for link in mechanism.links if link.name == "wheel")
    bars = [shape for shape in link_shapes(mechanism)["wheel"] if shape.kind == "box"]
    drawn = np.array([shape.frm[:2] for shape in bars[: len(corners)]])
    assert np.abs(drawn - np.array(corners)[:, :2]).max() < 1e-15
    assert np.abs(np.array(bars[15].to[:2]) - corners[0][:2]).max() < 1e-15


def test_springs_in_joints_have_a_spiral_or_two_ends(tmp_path):
    pivot = ms.load(str(ELEMENTS / "torsion_spring.toml"), still=True)
    assert torsion_springs(pivot.mechanism, pivot.forces) == ("hip",)
    spiral = [
        shape
        for shape in link_shapes(pivot.mechanism, forces=pivot.forces)["arm"]
        if shape.kind == "capsule" and shape.rgba == STEEL
    ]
    radii = [float(np.hypot(*shape.to[:2])) for shape in spiral]
    assert len(radii) == 50
    assert (np.diff(radii) > 0.0).all()
    text = (ELEMENTS / "damper.toml").read_text().partition("[forces")[0]
    (tmp_path / "slide.toml").write_text(
        f"{text}[forces]\njoint_springs.slide = {{stiffness = 400, rest = 0.1}}\n"
    )
    slide = ms.load(str(tmp_path / "slide.toml"), still=True)
    assert torsion_springs(slide.mechanism, slide.forces) == ()
    ((a, start), (b, end), damper) = spring_ends(slide.mechanism, slide.forces)[0]
    assert (a, b, damper) == ("ground", "block", False)
    oil = ms.load(str(ELEMENTS / "damper.toml"), still=True)
    assert [damper for *_, damper in spring_ends(oil.mechanism, oil.forces)] == [True]
    # unloaded, the block is half of the mechanism's size from the other end
    length = slide.mechanism.characteristic_length
    assert np.abs(np.add(end, [0.0, 0.1, 0.0]) - start - [0.0, 0.5 * length, 0.0]).max() < 1e-15


def test_a_table_wider_than_its_mechanism_is_not_drawn():
    mechanism = ms.load("peaucellier_rods").mechanism
    discs = [shape for shape in link_shapes(mechanism)["ground"] if shape.kind == "cylinder"]
    # the longest rod is 80 mm; P is 92 mm from the origin of its plane
    assert max(shape.sizes[0] for shape in discs) < 0.01
