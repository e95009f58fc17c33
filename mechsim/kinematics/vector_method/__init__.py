"""The vector method: unit vectors from given angles, roots of their equations, and frames of links."""
