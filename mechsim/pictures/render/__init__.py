"""Pictures and videos of a motion, without a screen."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
from mechsim.pictures.render.drawing import frames, still
from mechsim.pictures.render.gl_backend import describe_backend
from mechsim.pictures.render.look import Look
from mechsim.pictures.render.video import find_ffmpeg, turn_angles, write_picture, write_video

__all__ = [
    "Look",
    "describe_backend",
    "find_ffmpeg",
    "frames",
    "still",
    "turn_angles",
    "write_picture",
    "write_video",
]
