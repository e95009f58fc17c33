"""Loop equations of any mechanism: residual, Jacobian, rates, rank and assembly.

They are independent of closed forms. For given poses every moving link has six coordinates, and each joint
has constraint equations (`equations`). Whole motions are solved in the coordinates of a spanning tree
(`solve`), for all poses together.
"""
