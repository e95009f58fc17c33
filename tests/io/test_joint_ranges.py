"""Joint ranges apply in every method: a start outside its range is rejected with the same message."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.io.driver_positions import poses_of_table

ARM = model_text("joint_ranges_arm.xml")


@pytest.fixture
def arm(file):
    def made(value, text=ARM):
        path = file(text)
        return ms.load(path, drive={"crank": "0.3*sin(t)"}, lock={"wrist": value})

    return made


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
def test_a_start_outside_a_range_is_rejected_by_every_method(arm, route):
    with pytest.raises(ms.AssemblyError, match=r"joint 'wrist' would be at 0\.1 rad, .* of 0\.2 to 1, at "):
        ROUTES[route](arm("0.1rad"))
    ROUTES[route](arm("0.3rad"))
    disabled = ARM.replace("<worldbody>", '<option><flag limit="disable"/></option><worldbody>')
    ROUTES[route](arm("0.1rad", disabled))


def test_poses_report_floating_bodies(tmp_path):
    path = tmp_path / "load.xml"
    load_text = '<body name="load" pos="1 0 0"><freejoint/><geom size="0.01"/></body></worldbody>'
    path.write_text(ARM.replace("</worldbody>", load_text))
    run = ms.simulate(str(path), drive="crank", speed=1.0, turns=0.1, lock={"wrist": 0.3}, method="pose")
    assert "load floats independently of the drivers, so poses do not determine it: it stays" in run.note
    assert "--fix-base" in run.note
    path.write_text(ARM)
    run = ms.simulate(str(path), drive="crank", speed=1.0, turns=0.1, lock={"wrist": 0.3}, method="pose")
    assert run.note == ""


FOUR_BAR = model_text("joint_ranges_four_bar.xml")


def parallelogram(tmp_path, joint, low, high, **options):
    """Return a parallelogram whose rocker turns as its crank does, one joint of it with a range."""
    path = tmp_path / "bar.xml"
    limited = f'name="{joint}" axis="0 0 1" limited="true" range="{low} {high}"'
    path.write_text(FOUR_BAR.replace(f'name="{joint}" axis="0 0 1"', limited))
    return ms.load(str(path), key="up", **options)


SAMPLED_ROUTES = {
    "solved": lambda solver, samples: solver.solve(t=np.linspace(0.0, 0.9, samples)),
    "posed": lambda solver, samples: ms.simulate(solver, method="pose", samples=samples - 1),
    "stepped": lambda solver, samples: ms.simulate(solver, method="step", samples=samples - 1),
}


@pytest.mark.long
@pytest.mark.parametrize("route", SAMPLED_ROUTES)
@pytest.mark.parametrize("samples", [3])
@pytest.mark.parametrize("joint", ["crank", "rocker"])
def test_ranges_are_checked_between_samples_by_every_method(tmp_path, route, samples, joint):
    # largest at 0.5 s, which is no sample of three
    law, limit = "0.4 + 0.2*(1-cos(2*pi*t))", 0.8
    beyond = parallelogram(tmp_path, joint, 0.1, limit - 1e-6, drive={"crank": law}, duration="0.9s")
    with pytest.raises(ms.AssemblyError, match=rf"joint '{joint}' would be at 0\.8 rad, .* at 0\.5 s"):
        SAMPLED_ROUTES[route](beyond, samples)
    within = parallelogram(tmp_path, joint, 0.1, limit + 1e-9, drive={"crank": law}, duration="0.9s")
    SAMPLED_ROUTES[route](within, samples)


def test_rows_of_driver_coordinates_are_independent_poses(tmp_path):
    solver = parallelogram(tmp_path, "rocker", 0.1, 0.85)
    assert len(poses_of_table(solver, {"crank": np.array([0.2, 0.8])}, "rows.csv")) == 2
    with pytest.raises(ms.AssemblyError, match=r"joint 'rocker' would be at 0\.9 rad"):
        poses_of_table(solver, {"crank": np.array([0.2, 0.9])}, "rows.csv")
