"""The equations of motion in C against those in numpy, and runs without a usable compiler."""

import stat
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from every_force import every_force
from kinematics.test_exact_geometry import row_of_four_bars
from kinetics.test_bushings import MOUNT
from model_files import FOLDER, load_model

import mechsim as ms
from mechsim.io import catalog
from mechsim.io.law_text import control_law
from mechsim.kinetics import compiled_model as in_c
from mechsim.kinetics.compiled_motion import evaluated
from mechsim.kinetics.contacts import ContactMode, Contacts
from mechsim.kinetics.equations_of_motion import equations_of_motion
from mechsim.kinetics.initial_state import StateLayout, projected
from mechsim.kinetics.right_hand_side import RightHandSide
from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.bristle_friction import with_bristles
from mechsim.mechanism.coupling_functions import TabledFunction, WrittenFunction
from mechsim.mechanism.forces import Couple, Forces, Friction, Load, Spring
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Coupling
from mechsim.mechanism.load_profile import constant, function, table
from mechsim.mechanism.masses import slender_rod
from mechsim.mechanism.motors import TorqueSpeedLine
from mechsim.mechanism.nonlinear_springs import NonlinearSpring, SoftStop, SpringLaw
from mechsim.numerics import c_library

GALLERY = sorted((catalog.models() / "gallery").glob("*.toml"))
RODS = catalog.models() / "machines" / "peaucellier_rods.toml"
FREE_BODY = FOLDER / "compiled_dynamics_free_body.xml"
MODELS = [
    FREE_BODY,
    "four_bar",
    "slider_crank",
    "rssr",
    "rrsrr",
    "bennett",
    "warp_knitter",
    "looper",
    RODS,
    *GALLERY,
]


def with_crank_forces(mechanism):
    """Return forces of every kind, also at a crank on the ground."""
    forces = every_force(mechanism, [name for name, kind in KINDS.items() if kind.dof not in (0, 6)])
    if not mechanism.has_crank or mechanism.crank.a.link != "ground":
        return forces
    return replace(forces, crank_torque=constant(0.7), flywheel=0.02, motor=TorqueSpeedLine(2.0, 30.0))


def both(model, seed, forces=None, time=0.0):
    """Return the derivatives of a state at a time by numpy and by C."""
    source = ms.load(model, still=True)
    acting = with_crank_forces(source.mechanism) if forces is None else forces
    equations = equations_of_motion(ms.dynamics.dynamic_model(source, acting))
    layout, random = StateLayout(equations), np.random.default_rng(seed)
    rates = np.zeros((equations.loops.tree.count, 1))
    rates[equations.free] = random.normal(size=(len(equations.free), 1))
    q = equations.loops.displaced(equations.start, 0.02 * rates)
    q, rates = projected(equations, q, rates, np.zeros(1))
    state = layout.pack(q, rates, 0.0, 0.0)
    state[-2 - len(layout.start) : -2] += 0.3
    sliding = np.sign(random.normal(size=len(equations.frictions)))
    contacts = Contacts(equations)
    phases = contacts.phases(equations.kinematics(q, rates))
    mode = ContactMode(sliding, phases=phases)
    right = RightHandSide(equations, contacts, layout, mode)
    result = evaluated(in_c.compiled_model(equations), state[None], np.array([time]), mode)
    assert result.rank == equations.rank
    energies = equations.energy(equations.kinematics(q, rates))
    np.testing.assert_allclose([result.kinetic[0], result.potential[0]], energies, rtol=1e-11, atol=1e-13)
    return right.derivatives(np.array([time]), state[None])[0], result.derivatives[0]


def soft_stops(model, joint, depth, damping):
    """Return stops on both sides of a joint that are reached, or open at a negative depth."""
    equations = equations_of_motion(ms.dynamics.dynamic_model(ms.load(model, still=True).mechanism, Forces()))
    angle = float(equations.start.values[equations.loops.tree.index_of[joint], 0])
    stops = [SoftStop(angle - side * depth, side, 50.0, damping) for side in (-1.0, 1.0)]
    return Forces(nonlinear_springs=tuple(NonlinearSpring(joint, stop) for stop in stops))


def springs(law):
    """Return springs of a law in a joint and between points."""
    between = NonlinearSpring(("B", ("ground", (0.3, -0.2, 0.1))), law)
    return Forces(nonlinear_springs=(NonlinearSpring("B", law), between))


WRITTEN = tomllib.loads(Path(__file__).with_name("forces_in_c.toml").read_text("utf-8"))
POSITIONS = np.linspace(-7.0, 7.0, 40)
ROWS = tuple(POSITIONS.tolist()), tuple((40.0 * np.sin(POSITIONS) + POSITIONS).tolist())
OVER_LENGTH, OVER_RATE = (
    SpringLaw(3.0, 0.1, 0.2, 0.5, "0.3*l*v", table=TabledFunction("spring.csv", *ROWS), over=over)
    for over in ("l", "v")
)
ANGLES = np.linspace(0.5, 0.5 + 2.0 * np.pi, 19)
# a filter with every setting, a control beyond its range, and a state beyond its own
ACTUATORS = (
    Actuator(
        "filter",
        {"crank": 2.0, "A": -0.5},
        control_law("0.1+sin(3*t)", "filter"),
        gain=(1.0, 0.2, 0.1),
        bias=(0.1, -2.0, -0.1),
        direct=(0.3, 0.2),
        inflow=(20.0, -15.0, 0.2, -0.3),
        force_range=(-3.0, 9.0),
        inertia=1e-4,
    ),
    Actuator("clipped", {"crank": 1.0}, control_law("2*cos(t)", "clipped"), control_range=(-1.0, 1.0)),
    Actuator("full", {"A": 1.0}, control_law("1", "full"), inflow=(9.0, 0, 0, 0), state_range=(-1, 0.2)),
)
TABLES = {
    "springs by a table over length": springs(OVER_LENGTH),
    "springs by a table over rate": springs(OVER_RATE),
    "torque": Forces(crank_torque=table([0.0, 0.3, 1.0], [0.1, 0.2, 0.4], over="time")),
    "load": Forces(loads=(Load("A", table(ANGLES, np.stack([np.sin(k * ANGLES) for k in (1, 2, 3)], 1))),)),
    "couple": Forces(
        couples=(Couple("coupler", table(ANGLES, np.stack([np.cos(ANGLES)] * 3, 1), smooth=True)),)
    ),
    "bushing": Forces(
        bushings=(replace(MOUNT, a=ms.End("coupler", (0.01, 0.0, 0.02)), b=ms.End("rocker", axis=(1, 0, 0))),)
    ),
    "actuators": Forces(actuators=ACTUATORS, armature={"crank": 2e-4}),
}


def assert_same(model, tolerance, forces=None):
    """Check that C has the accelerations of numpy, and that they differ from those without the forces."""
    for seed, time in ((1, 0.0), (2, 0.7)):
        expected, result = both(model, seed, forces, time)
        assert np.abs(result - expected).max() <= tolerance * np.abs(expected).max()
        without, _ = both(model, seed, Forces(), time)
        assert np.abs(result[: len(without) - 2] - without[:-2]).max() > 1e-3


def marked(names, quick=()):
    return [name if name in quick else pytest.param(name, marks=pytest.mark.long) for name in names]


@pytest.mark.parametrize("name", marked(WRITTEN, [name for name, row in WRITTEN.items() if "quick" in row]))
def test_written_forces_are_the_same_in_c_and_in_numpy(name):
    row = WRITTEN[name]
    model = row.get("model", "four_bar")
    solver = load_model(model, more=f"[forces]\ngravity = [0, 0, 0]\n{row['text']}", still=True)
    assert_same(model, row["tolerance"], with_bristles(solver.forces))


@pytest.mark.parametrize("name", marked(TABLES, ["actuators"]))
def test_tables_and_actuators_are_the_same_in_c_and_in_numpy(name):
    assert_same("four_bar", 1e-11, TABLES[name])


@pytest.mark.parametrize("model", marked(MODELS, [FREE_BODY]), ids=lambda model: Path(model).stem)
def test_every_force_is_the_same_in_c_and_in_numpy(model):
    # rrsrr has a link that turns almost without inertia, which multiplies rounding
    assert_same(model, 1e-12 if model == FREE_BODY else 1e-9)


# a strong damper lets the joint go on one side
@pytest.mark.parametrize("damping", [0.1, 400.0])
@pytest.mark.parametrize(("model", "joint"), [("four_bar", "B"), ("rssr", "crank")])
def test_soft_stops_that_press_are_the_same_in_c_and_in_numpy(model, joint, damping):
    assert_same(model, 1e-11, soft_stops(model, joint, 0.3, damping))


def test_open_soft_stops_have_no_force_in_c_either():
    for model, joint in (("four_bar", "B"), ("rssr", "crank")):
        expected, result = both(model, 1, soft_stops(model, joint, -0.3, 2.0))
        np.testing.assert_allclose(result, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


FUNCTIONS = {
    "every function": WrittenFunction(
        "a*q + 0.01*sin(q)*cos(2*q) + 0.01*tan(0.1*q) + 0.02*asin(0.1*q)/(2+q**2) + 0.03*acos(0.1*q)"
        " - 0.02*atan(q) + 0.01*atan2(q, 2-0.1*q) + 0.02*sqrt(3+q) + 0.01*exp(-q)*log(4+q) - 0.01*abs(q+9)"
        " + max(-9, min(q, 9))*0.01 + 0.01*(2+0.1*q)**(0.3*q) + (0.1*q)**3",
        ("a",),
        (0.3,),
    ),
    "table": TabledFunction("f.csv", *(tuple(0.01 * np.array(column)) for column in ROWS)),
    "periodic table": TabledFunction(
        "f.csv", tuple(np.linspace(-3.0, 2.0, 30)), tuple(np.sin(np.linspace(0, 2 * np.pi, 30))), True
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_coupling_functions_are_the_same_in_c_and_in_numpy(name):
    """Two arms on the ground, of which one turns as a function of the other, also in its second period."""
    rod = slender_rod((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0)
    joints = [ms.Joint(n, "revolute", ms.End("ground"), ms.End(f"arm {n}")) for n in "ab"]
    law = Coupling("f", "b", "a", (), function=FUNCTIONS[name])
    links = tuple(ms.Link(f"arm {n}", inertia=rod) for n in "ab")
    for start in (0.0, 4.0 if "periodic" in name else 0.03):
        mechanism = ms.Mechanism("arms", links, tuple(joints), "a", {}, couplings=(law,), start=start)
        expected, result = both(mechanism, 1, Forces(gravity=(0.0, -9.81, 0.0)))
        np.testing.assert_allclose(result, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


def run_of(forces=None, **options):
    return ms.dynamics.run("four_bar", forces, duration=0.3, samples=20, **options)


@pytest.fixture
def fresh_library(monkeypatch, tmp_path):
    """An empty cache, and nothing loaded yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    c_library.library_or_error.cache_clear()
    yield tmp_path
    c_library.library_or_error.cache_clear()


@pytest.mark.long
def test_what_c_does_not_contain_runs_in_numpy_with_a_note():
    run = run_of(Forces(crank_torque=function(lambda time: 1e-3 * time, over="time")))
    assert run.executed == "numpy"
    assert "a load over time given by a function" in run.note


@pytest.mark.long
def test_an_element_of_an_unknown_kind_is_not_ignored(monkeypatch):
    monkeypatch.setattr(in_c, "FORCES", in_c.FORCES - {"springs"})
    spring = Spring("A", ("ground", (0.3, -0.2, 0.0)), 50.0)
    assert run_of(Forces(springs=(spring,))).executed == "numpy"
    assert run_of(Forces()).executed == "C"


@pytest.mark.long
def test_an_element_that_c_lacks_is_noticed_in_the_accelerations(monkeypatch):
    monkeypatch.setattr(in_c, "spring_table", lambda _: np.zeros(0, in_c.record("Spring")))
    run = run_of(Forces(springs=(Spring("A", ("ground", (0.3, -0.2, 0.0)), 50.0),)))
    assert run.executed == "numpy"
    assert "changes the accelerations" in run.note


FILTER = Actuator("filter", {"crank": 1.0}, control_law("0.01+0.01*t", "filter"), inflow=(1e6, -1e6, 0, 0))
TIMES = np.linspace(0.0, 0.3, 16)
DRIVEN = {"model": "five_bar", "drive": {"left": "0.2rad*sin(3*t)", "right": "1rad/s"}}


def drag(right):
    """Return weight and viscous friction at both drivers of a five-bar."""
    friction = Friction("right", viscous=right), Friction("left", viscous=2e-3)
    return Forces(gravity=(0.0, -9.81, 0.0), friction=friction)


# model, forces and options of a run
RUNS = {
    "free": ({"model": "four_bar"}, None, {}),
    # third derivatives of the spline jump at the rows of the table, which steps do not know
    "load table": (
        {"model": "four_bar"},
        Forces(crank_torque=table(TIMES, 1e-3 * np.sin(20.0 * TIMES), over="time", smooth=True)),
        {},
    ),
    "prescribed": (DRIVEN, drag(1e-3), {"prescribed": ["left"]}),
    "stiff under a prescribed motion": (DRIVEN, drag(5.0), {"prescribed": ["left"]}),
    # the speed of the crank approaches that of the motor within 1.2e-5 s
    "stiff motor": ({"model": "rssr"}, Forces(motor=TorqueSpeedLine(1.0, 62.8)), {"duration": 0.03}),
    "stiff damper": (
        {"model": "four_bar"},
        Forces(springs=(Spring("B", ("ground", (0.3, -0.2, 0)), 5.0, 0.1, 1e4),)),
        {},
    ),
    "stiff actuator": ({"model": "four_bar"}, Forces(actuators=(FILTER,)), {"duration": 0.1}),
}


@pytest.mark.parametrize("name", marked(RUNS, ["free", "prescribed"]))
def test_a_run_is_the_same_in_c_and_in_numpy(name, monkeypatch):
    """Both integrate with a relative error of 3e-13 a step; numpy integrates stiff runs implicitly."""
    source, forces, options = RUNS[name]

    def run():
        settings = {"duration": 0.3, "samples": 20} | options
        return ms.dynamics.run(ms.load(source["model"], drive=source.get("drive")), forces, **settings)

    fast = run()
    monkeypatch.setattr(in_c, "FORCES", set())
    slow = run()
    assert (fast.executed, fast.note, slow.executed) == ("C", "", "numpy")
    for joint, exact in slow.motion.joints.items():
        own, fastest = fast.motion.joints[joint], np.abs(exact.rate).max()
        assert np.abs(own.value - exact.value).max() <= (1e-11 if name == "load table" else 1e-12)
        assert np.abs(own.rate - exact.rate).max() <= 1e-10 * fastest
    exchanged = max(slow.kinetic.max(), np.ptp(slow.potential))
    for values, exact in ((fast.work, slow.work), (fast.lost, slow.lost)):
        assert np.abs(values - exact).max() <= 1e-10 * exchanged
    for driver, exact in slow.driving.items():
        assert np.abs(fast.driving[driver] - exact).max() <= 1e-11 * np.abs(exact).max()
    if "stiff" in name:
        assert fast.steps <= 1.5 * slow.steps


def positions(run):
    return np.stack([run.motion.points[name].position for name in "AB"])


def test_rows_of_loops_eliminated_in_their_order_are_the_same_in_c_and_in_numpy():
    """Three rows of five are dependent; those of five loops are eliminated by the largest norm."""
    for count in (5, 30):
        expected, result = both(row_of_four_bars(count), 4)
        assert np.abs(result - expected).max() <= 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_the_error_follows_the_tolerance(tolerance):
    exact, run = run_of(tolerance=1e-13), run_of(tolerance=tolerance)
    error = np.abs(positions(run) - positions(exact)).max()
    assert 1e-4 * tolerance <= error <= 10.0 * tolerance


@pytest.mark.long
def test_without_a_compiler_the_run_is_in_numpy(fresh_library, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    run = run_of()
    assert run.outcome == "done"
    assert (run.executed, run.note.startswith("CC=no-such-compiler is not found")) == ("numpy", True)


@pytest.mark.long
def test_a_compiler_that_does_not_end_is_given_up_once(fresh_library, monkeypatch):
    compiler = fresh_library / "cc"
    compiler.write_text("#!/bin/sh\nexec sleep 60\n")
    compiler.chmod(compiler.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setattr(c_library, "TIME_LIMIT", 0.5)
    monkeypatch.setattr(c_library.os, "getloadavg", lambda: (0.0, 0.0, 0.0))
    for _ in range(2):
        run = run_of()
        assert (run.executed, "does not end within 0.5 s" in run.note) == ("numpy", True)
    assert not [*(fresh_library / "mechsim").rglob("*.so")]


def test_a_cache_that_cannot_be_written_leaves_numpy_and_one_remedy(fresh_library):
    (fresh_library / "mechsim").write_text("a file in the cache's place")
    run = run_of()
    assert (run.executed, run.note.startswith("cannot keep compiled code")) == ("numpy", True)
    assert "CC" not in run.note


@pytest.mark.long
def test_a_damaged_library_is_compiled_again(fresh_library):
    assert run_of().executed == "C"
    (path,) = (fresh_library / "mechsim").rglob("*.so")
    path.unlink()
    path.write_bytes(b"\x7fELF damaged")
    c_library.library_or_error.cache_clear()
    run = run_of()
    assert (run.executed, run.note) == ("C", "")


WITH_FRICTION = Forces(gravity=(0.0, -9.81, 0.0), friction=(Friction("crank", coulomb=1e-5),))
# forces, initial values and cranks of many runs; those with friction are taken one by one
MANY = {
    "states": (None, {"crank.q": np.linspace(-1.0, 1.0, 5), "crank.v": [2.0] * 5}, None),
    "friction": (WITH_FRICTION, {"crank.q": [0.0, 0.5]}, None),
    "designs": (None, {"crank.q": [0.2, 0.3]}, [0.028, 0.032]),
}


@pytest.mark.parametrize("case", marked(MANY, ["designs"]))
def test_many_runs_are_the_runs_one_by_one(case):
    forces, initial, cranks = MANY[case]
    options = {"duration": 0.1, "samples": 4}
    changed = {"parameters": {"crank": cranks}} if cranks else {}
    runs = ms.dynamics.run_many("four_bar", forces, initial=initial, **changed, **options)
    assert case == "friction" or set(runs["executed"].values) == {"C"}
    for i in range(len(initial["crank.q"])):
        design = ms.load("four_bar", {"crank": cranks[i]} if cranks else {}, still=True)
        start = {name: values[i] for name, values in initial.items()}
        single = ms.dynamics.run(design, forces, initial=start, **options)
        np.testing.assert_allclose(runs["B.x"][i], single.motion.points["B"].position[:, 0], atol=1e-12)
        np.testing.assert_allclose(runs["kinetic"][i], single.kinetic, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(runs["lost"][i], single.lost, rtol=1e-12)
    assert (float(runs["lost"][-1, -1]) > 0.0) == (case == "friction")
    if cranks:
        np.testing.assert_array_equal(runs["parameter crank"], cranks)
        with pytest.raises(ms.InputError, match="a name, a file or a function"):
            ms.dynamics.run_many(design, parameters={"crank": cranks}, duration=0.1)
