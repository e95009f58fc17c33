"""Racks: toothed bars that a pinion shifts, where the same link guides the one and carries the other."""

import numpy as np

from mechsim.model.couplings import Coupling
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND
from mechsim.shapes.canvas import Canvas, upright_end
from mechsim.shapes.shape import Shape, vector
from mechsim.shapes.wheels import Wheel, angle_in, draw_wheel, wheel_colour, wheel_height

# cosine of the angle between slide and shaft below which they are square, and teeth of a rack at the most
SQUARE, MOST = 1e-9, 400


def draw_racks(canvas: Canvas, teeth: int) -> None:
    """Draw pinions of so many teeth and their racks, as long as their way asks for."""
    for coupling in canvas.mechanism.couplings:
        if isinstance(coupling.left, str) and isinstance(coupling.right, str):
            joints = {joint.name: joint for joint in canvas.mechanism.joints}
            rack, pinion = joints.get(coupling.left), joints.get(coupling.right)
            if rack and pinion and _meshes(coupling, rack, pinion):
                _draw(canvas, coupling, rack, pinion, teeth)


def _meshes(coupling: Coupling, rack: Joint, pinion: Joint) -> bool:
    square = abs(float(np.dot(rack.a.axis, pinion.a.axis))) < SQUARE
    slide, hinge = KINDS[rack.kind], KINDS[pinion.kind]
    kinds = slide.single and not slide.turns and hinge.hinge and rack.a.link == pinion.a.link
    return kinds and square and len(coupling.coefficients) == 2 and coupling.slope != 0.0


def _draw(canvas: Canvas, coupling: Coupling, rack: Joint, pinion: Joint, teeth: int) -> None:
    """Draw a pinion and the teeth of its rack, a tooth of the one in a gap of the other.

    A bracket joins the rack to the place of its slide.
    """
    radius = abs(coupling.slope)
    step = 2.0 * np.pi * radius / teeth
    way, axis = np.asarray(rack.a.axis), np.asarray(pinion.a.axis)
    out = np.cross(way, axis) * np.sign(coupling.slope)
    draw_wheel(canvas, Wheel(pinion.b, radius, teeth, angle_in(pinion.a, out) - coupling.zeros[1]))
    own = pinion.a
    up = np.asarray((upright_end(own, canvas.normals[own.link]) if canvas.normals else own).axis)
    meet = own.point + wheel_height(canvas) * up + radius * out
    # in the rack's frame, which goes along the slide
    turned = rack.b.frame @ rack.a.frame.T
    here = coupling.zeros[0] + coupling.coefficients[0]
    base = rack.b.point + turned @ (meet - rack.a.point) - here * (turned @ way)
    low, high = (here - end for end in canvas.travel_of(rack)[::-1])
    depth, colour = 0.7 * np.pi * radius / teeth, wheel_colour(canvas, rack.b.link)
    outward, forward, flat = turned @ out, turned @ way, vector(turned @ axis)
    first, last = np.floor(low / step) - 2.0, np.ceil(high / step) + 2.0
    if last - first > MOST:
        return
    shapes = canvas.out[rack.b.link]
    for k in np.arange(first, last) + 0.5:
        foot = base + k * step * forward
        ends = vector(foot - 0.8 * depth * outward), vector(foot + 1.3 * depth * outward)
        shapes.append(Shape("box", *ends, (0.21 * step, 0.57 * canvas.r), colour, flat))
    bar = base + (depth + 1.2 * canvas.r) * outward
    ends = vector(bar + first * step * forward), vector(bar + last * step * forward)
    shapes.append(Shape("box", *ends, (1.2 * canvas.r, 0.6 * canvas.r), colour, flat))
    if rack.b.link != GROUND:
        own = rack.b.point + canvas.lift(rack.b)
        along = np.clip(float((own - bar) @ forward), first * step, last * step)
        under = bar + along * forward
        canvas.join(rack.b.link, (own, under + float((own - under) @ flat) * np.asarray(flat), under))
