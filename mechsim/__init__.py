"""mechsim: an analytic model of a linkage checked against a multibody simulator.

The names below are the public face; they load on first use, so that the command line starts fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mechsim._version import __version__

if TYPE_CHECKING:
    from mechsim import catalog, closure, course, dynamics, motors, rods, simulation, units
    from mechsim.crosscheck import Check, Verdict, crosscheck
    from mechsim.errors import AssemblyError, InputError, MechsimError
    from mechsim.forces import Forces, Friction, JointSpring, Load, Spring
    from mechsim.inertia import Inertia
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
    "Forces": "forces",
    "Friction": "forces",
    "Gear": "mechanism",
    "Inertia": "inertia",
    "InputError": "errors",
    "Joint": "mechanism",
    "JointSpring": "forces",
    "Link": "mechanism",
    "Load": "forces",
    "Mechanism": "mechanism",
    "MechsimError": "errors",
    "Motion": "motion",
    "Pose": "mechanism",
    "Run": "simulation",
    "Scene": "scene",
    "Settings": "simulation",
    "Spring": "forces",
    "Tolerance": "tolerances",
    "Verdict": "crosscheck",
    "crosscheck": "crosscheck",
    "show": "notebook",
    "simulate": "simulation",
}
_MODULES = ("catalog", "closure", "course", "dynamics", "motors", "rods", "simulation", "units")

__all__ = [
    "AssemblyError",
    "Check",
    "End",
    "Forces",
    "Friction",
    "Gear",
    "Inertia",
    "InputError",
    "Joint",
    "JointSpring",
    "Link",
    "Load",
    "Mechanism",
    "MechsimError",
    "Motion",
    "Pose",
    "Run",
    "Scene",
    "Settings",
    "Spring",
    "Tolerance",
    "Verdict",
    "__version__",
    "catalog",
    "closure",
    "course",
    "crosscheck",
    "dynamics",
    "motors",
    "rods",
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
