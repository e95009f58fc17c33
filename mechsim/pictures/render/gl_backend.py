"""OpenGL without a screen: the available back end, its driver, and a renderer."""

import functools
import importlib
import json
import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
from mujoco.rendering.classic import gl_context

from mechsim.errors import MissingToolError, require_extra

# order of trial; macOS and Windows have one back end each
ORDER = {"linux": ("egl", "osmesa"), "darwin": ("cgl",), "win32": ("glfw",)}.get(sys.platform, ("glfw",))
PACKAGES = {"egl": "libegl1", "osmesa": "libosmesa6"}
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software", "offscreen")

# a driver that is missing or broken may abort the process or fix PyOpenGL on the wrong platform,
# so each is tried in a process of its own
PROBE = """
import importlib, json, sys
context = importlib.import_module("mujoco." + sys.argv[1]).GLContext(16, 16)
context.make_current()
from OpenGL import GL
print(json.dumps([GL.glGetString(name).decode() for name in (GL.GL_RENDERER, GL.GL_VERSION)]))
context.free()
"""


@dataclass(frozen=True, slots=True)
class Backend:
    """An OpenGL back end that works on this machine.

    Attributes:
        name: "egl", "osmesa", ... as in MUJOCO_GL.
        driver: name of the driver.
        version: of OpenGL.
    """

    name: str
    driver: str
    version: str

    @property
    def software(self) -> bool:
        """Whether the processor renders, not a graphics card."""
        return any(word in self.driver.lower() for word in SOFTWARE)


def choose() -> Backend:
    """Return the back end for rendering: that of MUJOCO_GL, else the first of EGL and OSMesa that works.

    Raises:
        MissingToolError: where none works; names the package that brings one, or the extra of mechsim.
    """
    require_extra("pictures", "PIL")
    # PyOpenGL keeps the back end with which it was first imported in this process
    current = os.environ.get("PYOPENGL_PLATFORM", "").lower() if "OpenGL.platform" in sys.modules else ""
    requested = os.environ.get("MUJOCO_GL", "").lower().strip()
    names = (current,) if current in ORDER else sorted(ORDER, key=lambda name: name != requested)
    for name in names:
        if backend := probe(name):
            return backend
    packages = " or ".join(PACKAGES[name] for name in names if name in PACKAGES)
    remedy = f"; install the system package {packages}" if packages else ""
    tried = " and ".join(names)
    raise MissingToolError(f"no picture can be drawn: OpenGL by {tried} does not work here{remedy}")


@functools.cache
def probe(name: str) -> Backend | None:
    """Return the named back end if it works in a separate process, else None."""
    environment = os.environ | {"MUJOCO_GL": name}
    environment.pop("PYOPENGL_PLATFORM", None)
    command = [sys.executable, "-c", PROBE, name]
    try:
        printed = subprocess.check_output(command, env=environment, stderr=subprocess.DEVNULL, timeout=60)
        driver, version = json.loads(printed)
    except (subprocess.SubprocessError, OSError, ValueError):
        return None
    return Backend(name, driver, version)


def describe_backend() -> list[dict[str, object]]:
    """Return one row per back end of this platform: name, whether it works, its driver, its package."""
    return [
        {
            "name": name,
            "works": backend is not None,
            "driver": backend.driver if backend else "",
            "version": backend.version if backend else "",
            "software": backend.software if backend else None,
            "package": PACKAGES.get(name, ""),
        }
        for name, backend in zip(ORDER, map(probe, ORDER), strict=True)
    ]


@contextmanager
def renderer(
    model: mujoco.MjModel, resolution: tuple[int, int], backend: Backend
) -> Generator[mujoco.Renderer]:
    """Open a MuJoCo renderer of (width, height) pixels on a back end, and close it afterwards.

    MuJoCo fixes its back end when it is first imported; a caller may have done that long ago
    without MUJOCO_GL, so the context class is put in its place for the time of construction.
    """
    before = getattr(gl_context, "GLContext", None)
    gl_context.GLContext = importlib.import_module(f"mujoco.{backend.name}").GLContext
    try:
        drawing = mujoco.Renderer(model, height=resolution[1], width=resolution[0])
    finally:
        gl_context.GLContext = before
    with drawing:
        yield drawing
