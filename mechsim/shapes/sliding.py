"""Joints that slide: a block on a rail, a sleeve on a shaft."""

import numpy as np

from mechsim.model.mechanism import GROUND, Joint
from mechsim.shapes.canvas import Canvas
from mechsim.shapes.shape import HOUSING, STEEL, Array, Shape, vector


def slide(canvas: Canvas, joint: Joint) -> None:
    """Draw a block on a rail that is as long as the way it goes."""
    r = canvas.r
    low, high = canvas.way(joint)
    rail, block = joint.a, joint.b
    thick = canvas.thickness(rail)
    at = np.asarray(rail.point) - 1.9 * r * thick + canvas.lift(rail)
    axis = np.asarray(rail.axis)
    ends = at + (low - 4.0 * r) * axis, at + (high + 4.0 * r) * axis
    colour = STEEL if rail.link == GROUND else canvas.colours[rail.link]
    shape = Shape("box", vector(ends[0]), vector(ends[1]), (1.4 * r, 0.6 * r), colour, vector(thick))
    canvas.out[rail.link].append(shape)
    if rail.link == GROUND and canvas.normals:
        _feet(canvas, shape, thick)
    thick = canvas.thickness(block)
    at, axis = np.asarray(block.point) + canvas.lift(block), np.asarray(block.axis)
    ends = at - 3.0 * r * axis, at + 3.0 * r * axis
    colour = STEEL if block.link == GROUND else canvas.colours[block.link]
    size = (2.2 * r, 1.2 * r)
    canvas.out[block.link].append(Shape("box", vector(ends[0]), vector(ends[1]), size, colour, vector(thick)))


def _feet(canvas: Canvas, rail: Shape, thick: Array) -> None:
    """Draw two feet that carry a rail on the mounting plate."""
    for end, inward in ((rail.frm, rail.to), (rail.to, rail.frm)):
        way = np.subtract(inward, end)
        at = np.asarray(end) + 2.0 * canvas.r * way / np.linalg.norm(way)
        plate = at + thick * (canvas.back - float(at @ thick))
        canvas.add(GROUND, "cylinder", at, plate, 1.3 * canvas.r, HOUSING)


def sleeve(canvas: Canvas, joint: Joint) -> None:
    """Draw a shaft on one link as long as the way along it, a sleeve on the other."""
    r = canvas.r
    low, high = canvas.way(joint)
    colour = STEEL if joint.a.link == GROUND else canvas.colours[joint.a.link]
    canvas.disc(joint.a.link, joint.a, low - 8.0 * r, high + 8.0 * r, 1.0 * r, colour)
    if joint.a.link == GROUND:
        for low_end in (low - 8.0 * r, high + 5.6 * r):
            canvas.bearing(joint.a, low_end, low_end + 2.4 * r)
    colour = HOUSING if joint.b.link == GROUND else canvas.colours[joint.b.link]
    canvas.disc(joint.b.link, joint.b, -3.0 * r, 3.0 * r, 1.9 * r, colour)
