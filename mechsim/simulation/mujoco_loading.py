"""MuJoCo, loaded whatever MUJOCO_GL asks for: a back end that cannot draw must not stop what never draws."""

import os
import sys
from importlib import import_module


def load() -> str:
    """Import MuJoCo, without a back end where that of MUJOCO_GL fails; say which one."""
    platform = os.environ.get("PYOPENGL_PLATFORM")
    asked = os.environ.get("MUJOCO_GL")
    try:
        import_module("mujoco")
    except Exception:  # a library that is missing or broken says anything
        if not asked:
            raise
        _forget_back_end(platform)
        os.environ["MUJOCO_GL"] = "off"
        try:
            import_module("mujoco")
        finally:
            os.environ["MUJOCO_GL"] = asked
        return f"MUJOCO_GL={asked} does not work here; pictures take another back end, if there is one"
    return ""


def _forget_back_end(platform: str | None) -> None:
    """Undo the choice of a back end that PyOpenGL made when it was first imported."""
    if platform is None:
        os.environ.pop("PYOPENGL_PLATFORM", None)
    for name in [name for name in sys.modules if name.split(".")[0] == "OpenGL"]:
        del sys.modules[name]


PROBLEM = load()
