"""How each kind of joint is drawn: eyes and pins, shafts in bearings, blocks on rails, balls, crosses."""

from collections.abc import Callable

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.joints import KindName
from mechsim.model.mechanism import GROUND, End, Joint
from mechsim.shapes.body import stations
from mechsim.shapes.canvas import Canvas, upright_end
from mechsim.shapes.shape import HOUSING, STEEL, Shape, vector


def revolute(canvas: Canvas, joint: Joint) -> None:
    """Draw eyes and a pin in a flat mechanism, else a shaft in a bearing or a fork."""
    (flat_revolute if canvas.normals else spatial_revolute)(canvas, joint)


def flat_revolute(canvas: Canvas, joint: Joint) -> None:
    """Draw two eyes in their layers and the pin through both; on the ground a boss on the plate."""
    assert canvas.normals
    heights = [canvas.height(end.link) for end in (joint.a, joint.b) if end.link != GROUND]
    thick, top = 0.62 * canvas.r, max(heights) + 1.0 * canvas.r
    for end in (joint.a, joint.b):
        if end.link != GROUND:
            upright = upright_end(end, canvas.normals[end.link])
            at = canvas.height(end.link)
            canvas.disc(end.link, upright, at - thick, at + thick, 1.9 * canvas.r, canvas.colours[end.link])
    grounded = [end for end in (joint.a, joint.b) if end.link == GROUND]
    if grounded:
        post = upright_end(grounded[0], canvas.normals[GROUND])
        canvas.disc(GROUND, post, canvas.back, min(heights) - 1.2 * thick, 2.4 * canvas.r, HOUSING)
        canvas.disc(GROUND, post, canvas.back, top, 0.9 * canvas.r, STEEL)
    else:
        pin = upright_end(joint.a, canvas.normals[joint.a.link])
        canvas.disc(joint.a.link, pin, min(heights) - 1.0 * canvas.r, top, 0.9 * canvas.r, STEEL)


def spatial_revolute(canvas: Canvas, joint: Joint) -> None:
    """Draw a hub and a shaft into a bearing on the ground; between moving links a fork and an eye."""
    r = canvas.r
    for ground, link in ((joint.a, joint.b), (joint.b, joint.a)):
        if ground.link == GROUND:
            canvas.disc(link.link, link, -1.6 * r, 1.6 * r, 2.0 * r, canvas.colours[link.link])
            away = canvas.outward.get(joint.name, -1.0)
            low, high = sorted((-2.2 * r * away, 9.0 * r * away))
            canvas.disc(GROUND, ground, low, high, 1.1 * r, STEEL)
            low, high = sorted((4.2 * r * away, 7.8 * r * away))
            canvas.bearing(ground, low, high)
            return
    a, b = joint.a, joint.b
    canvas.disc(b.link, b, -1.1 * r, 1.1 * r, 1.9 * r, canvas.colours[b.link])
    for low, high in ((-2.0 * r, -1.2 * r), (1.2 * r, 2.0 * r)):
        canvas.disc(a.link, a, low, high, 1.9 * r, canvas.colours[a.link])
    canvas.disc(a.link, a, -2.5 * r, 2.5 * r, 0.9 * r, STEEL)


def ball(canvas: Canvas, joint: Joint) -> None:
    """Draw a steel ball on the first link, a collar of the second around it."""
    place = joint.a.point
    canvas.add(joint.a.link, "sphere", place, place, 2.0 * canvas.r, STEEL)
    rod = _rod_direction(canvas, joint.b)
    if rod is not None:
        at = np.asarray(joint.b.point)
        ends = at + 1.0 * canvas.r * rod, at + 2.6 * canvas.r * rod
        canvas.add(joint.b.link, "cylinder", *ends, 1.8 * canvas.r, canvas.colours[joint.b.link])


def cross(canvas: Canvas, joint: Joint) -> None:
    """Draw the two crossing pins of a universal joint, each on its own link."""
    r = canvas.r
    canvas.disc(joint.a.link, joint.a, -2.8 * r, 2.8 * r, 1.0 * r, STEEL)
    canvas.disc(joint.b.link, joint.b, -2.4 * r, 2.4 * r, 1.3 * r, canvas.colours[joint.b.link])
    canvas.add(joint.a.link, "sphere", joint.a.point, joint.a.point, 1.6 * r, STEEL)


def slide(canvas: Canvas, joint: Joint) -> None:
    """Draw a block on a rail that is as long as its travel."""
    r = canvas.r
    low, high = canvas.travel_of(joint)
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


def sleeve(canvas: Canvas, joint: Joint) -> None:
    """Draw a shaft on one link as long as the travel along it, a sleeve on the other."""
    r = canvas.r
    low, high = canvas.travel_of(joint)
    colour = STEEL if joint.a.link == GROUND else canvas.colours[joint.a.link]
    canvas.disc(joint.a.link, joint.a, low - 8.0 * r, high + 8.0 * r, 1.0 * r, colour)
    if joint.a.link == GROUND:
        for low_end in (low - 8.0 * r, high + 5.6 * r):
            canvas.bearing(joint.a, low_end, low_end + 2.4 * r)
    colour = HOUSING if joint.b.link == GROUND else canvas.colours[joint.b.link]
    canvas.disc(joint.b.link, joint.b, -3.0 * r, 3.0 * r, 1.9 * r, colour)


def plate(canvas: Canvas, joint: Joint) -> None:
    """Draw a table across the axis on one link, and a foot that glides on it."""
    r = canvas.r
    colour = STEEL if joint.a.link == GROUND else canvas.colours[joint.a.link]
    canvas.disc(joint.a.link, joint.a, -0.6 * r, 0.0, 6.0 * r, colour)
    colour = HOUSING if joint.b.link == GROUND else canvas.colours[joint.b.link]
    canvas.disc(joint.b.link, joint.b, 0.0, 1.2 * r, 2.0 * r, colour)


def weld(canvas: Canvas, joint: Joint) -> None:
    """Draw a collar where two links are one."""
    canvas.disc(joint.b.link, joint.b, -0.8 * canvas.r, 0.8 * canvas.r, 1.6 * canvas.r, HOUSING)


def _feet(canvas: Canvas, rail: Shape, thick: Array) -> None:
    """Draw two feet that carry a rail on the mounting plate."""
    for end, inward in ((rail.frm, rail.to), (rail.to, rail.frm)):
        along = np.subtract(inward, end)
        at = np.asarray(end) + 2.0 * canvas.r * along / np.linalg.norm(along)
        plate = at + thick * (canvas.back - float(at @ thick))
        canvas.add(GROUND, "cylinder", at, plate, 1.3 * canvas.r, HOUSING)


def _rod_direction(canvas: Canvas, end: End) -> Array | None:
    """The direction from a joint to the rest of its link, None where the link is only that place."""
    rest = np.array(stations(canvas.mechanism, end.link)) - np.asarray(end.point)
    towards = rest.sum(0)
    length = float(np.linalg.norm(towards))
    return towards / length if length > 0.1 * canvas.r else None


DRAW: dict[KindName, Callable[[Canvas, Joint], None]] = {
    "revolute": revolute,
    "prismatic": slide,
    "cylindrical": sleeve,
    "screw": sleeve,
    "planar": plate,
    "fixed": weld,
    "floating": lambda canvas, joint: None,
    "universal": cross,
    "spherical": ball,
}
