"""Expressions of named arrays: values, exact derivatives, and what is rejected."""

import numpy as np
import pytest

from mechsim.mechanism.expressions import compiled

NAMES = ("angle", "speed", "t")
VALUES = {
    "angle": np.linspace(-0.9, 0.8, 7),
    "speed": np.linspace(0.3, 2.1, 7),
    "t": np.linspace(0.1, 1.3, 7),
}


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        (
            "-20*(angle - 0.3*sin(2*pi*t)) - 0.5*speed",
            lambda q, v, t: -20 * (q - 0.3 * np.sin(2 * np.pi * t)) - 0.5 * v,
        ),
        ("min(2.5, max(-2.5, 4*angle*speed))", lambda q, v, t: np.clip(4 * q * v, -2.5, 2.5)),
        ("atan2(angle, speed)*abs(angle)", lambda q, v, t: np.arctan2(q, v) * np.abs(q)),
        ("speed**1.5/exp(t) + log(t)**2", lambda q, v, t: v**1.5 / np.exp(t) + np.log(t) ** 2),
        ("speed**angle", lambda q, v, t: v**q),
        ("7", lambda q, v, t: 7.0),
    ],
)
def test_values_and_derivatives_agree_with_the_formula(text, formula):
    expression = compiled(text, NAMES)
    value, derivatives = expression.derivatives({name: VALUES[name] for name in expression.names} or VALUES)
    expected = formula(*VALUES.values())
    np.testing.assert_allclose(value, expected, rtol=1e-14)
    for name in expression.names:
        step = 1e-6
        ahead, behind = (formula(*{**VALUES, name: VALUES[name] + sign * step}.values()) for sign in (1, -1))
        by_differences = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(derivatives[name], by_differences, rtol=1e-7, atol=1e-8)
        assert np.abs(derivatives[name] - 1.001 * by_differences).max() > 1e-6
