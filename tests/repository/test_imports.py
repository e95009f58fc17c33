"""The structure of the package: allowed imports, no cycles, no name used twice."""

import importlib
import re
import sys
from collections import Counter
from types import ModuleType

import import_closures
import pytest
import structure

FILES = structure.modules()

# package -> the packages it may import besides `errors`; every package is listed
ALLOWED_IMPORTS = {
    "numerics": set(),
    "mechanism": {"numerics"},
    "kinematics": {"numerics", "mechanism", "units"},
    "kinetics": {"numerics", "mechanism", "kinematics", "units"},
    # what the file of a user's own formulas imports
    "formulas": {"numerics", "mechanism", "kinematics"},
    "loops": {"numerics", "mechanism", "kinematics"},
    "dynamics": {"kinetics", "io"},
    "simulation": {"numerics", "mechanism", "units", "files"},
    "compare": {"numerics", "mechanism"},
    "shapes": {"numerics", "mechanism"},
    "papers": {"numerics", "mechanism", "kinematics"},
    "pictures": {"numerics", "mechanism", "shapes", "simulation", "files", "units"},
    "io": {"numerics", "mechanism", "kinematics", "kinetics", "simulation", "units", "files"},
    # only the export of a picture imports pictures
    "studies": {
        *("numerics", "mechanism", "kinematics", "kinetics", "simulation", "io", "compare", "pictures"),
        *("files", "units"),
    },
    "codegen": {"numerics", "mechanism", "kinematics", "kinetics", "studies", "io", "units"},
    "report": {
        *("shapes", "numerics", "mechanism", "kinematics", "kinetics", "compare", "pictures", "studies"),
        *("codegen", "io", "files", "units"),
    },
    "cli": {
        *("numerics", "mechanism", "kinematics", "kinetics", "simulation", "compare", "shapes", "papers"),
        *("pictures", "studies", "codegen", "io", "report", "files", "units"),
    },
    # the pytest plugin and the assertion that a user's own test suite calls
    "testing": {"numerics", "mechanism", "kinematics", "kinetics", "compare", "studies", "io", "files"},
    "__main__": {"cli"},
    "errors": set(),
    "files": {"numerics", "mechanism", "units"},
    "units": set(),
}
EVERYWHERE = {"errors", "_version", ""}
# library -> the modules that may import it, by the start of their names
LIBRARIES = {
    "mujoco": ("mechsim.simulation", "mechsim.pictures.render", "mechsim.studies", "mechsim.cli.doctor"),
    "matplotlib": ("mechsim.pictures", "mechsim.report.study_plots"),
    "mediapy": ("mechsim.pictures.render",),
    "jinja2": ("mechsim.report", "mechsim.pictures.view"),
    "typer": ("mechsim.cli",),
    "rich": ("mechsim.cli",),
    "pint": ("mechsim.units",),
    "IPython": ("mechsim.report",),
    "pytest": ("mechsim.testing",),
}
# libraries that would slow down every command if imported at the top of a file
SLOW = re.compile(r"^(?:import|from) (?:matplotlib|mediapy|pint|jinja2|pandas|xarray)\b", re.MULTILINE)


# command -> most lines of code that it may reach (validation/import_closures.py lists them)
REACHED = {
    "list": 12600,
    "show": 12600,
    "solve": 10500,
    "simulate": 17000,
    "validate": 18500,
    "export": 17500,
    "check": 14000,
    "sample": 15000,
    "map": 15000,
}
# studies that are features: they import the core and what is shared, and of each other only this
FEATURES = (
    *("agreement", "calibration", "certify", "extremes", "identification", "reduction", "robots", "scene"),
    *("sensitivity", "sweep", "tradeoff"),
)
BETWEEN_FEATURES = {
    ("agreement", "scene"),  # a difference is attributed to the settings of a scene
    ("calibration", "sensitivity"),  # a fit uses the derivatives of a motion
    ("certify", "sensitivity"),  # tolerances are written alike
    ("reduction", "scene"),  # a reduced scene is a scene
}


@pytest.fixture(scope="module")
def imports():
    return structure.imports()


@pytest.fixture(scope="module")
def graph(imports):
    return structure.import_graph(imports)


def breaches(graph):
    """Return the imports from one package into another that the table does not allow."""
    packages = [(a, b, structure.package_of(a), structure.package_of(b)) for a, b in graph.edges]
    return [f"{a} imports {b}" for a, b, item, other in packages if item and not allowed(item, other)]


def allowed(package, other):
    return package == other or other in EVERYWHERE or other in ALLOWED_IMPORTS.get(package, set())


def forbidden_libraries(name, imported):
    """Return the libraries that a module imports but may not."""
    libraries = {item.split(".")[0] for item in imported} & LIBRARIES.keys()
    return {item for item in libraries if not name.startswith(LIBRARIES[item])}


def test_packages_import_only_allowed_packages(graph):
    assert {structure.package_of(name) for name in FILES} - {"", "_version"} == set(ALLOWED_IMPORTS)
    assert breaches(graph) == []


def between_features(graph):
    """Return the pairs of features of which one imports the other."""
    pairs = {
        tuple(name.split(".")[2] for name in edge if name.startswith("mechsim.studies."))
        for edge in graph.edges
    }
    return {pair for pair in pairs if len({*pair}) == 2 and {*pair} <= {*FEATURES}}


def test_features_do_not_import_each_other(graph):
    assert between_features(graph) == BETWEEN_FEATURES


def test_commands_reach_no_more_code_than_allowed():
    reached = import_closures.closures()
    assert {command: lines for command, lines in reached.items() if lines > REACHED[command]} == {}


def test_the_closure_of_a_command_contains_what_it_runs():
    graph = import_closures.loaded()
    assert "mechsim.kinematics.loops.motion" in import_closures.closure(graph, "solve")
    assert "mechsim.report.page" not in import_closures.closure(graph, "validate")
    assert "mechsim.report.page" in import_closures.closure(import_closures.loaded(gates=False), "validate")


def test_every_gate_is_an_import():
    edges = import_closures.loaded(gates=False).edges
    gates = [tuple(f"mechsim.{name}" for name in gate) for gate in import_closures.GATES]
    assert [gate for gate in gates if gate not in edges] == []


def test_imports_have_no_cycles(graph):
    assert structure.cycles(graph) == []
    assert structure.cycles(structure.packages(graph)) == []


def test_libraries_are_imported_only_by_allowed_modules(imports):
    assert {
        name: wrong for name, result in imports.items() if (wrong := forbidden_libraries(name, result))
    } == {}


def test_slow_libraries_are_imported_inside_functions():
    # an import inside a function is indented
    assert SLOW.search("import numpy\nfrom xarray import Dataset")
    assert {name: result for name, path in FILES.items() if (result := SLOW.findall(path.read_text()))} == {}


def test_no_module_is_shadowed_by_an_export_of_its_package():
    for name in FILES:
        importlib.import_module(name)
    hidden = [
        name
        for name in FILES
        if "." in name
        and not isinstance(
            vars(sys.modules[name.rpartition(".")[0]]).get(name.rpartition(".")[2]), ModuleType
        )
    ]
    assert hidden == []


def test_no_two_classes_share_a_name():
    named = re.compile(r"^ *class (\w+)", re.MULTILINE)
    result = Counter(name for path in FILES.values() for name in named.findall(path.read_text()))
    assert [name for name, count in result.items() if count > 1] == []


@pytest.mark.parametrize(
    "source",
    [
        "import mujoco",
        "def f():\n    from mujoco import MjSpec",
        "import importlib\nimportlib.import_module('mujoco')",
        "from mechsim import simulation",
        "from ...simulation.mjcf import generator",
        "def f():\n    from mechsim.simulation.mjcf.compiling import to_xml",
        "if TYPE_CHECKING:\n    from mechsim.simulation import Run",
    ],
)
def test_the_check_rejects_a_forbidden_library_or_module(source, graph):
    name, wrong = "mechsim.kinematics.loops.tree", graph.copy()
    imported = structure.imports_of(source, name.rpartition(".")[0])
    for item in imported:
        target = item if item in FILES else item.rpartition(".")[0]
        wrong.add_edges_from([(name, target)] if target in FILES else [])
    assert forbidden_libraries(name, imported) or len(breaches(wrong)) == len(breaches(graph)) + 1


def test_the_check_rejects_a_cycle_and_an_import_between_features(graph):
    wrong = graph.copy()
    wrong.add_edge("mechsim.studies.sweep.task", "mechsim.studies.tradeoff.methods")
    assert between_features(wrong) - BETWEEN_FEATURES == {("sweep", "tradeoff")}
    wrong.add_edge("mechsim.mechanism.mechanism", "mechsim.kinematics.loops.tree")
    assert any("mechsim.kinematics.loops.tree" in cycle for cycle in structure.cycles(wrong))
