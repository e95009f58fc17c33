"""A mechanism in a page that needs nothing but itself, to turn by hand.

All that moves was solved before: the page interpolates between dense samples and solves nothing.
"""

from mechsim.pictures.view.offline_page import page, three_js
from mechsim.pictures.view.platform_drive import POSE_COORDINATES, PlatformDrive, quaternions
from mechsim.pictures.view.pose_grid import (
    GhostTrack,
    Landmark,
    PoseGrid,
    Readout,
    Slider,
    SliderUnit,
    View,
    between,
    ghost_of,
    interpolated,
    motion_grid,
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
