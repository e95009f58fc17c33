"""Print the newest installed Python that makes virtual environments, from PATH or pyenv."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

# lowest 3.x that mechsim supports
OLDEST_MINOR = 11
VERSION_CODE = "import sys, venv; print('%d.%d.%d' % sys.version_info[:3])"


def candidates() -> list[str]:
    """Return the programs that may be a Python."""
    on_path = [shutil.which(f"python3.{minor}") for minor in range(OLDEST_MINOR, 30)]
    from_pyenv = sorted((Path.home() / ".pyenv" / "versions").glob("3.*/bin/python3"))
    return [*filter(None, on_path), *map(str, from_pyenv), sys.executable]


def version(python: str) -> tuple[int, ...]:
    """Return the version of a Python; empty where it does not run."""
    try:
        completed = subprocess.run(
            [python, "-c", VERSION_CODE], capture_output=True, text=True, timeout=30, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return ()
    match = re.fullmatch(r"(\d+)\.(\d+)\.(\d+)", completed.stdout.strip())
    return tuple(int(number) for number in match.groups()) if match else ()


def newest(pythons: list[str]) -> str:
    """Return the Python of the highest version, the first of equal ones."""
    return max(pythons, key=version)


if __name__ == "__main__":
    print(newest(candidates()))
