"""Runs under friction by the load: closed forms, equations by hand, and MuJoCo."""

import json
from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

import mechsim as ms
from mechsim.kinetics.compiled_model import NotCompiledError
from mechsim.kinetics.contacts import ContactMode, Contacts
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.equations_of_motion import equations_of_motion
from mechsim.mechanism.motors import ConstantTorque
from mechsim.studies.dynamics_check import crosscheck_forward

G = 9.81
PRESS = model_text("friction_in_motion_press.toml")


def test_a_block_on_an_incline_slides_up_and_down_again(file):
    run = ms.dynamics.run(
        file(model_text("friction_in_motion_incline.toml", friction="coefficient = 0.3")),
        initial={"slide.v": 2.0},
        duration=1.0,
        samples=10,
    )
    up, down = G * (0.6 + 0.3 * 0.8), G * (0.6 - 0.3 * 0.8)
    reversal = 2.0 / up
    expected = 2.0 * reversal - up * reversal**2 / 2.0 - down * (1.0 - reversal) ** 2 / 2.0
    assert run.events == pytest.approx([reversal], rel=1e-12)
    assert run.motion.joints["slide"].value[-1] == pytest.approx(expected, rel=1e-12)
    assert run.energy_error <= 1e-12


def test_a_block_at_rest_keeps_its_friction_while_another_one_slides(file):
    run = ms.dynamics.run(file(model_text("friction_in_motion_blocks.toml")), duration=1.0, samples=4)
    # the second one starts where the force 20 t reaches its friction
    friction = 0.3 * 3.0 * G
    start = friction / 20.0
    assert run.motion.joints["a"].value[-1] == pytest.approx((10.0 - 0.2 * 2.0 * G) / 4.0, rel=1e-12)
    assert run.motion.joints["b"].value[-1] == pytest.approx(20.0 * (1.0 - start) ** 3 / 18.0, rel=1e-9)
    assert run.events == pytest.approx([start], rel=1e-9)


@pytest.mark.parametrize(("motion", "prescribed"), [("{}", []), ("{} + 3*t**2", ["crank"])])
def test_a_slide_at_its_dead_centre_has_friction_as_soon_as_it_moves(motion, prescribed, file):
    motor = ms.Forces() if prescribed else ms.Forces(motor=ConstantTorque(1.0))

    def run(start):
        press = ms.load(file(PRESS), drive={"crank": motion.format(start)} if prescribed else None)
        model = ms.dynamics.dynamic_model(press, replace(motor, friction=press.forces.friction))
        initial = {} if prescribed else {"crank.q": start}
        arguments = {"prescribed": prescribed, "initial": initial, "duration": 0.1, "samples": 4}
        return ms.dynamics.run(model, **arguments), model, initial_values(model, initial)

    first, model, initial = run(0.0)
    assert first.lost[-1] == pytest.approx(run(1e-7)[0].lost[-1], rel=1e-4)
    if not prescribed:
        assert crosscheck_forward(first, model, initial).passed


@pytest.mark.parametrize(("mu", "outcome"), [(0.7501, "stopped"), (0.7499, "done")])
def test_a_block_holds_above_the_angle_of_friction(mu, outcome, file):
    run = ms.dynamics.run(
        file(model_text("friction_in_motion_incline.toml", friction=f"coefficient = {mu}")),
        initial={"slide.v": 2.0},
        duration=1.0,
        samples=4,
    )
    assert run.outcome == outcome


@pytest.mark.parametrize(("beyond", "outcome"), [(0.05, "stopped"), (-0.05, "done")])
def test_friction_holds_a_ladder(beyond, outcome, file):
    # tan of the least angle: (1 - mu_floor mu_wall) / (2 mu_floor)
    angle = np.rad2deg(np.arctan((1.0 - 0.4 * 0.3) / 0.8)) + beyond
    # the ladder points from its foot to the wall on the left
    x, y = 2.0 * np.cos(np.deg2rad(angle)), 2.0 * np.sin(np.deg2rad(angle))
    text = model_text("friction_in_motion_ladder.toml", x=x, y=y, angle=180.0 - angle)
    run = ms.dynamics.run(file(text), duration=0.1, samples=4)
    assert run.outcome == outcome, run.reason


def test_a_ladder_that_friction_jams_ends_with_that_outcome(file, mechsim):
    text = model_text("friction_in_motion_ladder.toml", x=1.2, y=1.6, angle=np.rad2deg(np.arctan2(1.6, -1.2)))
    path = file(text.replace("0.4 }", "1.5 }").replace("0.3 }", "1.5 }"))
    arguments = ["--initial", "floor.v=-0.5", "--duration", "0.1s", "--json"]
    with np.errstate(all="ignore"):
        answer = mechsim("dynamics", "forward", path, *arguments)
    assert answer.code == 1
    assert json.loads(answer.out)["outcome"] == "jammed"


@pytest.mark.long
@pytest.mark.parametrize("lead", [6.0, 60.0])
def test_a_screw_locks_itself_or_runs_down(lead, file):
    run = ms.dynamics.run(
        file(model_text("friction_in_motion_screw.toml", lead=lead)), duration=0.5, samples=4
    )
    r, mu, mass, inertia = 9e-3, 0.12, 100.0, 0.02
    tangent = lead * 1e-3 / (2 * np.pi * r)
    if tangent <= mu:
        assert run.outcome == "stopped"
        return
    # axial force F of the thread: F - m g = -m r a tan, and F r (tan - mu) / (1 + mu tan) = I a
    share = r * (tangent - mu) / (1.0 + mu * tangent)
    turning = mass * G * share / (inertia + mass * r * tangent * share)
    assert run.motion.joints["thread.turn"].rate[-1] == pytest.approx(-0.5 * turning, rel=1e-11)


STRIBECK = 'coefficient = 0.3, static = 0.5, stribeck = "0.3 m/s", coulomb = "0.4 N", viscous = 0.2'


def stribeck_by_hand(rate):
    return (0.3 * 2.0 * G * 0.8 + 0.4) * (1.0 + (0.5 / 0.3 - 1.0) * np.exp(-((rate / 0.3) ** 2)))


def test_a_block_slides_under_friction_by_the_curve_of_stribeck(file):
    path = file(model_text("friction_in_motion_incline.toml", friction=STRIBECK))
    run = ms.dynamics.run(path, initial={"slide.v": 2.0}, duration=1.0, samples=4)

    def stops(_, state):
        return state[1]

    stops.terminal = True
    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    up = solve_ivp(
        lambda _, y: [y[1], -G * 0.6 - 0.5 * (stribeck_by_hand(y[1]) + 0.2 * y[1])],
        (0.0, 1.0),
        [0.0, 2.0],
        events=[stops],
        **settings,
    )
    down = solve_ivp(
        lambda _, y: [y[1], -G * 0.6 + 0.5 * (stribeck_by_hand(y[1]) - 0.2 * y[1])],
        (up.t[-1], 1.0),
        [up.y[0, -1], 0.0],
        **settings,
    )
    slide = run.motion.joints["slide"]
    assert run.events == pytest.approx([up.t[-1]], rel=1e-11)
    assert [slide.value[-1], slide.rate[-1]] == pytest.approx(down.y[:, -1], rel=1e-10)
    assert run.energy_error <= 1e-12


@pytest.mark.parametrize(("static", "outcome"), [(0.751, "stopped"), (0.749, "done")])
def test_static_friction_holds_what_slides_with_less(static, outcome, file):
    text = model_text("friction_in_motion_incline.toml", friction=f"coefficient = 0.3, static = {static}")
    run = ms.dynamics.run(file(text), initial={"slide.v": 2.0}, duration=1.0, samples=4)
    assert run.outcome == outcome


def test_mujoco_has_the_same_friction_by_rate(file):
    path = file(model_text("friction_in_motion_incline.toml", friction=STRIBECK))
    model = ms.dynamics.dynamic_model(ms.load(path))
    initial = {"slide.v": 2.0}
    run = ms.dynamics.run(path, initial=initial, duration=0.2, samples=4)
    verdict = crosscheck_forward(run, model, initial_values(model, initial))
    assert verdict.passed, verdict
    other = replace(model.forces.friction[0], stribeck=0.35)
    wrong = model.with_forces(replace(model.forces, friction=(other,)))
    assert not crosscheck_forward(run, wrong, initial_values(model, initial)).passed


@pytest.mark.parametrize("lead", [6.0, 60.0])
def test_a_screw_holds_between_the_torques_that_lower_and_raise_the_load(lead, file):
    text = model_text("friction_in_motion_screw.toml", lead=lead).replace(
        "[joints", 'drivers = ["thread.turn"]\n[joints', 1
    )
    (limits,) = ms.dynamics.holding_range(ms.load(file(text))).values()
    r, mu, load = 9e-3, 0.12, 981.0
    tangent = lead * 1e-3 / (2 * np.pi * r)
    lowering, raising = ((tangent + s * mu) / (1.0 - s * mu * tangent) for s in (-1.0, 1.0))
    assert limits == pytest.approx((load * r * lowering, load * r * raising), rel=1e-12)
    assert (limits[0] <= 0.0) == (tangent <= mu)


def test_static_friction_widens_the_range_of_forces_that_hold(file):
    text = model_text(
        "friction_in_motion_incline.toml", friction='coefficient = 0.3, static = 0.5, stribeck = "1 m/s"'
    ).replace("[joints", 'drivers = ["slide"]\n[joints', 1)
    (limits,) = ms.dynamics.holding_range(ms.load(file(text))).values()
    assert limits == pytest.approx((2.0 * G * (0.6 - 0.5 * 0.8), 2.0 * G * (0.6 + 0.5 * 0.8)), rel=1e-12)


def test_a_released_slider_crank_needs_no_drive_torque(file):
    path = file(PRESS)
    run = ms.dynamics.run(path, initial={"crank.q": 0.3, "crank.v": 25.0}, duration=0.12, samples=40)
    motion, model = run.motion, ms.dynamics.dynamic_model(ms.load(path))
    forces = ms.dynamics.prescribed(model, motion.angle, motion.speed, motion.acceleration).forces
    # the torque of a prescribed motion is that by hand in test_load_friction
    assert np.abs(forces.torque * motion.speed).max() <= 1e-9 * forces.power_lost.max()
    assert len(run.events) == 1
    assert run.energy_error <= 1e-11
    assert run.executed == "C"


PIN = {"coefficient": 0.15, "pin_radius": 4e-3}
OTHERS = {
    "four_bar": (
        ms.Forces(
            friction=tuple(ms.Friction(name, **PIN) for name in ("crank", "A", "B", "rocker")),
            motor=ConstantTorque(0.05),
            flywheel=1e-4,
        ),
        {"crank.v": 20.0},
    ),
    "rrsrr": (ms.Forces(friction=(ms.Friction("S", **PIN),)), {"crank.v": 40.0}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_runs_under_friction_by_the_load_agree_with_mujoco(name):
    forces, initial = OTHERS[name]
    model = ms.dynamics.dynamic_model(ms.catalog.make(name), forces)
    run = ms.dynamics.run(model, initial=initial, duration=0.03, samples=12)
    assert run.energy_error <= 1e-12
    verdict = crosscheck_forward(run, model, initial_values(model, initial))
    assert verdict.passed, verdict
    other = tuple(replace(friction, coefficient=0.16) for friction in forces.friction)
    wrong = model.with_forces(replace(forces, friction=other))
    assert not crosscheck_forward(run, wrong, initial_values(wrong, initial)).passed


def ladder(file, floor, wall):
    text = model_text("friction_in_motion_ladder.toml", x=1.2, y=1.6, angle=np.rad2deg(np.arctan2(1.6, -1.2)))
    return file(text.replace("0.4 }", f"{floor} }}").replace("0.3 }", f"{wall} }}"))


def sliding_ladder(angle, rate, floor, wall):
    """Return angular accelerations of all signs of both normal forces for which a load that is off decays."""
    c, s = np.cos(angle), np.sin(angle)
    along = np.array([np.sign(s * rate), -np.sign(c * rate)])
    # 10 kg at the middle, 3 kg m2, unknown angular acceleration and normal forces
    free = np.array([[-10.0 * s, 0.0, -1.0], [10.0 * c, -1.0, 0.0], [-3.0, -c, s]])
    frictions = np.array([[1.0, 0.0], [0.0, 1.0], [s, -c]]) * along
    driving = 10.0 * np.array([c * rate**2, s * rate**2 - 9.81, 0.0])
    result = []
    for signs in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]):
        loads = np.diag(signs * np.array([floor, wall])) @ np.eye(3)[1:]
        solution = np.linalg.solve(free - frictions @ loads, driving)
        growth = np.linalg.eigvals(loads @ np.linalg.solve(free, frictions)).real.max()
        if (signs * solution[1:] >= 0.0).all() and growth < 1.0:
            result.append(solution[0])
    return result


@pytest.mark.long
@pytest.mark.parametrize(("floor", "wall"), [(1.2, 1.2), (0.5, 3.0)])
def test_frictions_whose_loads_grow_slide_while_one_stable_solution_balances_them(floor, wall, file):
    """Normal forces change their sign within steps: an error of 6e-9 m, which grows to 8e-8 m."""
    start, rate = np.arctan2(1.6, 1.2), 3.75

    def motion(t, state):
        (acceleration,) = sliding_ladder(*state, floor, wall)
        return state[1], acceleration

    model = ms.dynamics.dynamic_model(ms.load(ladder(file, floor, wall), still=True))
    initial = {"floor.q": 1.2, "floor.v": -6.0}
    run = ms.dynamics.run(model, initial=initial, duration=0.1, samples=10)
    exact = solve_ivp(
        motion, (0.0, 0.1), (start, rate), t_eval=run.time, rtol=1e-10, atol=1e-12, max_step=1e-3
    )
    assert run.motion.joints["floor"].value == pytest.approx(2.0 * np.cos(exact.y[0]), abs=2e-7)
    assert run.energy_error <= 1e-11
    verdict = crosscheck_forward(run, model, initial_values(model, initial))
    assert verdict.passed, verdict


@pytest.mark.long
def test_a_run_ends_with_its_record_where_friction_jams_the_motion(file):
    with np.errstate(all="ignore"):
        run = ms.dynamics.run(
            ladder(file, 0.5, 3.0), initial={"floor.q": 1.2, "floor.v": -6.0}, duration=0.6, samples=20
        )
    assert run.outcome == "jammed"
    assert len(run.time) == 21
    assert run.energy_error <= 1e-11
    # the motion has a stable solution until there, and none right after
    angle = np.arccos(run.motion.joints["floor"].value[-1] / 2.0)
    rate = run.motion.joints["floor"].rate[-1] / (-2.0 * np.sin(angle))
    assert len(sliding_ladder(angle - 1e-6, rate, 0.5, 3.0)) == 1
    assert not sliding_ladder(angle + 1e-6, rate, 0.5, 3.0)


@pytest.mark.parametrize("seed", range(4))
def test_joints_at_rest_start_to_slide_by_the_principle_of_gauss(seed, file):
    """An arm at rest: accelerations a minimise (a - f)' M (a - f) / 2 + sum of T_i |a_i|, by scipy."""
    limits = np.random.default_rng(seed).uniform(0.2, 3.0, 5) * np.array([5.0, 3.0, 2.0, 1.0, 0.4])
    links = "".join(
        f'<body name="l{i}" pos="{0.2 if i else 0} 0 0">'
        f'<joint name="J{i}" axis="0 1 0" frictionloss="{limit}"/>'
        '<inertial mass="0.5" pos="0.1 0 0" diaginertia="1e-4 2e-3 2e-3"/>'
        for i, limit in enumerate(limits)
    )
    arm = file(f"<mujoco><worldbody>{links}{'</body>' * 5}</worldbody></mujoco>")
    equations = equations_of_motion(ms.dynamics.dynamic_model(ms.load(arm, still=True)))
    contacts = Contacts(equations)
    state = equations.kinematics(equations.start, np.zeros((5, 1)))
    mode = contacts.choose(state, 0.0, 0.0)
    result = contacts.accelerate(state, np.zeros(1), mode).acceleration[:, 0]
    free = contacts.accelerate(state, np.zeros(1), ContactMode(np.zeros(5))).acceleration[:, 0]
    mass = state.mass[0]

    def smooth(split):
        apart = split[:5] - split[5:] - free
        gradient = mass @ apart
        return apart @ gradient / 2 + limits @ (split[:5] + split[5:]), np.concatenate(
            [gradient + limits, limits - gradient]
        )

    best = minimize(
        smooth, np.zeros(10), jac=True, bounds=[(0, None)] * 10, options={"ftol": 1e-16, "gtol": 1e-12}
    )
    expected = best.x[:5] - best.x[5:]
    assert result == pytest.approx(expected, abs=1e-4 * np.abs(free).max())
    assert len(mode.stuck) not in (0, 5)


CLAMP = model_text("latch_clamp.toml")


@pytest.mark.parametrize("compiled", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_clamp_reverses_within_the_narrow_curve_of_stribeck(compiled, file, monkeypatch):
    if not compiled:
        monkeypatch.setattr("mechsim.kinetics.forward_dynamics.compiled_model", not_compiled)
    clamp = ms.load(file(CLAMP), still=True)
    run = ms.dynamics.run(clamp, initial={"handle.q": "119.1deg"}, duration="0.08s")
    assert run.executed == ("C" if compiled else "numpy")
    # by Newton's and Euler's equations of three bodies with all reactions, DOP853 at 1e-12, steps of 10 us
    assert np.allclose(run.events, [0.030469177301622, 0.060230287316856], rtol=0, atol=1e-12)
    assert run.energy_error < 1e-11


def not_compiled(equations):
    raise NotCompiledError("this model")


@pytest.mark.long
@pytest.mark.parametrize(("rate", "limit"), [(20.0, -54.40443208683846), (-20.0, -65.79561640577958)])
def test_a_clamp_breaks_away_where_friction_at_rest_cannot_hold_it(rate, limit, file):
    # the limit is the force at which the accelerations of the same equations vanish at 134 degrees
    clamp = ms.load(file(CLAMP.replace('"-60 N"', f'"-60 N + {rate} N*t"')), still=True)
    run = ms.dynamics.run(clamp, initial={"handle.q": "134deg"}, duration="0.35s")
    assert abs(run.events[0] - (limit + 60.0) / rate) < 1e-9
