"""Mechanisms without drivers: spherical pendulum, tops and free bodies against elliptic functions."""

import numpy as np
import pytest
from model_files import stated_mechanism
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipj

import mechsim as ms
from mechsim.mechanism.links import GROUND

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
