"""Whether pictures can be drawn here, and the mark of tests that need it."""

import pytest

from mechsim.errors import MissingToolError
from mechsim.pictures.render import gl_backend

try:
    gl_backend.choose()
except MissingToolError as missing:
    WHY = str(missing)
else:
    WHY = ""
draws = pytest.mark.skipif(bool(WHY), reason=WHY or "OpenGL works")
