"""Marker of tests that need OpenGL."""

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
