"""The house in figures: rooms, arrows, circles, floors, lines and the longest function of a package.

    python validation/house.py [FOLDER]

FOLDER is the package's; left out, mechsim of this checkout. A room is a folder of it or a loose file;
an arrow leads from a room to one it imports, under TYPE_CHECKING and inside functions too; a circle is
a set of files that import each other, a floor the longest way down.
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


def room_of(module: str) -> str:
    """Return the folder of the package that a module lies in, or its own name where it lies loose."""
    return [*module.split("."), ""][1]


def rooms(graph: nx.DiGraph) -> nx.DiGraph:
    """Return which room imports which; the package's own `__init__` is no room."""
    found = nx.DiGraph()
    found.add_nodes_from(room_of(name) for name in graph if room_of(name))
    found.add_edges_from(
        (room_of(a), room_of(b))
        for a, b in graph.edges
        if room_of(a) and room_of(b) and room_of(a) != room_of(b)
    )
    return found


def circles(graph: nx.DiGraph) -> list[list[str]]:
    """Return the sets of modules that import each other, largest first."""
    found = [sorted(part) for part in nx.strongly_connected_components(graph) if len(part) > 1]
    return sorted(found, key=len, reverse=True)


def floors(graph: nx.DiGraph) -> int:
    """Return how many rooms stand on each other at the most; rooms in a circle share a floor."""
    return nx.dag_longest_path_length(nx.condensation(graph)) + 1


def functions(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines, without signature and docstring, and the name of every function of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            does = node.body[ast.get_docstring(node) is not None :]
            yield (node.end_lineno or 0) - does[0].lineno + 1 if does else 0, node.name


def figures(package: Path = PACKAGE) -> dict[str, object]:
    """Return the house in figures."""
    graph = import_graph(imports(package))
    between = rooms(graph)
    sizes = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules(package).values()}
    length, name, path = max((*found, str(path)) for path in sizes for found in functions(path))
    found = circles(graph)
    largest = max(sizes, key=lambda path: sizes[path])
    return {
        "rooms": len(between),
        "folders": sum(path.is_dir() and any(path.rglob("*.py")) for path in package.iterdir()),
        "loose files": len(list(package.glob("*.py"))),
        "arrows between rooms": between.number_of_edges(),
        "circles of files": f"{len(found)}, the largest of {len(found[0])}" if found else "0",
        "circles of rooms": len(circles(between)),
        "floors": floors(between),
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
