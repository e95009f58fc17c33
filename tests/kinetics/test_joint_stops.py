"""Joint stops in forward dynamics: impacts and contacts over all closed gaps."""

import itertools
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from model_files import changed_model, load_model, model_text
from scipy.optimize import minimize

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import dynamic_model
from mechsim.mechanism.forces import Forces
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.studies.dynamics_check import crosscheck_equilibrium

CHAINS = tomllib.loads(model_text("joint_stops_chains.toml"))["chain"]
WEIGHT = Forces(gravity=(0.0, -9.81, 0.0))


def pendulum(low, high):
    """A link of 1 kg, 0.3 m from its hinge to its centre, with end stops."""
    inertia = ms.Inertia(1.0, (0.3, 0.0, 0.0), tuple(tuple(row) for row in 0.02 * np.eye(3)))
    arm = ms.Link("arm", outline=((0.6, 0.0, 0.0),), inertia=inertia)
    hinge = ms.Joint("j", "revolute", ms.End("ground"), ms.End("arm"))
    mechanism = ms.Mechanism("arm", (arm,), (hinge,), "j", {"P": ("arm", (0.6, 0.0, 0.0))})
    return KinematicSolver(mechanism, ranges={"j": (low, high)})


@pytest.mark.parametrize("number", [pytest.param(n, marks=[pytest.mark.long] * (n > 5)) for n in range(18)])
def test_chains_agree_with_an_independent_integration(file, number):
    chain = CHAINS[number]
    initial = {f"j{i}.v": rate for i, rate in enumerate(chain["rates"])}
    run = ms.dynamics.run(
        ms.load(file(chain["text"]), still=True),
        initial=initial,
        duration=0.3,
        restitution=chain["restitution"],
        samples=4,
    )
    own = np.array([joint.value[1:] for joint in run.motion.joints.values()]).T
    # a run ends where stops hold the mechanism at rest
    assert run.outcome in ("done", "stopped")
    last = 4 if run.outcome == "done" else 1
    np.testing.assert_allclose(own[-last:], chain["coordinates"][-last:], atol=1e-9)
    assert run.energy_error <= 1e-8


def test_a_stop_between_two_instants_of_a_step_is_found():
    """The swing passes its stop by 1e-9 rad to 1e-3 rad for less than a step."""
    swing = ms.dynamics.run(pendulum(-10.0, 10.0), WEIGHT, duration=2.0, samples=20_000)
    deepest = swing.motion.joints["j"].value.min()
    for depth in (1e-8, 1e-5, 1e-3):
        run = ms.dynamics.run(pendulum(deepest + depth, 10.0), WEIGHT, duration=2.0, restitution=1.0)
        assert run.events
        assert run.motion.joints["j"].value.min() >= deepest + depth - 1e-12


def test_a_joint_at_which_a_loop_is_cut_is_not_left_beyond_its_range():
    linkage = ms.catalog.make("four_bar").mechanism
    free = ms.dynamics.run(KinematicSolver(linkage), WEIGHT, initial={"crank.q": "30deg"}, duration=0.15)
    for name, joint in free.motion.joints.items():
        low, high = float(joint.value.min()), float(joint.value.max())
        ranges = dict.fromkeys(free.motion.joints, (-20.0, 20.0))
        ranges[name] = (low - 1.0, high - 0.1 * (high - low))
        if joint.value[0] > ranges[name][1]:
            ranges[name] = (low + 0.1 * (high - low), high + 1.0)
        run = ms.dynamics.run(
            KinematicSolver(linkage, ranges=ranges), WEIGHT, initial={"crank.q": "30deg"}, duration=0.15
        )
        low, high = ranges[name]
        beyond = max(low - joint.value.min(), joint.value.max() - high)
        assert beyond > 0.0
        values = run.motion.joints[name].value
        assert run.outcome == "failed" or max(low - values.min(), values.max() - high) <= 1e-9


@pytest.mark.parametrize(
    ("ranges", "at_stops"),
    [
        ((("-0.5 1.2"), ("-0.4 0.9")), {"j1", "j2"}),
        ((("-0.5 1.2"), ("-0.2 3.2")), {"j1", "j2"}),
        ((("-0.5 1.2"), ("-3 3")), {"j1"}),
        ((("-3 3"), ("0.2 0.9")), {"j2"}),
        ((("-3 3"), ("-1 1")), set()),
    ],
)
def test_an_arm_rests_where_its_energy_is_least_within_its_ranges(ranges, at_stops, tmp_path):
    """Local minima of the energy in a box, by scipy; the force of a stop is the derivative of the energy."""
    values = {"centre": 0.25, "length": 0.5, "mass": 2.0, "centre2": 0.3, "mass2": 1.5, "length2": 0.6}
    values |= {"range1": ranges[0], "range2": ranges[1], "damping1": 0.0, "damping2": 0.0}
    text = model_text("joint_stops_two_hinges.xml", **values)
    # joints with motors are drivers, which the search locks at their limits too
    motors = '<actuator><motor joint="j1"/><motor joint="j2"/></actuator></mujoco>'
    (tmp_path / "arm.xml").write_text(text.replace("</mujoco>", motors))
    box = [tuple(map(float, limits.split())) for limits in ranges]

    def energy(q):
        return 9.81 * (2.0 * 0.25 * np.sin(q[0]) + 1.5 * (0.5 * np.sin(q[0]) + 0.3 * np.sin(q[0] + q[1])))

    def gradient(q):
        both = 1.5 * 0.3 * np.cos(q[0] + q[1])
        return 9.81 * np.array([(2.0 * 0.25 + 1.5 * 0.5) * np.cos(q[0]) + both, both])

    minima = {}
    for start in itertools.product(*(np.linspace(*limits, 4) for limits in box)):
        end = minimize(energy, start, jac=gradient, bounds=box, method="L-BFGS-B", options={"gtol": 1e-12}).x
        minima[tuple(end.round(5))] = end
    arm = ms.load(str(tmp_path / "arm.xml"), still=True)
    resting = [each for each in ms.dynamics.equilibria(arm) if each.stable]
    assert len(resting) == len(minima)
    for each in resting:
        q = np.array([each.q["j1"], each.q["j2"]])
        nearest = min(minima.values(), key=lambda end: np.abs(end - q).max())
        assert np.abs(q - nearest).max() < 1e-6
        for index, name in enumerate(("j1", "j2")):
            assert each.stops.get(name, 0.0) == pytest.approx(gradient(q)[index], abs=1e-9)
    assert at_stops in [set(each.stops) for each in resting]


def test_a_stop_balances_no_block_that_is_pulled(tmp_path):
    """Where nothing is at rest with a coordinate at its limit, the start of that search is no equilibrium."""
    block = (
        '<mujoco><worldbody><body><joint name="s" type="slide" axis="1 0 0"/><geom size=".05"/><body>'
        '<joint name="h" axis="0 1 0" range="-60 20"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>'
        '</body></body></worldbody><actuator><general joint="s" biastype="affine" biasprm="{} 0 0"/>'
        "</actuator></mujoco>"
    )
    pulled, free = tmp_path / "pulled.xml", tmp_path / "free.xml"
    pulled.write_text(block.format(5))
    assert ms.dynamics.equilibria(ms.load(str(pulled), still=True)) == ()
    # without the pull the arm rests on its stop wherever the block is
    free.write_text(block.format(0))
    (resting,) = ms.dynamics.equilibria(ms.load(str(free), still=True))
    assert resting.q["h"] == pytest.approx(np.deg2rad(20.0), abs=1e-12)


def test_the_comparison_rejects_a_stop_with_another_force():
    model = dynamic_model(load_model("stops_at_rest_arm.toml", ("LOWER", "-30"), ("UPPER", "80"), still=True))
    (rest,) = ms.dynamics.equilibria(model)
    wrong = {name: 1.01 * force for name, force in rest.stops.items()}
    assert wrong
    assert not crosscheck_equilibrium(replace(rest, stops=wrong), model).passed


@pytest.mark.long
def test_mujoco_converges_for_a_pendulum_between_two_stops():
    solver = load_model(
        "soft_stops_pendulum.toml",
        ('"-30 deg"', '"-80 deg"'),
        ('"1 rad/s"', '"4 rad/s"'),
        limits='{ lower = "-100 deg", upper = "-60 deg", stiffness = 40, damping = "0.3 N m s/rad" }',
        still=True,
    )
    run = ms.dynamics.run(solver, duration="0.3s", samples=30)
    model = dynamic_model(solver)

    def error(substeps):
        stepped = stepped_run(
            model.mechanism, model.forces, {"hip": np.radians(-80.0)}, {"hip": 4.0}, run.time, substeps
        )
        return np.abs(stepped.motion.joints["hip"].value - run.motion.joints["hip"].value).max()

    # first order: MuJoCo's steps do not end at the contacts
    coarse, fine = error(10), error(80)
    assert fine < 0.4 * coarse
    assert fine < 1e-4


def test_states_are_drawn_between_soft_stops():
    """`sample` and `show` know limits of a TOML file, hard or soft."""
    for law in ("restitution = 0.5", "stiffness = 20"):
        crank = ms.sample(changed_model("soft_stops_four_bar.toml", law=law), 50).qpos[:, 0]
        assert np.radians(-10.0) <= crank.min() < 0.0
        assert 1.0 < crank.max() <= np.radians(100.0)
