"""Mutants: a file of the package with one operator, sign, condition or number changed.

Messages, annotations and text are not changed. `<` is not changed to `<=`, because no two relevant floats
are equal.
"""

import ast
import itertools
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "mechsim"
# (file, line, changed line) of the mutants that no test can reject
EQUIVALENT = {
    (file, line, changed)
    for file, lines in tomllib.loads(
        Path(__file__).with_name("equivalent_mutants.toml").read_text("utf-8")
    ).items()
    for line, mutants in lines.items()
    for changed in mutants
}
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
Change = Callable[[], None]


@dataclass(frozen=True)
class Mutant:
    """A file with one change, or unchanged.

    Attributes:
        file: below `mechsim/`.
        text: source of the file at the start of the run.
        line: number of the changed line.
        before: original line.
        after: changed line.
        position: index of the changed node in the file, and of the change among those of the node.
    """

    file: str
    text: str
    line: int = 0
    before: str = ""
    after: str = ""
    position: tuple[int, int] | None = None

    def __str__(self) -> str:
        prefix = _common_prefix_length(self.before, self.after)
        suffix = _common_prefix_length(self.before[:prefix:-1], self.after[:prefix:-1])
        before, after = (
            text[max(0, prefix - 60) : len(text) - suffix] + text[len(text) - suffix :][:20]
            for text in (self.before, self.after)
        )
        return f"mechsim/{self.file}:{self.line}: {before}  ->  {after}"

    @property
    def equivalent(self) -> bool:
        """Whether the mutant is listed as equivalent."""
        return any((self.file, self.before, after) in EQUIVALENT for after in (self.after, "..."))

    @property
    def module(self) -> str:
        """The name under which the file is imported."""
        return "mechsim." + self.file.removesuffix(".py").replace("/", ".")

    def run(self, names: dict[str, object]) -> None:
        """Execute the changed file in the namespace of its module."""
        tree = ast.parse(self.text)
        if self.position is not None:
            _change(tree, *self.position)
        exec(compile(ast.fix_missing_locations(tree), PACKAGE / self.file, "exec"), names)


def unchanged(file: str) -> Mutant:
    """Return the unchanged file."""
    return Mutant(file, (PACKAGE / file).read_text())


def mutants(file: str) -> list[Mutant]:
    """Return all mutants of a file."""
    text, result = unchanged(file).text, list[Mutant]()
    for k, (node, statement) in enumerate(nodes(ast.parse(text))):
        before = ""
        for m in range(len(list(changes(node)))):
            before = before or ast.unparse(statement)
            after = ast.unparse(_change(ast.parse(text), k, m))
            line = getattr(node, "lineno", 0)
            result.append(Mutant(file, text, line, *_first_different_lines(before, after), (k, m)))
    return result


def _change(tree: ast.Module, node_index: int, change_index: int) -> ast.AST:
    """Apply a change to a tree; return the statement that contains it."""
    node, statement = next(itertools.islice(nodes(tree), node_index, None))
    list(changes(node))[change_index]()
    return statement


def nodes(node: ast.AST, statement: ast.AST | None = None) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield each node that may be changed, with the statement that contains it."""
    statement = node if statement is None or isinstance(node, ast.stmt) else statement
    yield node, statement
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            message = isinstance(child, (ast.JoinedStr, ast.Raise))
            # `strict` of zip only checks lengths
            strict = isinstance(child, ast.keyword) and child.arg == "strict"
            if isinstance(child, ast.AST) and not message and not strict:
                yield from nodes(child, statement)


def changes(node: ast.AST) -> Iterator[Change]:
    """Yield the functions that change a node in place."""
    if isinstance(node, (ast.BinOp, ast.BoolOp, ast.AugAssign)) and type(node.op) in SWAPPED:
        yield lambda: setattr(node, "op", SWAPPED[type(node.op)]())
    elif isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            yield lambda i=i, op=op: node.ops.__setitem__(i, SWAPPED[type(op)]())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield lambda: setattr(node, "op", ast.UAdd())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield lambda: setattr(node, "operand", ast.UnaryOp(ast.Not(), node.operand))
    elif isinstance(node, (ast.If, ast.IfExp, ast.While)) and not isinstance(node.test, ast.Compare):
        yield lambda: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
        for value in changed_values(node.value):
            yield lambda value=value: setattr(node, "value", value)


def changed_values(value: bool | float) -> list[bool | float]:
    """Return the values that replace a number: ten times and a tenth of it, or the next small integer."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1] if abs(value) < 10 else [10 * value, value // 10]
    return [10.0 * value, 0.1 * value] if value else [1.0]


def _common_prefix_length(first: str, second: str) -> int:
    """Return the number of leading characters that two texts share."""
    pairs = zip(first, second, strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(first), len(second)))


def _first_different_lines(before: str, after: str) -> tuple[str, str]:
    """Return the first line that differs, of both texts."""
    pairs = zip(before.splitlines(), after.splitlines(), strict=True)
    return next((a.strip(), b.strip()) for a, b in pairs if a != b)
