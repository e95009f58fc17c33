"""Arc-length continuation: tracing the solution curve of equations with one degree of freedom.

Dragilev's method, as paper 002 uses it: the unit tangent is the null vector of the Jacobian, and arc length
is the independent variable, so turning points of coordinates are regular. `trace` applies it to all
assemblies of a mechanism.
"""

from mechsim.theory.continuation.assembly_curve import (
    AssemblyCurve,
    CurvePoses,
    TurningPoint,
    crank_path_length,
    even_motion,
)
from mechsim.theory.continuation.mechanism_trace import AssemblyTrace, BranchPoint, trace

__all__ = [
    "AssemblyCurve",
    "AssemblyTrace",
    "BranchPoint",
    "CurvePoses",
    "TurningPoint",
    "crank_path_length",
    "even_motion",
    "trace",
]
