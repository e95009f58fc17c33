"""Pictures and videos of a motion, without a screen."""

from mechsim.render.backend import Backend, choose, describe_backend
from mechsim.render.draw import frames, still
from mechsim.render.look import Look

__all__ = ["Backend", "Look", "choose", "describe_backend", "frames", "still"]
