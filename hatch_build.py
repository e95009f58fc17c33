"""What a wheel holds besides the package: models, reference data and tests; the sources keep one copy."""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class WithData(BuildHookInterface):
    """Puts models and reference data into wheels; one that is run from its sources finds them there."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the folders, unless the install is editable."""
        if version != "editable":
            build_data["force_include"]["models"] = "mechsim/models"
            stated = ("runs.toml", "datapackage.json", "SHA256SUMS", "README.md")
            for part in ("data", "mechanisms", "forward", "models", *stated):
                build_data["force_include"][f"reference/{part}"] = f"mechsim/reference/{part}"
            for entry in sorted(Path(self.root, "tests").iterdir()):
                if entry.name not in ("repository", "validation", "__pycache__"):
                    build_data["force_include"][f"tests/{entry.name}"] = f"mechsim/tests/{entry.name}"
            # pytest reads its settings from here
            build_data["force_include"]["pyproject.toml"] = "mechsim/tests/pyproject.toml"
