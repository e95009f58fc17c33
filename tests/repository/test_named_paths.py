"""Every file named in a document, a comment or a docstring exists."""

import ast
import importlib
import re
from pathlib import Path

import mechsim

ROOT = Path(__file__).parents[2]
PAGES = [path for path in ROOT.glob("docs/**/*.md") if "_generated" not in path.parts]
DOCUMENTS = [*ROOT.glob("*.md"), *PAGES, ROOT / "validation" / "README.md"]
SOURCES = [
    *ROOT.glob("mechsim/**/*.py"),
    *ROOT.glob("validation/**/*.py"),
    *ROOT.glob("examples/*.py"),
    *ROOT.glob("docs/*.py"),
]
PATH = re.compile(r"(?<![\w/.-])((?:validation|tests|mechsim|examples|docs|\.ci)/[\w/.-]*\w)/?")
MODULE = re.compile(r"(?<![\w/.@\"-])mechsim((?:\.[a-z_]+)+)(?![\w/(])")


def missing(text: str) -> list[str]:
    """Return the paths and modules that a text names and that do not exist."""
    # a path may continue on the next line of a comment
    joined = re.sub(r"/\n#? *", "/", text)
    homes = (ROOT, ROOT / "examples" / "my_project")
    paths = [path for path in PATH.findall(joined) if not any((home / path).exists() for home in homes)]
    return paths + [f"mechsim{name}" for name in MODULE.findall(joined) if not _exists(name.strip("."))]


def _exists(name: str) -> bool:
    components = name.split(".")
    if components[0] in mechsim.__all__:
        return True
    # a module or a name in a module
    candidates = [
        ROOT.joinpath("mechsim", *components[:end]) for end in (len(components), len(components) - 1) if end
    ]
    return any(candidate.is_dir() or candidate.with_suffix(".py").exists() for candidate in candidates)


def test_all_named_paths_and_modules_exist():
    result = {str(path.relative_to(ROOT)): missing(path.read_text()) for path in [*DOCUMENTS, *SOURCES]}
    assert {path: names for path, names in result.items() if names} == {}


def unknown_names(text: str) -> list[str]:
    """Return the names that a script imports from modules of mechsim that do not have them."""
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)]
    names = [(node.module, alias.name) for node in imports for alias in node.names if node.module]
    return [
        f"{module}.{name}"
        for module, name in names
        if module.startswith("mechsim")
        and not hasattr(importlib.import_module(module), name)
        and not _is_module(f"{module}.{name}")
    ]


def _is_module(name: str) -> bool:
    path = ROOT.joinpath(*name.split("."))
    return path.is_dir() or path.with_suffix(".py").exists()


def test_scripts_import_only_existing_names():
    scripts = [path for path in SOURCES if path.relative_to(ROOT).parts[0] != "mechsim"]
    unknown = {str(path.relative_to(ROOT)): unknown_names(path.read_text()) for path in scripts}
    assert {path: names for path, names in unknown.items() if names} == {}


def test_an_import_of_a_missing_name_is_detected():
    assert unknown_names("from mechsim.numerics.rank import rank, ranks") == ["mechsim.numerics.rank.ranks"]
    assert unknown_names("from mechsim.numerics import rank") == []


def test_every_folder_of_validation_is_explained():
    reported = (ROOT / "validation" / "README.md").read_text()
    folders = {path.parent.name for path in ROOT.glob("validation/*/*") if path.suffix in (".py", ".csv")}
    assert all(f"| `{folder}/` |" in reported for folder in folders)


def test_the_check_detects_missing_paths():
    output = "see validation/tradeoff/drive.py, validation/\n# choices/crank_actuation.py and `mechsim.judge`"
    assert missing(output) == ["validation/tradeoff/drive.py", "mechsim.judge"]
