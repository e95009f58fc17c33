"""The vector method: unit vectors at given angles, the roots they lead to, and the frames of links."""
