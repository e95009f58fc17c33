"""Forces by both methods: MuJoCo agrees with the correct model, and the check rejects wrong ones."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from driven_mechanisms import nonlinear_rocker
from mechanisms import rscr, rsup, three_cranks

import mechsim as ms
from mechsim.compare.record_errors import of_reactions
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.mechanism.forces import Couple
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


def heavier(inertia):
    return ms.Inertia(1.001 * inertia.mass, inertia.centre, 1.001 * inertia.matrix)


def swapped(inertia):
    order = [1, 2, 0]
    return ms.Inertia(inertia.mass, inertia.centre, inertia.matrix[np.ix_(order, order)])


def changed_link(model, name, change):
    """Return a model with the inertia of one link changed."""
    links = tuple(
        replace(link, inertia=change(link.inertia)) if link.name == name else link
        for link in model.mechanism.links
    )
    mechanism = replace(model.mechanism, links=links)
    return ms.dynamics.dynamic_model(model.solver, model.forces, mechanism=mechanism)


def changed_forces(model, **fields):
    return model.with_forces(replace(model.forces, **fields))


def changed_friction(model, **coefficients):
    friction = tuple(replace(item, **coefficients) for item in model.forces.friction)
    return changed_forces(model, friction=friction)


def every_force():
    model, (first, second) = ms.dynamics.dynamic_model(LINKAGE, FORCES, mechanism=RIGHT), FORCES.friction
    wrong = {
        "mass 0.1 % off": changed_link(model, "link", heavier),
        "inertia axes swapped": changed_link(model, "coupler", swapped),
        "gravity reversed": changed_forces(model, gravity=(-0.3, 9.81, -2.1)),
        "load at the neighbour point": changed_forces(model, loads=(ms.Load("C", PUSH),)),
        "friction left out": changed_forces(model, friction=(second,)),
        "Coulomb friction left out": changed_forces(model, friction=(replace(first, coulomb=0.0), second)),
    }
    return model, {"speed": 60.0, "samples": 24}, wrong


def rubbing(source, *frictions):
    """Return a case with friction, by default in every joint, the cut joint included."""
    joints = getattr(source, "mechanism", source).joints
    acting = frictions or tuple(ms.Friction(joint.name, 0.0, 2e-3) for joint in joints)
    model = ms.dynamics.dynamic_model(source, ms.Forces(gravity=(0.3, -9.81, 0.5), friction=acting))
    names = ("viscous", "coulomb", "viscous_turn", "coulomb_turn")
    wrong = {name: changed_friction(model, **{name: 0.0}) for name in names if getattr(acting[0], name)}
    return model, {"speed": 30.0, "turns": 0.1, "samples": 12}, wrong


def opposed(*names):
    """Return a four-bar with friction, some of whose joints have opposite axes."""
    mechanism, down = ms.catalog.make("four_bar").mechanism, {"axis": (0.0, 0.0, -1.0)}
    joints = tuple(
        replace(item, a=replace(item.a, **down), b=replace(item.b, **down)) if item.name in names else item
        for item in mechanism.joints
    )
    return rubbing(
        replace(mechanism, joints=joints), *(ms.Friction(item.name, 1e-4, 2e-3) for item in joints)
    )


def couple():
    moment = ms.load_profile.function(
        lambda angle: np.stack([np.cos(angle), 0.3 + 0.0 * angle, np.sin(2.0 * angle)], 1), width=3
    )
    model = ms.dynamics.dynamic_model(LINKAGE, ms.Forces(couples=(Couple("link", moment),)))
    wrong = {"on another link": changed_forces(model, couples=(Couple("coupler", moment),))}
    return model, {"speed": 30.0, "samples": 24}, wrong


def cut_at(mechanism, joint):
    sleeve = ms.Friction("sleeve", 0.02, 0.01, viscous_turn=1e-5, coulomb_turn=1e-4)
    model = ms.dynamics.dynamic_model(mechanism, ms.Forces(gravity=(0.3, -9.81, 2.1), friction=(sleeve,)))
    options = {"speed": 30.0, "turns": 0.2, "samples": 8, "cut": (joint,)}
    return model, options, {"heavier rod": changed_link(model, "rod", heavier)}


# a model, options of its prescribed motion, and wrong models
PRESCRIBED = {
    "every force": every_force,
    "friction of a cylindrical joint": lambda: rubbing(rscr(), ms.Friction("sleeve", 0.2, 0.5, 1e-3, 4e-3)),
    "friction of a universal joint": lambda: rubbing(rsup(), ms.Friction("cross", 1e-3, 3e-3)),
    "friction of a spatial cut joint": lambda: rubbing(ms.catalog.make("bennett")),
    "friction of a ball that is cut": lambda: rubbing(LINKAGE, ms.Friction("S", 1e-5, 4e-4)),
    **{f"opposed {names}": partial(opposed, *names) for names in ((), "A", "B", ("crank", "A"))},
    "couple": couple,
    "cylindrical joint that is cut": lambda: cut_at(rscr(), "sleeve"),
    "fixed joint that is cut": lambda: cut_at(glued(), "glue"),
}


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
@pytest.mark.parametrize("case", PRESCRIBED)
def test_forces_of_prescribed_motions_agree_and_wrong_models_fail(case, method):
    model, options, wrong = PRESCRIBED[case]()
    run = driven(model.mechanism, model.forces, method=method, **options)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    checked = {(check.kind, check.subject) for check in verdict.checks}
    assert {("moment", joint) for joint in options.get("cut", ())} <= checked
    for name, other in wrong.items():
        assert crosscheck_driven(run, other).outcome == "failed", name


def with_motor(motor, other, **options):
    """Return a free run of a four-bar with a motor, and with another one."""
    forces = ms.Forces(gravity=(0.3, -9.81, 0.0), motor=motor)
    model = ms.dynamics.dynamic_model(ms.catalog.make("four_bar"), forces)
    return model, {"initial": {}, **options}, changed_forces(model, motor=other)


def coasting(model, wrong=None, **options):
    return model, {"initial": {"crank.v": 60.0}, **options}, wrong


def rubbing_freely(source, *frictions):
    model = changed_forces(rubbing(source, *frictions)[0], flywheel=1e-3)
    return coasting(model, changed_friction(model, coulomb=0.0), duration=0.01, samples=20)


LINE, DC, Geared = ms.motors.TorqueSpeedLine, ms.motors.DCMotor, ms.motors.Geared
START = {"initial": {"crank.q": 0.3, "crank.v": 20.0}, "duration": 0.05, "samples": 10}
# a model, options of its free run, and a wrong model
FREE = {
    "motor": lambda: with_motor(DC(6.0, 2.0, 0.05), DC(5.99, 2.0, 0.05), **START),
    # at its speed before the second record
    "stiff motor": lambda: with_motor(LINE(100.0, 60.0), LINE(100.0, 59.99), turns=0.1, samples=10),
    **{
        f"geared {type(motor).__name__}": partial(
            with_motor, Geared(motor, 9.0), Geared(motor, 9.01), duration=0.02, samples=20
        )
        for motor in (LINE(0.02, 900.0), DC(12.0, 4.0, 0.012))
    },
    "friction of a ball": lambda: rubbing_freely(LINKAGE, ms.Friction("S", 1e-5, 4e-4)),
    "friction of a spatial loop": lambda: rubbing_freely(ms.catalog.make("bennett")),
    "redundant crank": lambda: coasting(three_armed((0.05, 0.03)), turns=0.2, samples=30),
    "redundant loop": lambda: coasting(
        ms.dynamics.dynamic_model(ms.catalog.make("bennett"), ms.Forces()), turns=0.1, samples=30
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("case", FREE)
def test_free_runs_agree_and_wrong_models_fail(case):
    model, options, wrong = FREE[case]()
    result = ms.dynamics.run(model, **options)
    verdict = crosscheck_forward(result, model, initial_values(model, options["initial"]))
    assert verdict.passed, verdict
    assert result.energy_error <= 1e-6
    if wrong is not None:
        start = initial_values(wrong, options["initial"])
        assert crosscheck_forward(result, wrong, start).outcome == "failed"


def test_a_torque_that_is_no_number_is_detected():
    model, options, _ = every_force()
    result = driven(model.mechanism, model.forces, method="pose", **options)
    torque = result.forces.torque.copy()
    torque[5] = np.nan
    broken = replace(result, forces=replace(result.forces, torque=torque))
    assert crosscheck_driven(broken, model).outcome == "diverged"
    assert crosscheck_driven(replace(result, outcome="diverged"), model).outcome == "diverged"


def test_inverse_dynamics_that_is_solved_already_is_compared_if_it_is_of_the_same_instants():
    result = driven(RIGHT, FORCES, speed=60.0, method="pose", samples=24)
    model = ms.dynamics.dynamic_model(LINKAGE, FORCES, mechanism=RIGHT)
    solved = ms.dynamics.prescribed(model, result.motion.angle, speed=60.0, time=result.motion.time)
    assert crosscheck_driven(result, model, solved=solved).passed
    wrong = replace(solved, forces=replace(solved.forces, torque=-solved.forces.torque))
    assert not crosscheck_driven(result, model, solved=wrong).passed
    # of other angles, speeds and inertias, and for a stepped run, it is not used
    others = (
        replace(wrong, forces=replace(wrong.forces, angle=wrong.forces.angle + 1e-9)),
        replace(wrong, forces=replace(wrong.forces, speed=wrong.forces.speed * (1.0 + 1e-9))),
        replace(wrong, forces=replace(wrong.forces, acceleration=wrong.forces.acceleration + 1e-5)),
        replace(wrong, model=replace(model, mechanism=with_inertia(LINKAGE.mechanism, 7000.0))),
    )
    for other in others:
        assert crosscheck_driven(result, model, solved=other).passed
    stepped = driven(RIGHT, FORCES, speed=60.0, method="step", samples=24)
    assert crosscheck_driven(stepped, model, solved=wrong).passed


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
    wrong = changed_link(model, "third", heavier)
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
def test_a_free_run_with_nonlinear_couplings_has_fourth_order():
    model = ms.dynamics.dynamic_model(nonlinear_rocker(), ms.Forces(gravity=(0.3, -9.81, 0.0)))
    errors, initial = [], {"crank.v": 40.0}
    result = ms.dynamics.run(model, initial=initial, duration=0.06, samples=40)
    verdict = crosscheck_forward(result, model, initial_values(model, initial))
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
