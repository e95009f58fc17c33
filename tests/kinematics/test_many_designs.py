"""Vectorised closed forms of many designs agree with single designs; full and limited crank ranges."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.formulas import many_designs as md

ANGLES = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
QUANTITIES = [("points", name) for name in ("position", "velocity", "acceleration")]
QUANTITIES += [("joints", name) for name in ("value", "rate", "acceleration")]
VARIED = {
    "four_bar": ("crank", "coupler", "arm_angle", "ground", "branch"),
    "slider_crank": ("crank", "rod", "offset"),
    "rssr": ("crank", "coupler", "pivot.x", "gamma1", "gamma2"),
    "rrsrr": ("crank", "coupler", "link", "gamma1", "pivot.y"),
}


def designs(name, spread, count=40):
    """Return a mechanism and random parameters about its own, (count,) each."""
    solver, rng = ms.catalog.make(name), np.random.default_rng(5)
    own = {}
    for parameter in VARIED[name]:
        field, _, axis = parameter.partition(".")
        value = getattr(solver, field)
        own[parameter] = value["xyz".index(axis)] if axis else value
    varied = {item: value * (1.0 + spread * rng.uniform(-1.0, 1.0, count)) for item, value in own.items()}
    if "branch" in varied:
        varied["branch"] = rng.choice([-1.0, 1.0], count)
    return solver, varied


def single_design(solver, varied, index):
    """Return one of the designs by itself."""
    changed = {}
    for name, row in varied.items():
        parameter, _, axis = name.partition(".")
        own = changed.get(parameter, getattr(solver, parameter))
        if axis:
            changed[parameter] = (*own[: "xyz".index(axis)], row[index], *own["xyz".index(axis) + 1 :])
        else:
            changed[parameter] = type(own)(row[index])
    return solver.with_parameters(**changed)


@pytest.mark.long
@pytest.mark.parametrize("name", VARIED)
def test_each_design_agrees_with_its_own_closed_form(name):
    solver, varied = designs(name, 0.3)
    full = md.crank_ranges(solver.closed_form, varied).full
    varied = {item: values[full] for item, values in varied.items()}
    together = md.solved(solver.closed_form, varied, ANGLES, 2.0, rates=True, joints=True)
    assert full.sum() > 5
    for i in range(full.sum()):
        alone = single_design(solver, varied, i).solve(ANGLES, 2.0)
        rows = slice(i * len(ANGLES), (i + 1) * len(ANGLES))
        for kind, quantity in QUANTITIES:
            for item, exact in getattr(alone, kind).items():
                result = getattr(getattr(together, kind)[item], quantity)[rows]
                expected = getattr(exact, quantity)
                np.testing.assert_allclose(result, expected, rtol=1e-10, atol=1e-11 * np.abs(expected).max())


@pytest.mark.long
@pytest.mark.parametrize("name", VARIED)
def test_crank_ranges_agree_with_the_exact_roots(name):
    solver, varied = designs(name, 0.8, 60)
    result = md.crank_ranges(solver.closed_form, varied)
    low, high = md.swing_arcs(result)
    assert 0 < result.full.sum() < 60
    for i in range(60):
        alone = single_design(solver, varied, i)
        arcs = alone.crank_range()
        assert arcs.full == result.full[i]
        if not arcs.full and np.isfinite(low[i]):
            own = np.exp(1j * np.array(arcs.arcs))
            assert np.abs(own - np.exp(1j * np.array([low[i], high[i]]))).sum(1).min() < 1e-8
            assert any(high[i] - low[i] == pytest.approx(b - a, abs=1e-8) for a, b in arcs.arcs)


def test_only_a_design_with_a_change_point_is_uncertain():
    solver = ms.catalog.make("four_bar", ground=0.1, coupler=0.1, crank=0.04, rocker=0.04)
    result = md.crank_ranges(solver.closed_form, {"crank": np.array([0.04, 0.039])})
    assert result.uncertain.tolist() == [True, False]
    assert not result.full[0]


def test_each_design_with_invalid_parameters_is_rejected():
    solver = ms.catalog.make("four_bar")
    varied = {
        "crank": np.array([0.03, -0.03, np.nan, np.inf, 0.03]),
        "branch": np.array([1.0, 1.0, 1.0, 1.0, 2.0]),
    }
    assert md.allowed(solver.closed_form, varied).tolist() == [True, False, False, False, False]
    for i in (1, 2, 3, 4):
        with pytest.raises(ms.InputError):
            single_design(solver, varied, i)
