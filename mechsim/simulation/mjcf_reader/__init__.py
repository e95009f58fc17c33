"""Reads MJCF files as mechanisms: copies positions, axes, anchors and couplings, and solves nothing."""
