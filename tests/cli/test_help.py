"""Help of the commands: groups, panels, named types, examples."""

import re
import shlex

import pytest

from mechsim import cli
from mechsim.cli import examples


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_help_names_types_fits_eighty_columns_and_ends_with_two_examples(name, mechsim):
    out = mechsim(*name.split(), "--help").out
    assert not re.search(r"<(str|int|float|text)>", out)
    assert max(map(len, out.splitlines())) <= 80
    lines = examples(cli.load_command(name).help)
    assert len(lines) >= 2
    assert out.splitlines()[-len(lines) :] == [f"  {line}" for line in lines]


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_examples_use_existing_options(name):
    command = cli.load_command(name)
    for line in examples(command.help):
        words = shlex.split(line)
        count = 1 + len(name.split())
        assert words[:count] == ["mechsim", *name.split()]
        # raises for an unknown option or a missing argument
        command.make_context(name, words[count:])
