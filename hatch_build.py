"""What a wheel holds besides the package: the gallery, of which the sources keep one copy, in models/."""

from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class WithGallery(BuildHookInterface):
    """Puts the gallery into wheels; one that is run from its sources finds it there."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the folder, unless the install is editable."""
        if version != "editable":
            build_data["force_include"]["models/gallery"] = "mechsim/gallery"
