"""Base classes of formulas, frames of links and vector algebra: what a user's own formulas import.

FILE.py in the folder of FILE.toml defines a subclass of `ClosedForm`, which yields the `LinkFrame` of links
at crank angles. `TwoBranchForm` adds the discriminant whose sign changes are the dead centres. Vectors are
(3, n), component first. Angles may be jets, so that rates follow from the same formula (`Values`).
"""

from mechsim.kinematics.formulas.closed_form import ClosedForm
from mechsim.kinematics.formulas.two_branch import TwoBranchForm
from mechsim.kinematics.vector_method.link_frames import LinkFrame
from mechsim.kinematics.vector_method.vectors import (
    circle_sphere,
    column,
    cross,
    dot,
    norm,
    rotate,
    rotation,
    rotation_product,
    sine_of,
    triangle_angle,
    unit_at_angles,
)
from mechsim.mechanism.links import EX, EY, EZ, ORIGIN, Vector
from mechsim.mechanism.motion_laws import Arcs
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Values, cos_sin, values, with_value

__all__ = [
    "EX",
    "EY",
    "EZ",
    "ORIGIN",
    "Arcs",
    "Array",
    "ClosedForm",
    "LinkFrame",
    "TwoBranchForm",
    "Values",
    "Vector",
    "circle_sphere",
    "column",
    "cos_sin",
    "cross",
    "dot",
    "norm",
    "rotate",
    "rotation",
    "rotation_product",
    "sine_of",
    "triangle_angle",
    "unit_at_angles",
    "values",
    "with_value",
]
