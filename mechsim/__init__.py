"""mechsim: an analytic model of a linkage checked against a multibody simulator.

The names below are the public face; they load on first use, so that the command line starts fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mechsim._version import __version__

if TYPE_CHECKING:
    from mechsim import catalog, closure, simulation, units
    from mechsim.crosscheck import Check, Verdict, crosscheck
    from mechsim.errors import AssemblyError, InputError, MechsimError
    from mechsim.mechanism import End, Gear, Joint, Link, Mechanism, Pose
    from mechsim.motion import Motion
    from mechsim.notebook import show
    from mechsim.scene import Scene
    from mechsim.simulation import Run, Settings, simulate
    from mechsim.tolerances import Tolerance

_HOME = {
    "AssemblyError": "errors",
    "Check": "crosscheck",
    "End": "mechanism",
    "Gear": "mechanism",
    "InputError": "errors",
    "Joint": "mechanism",
    "Link": "mechanism",
    "Mechanism": "mechanism",
    "MechsimError": "errors",
    "Motion": "motion",
    "Pose": "mechanism",
    "Run": "simulation",
    "Scene": "scene",
    "Settings": "simulation",
    "Tolerance": "tolerances",
    "Verdict": "crosscheck",
    "crosscheck": "crosscheck",
    "show": "notebook",
    "simulate": "simulation",
}
_MODULES = ("catalog", "closure", "simulation", "units")

__all__ = [
    "AssemblyError",
    "Check",
    "End",
    "Gear",
    "InputError",
    "Joint",
    "Link",
    "Mechanism",
    "MechsimError",
    "Motion",
    "Pose",
    "Run",
    "Scene",
    "Settings",
    "Tolerance",
    "Verdict",
    "__version__",
    "catalog",
    "closure",
    "crosscheck",
    "show",
    "simulate",
    "simulation",
    "units",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"mechsim.{name}")
    if name in _HOME:
        return getattr(import_module(f"mechsim.{_HOME[name]}"), name)
    raise AttributeError(f"module 'mechsim' has no attribute {name!r}")
