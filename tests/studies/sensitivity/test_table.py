"""Tables of derivatives: names, units, omitted dimensions, rejected input."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.io import reference_data
from mechsim.io.readers import parametric_model
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.studies.sensitivity.moved_family import MovedFamily, spread_instants
from mechsim.studies.sensitivity.sensitivity import derivative_table

ANGLES = np.array([0.3, 1.7, 4.1])


def moved(model, speed=3.0, angles=ANGLES, **options):
    return MovedFamily(parametric_model(model, **options), angles, speed)


def test_a_table_has_a_column_per_quantity_and_dimension():
    table = derivative_table(moved("slider_crank"), ["B", "B.vx", "torque"], ["crank", "rod"])
    names = [name for name, _ in table.columns()]
    expected = ["B.x", "B.y", "B.z", "B.vx", "torque"]
    assert names == ["angle", *(f"{item}/{by}" for item in expected for by in ("crank", "rod"))]
    assert table.unit("torque", "crank") == "N m/m"
    assert table.unit("B.x", "crank") == "1"


def test_a_point_dimension_includes_its_components():
    mechanism = moved("rssr")
    assert list(derivative_table(mechanism, ["rocker"], ["pivot"]).by) == ["pivot.x", "pivot.y", "pivot.z"]
    assert {"crank", "gamma1", "pivot.z"} <= set(derivative_table(mechanism, ["rocker"]).by)


def test_dimensions_that_make_loops_inconsistent_are_omitted():
    mechanism = MovedFamily(
        parametric_model(KinematicSolver(ms.catalog.make("four_bar").mechanism)), ANGLES, 1.0
    )
    table = derivative_table(mechanism, ["rocker"])
    assert {"A.at.x", "B.at.y"} <= set(table.by)
    inconsistent = [name for name in table.left_out if name.endswith(".z")]
    assert inconsistent == list(table.left_out)
    with pytest.raises(ms.AssemblyError, match="makes redundant loop equations inconsistent"):
        derivative_table(mechanism, ["rocker"], ["A.a.at.z"])


def test_derivatives_under_motion_laws_are_tabulated_over_time():
    designs = parametric_model(
        "five_bar", drive={"left": "120deg+20deg*sin(2*pi*t)", "right": "60deg+20deg*sin(4*pi*t)"}
    )
    solver = designs.make({})
    table = derivative_table(MovedFamily(designs, spread_instants(solver)[::24], 1.0), ["left"], ["arm"])
    assert next(table.columns())[0] == "t"
    # a driver follows its motion law, independent of the arms
    assert not table.derivatives("left.q")["arm"].any()


def test_instants_of_a_swinging_crank_lie_between_its_dead_centres():
    solver = ms.catalog.make("four_bar", rocker=0.035)
    instants = spread_instants(solver)
    low, high = solver.crank_range().arcs[0]
    assert low < instants[0] < instants[-1] < high


def test_instants_avoid_change_points():
    designs = parametric_model(str(reference_data.folder() / "mechanisms/elliptic_trammel.toml"))
    instants = spread_instants(designs.make({}))
    assert len(instants) == 71
    assert np.abs(np.cos(instants)).min() > 1e-3
    assert derivative_table(MovedFamily(designs, instants[::10], 1.0), ["pen"]).by


def test_drive_torques_are_requested_by_the_driven_joint():
    result = derivative_table(moved("four_bar"), ["torque:crank"], ["rocker"])
    assert [*result.values] == ["torque"]
    with pytest.raises(ms.InputError, match="no quantity 'torque:rocker'"):
        derivative_table(moved("four_bar"), ["torque:rocker"])
