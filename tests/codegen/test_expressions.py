"""Symbolic expressions: constant folding, common subexpressions, and values."""

import math
import re

import numpy as np

from mechsim.codegen.expressions import Block, ExpressionTable, number_text, statements


def run(lines, values):
    """Return what straight-line code assigns, run as Python."""
    out = {"out": {}, "R": float, **values}
    for line in lines:
        if not line.startswith("/*"):
            exec(re.sub(r"^const real ", "", line).rstrip(";"), out)
    return out["out"]


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


def test_code_has_the_value_of_the_expression():
    rng, table = np.random.default_rng(3), ExpressionTable()
    names = [f"v{i}" for i in range(4)]
    values = dict(zip(names, rng.uniform(-2.0, 2.0, 4).tolist(), strict=True))
    pool = [(table.symbol(name), values[name]) for name in names]
    for _ in range(300):
        (a, x), (b, y) = (pool[i] for i in rng.integers(0, len(pool), 2))
        kind = int(rng.integers(0, 5))
        number = float(rng.choice([0.0, 1.0, -1.0, 2.0, 0.3]))
        made, value = [
            (a + b, x + y),
            (a - b, x - y),
            (a * b, x * y),
            (number * a - b, number * x - y),
            (-a, -x),
        ][kind]
        if abs(value) < 50.0:
            pool.append((made, value))
    roots = {f"out[{i}]": made for i, (made, _) in enumerate(pool)}
    out = run(statements([Block("all", roots)], {name: name for name in names}), values)
    for i, (_, value) in enumerate(pool):
        assert math.isclose(out[i], value, rel_tol=1e-9, abs_tol=1e-9)


def test_arrays_of_expressions_multiply_like_numbers():
    rng, table = np.random.default_rng(4), ExpressionTable()
    matrix, vector = rng.standard_normal((3, 3)), rng.standard_normal(3)
    symbols = np.array([table.symbol(f"v{i}") for i in range(3)], dtype=object)
    blocks = [Block("product", {f"out[{i}]": row for i, row in enumerate(matrix @ symbols)})]
    out = run(
        statements(blocks, {f"v{i}": f"v{i}" for i in range(3)}), {f"v{i}": vector[i] for i in range(3)}
    )
    assert np.allclose([out[i] for i in range(3)], matrix @ vector, rtol=1e-14)


def test_numbers_keep_all_digits():
    assert number_text(2.0) == "2"
    assert number_text(-1.0) == "-1"
    assert eval(number_text(1.0 / 3.0), {"R": float}) == 1.0 / 3.0
