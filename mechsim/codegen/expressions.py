"""Symbolic sums and products, simplified on construction, and straight-line code for them."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Union

# distance from 0, 1 or -1 within which numbers are rounded to these: rounding errors of directions; lengths
# are already rounded
ROUNDING = 1e-15
# number of characters of an expression above which its value gets a name
MAX_TEXT = 58

Operand = Union["SymbolicExpression", float, int]


@dataclass(slots=True, eq=False, repr=False)
class SymbolicExpression:
    """A number, a symbol, or a sum, difference, product or negative of expressions.

    Equal expressions of a table are the same object. numpy arrays of dtype object contain expressions, so
    that functions on arrays return formulas.
    """

    table: "ExpressionTable"
    op: str
    args: tuple["SymbolicExpression | str | float", ...]
    index: int

    @property
    def number(self) -> float | None:
        """The value of a number; None for other expressions."""
        return float(self.args[0]) if self.op == "number" else None  # type: ignore[arg-type]

    @property
    def operands(self) -> tuple["SymbolicExpression", ...]:
        """The operands of the expression."""
        return tuple(arg for arg in self.args if isinstance(arg, SymbolicExpression))

    def __add__(self, other: Operand) -> "SymbolicExpression":
        return self.table.sum(self, self.table.expression(other))

    def __sub__(self, other: Operand) -> "SymbolicExpression":
        return self.table.difference(self, self.table.expression(other))

    def __rsub__(self, other: Operand) -> "SymbolicExpression":
        return self.table.difference(self.table.expression(other), self)

    def __mul__(self, other: Operand) -> "SymbolicExpression":
        return self.table.product(self, self.table.expression(other))

    def __truediv__(self, other: float) -> "SymbolicExpression":
        return self * (1.0 / other)

    def __pow__(self, exponent: int) -> "SymbolicExpression":
        return self if exponent == 1 else self * self ** (exponent - 1)

    def __neg__(self) -> "SymbolicExpression":
        return self.table.negative(self)

    __radd__, __rmul__ = __add__, __mul__

    def cos(self) -> "SymbolicExpression":
        """Return the cosine of a symbol, as a symbol."""
        return self.table.symbol(f"cos({self.args[0]})")

    def sin(self) -> "SymbolicExpression":
        """Return the sine of a symbol, as a symbol."""
        return self.table.symbol(f"sin({self.args[0]})")


@dataclass
class ExpressionTable:
    """All expressions of a code section, without duplicates.

    Attributes:
        entries: operation and operands -> expression.
    """

    entries: dict[tuple[object, ...], SymbolicExpression] = field(default_factory=dict)

    def _entry(self, op: str, *args: SymbolicExpression | str | float) -> SymbolicExpression:
        key = (op, *(arg.index if isinstance(arg, SymbolicExpression) else arg for arg in args))
        if key not in self.entries:
            self.entries[key] = SymbolicExpression(self, op, args, len(self.entries))
        return self.entries[key]

    def symbol(self, name: str) -> SymbolicExpression:
        """Return a symbol; the code must define its name."""
        return self._entry("symbol", name)

    def expression(self, value: Operand) -> SymbolicExpression:
        """Return a number as an expression, rounded to 0, 1 or -1 within `ROUNDING`."""
        if isinstance(value, SymbolicExpression):
            return value
        number = float(value)
        nearest = round(number) if abs(number) < 2.0 else number
        return self._entry("number", float(nearest if abs(number - nearest) < ROUNDING else number) + 0.0)

    def sum(self, a: SymbolicExpression, b: SymbolicExpression) -> SymbolicExpression:
        """Return a + b."""
        if a.number is not None and b.number is not None:
            return self.expression(a.number + b.number)
        if a.number == 0.0:
            return b
        if b.number == 0.0:
            return a
        if b.op == "neg":
            return self.difference(a, b.operands[0])
        if a.op == "neg":
            return self.difference(b, a.operands[0])
        return self._entry("+", *sorted((a, b), key=_index))

    def difference(self, a: SymbolicExpression, b: SymbolicExpression) -> SymbolicExpression:
        """Return a - b."""
        if a is b:
            return self.expression(0.0)
        if a.number == 0.0:
            return -b
        if b.op == "neg":
            return self.sum(a, b.operands[0])
        if a.op == "neg":
            return -self.sum(a.operands[0], b)
        if b.number is not None:
            return self.sum(a, self.expression(-b.number))
        return self._entry("-", a, b)

    def negative(self, a: SymbolicExpression) -> SymbolicExpression:
        """Return -a."""
        if a.number is not None:
            return self.expression(-a.number)
        if a.op == "neg":
            return a.operands[0]
        if a.op == "-":
            return self._entry("-", *a.operands[::-1])
        if a.op == "*" and a.operands[0].number is not None:
            return self.product(self.expression(-a.operands[0].number), a.operands[1])
        return self._entry("neg", a)

    def product(self, a: SymbolicExpression, b: SymbolicExpression) -> SymbolicExpression:
        """Return a b; a number becomes the first factor."""
        if b.number is not None:
            a, b = b, a
        if a.number is not None:
            if a.number == 0.0 or b.number is not None:
                return self.expression(a.number * b.number if b.number is not None else 0.0)
            if abs(a.number) == 1.0:
                return b if a.number == 1.0 else -b
            if b.op == "*" and b.operands[0].number is not None:
                return self.product(self.expression(a.number * b.operands[0].number), b.operands[1])
            if b.op == "neg":
                return self.product(self.expression(-a.number), b.operands[0])
            return self._entry("*", a, b)
        if a.op == "neg" or b.op == "neg":
            positive = self.product(*(x.operands[0] if x.op == "neg" else x for x in (a, b)))
            return positive if a.op == b.op else -positive
        return self._entry("*", *sorted((a, b), key=_index))

    def angle(self, sine: SymbolicExpression, cosine: SymbolicExpression) -> SymbolicExpression:
        """Return the angle in (-pi, pi] of a sine and a cosine with a common positive factor."""
        return self._entry("atan2", sine, cosine)


def _index(expression: SymbolicExpression) -> int:
    return expression.index


@dataclass(frozen=True)
class Block:
    """Assignments under a comment.

    Attributes:
        comment: one line.
        assignments: target, such as `residual[0]` -> its expression.
        names: whether the targets are intermediate values that other blocks use, not results.
    """

    comment: str
    assignments: Mapping[str, SymbolicExpression]
    names: bool = False


def comment_text(text: str) -> str:
    """Return the text without markers that end or nest a comment."""
    return text.replace("*/", "* /").replace("/*", "/ *")


def number_text(value: float) -> str:
    """Return a number in C and JavaScript that parses to the same double; `R` converts it to `real`."""
    return str(int(value)) if value == int(value) and abs(value) < 1e9 else f"R({value!r})"


def statements(blocks: Sequence[Block], symbols: Mapping[str, str]) -> list[str]:
    """Return straight-line code for blocks; common subexpressions are computed once.

    Args:
        blocks: blocks in order.
        symbols: symbol -> the code that reads it, for its definition as `const real`.
    """
    emission, code = Emission(blocks, symbols), list[str]()
    for block in blocks:
        if lines := [*emission.lines(block)]:
            code += [f"/* {comment_text(block.comment)} */", *lines]
    return code


class Emission:
    """State of code emission: the names of expressions so far."""

    def __init__(self, blocks: Sequence[Block], symbols: Mapping[str, str]):
        self.symbols = symbols
        self.uses: dict[int, int] = {}
        self.texts: dict[int, str] = {}
        for block in blocks:
            for root in () if block.names else block.assignments.values():
                for expression in _new(root, self.uses):
                    for operand in expression.operands:
                        self.uses[operand.index] += 1
                self.uses[root.index] += 1

    def lines(self, block: Block) -> Iterator[str]:
        """Yield the statements of a block."""
        for target, root in block.assignments.items():
            if not block.names:
                yield from self._defined(root)
                yield f"{target} = {self.texts[root.index]};"
            elif root.index in self.uses and root.index not in self.texts and root.op in "+-*":
                yield from self._defined(root, target)

    def _defined(self, root: SymbolicExpression, name: str = "") -> Iterator[str]:
        """Yield definitions of all operands of an expression, innermost first; its own value gets a name."""
        for expression in _new(root, self.texts, ""):
            text = self._text(expression)
            shared = self.uses[expression.index] > 1 or len(text) > MAX_TEXT
            called = name if name and expression is root else ""
            if expression.op == "symbol":
                called = re.sub(r"\W+", "_", text).strip("_")
                text = self.symbols[text]
            elif expression.op in "+-*" and shared:
                called = called or f"t{expression.index}"
            if called:
                yield f"const real {called} = {text};"
            self.texts[expression.index] = called or text

    def _text(self, expression: SymbolicExpression) -> str:
        if expression.op == "symbol":
            return str(expression.args[0])
        if expression.number is not None:
            return number_text(expression.number)
        if expression.op == "atan2":
            return f"atan2({', '.join(self.texts[operand.index] for operand in expression.operands)})"
        # unnamed sums and negatives in parentheses
        operands = [
            f"({text})" if operand.op in ("+", "-", "neg") and not text.isidentifier() else text
            for operand in expression.operands
            for text in (self.texts[operand.index],)
        ]
        return f"-{operands[0]}" if expression.op == "neg" else f" {expression.op} ".join(operands)


def _new(
    root: SymbolicExpression, visited: dict[int, int] | dict[int, str], initial: int | str = 0
) -> Iterable[SymbolicExpression]:
    """Return an expression and its operands that are not visited yet, operands first."""
    order: list[SymbolicExpression] = []
    waiting = [root]
    while waiting:
        expression = waiting.pop()
        if expression.index in visited:
            continue
        pending = [operand for operand in expression.operands if operand.index not in visited]
        if pending:
            waiting += [expression, *reversed(pending)]
            continue
        visited[expression.index] = initial  # type: ignore[assignment]
        order.append(expression)
    return order
