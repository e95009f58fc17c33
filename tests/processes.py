"""Python in a process of its own, for tests of what a process loads, prints or ends with."""

import os
import subprocess
import sys
from pathlib import Path

MAIN = "import sys; sys.argv[0] = 'mechsim'; from mechsim.cli import main; main()"


def python(
    *arguments: str | Path, folder: Path | None = None, **variables: str | None
) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder, with changed environment variables, of which None removes one."""
    environment = {name: value for name, value in (os.environ | variables).items() if value is not None}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8", timeout=120
    )


def mechsim_run(*words: str, **options: str | Path | None) -> subprocess.CompletedProcess[str]:
    """Run a command, as `python`."""
    return python("-c", MAIN, *words, **options)
