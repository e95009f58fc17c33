"""Pictures and videos of a motion, without a screen."""

from mechsim.render.backend import Backend, choose, describe_backend
from mechsim.render.draw import frames, still
from mechsim.render.look import Look
from mechsim.render.video import find_ffmpeg, turn_angles, write_picture, write_video

__all__ = [
    "Backend",
    "Look",
    "choose",
    "describe_backend",
    "find_ffmpeg",
    "frames",
    "still",
    "turn_angles",
    "write_picture",
    "write_video",
]
