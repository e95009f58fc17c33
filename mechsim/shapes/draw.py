"""Every link's shapes, drawn joint by joint."""

from collections.abc import Mapping

import numpy as np

from mechsim.model.links import GROUND
from mechsim.model.links import IDENTITY as GROUND_POSE
from mechsim.model.mechanism import Mechanism
from mechsim.shapes.body import edges, stations
from mechsim.shapes.canvas import Canvas
from mechsim.shapes.gears import draw_gears
from mechsim.shapes.joints import DRAW
from mechsim.shapes.shape import Shape, vector
from mechsim.shapes.sides import free_sides


def link_shapes(
    mechanism: Mechanism,
    travel: Mapping[str, tuple[float, float]] | None = None,
    outward: Mapping[str, float] | None = None,
) -> dict[str, list[Shape]]:
    """Return the shapes of every link, "ground" included.

    Args:
        mechanism: what to draw.
        travel: joint -> least and greatest displacement along its axis in [m], where it is known from a
            motion; else sliding joints get rails long enough for any motion from the guess.
        outward: joint -> in which direction its shaft leads along its axis to a bearing, +1 or -1; see
            `free_sides`. Else the side that is free in the guess.
    """
    if outward is None:
        outward = free_sides(mechanism, {GROUND: GROUND_POSE, **mechanism.guess})
    canvas = Canvas(mechanism, dict(travel or {}), dict(outward))
    for link in mechanism.links:
        _body(canvas, link.name)
    for joint in mechanism.joints:
        DRAW[joint.kind](canvas, joint)
    draw_gears(canvas)
    return canvas.out


def _body(canvas: Canvas, link: str) -> None:
    """Rods between the places of a link where something happens, an eye where no joint is."""
    places, colour = stations(canvas.mechanism, link), canvas.colours[link]
    lift = canvas.height(link) * canvas.normals[link] if canvas.normals else np.zeros(3)
    for a, b in edges(places):
        if canvas.normals:
            width, thick = 1.15 * canvas.r, 0.5 * canvas.r
            normal = vector(canvas.normals[link])
            bar = Shape("box", vector(a, lift), vector(b, lift), (width, thick), colour, normal)
            canvas.out[link].append(bar)
        else:
            canvas.add(link, "capsule", a, b, canvas.r, colour)
    met = [np.asarray(end.point) for end in canvas.mechanism.ends(link)]
    for place in places:
        if min(float(np.linalg.norm(place - joint)) for joint in met) > 0.1 * canvas.r:
            canvas.add(link, "sphere", place + lift, place + lift, 1.5 * canvas.r, colour)
