"""Belts and chains around their pulleys."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from mechsim.model.belts import belts_of
from mechsim.numerics.angles import REVOLUTION
from mechsim.shapes.body import Canvas, upright_end
from mechsim.shapes.gears import wheel_colour, wheel_height
from mechsim.shapes.shape import STEEL, Rgba, vector

RUBBER: Rgba = (0.16, 0.16, 0.18, 1.0)
# angle of a chord of a belt on its pulley, in [rad]
CHORD = REVOLUTION / 48.0


def draw_belts(canvas: Canvas) -> None:
    """Draw pulleys with spots that show their rotation, and belts on the link of the shafts."""
    r, low = canvas.r, wheel_height(canvas) - 0.7 * canvas.r
    for path in belts_of(canvas.mechanism):
        carrier = path.carrier
        axis = np.asarray(
            (upright_end(carrier, canvas.normals[carrier.link]) if canvas.normals else carrier).axis
        )
        plane, radii = carrier.frame[:, :2], np.abs(path.radii)
        for joint, centre, radius in zip(path.joints, path.centres, radii, strict=True):
            end = replace(carrier, point=vector(carrier.point, plane @ centre)) if joint is None else joint.b
            upright = upright_end(end, canvas.normals[end.link]) if canvas.normals else end
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
