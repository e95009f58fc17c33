"""Runs of models in MuJoCo: time stepping under a driven crank, and pose solving without time."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import mechsim.simulation.mujoco_loading  # before all else that imports it  # noqa: F401 # pyright: ignore[reportUnusedImport]

# public names; modules of the package import them from where they are defined
if TYPE_CHECKING:
    from mechsim.mechanism.motion_laws import CrankProfile as CrankProfile
    from mechsim.mechanism.motion_laws import constant as constant
    from mechsim.mechanism.motion_laws import swing as swing
    from mechsim.numerics.arrays import REVOLUTION as REVOLUTION
    from mechsim.simulation.run import Run as Run
    from mechsim.simulation.run import simulate as simulate
    from mechsim.simulation.settings import Settings as Settings

_NAMES = {
    "mechanism.motion_laws": "CrankProfile constant swing",
    "numerics.arrays": "REVOLUTION",
    "simulation.run": "Run simulate",
    "simulation.settings": "Settings",
}
_LOCATIONS = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = tuple(sorted(_LOCATIONS))  # pyright: ignore[reportUnsupportedDunderAll]


if not TYPE_CHECKING:  # a type checker must report names that are not imported above

    def __getattr__(name: str) -> Any:
        if name not in _LOCATIONS:
            raise AttributeError(f"module 'mechsim.simulation' has no attribute {name!r}")
        globals()[name] = getattr(import_module(f"mechsim.{_LOCATIONS[name]}"), name)
        return globals()[name]
