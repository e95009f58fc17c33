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

    def __str__(self) -> str:
        return f"{self.name}: {self.driver}, {'software' if self.software else 'hardware'}"


def choose() -> Backend:
    """Return the back end for rendering: that of MUJOCO_GL, else the first of EGL and OSMesa that works.

    Raises:
        MissingToolError: where none works; names the package that brings one, or the extra of mechsim.
    """
    require_extra("pictures", "PIL")
    current = _current_backend()
    names = (current,) if current else _preferred()
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
    environment = {key: value for key, value in os.environ.items() if key != "PYOPENGL_PLATFORM"}
    environment["MUJOCO_GL"] = name
    command = [sys.executable, "-c", PROBE, name]
    try:
        process = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=60, check=True
        )
        driver, version = json.loads(process.stdout)
    except (subprocess.SubprocessError, OSError, ValueError):
        return None
    return Backend(name, driver, version)


def describe_backend() -> list[dict[str, object]]:
    """Return one row per back end of this platform: name, whether it works, its driver, its package."""
    rows: list[dict[str, object]] = []
    for name in ORDER:
        backend = probe(name)
        rows.append(
            {
                "name": name,
                "works": backend is not None,
                "driver": backend.driver if backend else "",
                "version": backend.version if backend else "",
                "software": backend.software if backend else None,
                "package": PACKAGES.get(name, ""),
            }
        )
    return rows


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


def _current_backend() -> str | None:
    """The back end that PyOpenGL chose when it was first imported in this process, if it was."""
    if "OpenGL.platform" not in sys.modules:
        return None
    platform = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    return platform if platform in ORDER else None


def _preferred() -> tuple[str, ...]:
    """The order of trial, starting with that of MUJOCO_GL."""
    requested = os.environ.get("MUJOCO_GL", "").lower().strip()
    return tuple(sorted(ORDER, key=lambda name: name != requested))
