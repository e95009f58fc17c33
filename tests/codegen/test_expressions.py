"""Symbolic expressions: constant folding, common subexpressions, and values."""

from mechsim.codegen.expressions import ExpressionTable


def test_constants_are_folded():
    table = ExpressionTable()
    x, y = table.symbol("x"), table.symbol("y")
    assert x + 0.0 is x
    assert 0.0 + x is x
    assert x * 1.0 is x
    assert x - 0.0 is x
    assert (x * 0.0).number == 0.0
    assert (x - x).number == 0.0
    assert (x * 6e-17).number == 0.0
    negative = -x
    assert -negative is x
    assert (-x) * (-y) is x * y
    assert x - (-y) is x + y
    assert 2.0 * (3.0 * x) is 6.0 * x
    assert (table.expression(2.0) * table.expression(0.25)).number == 0.5
