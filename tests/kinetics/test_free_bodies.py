"""Mechanisms without drivers: spherical pendulum, tops and free bodies against elliptic functions."""

import numpy as np
import pytest
from model_files import stated_mechanism
from scipy.integrate import solve_ivp

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


# a body that drifts and turns through its unstable axis, and one that starts near that axis: errors of 1.5e-7
# where a passage of the axis magnifies them most, 8e-6 with the tolerance of other joints
@pytest.mark.parametrize(
    ("kind", "start", "drift", "tolerance"),
    [
        ("floating", (0.3, 2.0, 0.2), {"J.vx": 0.5, "J.z": 2.0}, ERROR),
        pytest.param("spherical", (0.01, 5.0, 0.0), {}, 5e-7, marks=pytest.mark.long),
    ],
)
def test_an_asymmetric_body_turns_by_eulers_equations(kind, start, drift, tolerance):
    """In the body's frame, integrated by scipy: the motion stays in them by itself."""
    moments = np.array([1.0, 2.0, 3.0])
    model = body(1.0, (0.0, 0.0, 0.0), moments, kind)
    run = ms.dynamics.run(model, ms.Forces(), initial={"J.w": start} | drift, duration=10.0)
    link = run.motion.links["body"]
    own = (np.swapaxes(link.rotation, 1, 2) @ link.angular_velocity[..., None])[..., 0]
    settings = {"method": "DOP853", "max_step": 0.02, "rtol": 3e-14, "atol": 1e-16}
    exact = solve_ivp(
        lambda _, w: -np.cross(w, moments * w) / moments, (0.0, 10.0), start, t_eval=run.time, **settings
    ).y.T
    assert np.ptp(np.sign(exact[:, 1])) > 0
    assert np.abs(own - exact).max() < tolerance
    assert np.abs(own - exact)[-1].max() < 1e-9
    momentum = (link.rotation @ (moments * own)[..., None])[..., 0]
    assert np.abs(momentum - momentum[0]).max() < 10.0 * tolerance
    if drift:
        assert np.abs(run.motion.joints["J.x"].value - 0.5 * run.time).max() < ERROR


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
