"""Marker of tests that need OpenGL, and the scene that MuJoCo's viewer shows."""

import mujoco
import pytest

from mechsim.errors import MissingToolError
from mechsim.pictures.render import gl_backend

try:
    gl_backend.choose()
except MissingToolError as missing:
    REASON = str(missing)
else:
    REASON = ""
draws = pytest.mark.skipif(bool(REASON), reason=REASON or "OpenGL works")


def viewer_scene(model, data):
    """Return the scene of the free camera, with which MuJoCo's viewer starts."""
    free, scene = mujoco.MjvCamera(), mujoco.MjvScene(model, maxgeom=200)
    mujoco.mj_forward(model, data)
    mujoco.mjv_defaultFreeCamera(model, free)
    every = int(mujoco.mjtCatBit.mjCAT_ALL)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, free, every, scene)
    return scene
