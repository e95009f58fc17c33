"""Print pip constraints with the lowest version of each dependency that pyproject.toml allows.

`python validation/lowest_versions.py > lowest.txt && pip install -c lowest.txt -e '.[test]'`
"""

import re
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
LOWEST_VERSION = re.compile(r"^(?P<name>[\w-]+)(\[[\w,]+\])?>=(?P<version>[\w.]+)$")


def lowest(project: dict) -> list[str]:
    """Return a pin of each dependency of use and tests to its lowest version; reject one without it."""
    extras = project["optional-dependencies"]
    names = [name for name in extras if name not in ("dev", "docs", "peers", "engines")]
    requirements = [*project["dependencies"], *(text for name in names for text in extras[name])]
    pins = []
    for requirement in requirements:
        if not requirement.startswith(f"{project['name']}["):
            match = LOWEST_VERSION.match(requirement)
            if match is None:
                raise SystemExit(f"{requirement!r} has no lowest version; write name>=version")
            pins.append(f"{match['name']}=={match['version']}")
    return pins


if __name__ == "__main__":
    print("\n".join(lowest(tomllib.loads(PYPROJECT.read_text())["project"])))
