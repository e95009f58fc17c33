"""mechsim: an analytic model of a linkage checked against a multibody simulator.

The names below are the public face; they load on first use, so that the command line starts fast.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from mechsim._version import __version__ as __version__

# a name that is imported as itself is public for type checkers
if TYPE_CHECKING:
    from mechsim import dynamics as dynamics
    from mechsim import formulas as formulas
    from mechsim import loops as loops
    from mechsim import simulation as simulation
    from mechsim import testing as testing
    from mechsim import units as units
    from mechsim.codegen.compiled import compile as compile
    from mechsim.compare.checks import Check as Check
    from mechsim.compare.checks import Verdict as Verdict
    from mechsim.compare.crosscheck import crosscheck as crosscheck
    from mechsim.compare.tolerances import Tolerance as Tolerance
    from mechsim.errors import AssemblyError as AssemblyError
    from mechsim.errors import InputError as InputError
    from mechsim.errors import MechsimError as MechsimError
    from mechsim.io import catalog as catalog
    from mechsim.io.gallery import list as list
    from mechsim.io.readers import load as load
    from mechsim.io.simulate_by_name import simulate as simulate
    from mechsim.kinematics.vector_method import vectors as vectors
    from mechsim.mechanism import load_profile as load_profile
    from mechsim.mechanism import masses as masses
    from mechsim.mechanism import motors as motors
    from mechsim.mechanism.clearances import Clearance as Clearance
    from mechsim.mechanism.forces import Forces as Forces
    from mechsim.mechanism.forces import Friction as Friction
    from mechsim.mechanism.forces import JointSpring as JointSpring
    from mechsim.mechanism.forces import Load as Load
    from mechsim.mechanism.forces import Spring as Spring
    from mechsim.mechanism.joints import Coupling as Coupling
    from mechsim.mechanism.joints import End as End
    from mechsim.mechanism.joints import Gear as Gear
    from mechsim.mechanism.joints import Joint as Joint
    from mechsim.mechanism.links import Inertia as Inertia
    from mechsim.mechanism.links import Link as Link
    from mechsim.mechanism.links import Pose as Pose
    from mechsim.mechanism.mechanism import Mechanism as Mechanism
    from mechsim.mechanism.motion import Motion as Motion
    from mechsim.mechanism.motion_laws import MotionLaws as MotionLaws
    from mechsim.mechanism.motors import Controller as Controller
    from mechsim.mechanism.nonlinear_springs import Bushing as Bushing
    from mechsim.mechanism.scene import Scene as Scene
    from mechsim.pictures import plots as plots
    from mechsim.pictures.render import Look as Look
    from mechsim.report.notebook import plot as plot
    from mechsim.report.notebook import render as render
    from mechsim.report.notebook import show as show
    from mechsim.report.notebook import view as view
    from mechsim.simulation.run import Run as Run
    from mechsim.simulation.settings import Settings as Settings
    from mechsim.studies.agreement.agreement import Agreement as Agreement
    from mechsim.studies.assemblies import assemblies as assemblies
    from mechsim.studies.calibration import fit as fit
    from mechsim.studies.certify import Certificate as Certificate
    from mechsim.studies.certify import certify as certify
    from mechsim.studies.check import check as check
    from mechsim.studies.closed_configurations import closed_qpos as closed_qpos
    from mechsim.studies.closed_configurations import sample as sample
    from mechsim.studies.export import export as export
    from mechsim.studies.identification import identify as identify
    from mechsim.studies.reduction.search import reduce as reduce
    from mechsim.studies.robots.joint_map import joint_map as joint_map
    from mechsim.studies.scene.tune_model import tune as tune
    from mechsim.studies.sensitivity.sensitivity import moved as moved
    from mechsim.studies.sensitivity.sensitivity import sensitivity as sensitivity
    from mechsim.studies.sensitivity.sensitivity import tolerance_study as tolerance_study
    from mechsim.studies.sweep.sweeping import sweep as sweep
    from mechsim.studies.trace import trace as trace
    from mechsim.studies.validate import Validation as Validation
    from mechsim.studies.validate import validate as validate

# public modules, and public names by the module that defines them; they are also imported above
_MODULES = {
    "catalog": "io.catalog",
    "dynamics": "dynamics",
    "formulas": "formulas",
    "load_profile": "mechanism.load_profile",
    "loops": "loops",
    "masses": "mechanism.masses",
    "motors": "mechanism.motors",
    "plots": "pictures.plots",
    "simulation": "simulation",
    "testing": "testing",
    "units": "units",
    "vectors": "kinematics.vector_method.vectors",
}
_NAMES = {
    "_version": "__version__",
    "codegen.compiled": "compile",
    "errors": "AssemblyError InputError MechsimError",
    "mechanism.nonlinear_springs": "Bushing",
    "mechanism.clearances": "Clearance",
    "mechanism.forces": "Forces Friction JointSpring Load Spring",
    "mechanism.joints": "Coupling End Gear Joint",
    "mechanism.links": "Inertia Link Pose",
    "mechanism.mechanism": "Mechanism",
    "mechanism.motion": "Motion",
    "mechanism.motion_laws": "MotionLaws",
    "mechanism.motors": "Controller",
    "mechanism.scene": "Scene",
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
    "studies.reduction.search": "reduce",
    "studies.robots.joint_map": "joint_map",
    "studies.scene.tune_model": "tune",
    "studies.sensitivity.sensitivity": "moved sensitivity tolerance_study",
    "studies.sweep.sweeping": "sweep",
    "studies.validate": "Validation validate",
    "io.gallery": "list",
    "io.readers": "load",
    "io.simulate_by_name": "simulate",
    "studies.assemblies": "assemblies",
    "studies.trace": "trace",
    "compare.checks": "Check Verdict",
    "compare.crosscheck": "crosscheck",
    "compare.tolerances": "Tolerance",
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
