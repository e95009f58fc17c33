"""Points on curves in TOML files, against closed forms."""

import numpy as np
import pytest
from model_files import FOLDER, load_model
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import fsolve

import mechsim as ms
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinetics import dynamic_model, prescribed
from mechsim.simulation.dynamics.forward_run import stepped_run

# a slider block on the ellipse (0.3 + 0.05 cos s, 0.2 sin s), whose rod is driven by a crank or by s
RAIL, BEAD = "toml_curves_model.toml", "toml_curves_bead.toml"
TIMES = np.linspace(0.0, 1.0, 41)


@pytest.mark.long
def test_a_point_follows_its_curve_with_a_force_normal_to_it():
    model = load_model(RAIL, curve="ellipse")
    point = model.solve(t=TIMES).points["P"]
    w, s = 2 * np.pi, 0.5 + 0.3 * np.sin(2 * np.pi * TIMES)
    v, a = 0.3 * w * np.cos(w * TIMES), -0.3 * w**2 * np.sin(w * TIMES)
    zero = np.zeros(41)
    first, second = (
        np.stack([-0.05 * np.sin(s), 0.2 * np.cos(s), zero], 1),
        np.stack([-0.05 * np.cos(s), -0.2 * np.sin(s), zero], 1),
    )
    exact = np.stack([0.3 + 0.05 * np.cos(s), 0.2 * np.sin(s), zero], 1)
    assert np.abs(point.position - exact).max() < 1e-14
    assert np.abs(point.velocity - first * v[:, None]).max() < 1e-12
    assert np.abs(point.acceleration - first * a[:, None] - second * v[:, None] ** 2).max() < 1e-11
    result = prescribed(dynamic_model(model), t=TIMES)
    force = result.forces.reactions["rail.point"].force
    # the drive of s does the work of the tangential force
    driving = result.forces.drives["rail"]
    assert np.abs((force * first).sum(1) - driving).max() < 1e-10 * np.abs(driving).max()
    assert ms.validate(model).passed


@pytest.mark.long
@pytest.mark.parametrize("side", ["outside", "inside"])
def test_the_centre_of_a_roller_follows_the_offset_curve(side):
    roller = f'kind = "curve"\nroller = "6 mm"\nside = "{side}"'
    closed = ('y = "', 'closed = true\ny = "')
    model = load_model(RAIL, ('kind = "curve"', roller), closed, curve="ellipse")
    point = model.solve(t=TIMES).points["P"]

    def centre(t):
        s = 0.5 + 0.3 * np.sin(2 * np.pi * t)
        normal = np.stack([0.2 * np.cos(s), 0.05 * np.sin(s)])
        distance = 0.006 if side == "outside" else -0.006
        along = np.sqrt((normal**2).sum(0))
        return np.stack([0.3 + 0.05 * np.cos(s), 0.2 * np.sin(s)]) + distance * normal / along

    assert np.abs(point.position[:, :2].T - centre(TIMES)).max() < 1e-14
    velocity = centre(TIMES + 1e-30j).imag / 1e-30
    assert np.abs(point.velocity[:, :2].T - velocity).max() < 1e-12
    if side == "outside":
        assert ms.validate(model).passed


def test_a_point_follows_a_periodic_spline_through_a_table(tmp_path):
    s = np.linspace(0.0, 2 * np.pi, 25)
    points = np.stack([0.3 + 0.05 * np.cos(s), 0.2 * np.sin(s)], 1)
    points[-1] = points[0]
    table = "\n".join(",".join(f"{entry:.17g}" for entry in row) for row in np.column_stack([s, points]))
    (tmp_path / "rail.csv").write_text(f"s,x,y\n{table}\n")
    table = f'table = "{tmp_path / "rail.csv"}"\nclosed = true'
    model = load_model(RAIL, ('x = "0.3 + 0.05*cos(s)"\ny = "0.2*sin(s)"', table), curve="ellipse")
    spline = CubicSpline(s, points, bc_type="periodic")
    value, rate = 0.5 + 0.3 * np.sin(2 * np.pi * TIMES), 0.6 * np.pi * np.cos(2 * np.pi * TIMES)
    point = model.solve(t=TIMES).points["P"]
    assert np.abs(point.position[:, :2] - spline(value)).max() < 1e-14
    assert np.abs(point.velocity[:, :2] - spline(value, 1) * rate[:, None]).max() < 1e-12


@pytest.mark.long
def test_a_structure_finds_where_its_arm_meets_the_curve():
    s = start_poses(load_model("toml_curves_structure.toml", still=True).mechanism)[1]["rail"]
    assert abs(np.hypot(0.3 + 0.05 * np.cos(s), 0.2 * np.sin(s)) - 0.3) < 1e-13


EXACTLY = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}


def bead_falls(_, state):
    # c'.c' s'' = c'.(g - c'' s'^2)
    s, v = state
    first = np.array([-0.2 * np.sin(s), 0.1 * np.cos(s), 0.04 * np.cos(2 * s)])
    second = np.array([-0.2 * np.cos(s), -0.1 * np.sin(s), -0.08 * np.sin(2 * s)])
    return v, first @ (np.array([0.0, -9.81, 0.0]) - second * v**2) / (first @ first)


@pytest.mark.long
def test_a_bead_slides_along_a_spatial_wire_as_an_independent_integration():
    model = load_model(BEAD, still=True)
    run = ms.dynamics.run(model, initial={"rail.q": 0.3}, duration=1.0, samples=10)
    exact = solve_ivp(bead_falls, (0, 1), [0.3, 0.0], t_eval=run.time, **EXACTLY)
    assert np.abs(run.motion.joints["rail"].value - exact.y[0]).max() < 1e-11
    assert run.energy_error < 1e-11
    # constraints that yielded by the inverse of negligible masses gave 3e-2 in MuJoCo
    released = dynamic_model(model)
    times = run.time[:2]
    stepped = stepped_run(released.mechanism, released.forces, {"rail": 0.3}, {"rail": 0.0}, times, 40)
    assert abs(stepped.motion.joints["rail"].value[-1] - exact.y[0, 1]) < 1e-9


@pytest.mark.long
def test_a_bead_bounces_at_the_end_of_its_wire_as_an_independent_integration():
    ranged = ("[curves.wire]\n", "[curves.wire]\nrange = [-0.4, 0.9]\n")
    end = lambda _, state: state[0] + 0.4  # noqa: E731
    end.terminal, end.direction = True, -1
    before = solve_ivp(bead_falls, (0, 1), [0.3, 0.0], events=end, **EXACTLY)
    impact = before.t_events[0][0]
    last = impact + 0.03
    after = solve_ivp(bead_falls, (impact, last), [-0.4, -0.6 * before.y_events[0][0, 1]], **EXACTLY)
    limits = 'limits = { lower = "-0.4 m", upper = 0.9, restitution = 0.6 }'
    model = load_model(BEAD, ranged, more=limits, still=True)
    run = ms.dynamics.run(model, initial={"rail.q": 0.3}, duration=last, samples=10)
    assert run.events == pytest.approx([impact], abs=1e-11)
    assert run.motion.joints["rail"].value[-1] == pytest.approx(after.y[0, -1], abs=1e-10)
    # without limits of its own, the point stops at the ends of the curve
    assert load_model(BEAD, ranged, still=True).ranges == {"rail": (-0.4, 0.9)}


@pytest.mark.long
def test_a_window_on_a_rail_of_the_frame_stops_at_its_end():
    model = ms.load(str(FOLDER / "window_regulator.toml"))
    run = ms.dynamics.run(model, duration=0.3)

    def gaps(values):
        # the guide is 0.15 m from the slot at s = 0; the pin is level with the point 0.05 m along the glass
        s, arm = values
        guide = np.array([0.02 * np.sin(np.pi * s / 0.6), s])
        pin = np.array([0.25 - 0.3 * np.cos(arm), 0.2 - 0.3 * np.sin(arm)])
        return guide @ guide - 0.15**2, pin @ guide / 0.15 - 0.05

    arm = fsolve(gaps, [0.15, 0.5], xtol=1e-14)[1]
    assert run.outcome == "stopped"
    assert run.motion.joints["arm"].value[-1] == pytest.approx(arm, abs=1e-12)
    # the frame carries the rail: the force of the glass on it is normal to the curve
    study = prescribed(dynamic_model(model), [0.1, 0.3], 1.0)
    s = model.solve([0.1, 0.3]).joints["slot"].value
    tangent = np.stack([0.02 * np.pi / 0.6 * np.cos(np.pi * s / 0.6), np.ones(2)], 1)
    force = study.forces.reactions["slot.point"].force[:, :2]
    assert np.abs((force * tangent).sum(1)).max() < 1e-11 * np.abs(force).max()


@pytest.mark.long
def test_a_bar_on_a_closed_rail_returns_after_a_round():
    # whose parameter has then increased by its period: both ends of the bar on one ellipse
    model = ms.load(str(FOLDER / "toml_curves_shuttle.toml"))
    trace = ms.trace(model, starts=20)
    assert [curve.turns for curve in trace.curves] == [1, 1]
    # a bar of 0.1 m within an ellipse of the half axes 0.3 and 0.2 m: its middle is highest where it is level
    highest = 0.2 * np.sqrt(1.0 - (0.05 / 0.3) ** 2)
    assert abs(max(curve.samples(721).points["P"][:, 1].max() for curve in trace.curves) - highest) < 1e-4
    assert len(ms.dynamics.equilibria(model)) == 2
