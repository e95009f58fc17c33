"""A mechanism in a page that needs nothing but itself, to turn by hand.

All that moves was solved before: the page interpolates between dense samples and solves nothing.
"""

from mechsim.pictures.view.offline_page import page, three_js
from mechsim.pictures.view.pose_grid import (
    POSE_COORDINATES,
    GhostTrack,
    Landmark,
    PlatformDrive,
    PoseGrid,
    Readout,
    Slider,
    SliderUnit,
    View,
    between,
    ghost_of,
    interpolated,
    motion_grid,
    quaternions,
)

__all__ = [
    "POSE_COORDINATES",
    "GhostTrack",
    "Landmark",
    "PlatformDrive",
    "PoseGrid",
    "Readout",
    "Slider",
    "SliderUnit",
    "View",
    "between",
    "ghost_of",
    "interpolated",
    "motion_grid",
    "page",
    "quaternions",
    "three_js",
]
