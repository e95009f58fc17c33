"""Joint ranges apply in every method: a start outside its range is rejected with the same message."""

import numpy as np
import pytest
from model_files import changed_model

import mechsim as ms
from mechsim.io.driver_positions import poses_of_table

ARM = "joint_ranges_arm.xml"


def arm(value, *changes):
    return ms.load(changed_model(ARM, *changes), drive={"crank": "0.3*sin(t)"}, lock={"wrist": value})


def prescribed(solver):
    model = ms.dynamics.dynamic_model(solver, solver.forces)
    return ms.dynamics.prescribed(model, t=np.linspace(0.0, 1.0, 5))


ROUTES = {
    "solved": lambda solver: solver.solve(t=np.linspace(0.0, 1.0, 5)),
    "row by row": lambda solver: poses_of_table(solver, {"crank": np.array([0.0, 0.1])}, "rows.csv"),
    "posed": lambda solver: ms.simulate(solver, method="pose"),
    "stepped": lambda solver: ms.simulate(solver, method="step"),
    "inverse dynamics": prescribed,
}


@pytest.mark.long
@pytest.mark.parametrize("route", ROUTES)
def test_a_start_outside_a_range_is_rejected_by_every_method(route):
    with pytest.raises(ms.AssemblyError, match=r"joint 'wrist' would be at 0\.1 rad, .* of 0\.2 to 1, at "):
        ROUTES[route](arm("0.1rad"))
    ROUTES[route](arm("0.3rad"))
    ROUTES[route](arm("0.1rad", ("<worldbody>", '<option><flag limit="disable"/></option><worldbody>')))


def test_poses_report_floating_bodies():
    floating = '<body name="load" pos="1 0 0"><freejoint/><geom size="0.01"/></body></worldbody>'
    options = {"drive": "crank", "speed": 1.0, "turns": 0.1, "lock": {"wrist": 0.3}, "method": "pose"}
    note = ms.simulate(changed_model(ARM, ("</worldbody>", floating)), **options).note
    assert "load floats independently of the drivers, so poses do not determine it: it stays" in note
    assert "--fix-base" in note
    assert ms.simulate(changed_model(ARM), **options).note == ""


def parallelogram(joint, low, high, **options):
    """Return a parallelogram whose rocker turns as its crank does, one joint of it with a range."""
    free = f'name="{joint}" axis="0 0 1"'
    limited = (free, f'{free} limited="true" range="{low} {high}"')
    return ms.load(changed_model("joint_ranges_four_bar.xml", limited), key="up", **options)


SAMPLED_ROUTES = {
    "solved": lambda solver: solver.solve(t=np.linspace(0.0, 0.9, 3)),
    "posed": lambda solver: ms.simulate(solver, method="pose", samples=2),
    "stepped": lambda solver: ms.simulate(solver, method="step", samples=2),
}


@pytest.mark.long
@pytest.mark.parametrize("route", SAMPLED_ROUTES)
@pytest.mark.parametrize("joint", ["crank", "rocker"])
def test_ranges_are_checked_between_samples_by_every_method(route, joint):
    # largest at 0.5 s, which is no sample of three
    law, limit = {"drive": {"crank": "0.4 + 0.2*(1-cos(2*pi*t))"}, "duration": "0.9s"}, 0.8
    with pytest.raises(ms.AssemblyError, match=rf"joint '{joint}' would be at 0\.8 rad, .* at 0\.5 s"):
        SAMPLED_ROUTES[route](parallelogram(joint, 0.1, limit - 1e-6, **law))
    SAMPLED_ROUTES[route](parallelogram(joint, 0.1, limit + 1e-9, **law))


def test_rows_of_driver_coordinates_are_independent_poses():
    solver = parallelogram("rocker", 0.1, 0.85)
    assert len(poses_of_table(solver, {"crank": np.array([0.2, 0.8])}, "rows.csv")) == 2
    with pytest.raises(ms.AssemblyError, match=r"joint 'rocker' would be at 0\.9 rad"):
        poses_of_table(solver, {"crank": np.array([0.2, 0.9])}, "rows.csv")
