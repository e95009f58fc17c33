"""Belts around pulleys against the formulas of open and crossed belts."""

import numpy as np
import pytest
from model_files import copied, model_text

import mechsim as ms
from mechsim.mechanism.belts import belts_of
from mechsim.shapes.joints import link_shapes

DISTANCE, SMALL, LARGE = np.hypot(0.3, 0.1), 0.05, 0.12


def belt(text="", side=1):
    model = ms.load(copied(model_text("belts_belt.toml", more=text, side=side)))
    (path,) = belts_of(model.mechanism)
    return model, path


def test_an_open_belt_has_the_length_and_wrap_angles_of_the_textbook():
    model, path = belt()
    half = np.arcsin((LARGE - SMALL) / DISTANCE)
    wraps = np.pi - 2 * half, np.pi + 2 * half
    length = 2 * np.sqrt(DISTANCE**2 - (LARGE - SMALL) ** 2) + SMALL * wraps[0] + LARGE * wraps[1]
    assert np.abs(path.wraps - wraps).max() < 1e-15
    assert abs(path.length - length) < 1e-15
    angle = np.array([0.0, 1.0, 9.0])
    assert np.abs(model.solve(angle).joints["fan"].value - angle * SMALL / LARGE).max() < 1e-14


@pytest.mark.parametrize(("text", "side"), [("crossed = true", 1), ("", -1)])
def test_a_crossed_belt_reverses_the_rotation(text, side):
    _, path = belt(text, side)
    wrap = np.pi + 2 * np.arcsin((LARGE + SMALL) / DISTANCE)
    assert np.abs(path.wraps - wrap).max() < 1e-15
    assert abs(path.length - 2 * np.sqrt(DISTANCE**2 - (LARGE + SMALL) ** 2) - (LARGE + SMALL) * wrap) < 1e-15


@pytest.mark.parametrize("centre", [(0.15, -0.02), (0.1, 0.14), (0.2, -0.05)])
def test_a_tensioner_presses_on_the_nearer_strand(centre):
    tensioner = f"tensioner = {{ at = [{centre[0]}, {centre[1]}, 0], radius = 0.03 }}"
    _, path = belt(tensioner)
    along = path.tangents[:, 1] - path.tangents[:, 0]
    for i, middle in enumerate(path.centres):
        # the strands before and after touch the pulley
        for point, direction in ((path.tangents[i, 0], along[i]), (path.tangents[i - 1, 1], along[i - 1])):
            assert abs((point - middle) @ direction) < 1e-16
            assert abs(np.linalg.norm(point - middle) - abs(path.radii[i])) < 1e-16
    polygon = np.vstack(path.points(1e-4))
    steps = np.diff(np.vstack([polygon, polygon[:1]]), axis=0)
    # chords of 1e-4 rad are shorter than their arcs by 4e-10
    assert abs(np.linalg.norm(steps, axis=1).sum() - path.length) < 1e-9
    assert path.length > belt()[1].length


def test_a_belt_is_drawn_around_its_pulleys():
    model, path = belt("crossed = true")
    strands = [shape for shape in link_shapes(model.mechanism)["ground"] if shape.kind == "capsule"]
    length = sum(np.linalg.norm(np.subtract(shape.to, shape.frm)) for shape in strands)
    assert length == pytest.approx(path.length, rel=2e-3)
