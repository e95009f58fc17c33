"""Arc-length continuation: tracing the solution curve of equations with one degree of freedom.

Dragilev's method, as in the paper on the RRSRR (docs/explanation/sources.md): the unit tangent is the
null vector of the Jacobian, and arc length is the independent variable, so turning points of coordinates are
regular. `trace` applies it to all assemblies of a mechanism.
"""
