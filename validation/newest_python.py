"""Print the newest Python here that makes virtual environments: on PATH, or one that pyenv keeps."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

OLDEST = 11
ASKED = "import sys, venv; print('%d.%d.%d' % sys.version_info[:3])"


def candidates() -> list[str]:
    """Return the programs that may be one."""
    on_path = [shutil.which(f"python3.{minor}") for minor in range(OLDEST, 30)]
    kept = sorted((Path.home() / ".pyenv" / "versions").glob("3.*/bin/python3"))
    return [*filter(None, on_path), *map(str, kept), sys.executable]


def version(program: str) -> tuple[int, ...]:
    """Return a program's version; empty where it does not run."""
    try:
        done = subprocess.run([program, "-c", ASKED], capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return ()
    result = re.fullmatch(r"(\d+)\.(\d+)\.(\d+)", done.stdout.strip())
    return tuple(int(part) for part in result.groups()) if result else ()


def newest(motion_laws: list[str]) -> str:
    """Return the program of the highest version; the first of equals."""
    return max(motion_laws, key=version)


if __name__ == "__main__":
    print(newest(candidates()))
