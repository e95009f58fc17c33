"""mechsim: an analytic model of a linkage checked against a multibody simulator.

The names below are the public face; they load on first use, so that the command line starts fast.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from mechsim._version import __version__

if TYPE_CHECKING:
    from mechsim import simulation, testing, units
    from mechsim.analytic import catalog, loops
    from mechsim.codegen.compiled import compile
    from mechsim.errors import AssemblyError, InputError, MechsimError
    from mechsim.model import load_profile, masses, motors
    from mechsim.model.controllers import Controller
    from mechsim.model.forces import Forces, Friction, JointSpring, Load, Spring
    from mechsim.model.joints import Coupling, End, Gear, Joint
    from mechsim.model.links import Inertia, Link, Pose
    from mechsim.model.mechanism import Mechanism
    from mechsim.model.motion import Motion
    from mechsim.model.motion_laws import MotionLaws
    from mechsim.model.scene import Scene
    from mechsim.pictures import plots, render
    from mechsim.report.notebook import show, view
    from mechsim.simulation import Run, Settings
    from mechsim.studies.agreement.agreement import Agreement
    from mechsim.studies.calibration import fit
    from mechsim.studies.certify import Certificate, certify
    from mechsim.studies.check import check
    from mechsim.studies.closed_configurations import closed_qpos, sample
    from mechsim.studies.export import export
    from mechsim.studies.optimise.search import optimise
    from mechsim.studies.reduction.reduce_model import reduce
    from mechsim.studies.robots.joint_map import joint_map
    from mechsim.studies.scene.tune_model import tune
    from mechsim.studies.sensitivity.sensitivity import moved, sensitivity
    from mechsim.studies.sensitivity.tolerance_analysis import tolerance_study
    from mechsim.studies.sweep.sweeping import sweep
    from mechsim.studies.validate import Validation, validate
    from mechsim.subjects import dynamics
    from mechsim.subjects.listing import list
    from mechsim.subjects.readers import load
    from mechsim.subjects.simulate_by_name import simulate
    from mechsim.theory.continuation.mechanism_trace import trace
    from mechsim.verdict.checks import Check, Verdict
    from mechsim.verdict.crosscheck import crosscheck
    from mechsim.verdict.tolerances import Tolerance

# public name -> module that defines it; modules first
_MODULES = {
    "catalog": "analytic.catalog",
    "dynamics": "subjects.dynamics",
    "load_profile": "model.load_profile",
    "loops": "analytic.loops",
    "masses": "model.masses",
    "motors": "model.motors",
    "plots": "pictures.plots",
    "render": "pictures.render",
    "simulation": "simulation",
    "testing": "testing",
    "units": "units",
}
_LOCATIONS = _MODULES | {
    "Agreement": "studies.agreement.agreement",
    "AssemblyError": "errors",
    "Certificate": "studies.certify",
    "Check": "verdict.checks",
    "Controller": "model.controllers",
    "End": "model.joints",
    "Forces": "model.forces",
    "Friction": "model.forces",
    "Coupling": "model.joints",
    "Gear": "model.joints",
    "Inertia": "model.links",
    "InputError": "errors",
    "Joint": "model.joints",
    "JointSpring": "model.forces",
    "Link": "model.links",
    "Load": "model.forces",
    "Mechanism": "model.mechanism",
    "MechsimError": "errors",
    "Motion": "model.motion",
    "Pose": "model.links",
    "MotionLaws": "model.motion_laws",
    "Run": "simulation",
    "Scene": "model.scene",
    "Settings": "simulation",
    "Spring": "model.forces",
    "Tolerance": "verdict.tolerances",
    "Validation": "studies.validate",
    "Verdict": "verdict.checks",
    "certify": "studies.certify",
    "check": "studies.check",
    "compile": "codegen.compiled",
    "closed_qpos": "studies.closed_configurations",
    "crosscheck": "verdict.crosscheck",
    "export": "studies.export",
    "fit": "studies.calibration",
    "joint_map": "studies.robots.joint_map",
    "list": "subjects.listing",
    "load": "subjects.readers",
    "moved": "studies.sensitivity.sensitivity",
    "optimise": "studies.optimise.search",
    "reduce": "studies.reduction.reduce_model",
    "sample": "studies.closed_configurations",
    "sensitivity": "studies.sensitivity.sensitivity",
    "show": "report.notebook",
    "simulate": "subjects.simulate_by_name",
    "sweep": "studies.sweep.sweeping",
    "tolerance_study": "studies.sensitivity.tolerance_analysis",
    "trace": "theory.continuation.mechanism_trace",
    "tune": "studies.scene.tune_model",
    "validate": "studies.validate",
    "view": "report.notebook",
}

__all__ = [
    "Agreement",
    "AssemblyError",
    "Certificate",
    "Check",
    "Controller",
    "Coupling",
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
    "MotionLaws",
    "Pose",
    "Run",
    "Scene",
    "Settings",
    "Spring",
    "Tolerance",
    "Validation",
    "Verdict",
    "__version__",
    "catalog",
    "certify",
    "check",
    "closed_qpos",
    "compile",
    "crosscheck",
    "dynamics",
    "export",
    "fit",
    "joint_map",
    "list",
    "load",
    "load_profile",
    "loops",
    "masses",
    "motors",
    "moved",
    "optimise",
    "plots",
    "reduce",
    "render",
    "sample",
    "sensitivity",
    "show",
    "simulate",
    "simulation",
    "sweep",
    "testing",
    "tolerance_study",
    "trace",
    "tune",
    "units",
    "validate",
    "view",
]


if not TYPE_CHECKING:  # a type checker must report names that are not imported above

    def __getattr__(name: str) -> Any:
        if name not in _LOCATIONS:
            raise AttributeError(f"module 'mechsim' has no attribute {name!r}")
        module = import_module(f"mechsim.{_LOCATIONS[name]}")
        globals()[name] = module if name in _MODULES else getattr(module, name)
        return globals()[name]


def __dir__() -> Any:
    return __all__


if "IPython" in sys.modules:
    import_module("mechsim.report.notebook").register()
