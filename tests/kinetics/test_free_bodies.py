"""Mechanisms without drivers: spherical pendulum, tops and free bodies against elliptic functions."""

import numpy as np
import pytest
from model_files import stated_mechanism
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipj, ellipk

import mechsim as ms
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.mechanism.forces import Couple
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.load_profile import constant
from mechsim.studies.dynamics_check import crosscheck_forward

GRAVITY = 9.81
DOWN = ms.Forces(gravity=(0.0, 0.0, -GRAVITY))
# largest error of a run of some periods at the default tolerance of 3e-13 a step
ERROR = 1e-10


def body(mass, centre, moments, kind="spherical"):
    """Return a body on a joint with the ground at its origin."""
    diagonal = tuple(tuple(row) for row in np.diag(moments).astype(float))
    joint = ms.Joint("J", kind, ms.End(GROUND), ms.End("body"))
    link = ms.Link("body", inertia=ms.Inertia(mass, centre, diagonal))
    return ms.Mechanism("body", (link,), (joint,), (), {"P": ("body", (0.0, 0.0, -1.0))})


def between_roots(cubic, start, times):
    """Return z(t) with z'^2 = c (z - z1) (z2 - z) (z3 - z), from z1 or z2, and its two turning points."""
    z1, z2, z3 = np.sort(np.roots(cubic).real)
    m, rate = (z2 - z1) / (z3 - z1), 0.5 * np.sqrt(cubic[0] * (z3 - z1))
    shift = 0.0 if abs(start - z1) < abs(start - z2) else ellipk(m)
    return z1 + (z2 - z1) * ellipj(rate * times + shift, m)[0] ** 2


@pytest.mark.parametrize("moment", [0.0, 0.02])
def test_spherical_pendulum(moment):
    """Height and azimuth against sn^2 and an integral; a point mass has no moment about its line."""
    model = body(1.0, (0.0, 0.0, -1.0), (moment, moment, 0.0))
    angle, azimuthal = 0.7, 2.0
    run = ms.dynamics.run(
        model, DOWN, initial={"J.q": (0.0, -1.0, 0.0, angle), "J.w": (0.0, 0.0, azimuthal)}, duration=3.0
    )
    x, y, z = run.motion.points["P"].position.T
    # with inertia k about the pivot: k z'^2/2 = (e - g z) (1 - z^2) - h^2 / (2 k)
    k, z0 = 1.0 + moment, -np.cos(angle)
    h = k * np.sin(angle) ** 2 * azimuthal
    energy = 0.5 * h * azimuthal + GRAVITY * z0
    cubic = np.array([GRAVITY, -energy, -GRAVITY, energy - h**2 / (2.0 * k)]) * 2.0 / k
    assert np.abs(z - between_roots(cubic, z0, run.time)).max() < ERROR

    def rate(time):
        return h / k / (1.0 - between_roots(cubic, z0, time) ** 2)

    exact = quad(rate, 0.0, run.time[-1], epsabs=1e-13, epsrel=1e-13, limit=200)[0]
    assert abs(np.unwrap(np.arctan2(y, x))[-1] - exact) < ERROR
    assert run.energy_error < ERROR


def test_symmetric_top():
    """Nutation of Lagrange's top against sn^2, and its conserved angular momenta."""
    mass, height, across, along = 2.0, 0.3, 0.2, 0.05
    model = body(mass, (0.0, 0.0, height), (across, across, along))
    angle, spin = 0.5, 30.0
    axis = np.array([np.sin(angle), 0.0, np.cos(angle)])
    run = ms.dynamics.run(
        model, DOWN, initial={"J.q": (0.0, 1.0, 0.0, angle), "J.w": tuple(spin * axis)}, duration=2.0
    )
    link = run.motion.links["body"]
    third = link.rotation[:, :, 2]
    k = across + mass * height**2
    # Goldstein, Classical Mechanics, section 5.7: u'^2 = (1 - u^2) (alpha - beta u) - (b - a u)^2
    a, beta, u0 = along * spin / k, 2.0 * mass * GRAVITY * height / k, np.cos(angle)
    b, alpha = a * u0, beta * u0
    cubic = np.array([beta, -alpha - a**2, 2.0 * a * b - beta, alpha - b**2])
    assert np.abs(third[:, 2] - between_roots(cubic, u0, run.time)).max() < ERROR
    assert np.abs((link.angular_velocity * third).sum(1) - spin).max() < ERROR * spin


def test_kovalevskaya_top():
    """Energy, vertical angular momentum and Kovalevskaya's constant: moments 2, 2, 1 about the pivot."""
    mass, arm = 1.0, 0.15
    # centre on the first axis: moments about it are those of the pivot less m arm^2 about axes 2 and 3
    model = body(mass, (arm, 0.0, 0.0), (0.1, 0.1 - mass * arm**2, 0.05 - mass * arm**2))
    run = ms.dynamics.run(
        model, DOWN, initial={"J.q": (1.0, 2.0, 0.5, 1.1), "J.w": (2.0, -1.0, 3.0)}, duration=5.0
    )
    link = run.motion.links["body"]
    to_body = np.swapaxes(link.rotation, 1, 2)
    p, q, r = (to_body @ link.angular_velocity[..., None])[..., 0].T
    up = to_body[:, :, 2]
    complex_rate, c = p + 1j * q, mass * GRAVITY * arm / 0.05
    kovalevskaya = np.abs(complex_rate**2 - c * (up[:, 0] + 1j * up[:, 1])) ** 2
    vertical = 0.1 * (p * up[:, 0] + q * up[:, 1]) + 0.05 * r * up[:, 2]
    assert np.abs(kovalevskaya / kovalevskaya[0] - 1.0).max() < ERROR
    assert np.abs(vertical - vertical[0]).max() < ERROR
    assert run.energy_error < ERROR


def test_free_asymmetric_body():
    """Euler's equations by Jacobi's functions, several times through the unstable axis, while it drifts."""
    moments = np.array([1.0, 2.0, 3.0])
    start = np.array([0.3, 2.0, 0.2])
    run = ms.dynamics.run(
        body(1.0, (0.0, 0.0, 0.0), moments, "floating"),
        ms.Forces(),
        initial={"J.w": tuple(start), "J.vx": 0.5, "J.z": 2.0},
        duration=12.0,
    )
    link = run.motion.links["body"]
    rates = (np.swapaxes(link.rotation, 1, 2) @ link.angular_velocity[..., None])[..., 0]
    # Landau and Lifshitz, Mechanics, section 37, for L^2 > 2 T I2
    (i1, i2, i3), twice = moments, moments @ start**2
    square = (moments**2) @ start**2
    if square < twice * i2:
        (i1, i3), order = (i3, i1), [2, 1, 0]
    else:
        order = [0, 1, 2]
    amplitudes = np.sqrt(
        [
            (twice * i3 - square) / (i1 * (i3 - i1)),
            (twice * i3 - square) / (i2 * (i3 - i2)),
            (square - twice * i1) / (i3 * (i3 - i1)),
        ]
    )
    m = (i2 - i1) * (twice * i3 - square) / ((i3 - i2) * (square - twice * i1))
    speed = np.sqrt((i3 - i2) * (square - twice * i1) / (i1 * i2 * i3))
    # phase of the start: sn = w2 / amplitude, in the quarter in which cn and dn have the signs of w1 and w3
    phase = quad(lambda s: 1.0 / np.sqrt((1 - s * s) * (1 - m * s * s)), 0.0, start[1] / amplitudes[1])[0]
    # w2' has the sign of (i3 - i1) w3 w1
    direction = np.sign((moments[2] - moments[0]) * start[0] * start[2])
    sn, cn, dn, _ = ellipj(phase + direction * speed * run.time, m)
    exact = np.empty_like(rates)
    exact[:, order] = amplitudes * np.stack([cn, sn, dn], 1)
    assert np.abs(rates - exact).max() < ERROR
    momentum = (link.rotation @ (moments * rates)[..., None])[..., 0]
    assert np.abs(momentum - momentum[0]).max() < ERROR
    assert np.ptp(np.sign(rates[:, 1])) > 0
    assert np.abs(run.motion.joints["J.x"].value - 0.5 * run.time).max() < ERROR


@pytest.mark.long
def test_a_body_that_starts_near_its_unstable_axis():
    """Euler's equations in the body's frame, integrated by scipy: the motion stays in them by itself."""
    moments, start = np.array([1.0, 2.0, 3.0]), np.array([0.01, 5.0, 0.0])

    def rates(_, w):
        return -np.cross(w, moments * w) / moments

    run = ms.dynamics.run(
        body(1.0, (0.0, 0.0, 0.0), moments), ms.Forces(), initial={"J.w": tuple(start)}, duration=10.0
    )
    link = run.motion.links["body"]
    own = (np.swapaxes(link.rotation, 1, 2) @ link.angular_velocity[..., None])[..., 0]
    settings = {"method": "DOP853", "max_step": 0.02, "rtol": 3e-14, "atol": 1e-16}
    exact = solve_ivp(rates, (0.0, 10.0), start, t_eval=run.time, **settings).y.T
    # the start grows to the whole rate several times
    assert np.abs(exact[:, 1]).min() < 1.0
    assert np.abs(exact[:, 0]).max() > 4.0
    # 1.5e-7 where a passage of the axis magnifies errors most; 8e-6 with the tolerance of other joints
    assert np.abs(own - exact).max() < 5e-7
    assert np.abs(own - exact)[-1].max() < 1e-9


def test_rod_that_spins_passively():
    """A dumbbell between two balls has no moment about its line: energy and constraint are in closed form."""
    run = ms.dynamics.run(
        stated_mechanism("free_bodies_rssr.toml"),
        ms.Forces(),
        initial={"crank.v": 3.0},
        duration=1.5,
        samples=60,
    )
    crank, rocker = (run.motion.joints[name] for name in ("crank", "rocker"))
    ends = np.stack(
        [
            0.35 + 0.25 * np.cos(rocker.value) - 0.1 * np.cos(crank.value),
            0.1 - 0.1 * np.sin(crank.value),
            0.1 - 0.25 * np.sin(rocker.value),
        ]
    )
    assert np.abs(np.sqrt((ends**2).sum(0)) - 0.4).max() < 1e-12
    kinetic = 0.5 * ((0.01 + 0.5 * 0.1**2) * crank.rate**2 + (0.01 + 0.5 * 0.25**2) * rocker.rate**2)
    assert np.abs(kinetic - kinetic[0]).max() < ERROR
    assert np.ptp(rocker.value) > 0.3


@pytest.mark.parametrize("kind", ["spherical", "floating"])
def test_mujoco_agrees_and_rejects_another_inertia(kind):
    moments, start = (0.1, 0.2, 0.25), {"J.q": (1.0, 1.0, 0.0, 0.5), "J.w": (1.0, 2.0, 3.0)}
    model = ms.dynamics.dynamic_model(body(1.0, (0.1, 0.0, -0.5), moments, kind), DOWN)
    run = ms.dynamics.run(model, initial=start, duration=0.5, samples=20)
    verdict = crosscheck_forward(run, model, initial_values(model, start))
    assert verdict.passed, str(verdict)
    assert any("orientation" in check.quantity for check in verdict.checks)
    other = ms.dynamics.dynamic_model(body(1.0, (0.1, 0.0, -0.5), (0.1, 0.2, 0.2501), kind), DOWN)
    assert not crosscheck_forward(run, other, initial_values(other, start)).passed


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        ({"J.q": (0.0, 0.0, 0.0, 1.0)}, "axis of length zero"),
        ({"J.q": "1,0,0"}, "X,Y,Z,ANGLE"),
        ({"J.w": "1,0,nan"}, "not a finite number"),
        ({"J.w": (1.0, np.inf, 0.0)}, "finite"),
        ({"J.v": 1.0}, "J.w"),
    ],
)
def test_invalid_initial_rotations(initial, message):
    with pytest.raises(ms.InputError, match=message):
        ms.dynamics.run(body(1.0, (0.0, 0.0, -1.0), (1.0, 1.0, 1.0)), DOWN, initial=initial, duration=1.0)


def test_a_moment_about_a_line_without_inertia_is_rejected():
    twist = ms.Forces(couples=(Couple("body", constant((0.0, 0.0, 1.0))),))
    with pytest.raises(ms.InputError, match="no moment of inertia"):
        ms.dynamics.run(body(1.0, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)), twist, duration=1.0)
