"""Arc-length continuation: tracing the curve that a system of equations with one freedom defines.

Dragilev's method, as paper 002 uses it: the unit tangent is the null direction of the Jacobian,
length along the curve is the independent variable, and so nothing happens where any one coordinate
turns back. Integration is adaptive, and Newton's method brings every step back onto the curve, so
that errors do not add up.
"""

from mechsim.theory.continuation.arc_length import Curve
from mechsim.theory.continuation.assembly_curve import AssemblyCurve, trace_mechanism
from mechsim.theory.continuation.equations import System, trace, turning_points

__all__ = ["AssemblyCurve", "Curve", "System", "trace", "trace_mechanism", "turning_points"]
