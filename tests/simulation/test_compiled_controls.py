"""MuJoCo's callbacks in C against those in Python: forces, and terms of the velocities in constraints."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.io.law_text import control_law
from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.coupling_functions import TabledFunction
from mechsim.mechanism.forces import Couple, Forces, Friction, JointSpring, Load
from mechsim.mechanism.joints import End
from mechsim.mechanism.load_profile import function, table
from mechsim.mechanism.motors import Controller, TorqueSpeedLine
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring, SoftStop, SpringLaw, diagonal
from mechsim.numerics import c_library
from mechsim.simulation import velocity_products
from mechsim.simulation.dynamics.applied_controls import AppliedControls, prepared
from mechsim.simulation.dynamics.forward_run import FREE, ITERATIONS, start_of
from mechsim.simulation.velocity_products import compiled_rows

ANGLES = np.linspace(0.0, 2.0 * np.pi, 9)
WAVES = np.stack([np.sin(ANGLES), np.cos(ANGLES), np.zeros(9)], 1)
TABLE = TabledFunction(
    "spring.csv", tuple(np.linspace(-9.0, 9.0, 9)), tuple(0.1 * np.linspace(-3.0, 3.0, 9) ** 3)
)
PEG = ("ground", (0.1, 0.2, 0.0))
SPREAD = diagonal(30.0, 20.0, 10.0, 0.3, 0.2, 0.1)
SKEWED = tuple(tuple(row) for row in np.array(SPREAD) + 0.05 * (np.ones((6, 6)) - np.eye(6)))
# kind of force -> forces on a four-bar, or on a spatial one
SPATIAL = ("couple", "bushing", "friction of a ball")
KINDS = {
    "controller": {"controllers": (Controller("crank", "-20*sin(crank.q)-2*rocker.v+cos(t)"),)},
    "load over angle": {"loads": (Load("C", table(ANGLES, WAVES)),)},
    "load over time": {"loads": (Load("C", table(ANGLES, WAVES, over="time", periodic=True)),)},
    "couple": {"couples": (Couple("coupler", table(ANGLES, WAVES, smooth=True)),)},
    "crank torque": {"crank_torque": table(ANGLES, WAVES[:, 0]), "motor": TorqueSpeedLine(2.0, 30.0)},
    "stop": {"nonlinear_springs": (NonlinearSpring("crank", SoftStop(-0.1, 1.0, 40.0, 0.3)),)},
    "stop of a cut joint": {"nonlinear_springs": (NonlinearSpring("B", SoftStop(9.0, -1.0, 4.0)),)},
    "spring by expression": {
        "nonlinear_springs": (NonlinearSpring(("C", PEG), SpringLaw(stiffness=5.0, text="3*l**2-v")),)
    },
    "spring by table": {
        "nonlinear_springs": (NonlinearSpring("rocker", SpringLaw(damping=0.1, table=TABLE)),)
    },
    "bushing": {"bushings": (Bushing("mount", End("ground"), End("coupler"), SKEWED, SPREAD),)},
    "friction of a ball": {"friction": (Friction("P2", coulomb=0.3),)},
    "actuator": {"actuators": (Actuator("motor", {"crank": 2.0}, control_law("3*sin(5*t)", "u")),)},
    "actuator with a state behind a spring": {
        "joint_springs": (JointSpring("crank", 0.1, 0.2),),
        "actuators": (
            Actuator("first", {"rocker": 1.0}, control_law("t", "u"), inflow=(1.0, -1.0, 0.0, 0.0)),
            Actuator(
                "dc",
                {"crank": 2.0, "rocker": -1.0},
                control_law("2+t", "u"),
                gain=(0.5, 0.1, 0.2),
                bias=(0.1, 0.2, 0.3),
                direct=(0.4, 0.5),
                inflow=(3.0, -2.0, 0.5, 0.6),
                start=0.4,
                control_range=(-3.0, 3.0),
                state_range=(-9.0, 9.0),
            ),
        ),
    },
}


def start_with(forces, mechanism="four_bar"):
    forces = Forces(gravity=(0.0, -9.81, 0.0), **forces)
    return start_of(ms.catalog.make(mechanism).mechanism, forces, {}, {"crank": 3.0})


def applied(start, *, in_python, time=0.3):
    """Return controls, forces and accelerations at a state, and the object that applies them."""
    controls = AppliedControls(start.model, prepared(start.model, FREE, 1e-3, ITERATIONS))
    if in_python:
        controls.compiled = None
    data, other = (mujoco.MjData(controls.loops.model) for _ in range(2))
    with controls.installed(data):
        for state in (data, other):
            state.qpos[:], state.qvel[:], state.time = start.qpos, start.qvel, time
            state.act[:] = start.activation
            mujoco.mj_forward(controls.loops.model, state)
    assert mujoco.get_mjcb_control() is None
    assert controls.executed == "Python" or not (other.ctrl.any() or other.qfrc_applied.any())
    return np.concatenate([data.ctrl, data.qfrc_applied, data.qacc]), controls


@pytest.mark.parametrize("kind", KINDS)
def test_every_force_is_the_same_in_c_and_in_python(kind):
    start = start_with(KINDS[kind], "rssr" if kind in SPATIAL else "four_bar")
    expected, controls = applied(start, in_python=True)
    assert controls.executed == "Python"
    result, controls = applied(start, in_python=False)
    assert controls.executed == "C"
    np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    forces = replace(start.model.forces, **{name: getattr(Forces(), name) for name in KINDS[kind]})
    without, _ = applied(replace(start, model=replace(start.model, forces=forces, dry=())), in_python=True)
    assert np.abs(without - result).max() > 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize(
    "model", ["machines/peaucellier_rods", "gallery/cam_follower", "gallery/geneva_drive"]
)
def test_rods_and_functions_are_the_same_in_c_and_in_python(model, monkeypatch):
    mechanism = ms.load(str(ms.catalog.models() / f"{model}.toml"), still=True).mechanism
    (driver,) = mechanism.drivers
    start = start_of(mechanism, Forces(), {driver: 0.3}, {driver: 2.0})
    results = []
    for rows in (compiled_rows, lambda _: None):
        monkeypatch.setattr(velocity_products, "compiled_rows", rows)
        loops = prepared(start.model, FREE, 1e-3, ITERATIONS)
        data = mujoco.MjData(loops.model)
        with velocity_products.velocity_products(loops, data) as expand:
            data.qpos[:], data.qvel[:] = start.qpos, start.qvel
            expand()
            mujoco.mj_forward(loops.model, data)
        assert mujoco.get_mjcb_passive() is None
        results.append(np.concatenate([data.qacc, loops.model.eq_data[:, :5].ravel()]))
    np.testing.assert_allclose(*results, rtol=1e-9, atol=1e-10 * np.abs(results[1]).max())
    # without the terms of the velocities
    mujoco.mj_forward(loops.model, data)
    assert np.abs(data.qacc - results[0][: len(data.qacc)]).max() > 1e-6 * np.abs(data.qacc).max()


def test_a_load_table_that_ends_is_named_by_steps_in_c():
    start = start_with({"crank_torque": table([0.0, 0.05], [1e-3, 2e-3], over="time")})
    with pytest.raises(ms.InputError, match="load table covers time"):
        start.stepped(np.linspace(0.0, 0.1, 6), 40)


def test_steps_in_c_and_without_a_compiler_agree(monkeypatch, tmp_path):
    start, times = start_with(KINDS["controller"]), np.linspace(0.0, 0.1, 6)
    compiled = start.stepped(times, 40)
    c_library.library_or_error.cache_clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", "no-such-compiler")
    plain = start.stepped(times, 40)
    c_library.library_or_error.cache_clear()
    assert (compiled.executed, plain.executed) == ("C", "Python")
    points = [run.motion.points["B"].position for run in (compiled, plain)]
    np.testing.assert_allclose(*points, rtol=0.0, atol=1e-13)
    without = start_with({}).stepped(times, 40)
    assert np.abs(without.motion.points["B"].position - points[0]).max() > 1e-3
    assert without.executed == "C"


def test_a_load_by_a_function_in_python_needs_python():
    loads = (Load("C", function(lambda t: np.outer(np.sin(t), [1.0, 2.0, 3.0]), over="time", width=3)),)
    assert applied(start_with({"loads": loads}), in_python=False)[1].executed == "Python"


def test_an_error_during_the_steps_leaves_no_callback():
    start = start_with(KINDS["controller"])

    def stop(text, fraction):
        raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        start.stepped(np.linspace(0.0, 0.1, 6), 40, progress=stop)
    assert mujoco.get_mjcb_control() is None
