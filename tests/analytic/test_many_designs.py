"""Many designs by one formula: each as its own closed form has it, and full turns told from swings."""

from dataclasses import replace

import numpy as np
import pytest

from mechsim.analytic import catalog
from mechsim.analytic.catalog import many_designs as md
from mechsim.errors import InputError

ANGLES = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
VARIED = {
    "four_bar": ("crank", "coupler", "arm_angle", "ground", "branch"),
    "slider_crank": ("crank", "rod", "offset"),
    "rssr": ("crank", "coupler", "pivot.x", "gamma1", "gamma2"),
    "rrsrr": ("crank", "coupler", "link", "gamma1", "pivot.y"),
}


def designs(name, spread, count=40):
    """Return a mechanism and random parameters about its own, (count,) each."""
    form, rng = catalog.make(name), np.random.default_rng(5)
    own = {}
    for parameter in VARIED[name]:
        field, _, axis = parameter.partition(".")
        value = getattr(form, field)
        own[parameter] = value["xyz".index(axis)] if axis else value
    varied = {item: value * (1.0 + spread * rng.uniform(-1.0, 1.0, count)) for item, value in own.items()}
    if "branch" in varied:
        varied["branch"] = rng.choice([-1.0, 1.0], count)
    return form, varied


def one_of(form, varied, index):
    """Return one of the designs by itself."""
    changed = {}
    for name, row in varied.items():
        parameter, _, axis = name.partition(".")
        own = changed.get(parameter, getattr(form, parameter))
        if axis:
            changed[parameter] = (*own[: "xyz".index(axis)], row[index], *own["xyz".index(axis) + 1 :])
        else:
            changed[parameter] = type(own)(row[index])
    return replace(form, **changed)


@pytest.mark.parametrize("name", VARIED)
def test_each_design_agrees_with_its_own_closed_form(name):
    form, varied = designs(name, 0.3)
    full = md.crank_ranges(form, varied).full
    varied = {item: values[full] for item, values in varied.items()}
    together = md.solved(form, varied, ANGLES, 2.0, rates=True, joints=True)
    assert full.sum() > 5
    for i in range(full.sum()):
        alone = one_of(form, varied, i).solve(ANGLES, 2.0)
        rows = slice(i * len(ANGLES), (i + 1) * len(ANGLES))
        for kind, parts in (
            ("points", ("position", "velocity", "acceleration")),
            ("joints", ("value", "rate", "acceleration")),
        ):
            for item, exact in getattr(alone, kind).items():
                for part in parts:
                    result = getattr(getattr(together, kind)[item], part)[rows]
                    wanted = getattr(exact, part)
                    np.testing.assert_allclose(result, wanted, rtol=1e-10, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.parametrize("name", VARIED)
def test_crank_ranges_agree_with_the_exact_roots(name):
    form, varied = designs(name, 0.8, 60)
    result = md.crank_ranges(form, varied)
    widths, ends = md.ranges(result)
    assert 0 < result.full.sum() < 60
    for i in range(60):
        alone = one_of(form, varied, i)
        arcs = alone.crank_range()
        assert arcs.full == result.full[i]
        assert widths[i] == pytest.approx(sum(high - low for low, high in arcs.arcs), abs=1e-8)
        assert ends[i] == len(alone.dead_centres())


def test_only_a_design_with_a_change_point_is_uncertain():
    form = catalog.make("four_bar", ground=0.1, coupler=0.1, crank=0.04, rocker=0.04)
    result = md.crank_ranges(form, {"crank": np.array([0.04, 0.039])})
    assert result.uncertain.tolist() == [True, False]
    assert not result.full[0]


def test_each_design_with_invalid_parameters_is_rejected():
    form = catalog.make("four_bar")
    varied = {
        "crank": np.array([0.03, -0.03, np.nan, np.inf, 0.03]),
        "branch": np.array([1.0, 1.0, 1.0, 1.0, 2.0]),
    }
    assert md.allowed(form, varied).tolist() == [True, False, False, False, False]
    for i in (1, 2, 3, 4):
        with pytest.raises(InputError):
            one_of(form, varied, i)


def test_scalar_parameters_are_not_vectorised():
    assert not md.can_be_many(catalog.make("rssr", guide=True), {"psi1": np.zeros(2)})
    assert not md.can_be_many(catalog.make("looper"), {"crank": np.ones(2)})
