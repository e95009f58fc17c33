"""Processes of their own, for tests of what Python loads, prints or ends with."""

import os
import subprocess
import sys

MAIN = "import sys; sys.argv[0] = 'mechsim'; from mechsim.cli import main; main()"


def process(*command, folder=None, **variables):
    """Run a command in a folder, with changed environment variables, of which None removes one."""
    environment = {name: value for name, value in (os.environ | variables).items() if value is not None}
    # a process may print in the encoding of its system
    text = {"encoding": "utf-8", "errors": "backslashreplace"}
    options = {"cwd": folder, "env": environment, "capture_output": True, **text}
    return subprocess.run([*map(str, command)], check=False, timeout=120, **options)


def python(*arguments, **options):
    """Run Python, as `process`."""
    return process(sys.executable, *arguments, **options)


def mechsim_run(*words, **options):
    """Run a command of mechsim, as `process`."""
    return python("-c", MAIN, *words, **options)
