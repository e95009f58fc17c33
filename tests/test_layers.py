"""The two roads never meet before the verdict: who may import whom, read from the source itself."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "mechsim"
CLOSED_FORM = {
    "vectors",
    "inertia",
    "mechanism",
    "rods",
    "motors",
    "course",
    "forces",
    "motion",
    "closure",
    "catalog",
    "continuation",
    "structure",
    "synthesis",
    "dynamics",
}
MUJOCO = {"mjcf", "simulation", "render"}
PICTURES = {"plots", "render", "report"}
OUTSIDE_CLOSED_FORM = {
    "mujoco",
    "matplotlib",
    "mediapy",
    "mechsim.mjcf",
    "mechsim.simulation",
    "mechsim.render",
}
OUTSIDE_MUJOCO = {"mechsim.catalog", "mechsim.closure", "mechsim.continuation", "mechsim.dynamics"}


def layer_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(source: str, package: str) -> set[str]:
    """Return the full names a module imports, inside functions too; `package` is the one it lies in."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            base = ".".join(parts[: len(parts) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            found |= {module, *(f"{module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("import_module", "__import__"):
            found |= {arg.value for arg in node.args if isinstance(arg, ast.Constant)}
    return found


def breaches(layer: str, imported: set[str]) -> set[str]:
    forbidden: set[str] = set()
    if layer in CLOSED_FORM:
        forbidden |= OUTSIDE_CLOSED_FORM
    if layer in ("mjcf", "simulation"):
        forbidden |= OUTSIDE_MUJOCO
    if layer not in MUJOCO:
        forbidden.add("mujoco")
    if layer not in PICTURES:
        forbidden |= {"matplotlib", "mediapy"}
    return {name for name in imported for ban in forbidden if name == ban or name.startswith(f"{ban}.")}


MODULES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_module_imports_only_what_its_layer_may(path):
    package = ".".join(("mechsim", *path.relative_to(PACKAGE).parts[:-1]))
    assert not breaches(layer_of(path), imports_of(path.read_text(), package))


def test_pictures_are_drawn_with_libraries_loaded_only_when_wanted():
    for path in MODULES:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = imports_of(ast.unparse(node), "mechsim")
                heavy = {name for name in names if name.split(".")[0] in ("matplotlib", "mediapy", "pint")}
                assert not heavy, f"{path.name} imports {heavy} at its top; do it in the function that draws"


@pytest.mark.parametrize(
    ("layer", "source"),
    [
        ("catalog", "import mujoco"),
        ("catalog", "def f():\n    from mujoco import MjSpec"),
        ("closure", "from mechsim import simulation"),
        ("dynamics", "from mechsim.mjcf.text import write"),
        ("catalog", "from ..mjcf import generate"),
        ("mjcf", "from mechsim.catalog.rssr import Rssr"),
        ("simulation", "import mechsim.closure as c"),
        ("simulation", "from mechsim import catalog"),
        ("crosscheck", "import mujoco"),
        ("vectors", "import matplotlib.pyplot as plt"),
        ("units", "import mediapy"),
        ("catalog", "import importlib\nimportlib.import_module('mujoco')"),
    ],
)
def test_the_judge_sees_a_breach(layer, source):
    assert breaches(layer, imports_of(source, f"mechsim.{layer}"))


def test_the_judge_lets_the_verdict_see_both_roads():
    source = "from mechsim import catalog, closure, simulation"
    assert not breaches("crosscheck", imports_of(source, "mechsim"))
    assert not breaches("simulation", imports_of("import mujoco", "mechsim"))
