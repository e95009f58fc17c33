"""Which shapes a link is drawn with, from its joints alone: rods, eyes, pins, balls, rails, bearings, gears.

Sizes follow from the size of the mechanism, so that a needle drive of millimetres and a press of
metres look alike. Nothing here is physics: the shapes carry no mass and meet nothing.
"""

from mechsim.shapes.body import free_sides, link_colours, planar_normals, point_colours, rod_radius, span
from mechsim.shapes.joints import link_shapes
from mechsim.shapes.shape import HOUSING, PALETTE, STEEL, Kind, Rgba, Shape, TriangleMesh

__all__ = [
    "HOUSING",
    "PALETTE",
    "STEEL",
    "Kind",
    "Rgba",
    "Shape",
    "TriangleMesh",
    "free_sides",
    "link_colours",
    "link_shapes",
    "planar_normals",
    "point_colours",
    "rod_radius",
    "span",
]
