"""Print pip constraints that pin what pyproject.toml asks for to the lowest versions it allows.

`python validation/lowest_versions.py > lowest.txt && pip install -c lowest.txt -e '.[test]'`
"""

import re
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
FLOOR = re.compile(r"^(?P<name>[\w-]+)(\[[\w,]+\])?>=(?P<version>[\w.]+)$")


def lowest(project: dict) -> list[str]:
    """Return a pin for every floor of what is needed to use and to test; refuse what has none."""
    extras = project["optional-dependencies"]
    names = [name for name in extras if name not in ("dev", "docs", "peers", "engines")]
    asked = [*project["dependencies"], *(item for name in names for item in extras[name])]
    pins = []
    for item in asked:
        if not item.startswith(f"{project['name']}["):
            result = FLOOR.match(item)
            if result is None:
                raise SystemExit(f"{item!r} names no lowest version; write it as name>=version")
            pins.append(f"{result['name']}=={result['version']}")
    return pins


if __name__ == "__main__":
    print("\n".join(lowest(tomllib.loads(PYPROJECT.read_text())["project"])))
