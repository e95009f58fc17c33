"""Masses, friction and motor constants from torques: true values, deviations and combinations."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text
from scipy.stats import chi2

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven

LINK = ("mass", "com.x", "com.y", "inertia.zz")
TIMES = np.linspace(0.0, 4.0, 240)
GRAVITY = 9.81

PENDULUM = model_text("identification_pendulum.toml")
ARM = model_text("identification_arm.toml")


def waves(*terms, offset=0.0):
    """Return a sum of sines (amplitude, rate) and its two derivatives."""
    value = offset + sum(a * np.sin(w * TIMES) for a, w in terms)
    rate = sum(a * w * np.cos(w * TIMES) for a, w in terms)
    return value, rate, -sum(a * w * w * np.sin(w * TIMES) for a, w in terms)


def columns(name, state):
    return dict(zip((f"{name}.q", f"{name}.v", f"{name}.a"), state, strict=True))


@pytest.fixture
def pendulum(tmp_path):
    path = tmp_path / "pendulum.toml"
    path.write_text(PENDULUM)
    return path


def pendulum_log(mass, centre, inertia, viscous, coulomb):
    """Return a log by the equation of a pendulum, written out."""
    q, v, a = waves((1.2, 2.1), (0.7, 5.3), offset=0.3)
    moment = (inertia + mass * centre**2) * a + mass * GRAVITY * centre * np.cos(q)
    return {"t": TIMES, **columns("pivot", (q, v, a))}, moment + viscous * v + coulomb * np.sign(v)


def test_a_pendulum_has_two_base_parameters(pendulum):
    log, torque = pendulum_log(1.3, 0.25, 0.02, 0.05, 0.1)
    result = ms.identify(
        pendulum,
        log | {"torque": torque},
        ["bob.mass", "bob.com.x", "bob.inertia.zz", "pivot.viscous", "pivot.coulomb"],
    )
    assert {combination.text: combination.value for combination in result.combinations} == pytest.approx(
        {"bob.mass*com.x": 1.3 * 0.25, "bob.inertia_about_origin.zz": 0.02 + 1.3 * 0.25**2}, rel=1e-9
    )
    assert {name: result.values[name] for name in result.deviations} == pytest.approx(
        {"pivot.viscous": 0.05, "pivot.coulomb": 0.1}, rel=1e-9
    )


def test_the_motor_constant_comes_from_currents_if_a_mass_is_known(pendulum):
    log, torque = pendulum_log(1.0, 0.2, 0.02, 0.05, 0.1)
    names = ["bob.inertia.zz", "pivot.viscous", "pivot.coulomb", "motor.constant"]
    result = ms.identify(pendulum, log | {"current [A]": torque / 0.07}, names)
    assert result.outcome == "fitted"
    assert [*result.values.values()] == pytest.approx([0.02, 0.05, 0.1, 0.07], rel=1e-9)
    with pytest.raises(ms.InputError, match=r"motor constant is unknown; add motor\.constant"):
        ms.identify(pendulum, log | {"current": torque / 0.07}, names[:-1])
    # without any known mass, currents determine no scale
    names[:0] = ["bob.mass"]
    assert ms.identify(pendulum, log | {"current": torque / 0.07}, names).outcome == "underdetermined"


def test_rates_come_from_positions_if_the_log_has_none(pendulum):
    log, torque = pendulum_log(1.3, 0.2, 0.02, 0.05, 0.1)
    table = {"t": TIMES, "angle [deg]": np.rad2deg(log["pivot.q"]), "torque": torque, "battery": TIMES}
    result = ms.identify(pendulum, table, ["bob.mass", "bob.inertia.zz", "pivot.viscous", "pivot.coulomb"])
    assert [*result.values.values()] == pytest.approx([1.3, 0.02, 0.05, 0.1], rel=0.03)
    assert result.unused == ("battery",)


def test_a_model_without_a_late_load_does_not_predict_the_end_of_the_log(pendulum):
    log, torque = pendulum_log(1.3, 0.2, 0.001, 0.0, 0.0)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(TIMES))
    fitted = ms.identify(pendulum, log | {"torque": torque + noise}, ["bob.mass"])
    assert fitted.outcome == "fitted"
    # Student's t of 179 degrees of freedom
    assert fitted.within_95["bob.mass"] == pytest.approx(1.97331 * fitted.deviations["bob.mass"], rel=1e-5)
    # a load that acts in the last second only
    late = np.where(TIMES > 3.0, 0.5, 0.0)
    result = ms.identify(pendulum, log | {"torque": torque + noise + late}, ["bob.mass"])
    assert (result.outcome, result.rows) == ("not predicted", (180, 60))
    assert result.prediction_error["torque:pivot"] == pytest.approx(0.5, rel=0.05)


def arm_log(parameters):
    """Return a log by the equations of a planar arm of two links of 0.3 m and more, written out."""
    shoulder = waves((0.9, 1.9), (0.4, 4.4), offset=0.2)
    elbow = waves((0.8, 2.7), (0.5, 5.9), offset=-0.6)
    (q1, v1, a1), (q2, v2, a2) = shoulder, elbow
    m1, m2, c1, c2, i1, i2 = parameters
    length = 0.3
    outer = i2 + m2 * c2**2
    coupled = m2 * length * c2
    weight2 = m2 * GRAVITY * c2 * np.cos(q1 + q2)
    torque1 = (
        (i1 + m1 * c1**2 + m2 * length**2 + outer + 2.0 * coupled * np.cos(q2)) * a1
        + (outer + coupled * np.cos(q2)) * a2
        - coupled * np.sin(q2) * (2.0 * v1 * v2 + v2**2)
        + (m1 * c1 + m2 * length) * GRAVITY * np.cos(q1)
        + weight2
    )
    torque2 = (outer + coupled * np.cos(q2)) * a1 + outer * a2 + coupled * np.sin(q2) * v1**2 + weight2
    friction = {"shoulder": 0.05 * v1 + 0.2 * np.sign(v1), "elbow": 0.03 * v2 + 0.1 * np.sign(v2)}
    motion = {"t": TIMES, **columns("shoulder", shoulder), **columns("elbow", elbow)}
    return motion, {
        "torque:shoulder": torque1 + friction["shoulder"],
        "torque:elbow": torque2 + friction["elbow"],
    }


ARM_TRUTH = {
    "upper.com.x": 0.12,
    "upper.inertia.zz": 0.02,
    "fore.mass": 1.4,
    "fore.com.x": 0.15,
    "fore.inertia.zz": 0.015,
    "shoulder.viscous": 0.05,
    "shoulder.coulomb": 0.2,
    "elbow.viscous": 0.03,
    "elbow.coulomb": 0.1,
}


def arm(folder):
    (folder / "arm.toml").write_text(ARM)
    motion, torques = arm_log((1.0, 1.4, 0.12, 0.15, 0.02, 0.015))
    # the shoulder carries the mass of the forearm at the elbow, as it carries its own
    truth = {name: value for name, value in ARM_TRUTH.items() if name != "upper.com.x"}
    model = ARM.replace("centre = [0.1, 0, 0]", "centre = [0.12, 0, 0]", 1)
    (folder / "arm.toml").write_text(model)
    return folder / "arm.toml", motion, torques, truth


def crank_motion(time):
    return 2.0 * time + 0.8 * np.sin(3.0 * time), 2.0 + 2.4 * np.cos(3.0 * time), -7.2 * np.sin(3.0 * time)


def by_mujoco(name, truth, friction, gravity):
    """Return a function that makes the log of a crank that MuJoCo drives, with other masses and friction."""

    def simulated(folder):
        del folder
        duration = float(TIMES[-1])
        solver = ms.load(name, drive={"crank": crank_motion}, duration=duration)
        model = ms.dynamics.dynamic_model(solver, ms.Forces(gravity=gravity, friction=friction))
        links = tuple(
            replace(
                link,
                inertia=replace(
                    link.inertia,
                    mass=truth.get(f"{link.name}.mass", link.inertia.mass),
                    # of a planar motion only the moment about z counts
                    moments=np.eye(3) * truth.get(f"{link.name}.inertia.zz", link.inertia.moments[2][2]),
                    rods=None,
                ),
            )
            for link in model.mechanism.links
        )
        mechanism = replace(model.mechanism, links=links)
        run = driven(
            mechanism, model.forces, motion_laws=solver.motion_laws, method="pose", samples=len(TIMES) - 1
        )
        motion = {"t": TIMES, **columns("crank", crank_motion(TIMES))}
        return name, motion, {"torque:crank": run.forces.drives["crank"]}, truth

    return simulated


MACHINES = {
    "arm": arm,
    "four_bar": by_mujoco(
        "four_bar",
        {"coupler.mass": 0.03, "rocker.inertia.zz": 4e-5, "rocker.viscous": 2e-4, "rocker.coulomb": 3e-4},
        (ms.Friction("rocker", viscous=2e-4, coulomb=3e-4),),
        (0.0, -GRAVITY, 0.0),
    ),
    "slider_crank": by_mujoco(
        "slider_crank",
        {"rod.mass": 0.2, "slider.mass": 0.4, "slide.viscous": 0.9, "slide.coulomb": 0.6},
        (ms.Friction("slide", viscous=0.9, coulomb=0.6),),
        (0.0, -GRAVITY, 0.0),
    ),
}
NOISE = 0.02


def normalised_errors(simulated, seeds):
    """Return squared errors in units of their covariance, and errors by half the intervals, for each seed."""
    model, motion, torques, truth = simulated
    squares, errors = [], []
    for seed in seeds:
        random = np.random.default_rng(seed)
        noisy = {
            name: torque + NOISE * np.abs(torque).max() * random.standard_normal(len(TIMES))
            for name, torque in torques.items()
        }
        result = ms.identify(model, motion | noisy, [*truth])
        assert result.outcome == "fitted"
        error = np.array([result.values[name] - value for name, value in truth.items()])
        squares.append(error @ np.linalg.solve(np.array(result.covariance), error))
        errors.append(error / [result.within_95[name] for name in truth])
    return np.array(squares), np.array(errors)


@pytest.mark.long
@pytest.mark.parametrize("name", MACHINES)
def test_true_values_are_recovered_without_noise(name, tmp_path):
    model, motion, torques, truth = MACHINES[name](tmp_path)
    result = ms.identify(model, motion | torques, [*truth])
    assert result.outcome == "fitted"
    assert result.values == pytest.approx(truth, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "four_bar"])
def test_true_values_lie_within_the_stated_intervals_in_95_of_100_logs(name, tmp_path):
    simulated = MACHINES[name](tmp_path)
    squares, errors = normalised_errors(simulated, range(100))
    within = (np.abs(errors) <= 1.0).sum(0)
    # of 1,000 logs 94.2 to 95.7 % hold for each parameter; of 100, 90 or more in 97 of 100 cases
    assert within.min() >= 90
    assert 0.93 <= within.mean() / 100.0 <= 0.97
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 100 * len(simulated[-1]))
    assert low <= squares.sum() <= high


@pytest.mark.long
def test_closed_loops_have_the_base_parameters_of_a_four_bar(tmp_path):
    """A uniform change of masses along a null direction leaves the torque as it is."""
    _, motion, torques, _ = MACHINES["four_bar"](tmp_path)
    names = [f"{link}.{own}" for link in ("crank", "coupler", "rocker") for own in LINK]
    names += ["rocker.viscous", "rocker.coulomb"]
    result = ms.identify("four_bar", motion | torques, names)
    # of 14 parameters of a planar four-bar, ten combinations move the crank
    assert len(result.combinations) + len(result.deviations) == 10
    # the mass of the coupler acts in its ends A and B: with A at the crank's end, at 32 mm from its pivot
    texts = [combination.text for combination in result.combinations]
    assert any("0.032 coupler.mass" in text and "crank.mass*com.x" in text for text in texts)
    assert any("0.001024 coupler.mass" in text and "crank.inertia_about_origin.zz" in text for text in texts)


@pytest.mark.parametrize(
    ("change", "vary", "message"),
    [
        ({"t": None}, ["bob.mass"], "has no column t"),
        ({"t": np.zeros(240)}, ["bob.mass"], "must increase"),
        ({"torque": None}, ["bob.mass"], "has no column torque:J or current:J with J of pivot"),
        ({}, ["bbo.mass"], "did you mean 'bob.mass'"),
        ({"pivot.q": None}, ["bob.mass"], r"has no column pivot\.q"),
    ],
)
def test_invalid_logs_are_rejected(pendulum, change, vary, message):
    log, torque = pendulum_log(1.3, 0.25, 0.02, 0.05, 0.1)
    table = {
        name: column for name, column in {**log, "torque": torque, **change}.items() if column is not None
    }
    with pytest.raises(ms.InputError, match=message):
        ms.identify(pendulum, table, vary)


def test_friction_by_the_load_is_not_linear(pendulum):
    pendulum.write_text(PENDULUM + "friction.pivot = { coefficient = 0.1, pin_radius = 0.01 }\n")
    log, torque = pendulum_log(1.3, 0.25, 0.02, 0.05, 0.1)
    with pytest.raises(ms.InputError, match="friction by load or rate, in pivot, is not part of"):
        ms.identify(pendulum, log | {"torque": torque}, ["bob.mass"])
