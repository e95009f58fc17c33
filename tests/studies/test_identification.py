"""Masses, friction and motor constants from torques: true values, deviations and combinations."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import FOLDER
from scipy.stats import chi2

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven

LINK = ("mass", "com.x", "com.y", "inertia.zz")
TIMES = np.linspace(0.0, 4.0, 240)
GRAVITY = 9.81

PENDULUM = FOLDER / "identification_pendulum.toml"


def waves(*terms, offset=0.0):
    """Return a sum of sines (amplitude, rate) and its two derivatives."""
    value = offset + sum(a * np.sin(w * TIMES) for a, w in terms)
    rate = sum(a * w * np.cos(w * TIMES) for a, w in terms)
    return value, rate, -sum(a * w * w * np.sin(w * TIMES) for a, w in terms)


def columns(name, state):
    return dict(zip((f"{name}.q", f"{name}.v", f"{name}.a"), state, strict=True))


def pendulum_log(mass, centre, inertia, viscous, coulomb):
    """Return a log by the equation of a pendulum, written out."""
    q, v, a = waves((1.2, 2.1), (0.7, 5.3), offset=0.3)
    moment = (inertia + mass * centre**2) * a + mass * GRAVITY * centre * np.cos(q)
    return {"t": TIMES, **columns("pivot", (q, v, a))}, moment + viscous * v + coulomb * np.sign(v)


def test_a_pendulum_has_two_base_parameters():
    log, torque = pendulum_log(1.3, 0.25, 0.02, 0.05, 0.1)
    result = ms.identify(
        PENDULUM,
        log | {"torque": torque},
        ["bob.mass", "bob.com.x", "bob.inertia.zz", "pivot.viscous", "pivot.coulomb"],
    )
    assert {combination.text: combination.value for combination in result.combinations} == pytest.approx(
        {"bob.mass*com.x": 1.3 * 0.25, "bob.inertia_about_origin.zz": 0.02 + 1.3 * 0.25**2}, rel=1e-9
    )
    assert {name: result.values[name] for name in result.deviations} == pytest.approx(
        {"pivot.viscous": 0.05, "pivot.coulomb": 0.1}, rel=1e-9
    )


def test_the_motor_constant_comes_from_currents_if_a_mass_is_known():
    log, torque = pendulum_log(1.0, 0.2, 0.02, 0.05, 0.1)
    names = ["bob.inertia.zz", "pivot.viscous", "pivot.coulomb", "motor.constant"]
    result = ms.identify(PENDULUM, log | {"current [A]": torque / 0.07}, names)
    assert result.outcome == "fitted"
    assert [*result.values.values()] == pytest.approx([0.02, 0.05, 0.1, 0.07], rel=1e-9)
    with pytest.raises(ms.InputError, match=r"motor constant is unknown; add motor\.constant"):
        ms.identify(PENDULUM, log | {"current": torque / 0.07}, names[:-1])
    # without any known mass, currents determine no scale
    names[:0] = ["bob.mass"]
    assert ms.identify(PENDULUM, log | {"current": torque / 0.07}, names).outcome == "underdetermined"


def test_rates_come_from_positions_if_the_log_has_none():
    log, torque = pendulum_log(1.3, 0.2, 0.02, 0.05, 0.1)
    table = {"t": TIMES, "angle [deg]": np.rad2deg(log["pivot.q"]), "torque": torque, "battery": TIMES}
    result = ms.identify(PENDULUM, table, ["bob.mass", "bob.inertia.zz", "pivot.viscous", "pivot.coulomb"])
    assert [*result.values.values()] == pytest.approx([1.3, 0.02, 0.05, 0.1], rel=0.03)
    assert result.unused == ("battery",)


def test_a_model_without_a_late_load_does_not_predict_the_end_of_the_log():
    log, torque = pendulum_log(1.3, 0.2, 0.001, 0.0, 0.0)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(TIMES))
    fitted = ms.identify(PENDULUM, log | {"torque": torque + noise}, ["bob.mass"])
    assert fitted.outcome == "fitted"
    # Student's t of 179 degrees of freedom
    assert fitted.within_95["bob.mass"] == pytest.approx(1.97331 * fitted.deviations["bob.mass"], rel=1e-5)
    # a load that acts in the last second only
    late = np.where(TIMES > 3.0, 0.5, 0.0)
    result = ms.identify(PENDULUM, log | {"torque": torque + noise + late}, ["bob.mass"])
    assert (result.outcome, result.rows) == ("not predicted", (180, 60))
    assert result.prediction_error["torque:pivot"] == pytest.approx(0.5, rel=0.05)


def turning(time):
    return 2.0 * time + 0.8 * np.sin(3.0 * time), 2.0 + 2.4 * np.cos(3.0 * time), -7.2 * np.sin(3.0 * time)


def shoulder(time):
    return 0.9 * np.sin(1.9 * time), 1.71 * np.cos(1.9 * time), -3.249 * np.sin(1.9 * time)


# model, laws of its drivers, true values, and friction
MACHINES = {
    "arm": (
        "identification_arm.toml",
        {"shoulder": shoulder, "elbow": turning},
        {
            "upper.inertia.zz": 0.02,
            "fore.mass": 1.4,
            "fore.com.x": 0.15,
            "fore.inertia.zz": 0.015,
            "shoulder.viscous": 0.05,
            "shoulder.coulomb": 0.2,
            "elbow.viscous": 0.03,
            "elbow.coulomb": 0.1,
        },
        (ms.Friction("shoulder", viscous=0.05, coulomb=0.2), ms.Friction("elbow", viscous=0.03, coulomb=0.1)),
    ),
    "four_bar": (
        "four_bar",
        {"crank": turning},
        {"coupler.mass": 0.03, "rocker.inertia.zz": 4e-5, "rocker.viscous": 2e-4, "rocker.coulomb": 3e-4},
        (ms.Friction("rocker", viscous=2e-4, coulomb=3e-4),),
    ),
    "slider_crank": (
        "slider_crank",
        {"crank": turning},
        {"rod.mass": 0.2, "slider.mass": 0.4, "slide.viscous": 0.9, "slide.coulomb": 0.6},
        (ms.Friction("slide", viscous=0.9, coulomb=0.6),),
    ),
}


def log_of(case):
    """Return a model, its motion, torques of drivers by MuJoCo with true masses and friction, and these."""
    name, laws, truth, friction = MACHINES[case]
    source = str(FOLDER / name) if "." in name else name
    solver = ms.load(source, drive=laws, duration=float(TIMES[-1]))
    model = ms.dynamics.dynamic_model(solver, ms.Forces(gravity=(0.0, -GRAVITY, 0.0), friction=friction))

    def true_inertia(link):
        x, y, z = link.inertia.centre
        return replace(
            link.inertia,
            mass=truth.get(f"{link.name}.mass", link.inertia.mass),
            centre=(truth.get(f"{link.name}.com.x", x), y, z),
            # of a planar motion only the moment about z counts
            moments=np.eye(3) * truth.get(f"{link.name}.inertia.zz", link.inertia.moments[2][2]),
            rods=None,
        )

    links = tuple(replace(link, inertia=true_inertia(link)) for link in model.mechanism.links)
    run = driven(
        replace(model.mechanism, links=links),
        model.forces,
        motion_laws=solver.motion_laws,
        method="pose",
        samples=len(TIMES) - 1,
    )
    motion = {"t": TIMES} | {
        key: column for driver, law in laws.items() for key, column in columns(driver, law(TIMES)).items()
    }
    return source, motion, {f"torque:{driver}": run.forces.drives[driver] for driver in laws}, truth


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
def test_true_values_are_recovered_without_noise(name):
    model, motion, torques, truth = log_of(name)
    result = ms.identify(model, motion | torques, [*truth])
    assert result.outcome == "fitted"
    assert result.values == pytest.approx(truth, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "four_bar"])
def test_true_values_lie_within_the_stated_intervals_in_95_of_100_logs(name):
    simulated = log_of(name)
    squares, errors = normalised_errors(simulated, range(100))
    within = (np.abs(errors) <= 1.0).sum(0)
    # of 1,000 logs 94.2 to 95.7 % hold for each parameter; of 100, 90 or more in 97 of 100 cases
    assert within.min() >= 90
    assert 0.93 <= within.mean() / 100.0 <= 0.97
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 100 * len(simulated[-1]))
    assert low <= squares.sum() <= high


@pytest.mark.long
def test_closed_loops_have_the_base_parameters_of_a_four_bar():
    """A uniform change of masses along a null direction leaves the torque as it is."""
    _, motion, torques, _ = log_of("four_bar")
    names = [f"{link}.{own}" for link in ("crank", "coupler", "rocker") for own in LINK]
    names += ["rocker.viscous", "rocker.coulomb"]
    result = ms.identify("four_bar", motion | torques, names)
    # of 14 parameters of a planar four-bar, ten combinations move the crank
    assert len(result.combinations) + len(result.deviations) == 10
    # the mass of the coupler acts in its ends A and B: with A at the crank's end, at 32 mm from its pivot
    texts = [combination.text for combination in result.combinations]
    assert any("0.032 coupler.mass" in text and "crank.mass*com.x" in text for text in texts)
    assert any("0.001024 coupler.mass" in text and "crank.inertia_about_origin.zz" in text for text in texts)
