"""Analytic dynamics compared with other formulas, 50 digits and the laws of energy and momentum."""

from dataclasses import replace

import numpy as np
import pytest
from every_force import every_force

from mechsim import catalog, dynamics, load_profile
from mechsim.kinetics import prescribed_motion
from mechsim.kinetics.reduced_equation import kinetic_energy_of_links
from mechsim.mechanism.forces import Forces, Friction, Load
from mechsim.mechanism.links import GROUND, Inertia

GRAVITY = (0.3, -9.81, 2.1)
REVOLUTION = 2.0 * np.pi
FULL = [name for name in catalog.MECHANISMS if catalog.make(name).crank_range().full]
ANGLES = np.linspace(0.1, 6.4, 41)


def with_inertias(mechanism, **inertias):
    links = tuple(replace(link, inertia=inertias.get(link.name, link.inertia)) for link in mechanism.links)
    return replace(mechanism, links=links)


def all_forces(linkage):
    """Return forces of every kind, also at the crank and over its angle."""
    forces = every_force(linkage.mechanism)
    push = load_profile.function(lambda x: np.stack([np.cos(x), x, 1.0 + 0.0 * x], 1), width=3)
    torque = load_profile.function(lambda x: 0.01 + 0.02 * np.cos(x) + 0.03 * np.sin(x))
    return replace(forces, flywheel=2e-5, loads=(Load(forces.loads[0].location, push),), crank_torque=torque)


@pytest.fixture(scope="module", params=FULL)
def linkage(request):
    return catalog.make(request.param)


def test_virtual_power_and_newton_euler_give_the_same_torque(linkage):
    study = dynamics.prescribed(dynamics.dynamic_model(linkage, all_forces(linkage)), ANGLES, 80.0, 900.0)
    scale = np.abs(study.forces.torque).max()
    assert np.abs(study.second_torque - study.forces.torque).max() <= 1e-12 * scale
    assert study.forces.residual.max() <= 1e-12


def test_the_reduced_equation_gives_the_same_torque(linkage):
    forces = replace(all_forces(linkage), loads=(), couples=(), crank_torque=None)
    model = dynamics.dynamic_model(linkage, forces)
    torque = dynamics.prescribed(model, ANGLES, 80.0, 900.0).second_torque
    own = dynamics.reduced(model, ANGLES).torque(80.0, 900.0)
    assert np.abs(own - torque).max() <= 1e-11 * np.abs(torque).max()


def test_forces_of_a_slider_crank_agree_with_a_textbook():
    """Piston force F, rod angle b: torque F r sin(f + b) / cos b, side force F tan b, rod force F / cos b.

    Source: Shigley & Uicker, Theory of Machines and Mechanisms, section on gas and inertia forces.
    """
    linkage = catalog.make("slider_crank", offset=0.0)
    tiny = Inertia(1e-12, (0.0, 0.0, 0.0), (1e-16, 1e-16, 1e-16))
    block = Inertia(2.0, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))
    mechanism = with_inertias(linkage.mechanism, crank=tiny, rod=tiny, slider=block)
    pressure = load_profile.function(
        lambda x: np.stack([-30.0 + 5.0 * np.cos(x), 0.0 * x, 0.0 * x], 1), width=3
    )
    model = dynamics.dynamic_model(linkage, Forces(loads=(Load("B", pressure),)), mechanism=mechanism)
    f = np.linspace(0.2, 6.0, 30)
    study = dynamics.prescribed(model, f, 40.0)
    r, rod = linkage.crank, linkage.rod
    b = np.arcsin(r / rod * np.sin(f))
    pull = linkage.solve(f, 40.0).points["B"].acceleration[:, 0]
    # force on the rod at B along X; the reaction of the slide opposes that of the rod
    piston = -30.0 + 5.0 * np.cos(f) - 2.0 * pull
    torque = piston * r * np.sin(f + b) / np.cos(b)
    assert np.allclose(study.forces.torque, torque, rtol=0.0, atol=1e-9 * np.abs(torque).max())
    side = study.forces.reactions["slide"].force[:, 1]
    assert np.allclose(side, -piston * np.tan(b), rtol=0.0, atol=1e-9 * np.abs(piston).max())
    rod_force = np.linalg.norm(study.forces.reactions["A"].force[:, :2], axis=1)
    assert np.allclose(rod_force, np.abs(piston / np.cos(b)), rtol=0.0, atol=1e-9 * np.abs(piston).max())


def test_shaking_forces_are_the_reactions_on_the_frame(linkage):
    """With the reverse of the drive torque, and moments about the origin."""
    model = dynamics.dynamic_model(linkage, Forces(gravity=GRAVITY))
    f, w = np.array([0.7, 2.3]), 30.0
    study = dynamics.prescribed(model, f, w)
    force, moment = np.zeros((2, 3)), -study.forces.torque[:, None] * linkage.mechanism.crank.a.axis
    for item in study.forces.reactions.values():
        if GROUND in (item.link, item.by):
            sign = -1.0 if item.by == GROUND else 1.0
            force += sign * item.force
            moment += sign * (item.moment + np.cross(item.point, item.force))
    assert np.allclose(study.shaking_force, force, atol=1e-12 * np.abs(force).max())
    assert np.allclose(study.shaking_moment, moment, atol=1e-12 * np.abs(moment).max())
    kinetic = kinetic_energy_of_links(model.unit_motion(f), np.full(2, w))
    assert kinetic == pytest.approx(study.forces.kinetic, rel=1e-14)


def test_planar_mechanisms_have_undetermined_out_of_plane_reactions():
    planar = dynamics.prescribed(dynamics.dynamic_model(catalog.make("four_bar")), [0.5], 10.0)
    assert planar.indeterminacy == 3
    assert all(item.undetermined == ("fz", "mx", "my") for item in planar.forces.reactions.values())
    for name in ("rssr", "rrsrr", "looper"):
        spatial = dynamics.prescribed(dynamics.dynamic_model(catalog.make(name)), [0.5], 10.0)
        assert spatial.indeterminacy == 0
        assert all(item.undetermined == () for item in spatial.forces.reactions.values())


def test_friction_in_a_universal_joint_acts_on_both_angles():
    linkage = catalog.make("rssr", guide=True)
    model = dynamics.dynamic_model(linkage, Forces(friction=(Friction("P2", 1e-3),)))
    f, w, h = np.array([0.6, 3.1]), 20.0, 1e-4
    study = dynamics.prescribed(model, f, w)
    from mechsim.mechanism.joints import joint_coordinate

    def angles(angle):
        poses = model.unit_motion(angle).poses()
        return joint_coordinate(linkage.mechanism.joint("P2"), poses["crank"], poses["coupler"])

    rates = w * (8.0 * (angles(f + h) - angles(f - h)) - angles(f + 2 * h) + angles(f - 2 * h)) / (12.0 * h)
    assert study.forces.power_lost == pytest.approx(1e-3 * (rates**2).sum(1), rel=1e-8)


def test_the_required_flywheel_limits_the_speed_fluctuation():
    model = dynamics.dynamic_model(catalog.make("four_bar"), Forces(gravity=GRAVITY))
    even = dynamics.flywheel_for(model, 20.0, 1e-3)
    kept = dynamics.fluctuation(model.with_forces(replace(model.forces, flywheel=even.flywheel)), 20.0)
    assert kept.coefficient == pytest.approx(1e-3, rel=1e-10)
    assert 1.0 / np.mean(1.0 / kept.speed) == pytest.approx(20.0, rel=1e-12)
    # the textbook's flywheel, from the drive torque at constant speed: excess energy over delta w2
    torque = dynamics.prescribed(model, kept.angle, 20.0).forces.torque
    gained = np.cumsum(torque - torque.mean()) * (REVOLUTION / len(torque))
    rule = np.ptp(gained) / (1e-3 * 20.0**2)
    inertia = dynamics.reduced(model, np.arange(64) * (REVOLUTION / 64)).inertia
    assert even.flywheel + inertia.mean() == pytest.approx(rule, rel=5e-3)
    assert dynamics.flywheel_for(model, 20.0, 5.0).flywheel == 0.0


def test_the_speed_fluctuation_agrees_with_a_free_run():
    model = dynamics.dynamic_model(catalog.make("slider_crank"), Forces(gravity=GRAVITY))
    fluctuation = dynamics.fluctuation(model, 25.0)
    assert fluctuation.torque == pytest.approx(0.0, abs=1e-12)
    run = dynamics.run(
        model, initial={"crank.q": 0.0, "crank.v": float(fluctuation.speed[0])}, turns=1.0, samples=100
    )
    assert run.time[-1] == pytest.approx(REVOLUTION / 25.0, rel=1e-10)
    assert np.ptp(run.motion.speed) / 25.0 == pytest.approx(fluctuation.coefficient, rel=1e-3)


def columns_of(study):
    return {**dict(study.columns()), **study.torque_parts, "second": study.second_torque, "load": study.load}


@pytest.mark.parametrize("name", ["four_bar", "rssr", "warp_knitter", "loop equations"])
def test_batches_of_instants_give_the_same_forces(name, monkeypatch):
    linkage = catalog.make("four_bar" if name == "loop equations" else name)
    source = linkage.mechanism if name == "loop equations" else linkage
    model = dynamics.dynamic_model(source, replace(all_forces(linkage), loads=()))
    # from rest, so that all instants determine the threshold of a crank at rest
    time = np.linspace(0.0, 1.0, len(ANGLES))
    arguments = model, linkage.mechanism.start + 3.0 * time**2, 6.0 * time, 6.0
    whole = dynamics.prescribed(*arguments, time=time)
    monkeypatch.setattr(prescribed_motion, "BATCH_SIZE", 16)
    reported = []
    batches = dynamics.prescribed(
        *arguments, time=time, progress=lambda text, fraction: reported.append((text, fraction))
    )
    assert reported[0] == ("16 of 41 instants", 16 / 41)
    assert [fraction for _, fraction in reported] == [16 / 41, 32 / 41, 1.0]
    columns = columns_of(batches)
    for key, expected in columns_of(whole).items():
        assert columns[key].shape == expected.shape
        # each batch solves the loop equations anew, to rounding
        assert np.abs(columns[key] - expected).max() <= 1e-9 * (1e-3 + np.abs(expected).max())
    assert batches.indeterminacy == whole.indeterminacy
    np.testing.assert_array_equal(batches.forces.sliding, whole.forces.sliding)
    for joint, item in whole.forces.reactions.items():
        np.testing.assert_array_equal(batches.forces.reactions[joint].determined, item.determined)


def test_a_model_is_made_once_for_the_same_mechanism_and_forces():
    solver, weight = catalog.make("four_bar"), Forces(gravity=(0.0, -9.81, 0.0))
    model = dynamics.dynamic_model(solver, weight)
    assert dynamics.dynamic_model(solver, weight) is model
    assert dynamics.dynamic_model(catalog.make("four_bar"), weight).mechanism is not model.mechanism
    assert dynamics.dynamic_model(solver, Forces()).forces.gravity == (0.0, 0.0, 0.0)
