"""Names of quantities: the grammar of sweep, sensitivity, fit and validate."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.compare.quantities import FORCES
from mechsim.mechanism.quantities import (
    KINDS,
    QuantityKind,
    effort_units,
    numeric_quantity,
    quantity,
    quantity_names,
    scalar_quantities,
)
from mechsim.mechanism.quantity import Column, record_columns
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import values_of_function
from mechsim.studies.agreement.evaluation_points import evaluation_points
from mechsim.studies.measured_table import measured_of

ANGLES = np.linspace(0.3, 2.3, 9)
STEP = 1e-6
# name -> a dimension on which it depends
DEPENDS_ON = {
    "distance:A,B": "coupler",
    "angle:crank,coupler": "crank",
    "expr:distance:A,B*2 - sqrt(A.x**2 + B.y**2)": "coupler",
    "A.x": "crank",
    "rocker.v": "crank",
    "speed:B": "crank",
}


def value(name, angles=ANGLES, **dimensions):
    solved = ms.catalog.make("four_bar", **dimensions).solve(angles, 2.0)
    item = numeric_quantity(name, ms.catalog.make("four_bar").mechanism)
    return item.number(record_columns(solved, [item]))


def agrees(formula):
    """Return whether a formula agrees with the four-bar; without a search for the cause if not."""
    evaluation = evaluation_points(ms.catalog.make("four_bar"), speed=2.0)
    values = values_of_function(formula, evaluation, "formula")
    return agreement(evaluation, values, "formula", diagnose=False).passed


def require_understood(name, dimension):
    length = getattr(ms.catalog.make("four_bar"), dimension)
    moved = value(name, **{dimension: 1.01 * length})
    table = ms.sensitivity("four_bar", name, dimension, angles=ANGLES, speed=2.0)
    (column,) = table.values
    np.testing.assert_allclose(table.values[column], value(name), rtol=1e-12)
    ahead, behind = (value(name, **{dimension: length * (1.0 + sign * STEP)}) for sign in (1.0, -1.0))
    gradient = (ahead - behind) / (2.0 * STEP * length)
    np.testing.assert_allclose(
        table.by[dimension][column], gradient, rtol=1e-6, atol=1e-6 * np.abs(gradient).max()
    )
    measure = f"at:0.3rad:{name}"
    swept = ms.sweep("four_bar", {dimension: [length, 1.01 * length]}, measure=[measure], speed=2.0)
    difference = swept[measure].values - [value(name)[0], moved[0]]
    np.testing.assert_allclose(
        difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi)), 0.0, atol=1e-9
    )
    subject = ms.moved("four_bar", angles=ANGLES, speed=2.0)
    fitted = ms.fit(subject, {"angle": ANGLES, column: moved}, [dimension])
    assert fitted.values[dimension] == pytest.approx(1.01 * length, rel=1e-9)
    assert agrees(lambda angle: {name: value(name, angle)})
    assert not agrees(lambda angle: {name: 1.001 * value(name, angle)})


@pytest.mark.long
@pytest.mark.parametrize(("name", "dimension"), DEPENDS_ON.items())
def test_every_study_accepts_every_quantity(name, dimension):
    require_understood(name, dimension)


@pytest.mark.long
def test_every_study_accepts_a_new_quantity(monkeypatch):
    def height(mechanism, point):
        return [Column(f"{point}.y", "m", "point", point)], lambda values: values[0] + 1.0, "m"

    with pytest.raises(ms.InputError, match="has no quantity 'height:B'"):
        quantity("height:B", ms.catalog.make("four_bar").mechanism)
    monkeypatch.setitem(KINDS, "height", QuantityKind("height", word="height", derive=height))
    require_understood("height:B", "crank")


def test_force_quantities_have_names_and_tolerances():
    solver = ms.catalog.make("four_bar")
    study = ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver), ANGLES, 2.0)
    columns = dict(study.columns())
    assert effort_units().keys() <= columns.keys()
    units = {row.unit for row in FORCES}
    for name, unit in effort_units().items():
        assert quantity(name, solver.mechanism).unit == unit
        assert unit in units or name not in vars(type(study.forces))
    assert agrees(lambda angle: {"kinetic": energy(solver, angle)})
    assert not agrees(lambda angle: {"kinetic": 1.001 * energy(solver, angle)})


def energy(solver, angle):
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver), angle, 2.0).forces.kinetic


def test_columns_of_motions_and_forces_are_quantities():
    solver = ms.catalog.make("rssr")
    study = ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver), ANGLES, 2.0)
    skipped = {"t", "angle", "speed", "acceleration"}
    for record in (solver.solve(ANGLES, 2.0), study):
        for name, column in record.columns():
            if name not in skipped:
                item = quantity(name, solver.mechanism)
                np.testing.assert_array_equal(item.number(dict(record.columns())), column)
                assert [scalar.name for scalar in item.scalars()] == [name]


def test_a_vector_expands_to_its_components():
    mechanism = ms.catalog.make("rssr").mechanism
    names = [item.name for item in scalar_quantities(["P3.v", "force:P3", "rocker"], mechanism)]
    assert names == ["P3.vx", "P3.vy", "P3.vz", "P3.fx", "P3.fy", "P3.fz", "rocker.q"]


def test_commas_inside_names_and_brackets_do_not_separate_names():
    text = "rocker,distance:A,B,expr:atan2(B.y, B.x)*angle:crank,rocker,P3.x"
    names = ("rocker", "distance:A,B", "expr:atan2(B.y, B.x)*angle:crank,rocker", "P3.x")
    assert quantity_names(text) == names


def test_a_distance_from_a_fixed_point_is_a_quantity_but_its_position_is_not():
    solver = ms.catalog.make("four_bar")
    points = {**solver.mechanism.points, "O": ("ground", (0.0, 0.0, 0.0)), "O4": ("ground", (0.1, 0.0, 0.0))}
    mechanism = replace(solver.mechanism, points=points)
    motion = solver.solve(ANGLES)
    for name in ("distance:A,O", "distance:O,A"):
        length = quantity(name, mechanism)
        assert length.number(record_columns(motion, [length])) == pytest.approx(0.032, abs=1e-15)
    for name, message in {
        "O.x": "is a fixed point of the frame",
        "speed:O": "is a fixed point of the frame",
        "distance:O,O4": "is constant",
    }.items():
        with pytest.raises(ms.InputError, match=message):
            quantity(name, mechanism)


def test_expressions_have_the_unit_of_their_operands():
    mechanism = ms.catalog.make("four_bar").mechanism
    units = {
        "expr:A.vx*B.x": "m2 s-1",
        "expr:A.vx/B.x*rocker": "rad/s",
        "expr:force:A*distance:A,B": "N m",
        "expr:torque*rocker.v": "W",
        "expr:atan2(B.y, B.x)": "rad",
        "expr:max(A.x, B.x) - min(A.x, B.x)": "m",
    }
    assert {name: quantity(name, mechanism).unit for name in units} == units


def test_measured_tables_use_the_same_names():
    solver = ms.catalog.make("four_bar")
    table = {"angle": ANGLES, "distance:A,B [mm]": 1e3 * value("distance:A,B")}
    np.testing.assert_allclose(measured_of(table, solver).values["distance:A,B"], value("distance:A,B"))
