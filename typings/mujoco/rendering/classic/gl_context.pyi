"""The OpenGL context class MuJoCo draws with."""

from typing import Any

GLContext: Any
