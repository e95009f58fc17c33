"""Arc-length continuation: tracing the curve that a system of equations with one freedom defines.

Dragilev's method, as paper 002 uses it: the unit tangent is the null direction of the Jacobian,
length along the curve is the independent variable, and so nothing happens where any one coordinate
turns back. `trace` does so for all assemblies of a mechanism.
"""

from mechsim.theory.continuation.assembly_curve import AssemblyCurve, CurvePoses, TurningPoint
from mechsim.theory.continuation.filming import crank_way, even_motion
from mechsim.theory.continuation.mechanism_trace import AssemblyTrace, CurveMeeting, trace

__all__ = [
    "AssemblyCurve",
    "AssemblyTrace",
    "CurveMeeting",
    "CurvePoses",
    "TurningPoint",
    "crank_way",
    "even_motion",
    "trace",
]
