"""The structure of a package in figures: packages, imports, cycles, layers, lines.

    python validation/structure.py [FOLDER] [--list]

FOLDER defaults to mechsim of this checkout. A package is a folder of it, or a file next to the folders.
Imports under TYPE_CHECKING and inside functions count. A cycle is a set of files that import each other.
The number of layers is the length of the longest chain of imports between packages. Lines of code are those
without blank lines, comments and docstrings. With --list, the options of each command and the code lines of
each folder are listed.
"""

import argparse
import ast
import io
import tokenize
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import networkx as nx

PACKAGE = Path(__file__).parents[1] / "mechsim"
# tokens that are not code
NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


def imports_of(source: str, package: str, typing: bool = True) -> set[str]:
    """Return the full names that a module of a package imports, also inside functions.

    Without `typing`, imports under TYPE_CHECKING are left out.
    """
    result: set[str] = set()
    for node in _nodes(ast.parse(source), typing):
        if isinstance(node, ast.Import):
            result |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names = package.split(".")
            base = ".".join(names[: len(names) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            result |= {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and _called(node) in ("import_module", "__import__"):
            result |= {arg.value for arg in node.args if isinstance(arg, ast.Constant)}
    return result


def _nodes(tree: ast.AST, typing: bool) -> Iterator[ast.AST]:
    """Yield the nodes of a syntax tree, without those under TYPE_CHECKING unless `typing`."""
    for node in ast.iter_child_nodes(tree):
        if typing or not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            yield node
            yield from _nodes(node, typing)


def modules(package: Path = PACKAGE) -> dict[str, Path]:
    """Return the modules of a package: dotted name -> file."""
    return {_name(path, package): path for path in sorted(package.rglob("*.py"))}


def imports(package: Path = PACKAGE) -> dict[str, set[str]]:
    """Return what each module of a package imports: dotted name -> full names."""
    result: dict[str, set[str]] = {}
    for name, path in modules(package).items():
        inside = name if path.name == "__init__.py" else name.rpartition(".")[0]
        result[name] = imports_of(path.read_text(encoding="utf-8"), inside)
    return result


def import_graph(imported: Mapping[str, set[str]]) -> nx.DiGraph:
    """Return which module imports which of the same package; a package's name stands for its `__init__`."""
    graph = nx.DiGraph()
    graph.add_nodes_from(imported)
    for name, full_names in imported.items():
        for full_name in full_names:
            target = full_name if full_name in imported else full_name.rpartition(".")[0]
            if target in imported and target != name:
                graph.add_edge(name, target)
    return graph


def package_of(module: str) -> str:
    """Return the folder that a module lies in, or its own name if it lies next to the folders."""
    return [*module.split("."), ""][1]


def packages(graph: nx.DiGraph) -> nx.DiGraph:
    """Return which package imports which; the top-level `__init__` does not count."""
    result = nx.DiGraph()
    result.add_nodes_from(package_of(name) for name in graph if package_of(name))
    result.add_edges_from(
        (package_of(a), package_of(b))
        for a, b in graph.edges
        if package_of(a) and package_of(b) and package_of(a) != package_of(b)
    )
    return result


def cycles(graph: nx.DiGraph) -> list[list[str]]:
    """Return the sets of modules that import each other, largest first."""
    result = [sorted(modules) for modules in nx.strongly_connected_components(graph) if len(modules) > 1]
    return sorted(result, key=len, reverse=True)


def layers(graph: nx.DiGraph) -> int:
    """Return the length of the longest chain of imports; packages in a cycle share a layer."""
    return nx.dag_longest_path_length(nx.condensation(graph)) + 1


def docstring_lines(source: str) -> set[int]:
    """Return the numbers of the lines of docstrings."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if ast.get_docstring(node, clean=False) is not None and first is not None:
                lines |= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return lines


def code_lines(source: str) -> int:
    """Return how many lines hold code."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return len(lines - docstring_lines(source))


def figures(package: Path = PACKAGE) -> dict[str, object]:
    """Return the figures by name."""
    graph = import_graph(imports(package))
    between = packages(graph)
    sizes = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules(package).values()}
    cyclic = cycles(graph)
    largest = max(sizes, key=lambda path: sizes[path])
    sources = [path.read_text(encoding="utf-8") for path in sizes]
    return {
        "packages": len(between),
        "folders": sum(path.is_dir() and any(path.rglob("*.py")) for path in package.iterdir()),
        "files next to them": len(list(package.glob("*.py"))),
        "imports between packages": between.number_of_edges(),
        "cycles of files": f"{len(cyclic)}, the largest of {len(cyclic[0])}" if cyclic else "0",
        "cycles of packages": len(cycles(between)),
        "layers": layers(between),
        "files": len(sizes),
        "lines": sum(sizes.values()),
        "lines of code": sum(code_lines(source) for source in sources),
        "lines of docstrings": sum(len(docstring_lines(source)) for source in sources),
        "largest file": f"{sizes[largest]} lines, {largest.relative_to(package)}",
    }


def _name(path: Path, package: Path) -> str:
    path_parts = [package.name, *path.relative_to(package).with_suffix("").parts]
    return ".".join(path_parts[:-1] if path_parts[-1] == "__init__" else path_parts)


def _called(node: ast.Call) -> str:
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def _print_folders(package: Path) -> None:
    """Print the code lines of each folder."""
    folders: Counter[str] = Counter()
    for path in modules(package).values():
        folders["/".join(path.relative_to(package).parts[:2])] += code_lines(path.read_text(encoding="utf-8"))
    for folder, count in folders.most_common():
        print(f"{count:6} {folder}")


def options_of_commands() -> dict[str, int]:
    """Return the number of options of each command, without --help."""
    from mechsim.cli import COMMANDS, load_command

    return {
        name: sum(parameter.param_type_name == "option" for parameter in load_command(name).params)
        for name in COMMANDS
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=PACKAGE)
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    for name, value in figures(options.folder).items():
        print(f"{name:24} {value}")
    options_of = options_of_commands()
    print(f"{'options of all commands':24} {sum(options_of.values())}")
    if options.list:
        print(*(f"  {name:22} {count}" for name, count in options_of.items()), sep="\n")
        _print_folders(options.folder)


if __name__ == "__main__":
    main()
