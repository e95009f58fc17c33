"""Forces by both methods: MuJoCo agrees with the correct model, and the check rejects wrong ones."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import nonlinear_rocker
from mechanisms import rscr, three_cranks

import mechsim as ms
from mechsim.compare.record_errors import of_reactions
from mechsim.kinetics.initial_state import InitialValues
from mechsim.mechanism.masses import with_inertia
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_forward

LINKAGE = ms.catalog.make("rrsrr")
PUSH = ms.load_profile.table(
    [0.0, 2.0, 4.0, 2.0 * np.pi], [[0.0, 0.5, 1.0], [1.0, 0.0, -1.0], [0.5, 2.0, 0.0], [0.0, 0.5, 1.0]]
)
FORCES = ms.Forces(
    gravity=(0.3, -9.81, 2.1),
    friction=(ms.Friction("rocker", 1e-4, 2e-3), ms.Friction("C", 1e-5, 1e-4)),
    loads=(ms.Load("S", PUSH),),
)
RIGHT = with_inertia(LINKAGE.mechanism)
SPEED = 60.0


def verdict_of(method, mechanism=RIGHT, forces=FORCES):
    """Return the verdict on MuJoCo's run of a model against the correct model's reduced equation."""
    result = driven(mechanism, forces, speed=SPEED, method=method, samples=24)
    return crosscheck_driven(result, ms.dynamics.dynamic_model(LINKAGE, FORCES, mechanism=RIGHT))


def with_link(name, change):
    links = tuple(
        replace(link, inertia=change(link.inertia)) if link.name == name else link for link in RIGHT.links
    )
    return replace(RIGHT, links=links)


def heavier(inertia):
    return ms.Inertia(1.001 * inertia.mass, inertia.centre, 1.001 * inertia.matrix)


def swapped(inertia):
    order = [1, 2, 0]
    return ms.Inertia(inertia.mass, inertia.centre, inertia.matrix[np.ix_(order, order)])


WRONG = {
    "mass 0.1 % off": {"mechanism": with_link("link", heavier)},
    "inertia axes swapped": {"mechanism": with_link("coupler", swapped)},
    "gravity reversed": {"forces": replace(FORCES, gravity=(-0.3, 9.81, -2.1))},
    "load at the neighbour point": {"forces": replace(FORCES, loads=(ms.Load("C", PUSH),))},
    "friction left out": {"forces": replace(FORCES, friction=FORCES.friction[1:])},
    "Coulomb friction left out": {
        "forces": replace(FORCES, friction=(ms.Friction("rocker", 1e-4), FORCES.friction[1]))
    },
}


@pytest.mark.long
@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_wrong_model_fails(method, wrong):
    verdict = verdict_of(method, **WRONG[wrong])
    assert verdict.outcome == "failed", verdict
    assert "drive torque" in verdict.reason or "force in" in verdict.reason


def test_the_correct_model_passes_and_a_nan_is_detected():
    result = driven(RIGHT, FORCES, speed=SPEED, method="pose", samples=24)
    model = ms.dynamics.dynamic_model(LINKAGE, FORCES, mechanism=RIGHT)
    assert crosscheck_driven(result, model).passed
    torque = result.forces.torque.copy()
    torque[5] = np.nan
    broken = replace(result, forces=replace(result.forces, torque=torque))
    assert crosscheck_driven(broken, model).outcome == "diverged"
    assert crosscheck_driven(replace(result, outcome="diverged"), model).outcome == "diverged"


def test_a_free_run_with_another_motor_fails():
    linkage = ms.catalog.make("four_bar")
    motor = ms.motors.DCMotor(6.0, 2.0, 0.05)
    model = ms.dynamics.dynamic_model(linkage, ms.Forces(gravity=(0.0, -9.81, 0.0), motor=motor))
    result = ms.dynamics.run(model, initial={"crank.q": 0.3, "crank.v": 20.0}, duration=0.05, samples=10)
    initial = InitialValues({"crank": 0.3}, {"crank": 20.0})
    verdict = crosscheck_forward(result, model, initial)
    assert verdict.passed, verdict
    weaker = model.with_forces(replace(model.forces, motor=ms.motors.DCMotor(5.99, 2.0, 0.05)))
    assert crosscheck_forward(result, weaker, initial).outcome == "failed"


def three_armed(position):
    """Return a parallelogram with a third crank under gravity, with its unit motion by loop equations."""
    return ms.dynamics.dynamic_model(three_cranks(position), ms.Forces(gravity=(0.4, -9.81, 0.0)))


def test_determined_reactions_of_a_redundant_crank_are_checked():
    model = three_armed((0.047, 0.02))
    # where all cranks lie along x the third takes no part in the self-stress
    angle = 0.2 + np.linspace(0.0, 2.0 * np.pi, 25)
    study = ms.dynamics.prescribed(model, angle, 50.0)
    pin = study.forces.reactions["third pin"]
    force, _ = pin.project(pin.force, pin.moment)
    across, along = (
        np.stack([function(angle), other(angle), 0.0 * angle], 1)
        for function, other in ((lambda x: -np.sin(x), np.cos), (np.cos, np.sin))
    )
    arm = next(link.inertia for link in model.mechanism.links if link.name == "third")
    # at constant speed the pin carries the moment of the arm's weight
    weight = arm.mass * (across @ [0.4, -9.81, 0.0]) * arm.centre[0] / 0.03
    np.testing.assert_allclose((force * across).sum(1), weight, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose((force * along).sum(1), 0.0, atol=1e-12)
    assert pin.partly_undetermined == ("fx", "fy")
    run = driven(model.mechanism, model.forces, speed=50.0, method="step", samples=24)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    links = tuple(
        replace(link, inertia=heavier(link.inertia)) if link.name == "third" else link
        for link in model.mechanism.links
    )
    wrong = ms.dynamics.dynamic_model(
        model.solver, model.forces, mechanism=replace(model.mechanism, links=links)
    )
    failed = {(item.kind, item.subject) for item in crosscheck_driven(run, wrong).checks if not item.passed}
    assert {("force", "third"), ("force", "third pin")} <= failed


def flat_forces(angles):
    """Return the forces of a parallelogram, flat at 0 and pi."""
    flat = ms.catalog.make("four_bar", ground=0.1, crank=0.03, coupler=0.1, rocker=0.03)
    model = ms.dynamics.dynamic_model(flat, ms.Forces(gravity=(0.4, -9.81, 0.0)))
    return ms.dynamics.prescribed(model, np.array(angles), 50.0).forces


def test_forces_near_a_change_point_are_continuous():
    whole, subset = map(flat_forces, ([0.0, 0.7, 2.0, np.pi, 4.0], [0.7, 2.0, 4.0]))
    assert whole.unbounded.tolist() == [True, False, False, True, False]
    for name, item in subset.reactions.items():
        assert item.undetermined == whole.reactions[name].undetermined
        np.testing.assert_allclose(whole.reactions[name].force[[1, 2, 4]], item.force, rtol=1e-9, atol=1e-9)


def test_records_under_test_do_not_exclude_instants():
    exact = flat_forces([0.0, 0.7, 2.0, np.pi, 4.0])
    doubled = {name: replace(item, force=2.0 * item.force) for name, item in exact.reactions.items()}
    wrong = replace(exact, at_branch_point=np.ones(5, dtype=np.bool_), reactions=doubled)
    for name in doubled:
        error = of_reactions("force")(wrong, exact, name)
        assert (error > 0.0).tolist() == [False, True, True, False, True]


def glued():
    """Return the R-S-C-R whose lever consists of two links connected by a fixed joint."""
    whole = rscr()
    glue = ms.Joint("glue", "fixed", ms.End("half", (0.03, 0.01, 0.0)), ms.End("lever", (0.03, 0.01, 0.0)))
    joints = [
        replace(joint, b=replace(joint.b, link="half")) if joint.name == "pivot" else joint
        for joint in whole.joints
    ]
    guess = {**whole.guess, "half": whole.guess["lever"]}
    return replace(whole, links=(*whole.links, ms.Link("half")), joints=(*joints, glue), guess=guess)


@pytest.mark.parametrize(("mechanism", "cut"), [(rscr(), "sleeve"), (glued(), "glue")])
@pytest.mark.parametrize("method", ["pose", "step"])
def test_cylindrical_and_fixed_cut_joints_have_the_newton_euler_reactions(mechanism, cut, method):
    acting = ms.Forces(
        gravity=(0.3, -9.81, 2.1),
        friction=(ms.Friction("sleeve", 0.02, 0.01, viscous_turn=1e-5, coulomb_turn=1e-4),),
    )
    model = ms.dynamics.dynamic_model(mechanism, acting)
    run = driven(model.mechanism, acting, speed=30.0, turns=0.2, method=method, samples=8, cut=(cut,))
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    sound = next(check for check in verdict.checks if check.subject == cut and check.kind == "moment")
    assert sound.worst >= 0.0
    half = tuple(
        replace(link, inertia=heavier(link.inertia)) if link.name == "rod" else link
        for link in model.mechanism.links
    )
    wrong = ms.dynamics.dynamic_model(model.solver, acting, mechanism=replace(model.mechanism, links=half))
    assert not crosscheck_driven(run, wrong).passed


def test_links_too_light_for_mujoco_are_rejected():
    lengths = {"ground": 1e-2, "crank": 3e-3, "coupler": 9e-3, "rocker": 7e-3, "arm": 4e-3}
    large, small = (
        ms.dynamics.dynamic_model(
            ms.catalog.make("four_bar", **{name: k * x for name, x in lengths.items()}), ms.Forces()
        )
        for k in (1.0, 1e-3)
    )
    with pytest.raises(ms.InputError, match=r"body 'crank' has a mass of .* larger than mjMINVAL.* as large"):
        driven(small.mechanism, speed=50.0)
    angle = np.linspace(0.1, 6.0, 9)
    torques = [ms.dynamics.prescribed(item, angle, 50.0).forces.torque for item in (large, small)]
    np.testing.assert_allclose(torques[0], 1e15 * torques[1], rtol=1e-9)


@pytest.mark.long
def test_free_runs_with_redundant_loops_pass():
    bennett = ms.dynamics.dynamic_model(ms.catalog.make("bennett"), ms.Forces())
    for model, turns in ((three_armed((0.05, 0.03)), 0.2), (bennett, 0.1)):
        result = ms.dynamics.run(model, initial={"crank.v": 60.0}, turns=turns, samples=30)
        verdict = crosscheck_forward(result, model, InitialValues({}, {"crank": 60.0}))
        assert verdict.passed, verdict


@pytest.mark.long
def test_a_free_run_with_nonlinear_couplings_has_fourth_order():
    model = ms.dynamics.dynamic_model(nonlinear_rocker(), ms.Forces(gravity=(0.3, -9.81, 0.0)))
    errors = []
    result = ms.dynamics.run(model, initial={"crank.v": 40.0}, duration=0.06, samples=40)
    verdict = crosscheck_forward(result, model, InitialValues({}, {"crank": 40.0}))
    assert verdict.passed, verdict
    name = model.mechanism.crank.name
    start = {name: float(result.motion.angle[0])}, {name: 40.0}
    for substeps in (1, 2):
        run = stepped_run(model.mechanism, model.forces, *start, result.time, substeps)
        errors.append(float(np.abs(run.motion.angle - result.motion.angle).max()))
    assert 3.5 < np.log2(errors[0] / errors[1]) < 5.0, errors


def test_poor_conditioning_is_reported_with_stepped_forces():
    output = {}
    for aside in (1e-4, 0.03):
        model = ms.dynamics.dynamic_model(three_cranks((0.047, aside), start=0.0), ms.Forces())
        settings = ms.Settings(steps_per_turn=288)
        run = driven(model.mechanism, model.forces, speed=50.0, method="step", settings=settings)
        output[aside] = run.note
    assert "the loops hardly hold the links" in output[1e-4]
    assert output[0.03] == ""


@pytest.mark.long
def test_a_start_with_a_stiff_motor_conserves_energy():
    motor = ms.motors.TorqueSpeedLine(100.0, 60.0)
    model = ms.dynamics.dynamic_model(ms.catalog.make("four_bar"), ms.Forces(motor=motor))
    result = ms.dynamics.run(model, turns=0.1, samples=10)
    verdict = crosscheck_forward(result, model, InitialValues({}, {}))
    assert verdict.passed, verdict
    # the motor is at its speed before the second record
    assert result.motion.speed[1] == pytest.approx(60.0, rel=1e-2)
    assert result.energy_error <= 1e-6
    weaker = model.with_forces(replace(model.forces, motor=ms.motors.TorqueSpeedLine(100.0, 59.99)))
    assert not crosscheck_forward(result, weaker, InitialValues({}, {})).passed
