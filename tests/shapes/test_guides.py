"""Curves and cams are drawn where they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.mechanism.actuators import Actuator
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


def shoelace(x, y):
    """Return the area of a polygon by Gauss's formula."""
    return 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def test_a_cam_is_a_plate_within_its_profile():
    shapes = link_shapes(ms.load("cam_follower").mechanism)["cam"]
    (plate,) = (shape.facets for shape in shapes if shape.kind == "facets")
    a, b, c = (plate.vertices[plate.faces[:, k]] for k in range(3))
    # a closed surface has no resulting area; its volume is that of the profile's polygon times its thickness
    assert np.abs(np.cross(b - a, c - a).sum(0)).max() < 1e-15
    volume = (a * np.cross(b, c)).sum() / 6.0
    assert abs(abs(volume) - shoelace(*plate.vertices[:90, :2].T) * np.ptp(plate.vertices[:, 2])) < 1e-15


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


@pytest.mark.parametrize("slots", [3, 4, 7])
def test_a_polygon_is_a_plate_of_its_area(slots):
    mechanism = ms.load("geneva_drive", {"slots": slots}).mechanism
    for name in ("wheel", "crank"):
        corners = np.array(next(link.outline for link in mechanism.links if link.name == name))
        (plate,) = (shape for shape in link_shapes(mechanism)[name] if shape.kind == "facets")
        a, b, c = plate.facets.vertices[plate.facets.faces].swapaxes(0, 1)
        normals = np.cross(b - a, c - a)
        front = normals[:, 2] > 1e-12 * np.abs(normals).max()
        # triangles that do not overlap have the area of the polygon together, on either face
        assert 0.5 * normals[front, 2].sum() == pytest.approx(shoelace(*corners.T[:2]), rel=1e-12)
        assert front.sum() == len(corners) - 2


@pytest.mark.parametrize("slots", [3, 4, 7])
def test_the_drawn_geneva_wheel_is_locked_at_rest_and_clear_of_the_disc_while_it_turns(slots):
    solver = ms.load("geneva_drive", {"slots": slots})
    links = {link.name: np.array(link.outline)[:, :2] for link in solver.mechanism.links}
    crank, wheel = links["crank"], links["wheel"]
    distance, pin = 0.08, 0.004
    radius = distance * np.sin(np.pi / slots)
    disc = radius - 0.01
    for angle in np.linspace(-np.pi, np.pi, 73):
        rotated = solver.solve([angle]).joints["wheel"].value[0]
        corners = wheel @ np.array([[np.cos(rotated), np.sin(rotated)], [-np.sin(rotated), np.cos(rotated)]])
        corners += [distance, 0.0]
        gaps = np.hypot(*corners.T) - disc
        if abs(angle) >= np.pi / 2 - np.pi / slots - 1e-9:
            # an arc of seven corners lies on the disc
            assert np.sum(np.abs(gaps) < 1e-12) == 7
            assert gaps.min() > -1e-12
        else:
            along = np.exp(-1j * angle) * (corners @ [1.0, 1j])
            # no corner is in the disc, whose opening faces the pin
            closed = np.abs(np.angle(along)) > abs(np.angle(crank[0] @ [1.0, 1j]))
            assert (gaps[closed] > 0.0).all()
            # the pin is in the middle of the slot
            position = radius * np.exp(1j * angle) - distance
            own = position * np.exp(-1j * rotated)
            assert abs(own.imag) == pytest.approx(0.0, abs=1e-12)
            assert own.real < radius - distance + pin


def test_the_drawn_rotor_of_a_wankel_engine_stays_in_its_housing():
    links = {link.name: np.array(link.outline) for link in ms.load("wankel").mechanism.links}
    rotor, housing = (links[name][:, :2] @ [1.0, 1j] for name in ("rotor", "housing"))
    t = np.linspace(-np.pi, np.pi, 20001)
    wall = 0.015 * np.exp(3j * t) + 0.105 * np.exp(1j * t)
    order = np.argsort(np.angle(wall))

    def gaps(points):
        radius = np.interp(np.angle(points), np.angle(wall)[order], np.abs(wall)[order])
        return radius - np.abs(points)

    assert np.abs(gaps(housing)).max() < 1e-8
    for shaft in np.linspace(0.0, 2.0 * np.pi, 37):
        off = gaps(0.015 * np.exp(1j * shaft) + rotor * np.exp(1j * shaft / 3.0))
        assert off.min() > -1e-8
        assert np.sum(off < 1e-8) >= 3


def test_springs_in_joints_have_a_spiral_or_two_ends(tmp_path):
    pivot = ms.load(str(ELEMENTS / "torsion_spring.toml"), still=True)
    assert torsion_springs(pivot.mechanism, pivot.forces) == ("hip",)
    arm = link_shapes(pivot.mechanism, forces=pivot.forces)["arm"]
    spiral = [shape for shape in arm if shape.kind == "capsule" and shape.rgba == STEEL]
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
    # a cylinder is drawn as a damper
    ends = ("ground", (0.1, -0.2, 0.0)), (oil.mechanism.links[0].name, (0.15, 0.0, 0.0))
    cylinder = replace(oil.forces, springs=(), actuators=(Actuator("lift", {}, ends=ends),))
    assert spring_ends(oil.mechanism, cylinder) == ((*ends, True),)
    # unloaded, the block is half of the mechanism's size from the other end
    length = slide.mechanism.characteristic_length
    assert np.abs(np.add(end, [0.0, 0.1, 0.0]) - start - [0.0, 0.5 * length, 0.0]).max() < 1e-15


def test_a_table_wider_than_its_mechanism_is_not_drawn():
    mechanism = ms.load("peaucellier_rods").mechanism
    discs = [shape for shape in link_shapes(mechanism)["ground"] if shape.kind == "cylinder"]
    # the longest rod is 80 mm; P is 92 mm from the origin of its plane
    assert max(shape.sizes[0] for shape in discs) < 0.01
