"""Mutants: a file of the package with one operator, sign, condition or number changed.

Messages, annotations and text are left alone, and so is `<` for `<=`: no two floats
that matter here are equal.
"""

import ast
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from equivalent_mutants import EQUIVALENT

PACKAGE = Path(__file__).resolve().parents[1] / "mechsim"
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
    """A file with one thing changed, or with none.

    Attributes:
        file: below `mechsim/`.
        text: of the file, as it was when the run began.
        line: of what is changed.
        before: the line as it is.
        after: the line as it is changed.
        place: which of the file's nodes is changed, and which of its changes it is.
    """

    file: str
    text: str
    line: int = 0
    before: str = ""
    after: str = ""
    place: tuple[int, int] | None = None

    def __str__(self) -> str:
        same = _alike(self.before, self.after)
        end = _alike(self.before[:same:-1], self.after[:same:-1])
        before, after = (
            text[max(0, same - 60) : same] + text[same : len(text) - end] + text[len(text) - end :][:20]
            for text in (self.before, self.after)
        )
        return f"mechsim/{self.file}:{self.line}: {before}  ->  {after}"

    @property
    def equivalent(self) -> bool:
        """Whether it is known to change nothing that counts."""
        return any((self.file, self.before, after) in EQUIVALENT for after in (self.after, "..."))

    @property
    def module(self) -> str:
        """The name under which the file is imported."""
        return "mechsim." + self.file.removesuffix(".py").replace("/", ".")

    def run(self, names: dict[str, object]) -> None:
        """Run the changed file over the names of its module."""
        tree = ast.parse(self.text)
        if self.place is not None:
            _change(tree, *self.place)
        exec(compile(ast.fix_missing_locations(tree), PACKAGE / self.file, "exec"), names)


def unchanged(file: str) -> Mutant:
    """A file with nothing changed."""
    return Mutant(file, (PACKAGE / file).read_text())


def mutants(file: str) -> list[Mutant]:
    """All mutants of a file."""
    text, result = unchanged(file).text, list[Mutant]()
    for k, (node, statement) in enumerate(nodes(ast.parse(text))):
        before = ""
        for m in range(len(list(changes(node)))):
            before = before or ast.unparse(statement)
            after = ast.unparse(_change(ast.parse(text), k, m))
            line = getattr(node, "lineno", 0)
            result.append(Mutant(file, text, line, *_differing(before, after), (k, m)))
    return result


def _change(tree: ast.Module, k: int, m: int) -> ast.AST:
    """Make a change in a tree, and return the statement that it is in."""
    node, statement = next(itertools.islice(nodes(tree), k, None))
    list(changes(node))[m]()
    return statement


def nodes(node: ast.AST, statement: ast.AST | None = None) -> Iterator[tuple[ast.AST, ast.AST]]:
    """All nodes but messages, annotations and checks of lengths, each with the statement it is in."""
    statement = node if statement is None or isinstance(node, ast.stmt) else statement
    yield node, statement
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            message = isinstance(child, (ast.JoinedStr, ast.Raise))
            # zip's check of lengths that are equal
            strict = isinstance(child, ast.keyword) and child.arg == "strict"
            if isinstance(child, ast.AST) and not message and not strict:
                yield from nodes(child, statement)


def changes(node: ast.AST) -> Iterator[Change]:
    """What can be changed in a node, in place."""
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
        for other in others(node.value):
            yield lambda other=other: setattr(node, "value", other)


def others(value: bool | float) -> list[bool | float]:
    """Numbers for a number: the tenfold and the tenth, or of a small whole number the next."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1] if abs(value) < 10 else [10 * value, value // 10]
    return [10.0 * value, 0.1 * value] if value else [1.0]


def _alike(item: str, other: str) -> int:
    """How many letters two texts begin with alike."""
    pairs = zip(item, other, strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(item), len(other)))


def _differing(before: str, after: str) -> tuple[str, str]:
    """The lines in which two texts differ."""
    pairs = zip(before.splitlines(), after.splitlines(), strict=True)
    return next((a.strip(), b.strip()) for a, b in pairs if a != b)
