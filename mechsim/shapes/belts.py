"""Belts and chains around their pulleys."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from mechsim.mechanism.belts import belts_of
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND
from mechsim.numerics.arrays import REVOLUTION
from mechsim.shapes.body import Canvas
from mechsim.shapes.gears import wheel_colour, wheel_height
from mechsim.shapes.shape import HOUSING, RUBBER, STEEL, vector

# angle of a chord of a belt on its pulley, in [rad]
CHORD = REVOLUTION / 48.0


def draw_belts(canvas: Canvas) -> None:
    """Draw pulleys with spots that show their rotation, and belts on the link of the shafts."""
    r, low = canvas.r, wheel_height(canvas) - 0.7 * canvas.r
    for path in belts_of(canvas.mechanism):
        carrier = path.carrier
        axis = np.asarray(canvas.upright(carrier).axis)
        plane, radii = carrier.frame[:, :2], np.abs(path.radii)
        for joint, centre, radius in zip(path.joints, path.centres, radii, strict=True):
            end = replace(carrier, point=vector(carrier.point, plane @ centre)) if joint is None else joint.b
            upright = canvas.upright(end)
            colour = wheel_colour(canvas, end.link)
            canvas.disc(end.link, upright, low, low + 1.4 * r, radius - 0.5 * r, colour)
            if joint is None:
                canvas.disc(end.link, upright, canvas.level(end.link), low, 1.2 * r, colour)
            else:
                canvas.disc(
                    end.link, upright, low, canvas.height(end.link), min(2.4 * r, 0.7 * radius), colour
                )
                spot = (
                    end.point + (low + 1.2 * r) * np.asarray(upright.axis) + 0.75 * radius * end.frame[:, 0]
                )
                canvas.add(end.link, "sphere", spot, spot, min(0.8 * r, 0.2 * radius), STEEL)
        for i, points in enumerate(path.points(CHORD)):
            # where strands cross, one runs over the other
            over = 0.6 * r * (i % 2) * (path.radii[i] * path.radii[i - 1] < 0.0)
            strand = carrier.point + points @ plane.T + (low + 0.7 * r + over) * axis
            for frm, to in pairwise(strand):
                canvas.add(carrier.link, "capsule", frm, to, 0.5 * r, RUBBER)


def draw_ropes(canvas: Canvas) -> None:
    """Draw the drums of ropes, and their falls to the slides that they pull along the axis.

    Drums are wheels on the ground; falls hang from their height, one per unit of a slide's weight.
    """
    joints = {joint.name: joint for joint in canvas.mechanism.joints if joint.a.link == GROUND}
    for rope in canvas.mechanism.couplings:
        terms = [
            (joints[name], weight) for name, weight in rope.left_terms.items() if rope.rope and name in joints
        ]
        drums = [(joint, abs(weight)) for joint, weight in terms if KINDS[joint.kind].hinge]
        for joint, radius in drums:
            low, colour = wheel_height(canvas) - 0.7 * canvas.r, wheel_colour(canvas, joint.b.link)
            upright = canvas.upright(joint.b)
            canvas.disc(joint.b.link, upright, low, low + 1.4 * canvas.r, radius - 0.5 * canvas.r, colour)
            hub = min(2.4 * canvas.r, 0.7 * radius)
            canvas.disc(joint.b.link, upright, low, canvas.height(joint.b.link), hub, colour)
        for joint, weight in terms:
            if drums and KINDS[joint.kind].single and KINDS[joint.kind].slides:
                _draw_falls(canvas, joint, weight, drums[0])


def _draw_falls(canvas: Canvas, slide: Joint, weight: float, drum: tuple[Joint, float]) -> None:
    """Draw the falls of a rope between a drum, with its radius in [m], and a slide.

    A fall is a piece on either link, each as long as the shortest: they overlap up to twice that.
    """
    towards = -np.sign(weight) * np.asarray(slide.a.axis)
    top = float(np.subtract(drum[0].a.point, slide.a.point) @ towards)
    shortest = top - max(float(end) * -np.sign(weight) for end in canvas.travel_of(slide))
    if not shortest > 0.0:
        return
    rotation, count = slide.b.frame @ slide.a.frame.T, max(1, round(abs(weight)))
    across = np.cross(towards, drum[0].a.axis)
    # away from the drum
    across *= np.copysign(1.0, np.subtract(slide.a.point, drum[0].a.point) @ across)
    lift = (wheel_height(canvas) * canvas.normals[GROUND]) if canvas.normals else np.zeros(3)
    pulley = 0.5 * drum[1]
    for k in range(count):
        side = lift + (2 * k - count + 1) * pulley * across
        upper = np.asarray(slide.a.point) + top * towards + side
        lower = np.asarray(slide.b.point) + rotation @ side
        canvas.add(GROUND, "capsule", upper, upper - shortest * towards, 0.5 * canvas.r, RUBBER)
        tip = lower + shortest * (rotation @ towards)
        canvas.add(slide.b.link, "capsule", lower, tip, 0.5 * canvas.r, RUBBER)
        if k % 2:
            # the fall before it runs around a pulley into this one
            centre, half = lower - pulley * (rotation @ across), 0.7 * canvas.r * (rotation @ drum[0].a.axis)
            colour = wheel_colour(canvas, slide.b.link)
            canvas.add(slide.b.link, "cylinder", centre - half, centre + half, pulley, colour)
            if canvas.normals:
                canvas.add(slide.b.link, "cylinder", centre, centre - rotation @ lift, 0.9 * canvas.r, STEEL)
            canvas.add(GROUND, "sphere", upper, upper, 1.2 * canvas.r, HOUSING)
