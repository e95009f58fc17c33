"""mechsim: an analytic model of a linkage checked against a multibody simulator.

The names below are the public face; they load on first use, so that the command line starts fast.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from mechsim._version import __version__ as __version__

# a name that is imported as itself is public for type checkers
if TYPE_CHECKING:
    from mechsim import formulas as formulas
    from mechsim import simulation as simulation
    from mechsim import testing as testing
    from mechsim import units as units
    from mechsim.analytic.vector_method import vectors as vectors
    from mechsim.codegen.compiled import compile as compile
    from mechsim.errors import AssemblyError as AssemblyError
    from mechsim.errors import InputError as InputError
    from mechsim.errors import MechsimError as MechsimError
    from mechsim.model import load_profile as load_profile
    from mechsim.model import masses as masses
    from mechsim.model import motors as motors
    from mechsim.model.bushings import Bushing as Bushing
    from mechsim.model.clearances import Clearance as Clearance
    from mechsim.model.forces import Forces as Forces
    from mechsim.model.forces import Friction as Friction
    from mechsim.model.forces import JointSpring as JointSpring
    from mechsim.model.forces import Load as Load
    from mechsim.model.forces import Spring as Spring
    from mechsim.model.joints import Coupling as Coupling
    from mechsim.model.joints import End as End
    from mechsim.model.joints import Gear as Gear
    from mechsim.model.joints import Joint as Joint
    from mechsim.model.links import Inertia as Inertia
    from mechsim.model.links import Link as Link
    from mechsim.model.links import Pose as Pose
    from mechsim.model.mechanism import Mechanism as Mechanism
    from mechsim.model.motion import Motion as Motion
    from mechsim.model.motion_laws import MotionLaws as MotionLaws
    from mechsim.model.motors import Controller as Controller
    from mechsim.model.scene import Scene as Scene
    from mechsim.pictures import plots as plots
    from mechsim.pictures.render import Look as Look
    from mechsim.report.notebook import plot as plot
    from mechsim.report.notebook import render as render
    from mechsim.report.notebook import show as show
    from mechsim.report.notebook import view as view
    from mechsim.simulation.run import Run as Run
    from mechsim.simulation.settings import Settings as Settings
    from mechsim.studies.agreement.agreement import Agreement as Agreement
    from mechsim.studies.calibration import fit as fit
    from mechsim.studies.certify import Certificate as Certificate
    from mechsim.studies.certify import certify as certify
    from mechsim.studies.check import check as check
    from mechsim.studies.closed_configurations import closed_qpos as closed_qpos
    from mechsim.studies.closed_configurations import sample as sample
    from mechsim.studies.export import export as export
    from mechsim.studies.identification import identify as identify
    from mechsim.studies.reduction.reduce_model import reduce as reduce
    from mechsim.studies.robots.joint_map import joint_map as joint_map
    from mechsim.studies.scene.tune_model import tune as tune
    from mechsim.studies.sensitivity.sensitivity import moved as moved
    from mechsim.studies.sensitivity.sensitivity import sensitivity as sensitivity
    from mechsim.studies.sensitivity.tolerance_analysis import tolerance_study as tolerance_study
    from mechsim.studies.sweep.sweeping import sweep as sweep
    from mechsim.studies.validate import Validation as Validation
    from mechsim.studies.validate import validate as validate
    from mechsim.subjects import catalog as catalog
    from mechsim.subjects import dynamics as dynamics
    from mechsim.subjects.gallery import list as list
    from mechsim.subjects.readers import load as load
    from mechsim.subjects.simulate_by_name import simulate as simulate
    from mechsim.theory import loops as loops
    from mechsim.theory.assemblies import assemblies as assemblies
    from mechsim.theory.continuation.mechanism_trace import trace as trace
    from mechsim.verdict.checks import Check as Check
    from mechsim.verdict.checks import Verdict as Verdict
    from mechsim.verdict.crosscheck import crosscheck as crosscheck
    from mechsim.verdict.tolerances import Tolerance as Tolerance

# public modules, and public names by the module that defines them; they are also imported above
_MODULES = {
    "catalog": "subjects.catalog",
    "dynamics": "subjects.dynamics",
    "formulas": "formulas",
    "load_profile": "model.load_profile",
    "loops": "theory.loops",
    "masses": "model.masses",
    "motors": "model.motors",
    "plots": "pictures.plots",
    "simulation": "simulation",
    "testing": "testing",
    "units": "units",
    "vectors": "analytic.vector_method.vectors",
}
_NAMES = {
    "_version": "__version__",
    "codegen.compiled": "compile",
    "errors": "AssemblyError InputError MechsimError",
    "model.bushings": "Bushing",
    "model.clearances": "Clearance",
    "model.forces": "Forces Friction JointSpring Load Spring",
    "model.joints": "Coupling End Gear Joint",
    "model.links": "Inertia Link Pose",
    "model.mechanism": "Mechanism",
    "model.motion": "Motion",
    "model.motion_laws": "MotionLaws",
    "model.motors": "Controller",
    "model.scene": "Scene",
    "pictures.render": "Look",
    "report.notebook": "plot render show view",
    "simulation.run": "Run",
    "simulation.settings": "Settings",
    "studies.agreement.agreement": "Agreement",
    "studies.calibration": "fit",
    "studies.certify": "Certificate certify",
    "studies.check": "check",
    "studies.closed_configurations": "closed_qpos sample",
    "studies.export": "export",
    "studies.identification": "identify",
    "studies.reduction.reduce_model": "reduce",
    "studies.robots.joint_map": "joint_map",
    "studies.scene.tune_model": "tune",
    "studies.sensitivity.sensitivity": "moved sensitivity",
    "studies.sensitivity.tolerance_analysis": "tolerance_study",
    "studies.sweep.sweeping": "sweep",
    "studies.validate": "Validation validate",
    "subjects.gallery": "list",
    "subjects.readers": "load",
    "subjects.simulate_by_name": "simulate",
    "theory.assemblies": "assemblies",
    "theory.continuation.mechanism_trace": "trace",
    "verdict.checks": "Check Verdict",
    "verdict.crosscheck": "crosscheck",
    "verdict.tolerances": "Tolerance",
}
_LOCATIONS = _MODULES | {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = tuple(_LOCATIONS)  # pyright: ignore[reportUnsupportedDunderAll]


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
