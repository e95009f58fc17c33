"""The structure of a package in figures: packages, imports, cycles, layers, lines, the longest function.

    python validation/structure.py [FOLDER]

FOLDER defaults to mechsim of this checkout. A package is a folder of it, or a file next to the folders.
Imports under TYPE_CHECKING and inside functions count. A cycle is a set of files that import each other.
The number of layers is the length of the longest chain of imports between packages.
"""

import ast
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import networkx as nx

PACKAGE = Path(__file__).parents[1] / "mechsim"


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
            found |= {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and _called(node) in ("import_module", "__import__"):
            found |= {arg.value for arg in node.args if isinstance(arg, ast.Constant)}
    return found


def modules(package: Path = PACKAGE) -> dict[str, Path]:
    """Return the modules of a package: dotted name -> file."""
    return {_name(path, package): path for path in sorted(package.rglob("*.py"))}


def imports(package: Path = PACKAGE) -> dict[str, set[str]]:
    """Return what each module of a package imports: dotted name -> full names."""
    found: dict[str, set[str]] = {}
    for name, path in modules(package).items():
        inside = name if path.name == "__init__.py" else name.rpartition(".")[0]
        found[name] = imports_of(path.read_text(encoding="utf-8"), inside)
    return found


def import_graph(imported: Mapping[str, set[str]]) -> nx.DiGraph:
    """Return which module imports which of the same package; a package's name stands for its `__init__`."""
    graph = nx.DiGraph()
    graph.add_nodes_from(imported)
    for name, found in imported.items():
        for one in found:
            target = one if one in imported else one.rpartition(".")[0]
            if target in imported and target != name:
                graph.add_edge(name, target)
    return graph


def package_of(module: str) -> str:
    """Return the folder that a module lies in, or its own name if it lies next to the folders."""
    return [*module.split("."), ""][1]


def packages(graph: nx.DiGraph) -> nx.DiGraph:
    """Return which package imports which; the top-level `__init__` does not count."""
    found = nx.DiGraph()
    found.add_nodes_from(package_of(name) for name in graph if package_of(name))
    found.add_edges_from(
        (package_of(a), package_of(b))
        for a, b in graph.edges
        if package_of(a) and package_of(b) and package_of(a) != package_of(b)
    )
    return found


def cycles(graph: nx.DiGraph) -> list[list[str]]:
    """Return the sets of modules that import each other, largest first."""
    found = [sorted(part) for part in nx.strongly_connected_components(graph) if len(part) > 1]
    return sorted(found, key=len, reverse=True)


def layers(graph: nx.DiGraph) -> int:
    """Return the length of the longest chain of imports; packages in a cycle share a layer."""
    return nx.dag_longest_path_length(nx.condensation(graph)) + 1


def functions(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines, without signature and docstring, and the name of every function of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            does = node.body[ast.get_docstring(node) is not None :]
            yield (node.end_lineno or 0) - does[0].lineno + 1 if does else 0, node.name


def figures(package: Path = PACKAGE) -> dict[str, object]:
    """Return the figures by name."""
    graph = import_graph(imports(package))
    between = packages(graph)
    sizes = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules(package).values()}
    length, name, path = max((*found, str(path)) for path in sizes for found in functions(path))
    found = cycles(graph)
    largest = max(sizes, key=lambda path: sizes[path])
    return {
        "packages": len(between),
        "folders": sum(path.is_dir() and any(path.rglob("*.py")) for path in package.iterdir()),
        "files next to them": len(list(package.glob("*.py"))),
        "imports between packages": between.number_of_edges(),
        "cycles of files": f"{len(found)}, the largest of {len(found[0])}" if found else "0",
        "cycles of packages": len(cycles(between)),
        "layers": layers(between),
        "files": len(sizes),
        "lines": sum(sizes.values()),
        "largest file": f"{sizes[largest]} lines, {largest.relative_to(package)}",
        "longest function": f"{length} lines, {name} in {Path(path).relative_to(package)}",
    }


def _name(path: Path, package: Path) -> str:
    parts = [package.name, *path.relative_to(package).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _called(node: ast.Call) -> str:
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


if __name__ == "__main__":
    for what, value in figures(Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGE).items():
        print(f"{what:22} {value}")
