"""Print which commands of mechsim run on other releases of MuJoCo.

    python validation/lowest_mujoco.py VENV...

Each VENV is a virtual environment with mechsim and one release of MuJoCo, as
`pip install -e '.[test]' mujoco==3.17.0` makes. A command runs if it ends with exit code 0. The exit code of
this script is 1 if a command fails on a release that pyproject.toml allows.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CUSTOM = ROOT / "models" / "four_bar.xml"
COMMANDS = Path(__file__).with_suffix(".txt").read_text().splitlines()


def lowest_allowed() -> tuple[int, ...]:
    """Return the lowest release that pyproject.toml allows."""
    dependencies = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    (requirement,) = (text for text in dependencies if text.startswith("mujoco>="))
    return version(requirement)


def version(text: str) -> tuple[int, ...]:
    """Return a version as numbers."""
    return tuple(int(number) for number in re.findall(r"\d+", text))


def installed_release(python: Path) -> str:
    """Return the release of MuJoCo in an environment."""
    code = "import mujoco; print(mujoco.__version__)"
    return subprocess.run([python, "-c", code], check=True, capture_output=True, text=True).stdout.strip()


def failure(python: Path, command: str) -> str:
    """Return the last line of the messages of a command that fails; empty for one that runs."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = command.format(out=Path(folder) / "out", custom=CUSTOM).split()
        run = subprocess.run(
            [python, "-m", "mechsim", *arguments], cwd=folder, check=False, capture_output=True, text=True
        )
    lines = (run.stderr.strip() or run.stdout.strip() or f"exit code {run.returncode}").splitlines()
    return lines[-1] if run.returncode else ""


def main() -> None:
    pythons = [Path(venv).absolute() / "bin" / "python" for venv in sys.argv[1:]]
    releases = [installed_release(python) for python in pythons]
    width = max(len(command) for command in COMMANDS)
    print(f"{'command':{width}}", *(f"{name:>7}" for name in releases))
    messages, rejected = dict[str, str](), False
    with ThreadPoolExecutor(2) as pool:
        results = pool.map(lambda command: [failure(python, command) for python in pythons], COMMANDS)
        for command, failures in zip(COMMANDS, results, strict=True):
            outcomes = ("fails" if text else "runs" for text in failures)
            print(f"{command:{width}}", *(f"{text:>7}" for text in outcomes), flush=True)
            for name, text in zip(releases, failures, strict=True):
                rejected |= bool(text) and version(name) >= lowest_allowed()
                if text:
                    messages.setdefault(f"{name}: {text}", command)
    for message, command in messages.items():
        print(f"\n{command}\n  {message}")
    sys.exit(rejected)


if __name__ == "__main__":
    main()
