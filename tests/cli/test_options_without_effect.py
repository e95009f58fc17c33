"""An option that has no effect in a mode of a command is an error; nothing is computed or written."""

import pytest

from mechsim.cli.command import Stated
from mechsim.errors import InputError


def test_only_stated_options_are_excluded():
    stated = Stated({"speed": "--speed"})
    stated.exclude(["samples"], "in a run")
    with pytest.raises(InputError, match="--speed has no effect in a run"):
        stated.exclude(["samples", "speed"], "in a run")
