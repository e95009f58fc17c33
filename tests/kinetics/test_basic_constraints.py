"""The basic constraints as joints: a rod, a point on a line or plane, parallel and perpendicular axes."""

import mujoco
import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms

POINT = "inertia = { mass = 0.1, centre = [0, 0, 0], moments = [1e-5, 1e-5, 1e-5] }"


def rod(name, a, b, length):
    return f'[joints.{name}]\nkind = "distance"\nlength = {length}\na = {{ {a} }}\nb = {{ {b} }}\n'


@pytest.mark.long
def test_peaucelliers_linkage_of_rods_draws_a_straight_line_by_both_methods():
    model = ms.load("peaucellier_rods", drive={"crank": "20deg*sin(2*pi*t)"})
    point = model.solve(t=np.linspace(0.0, 1.0, 73)).points["P"].position
    # inversion of the circle through O: OQ * OP = L^2 - s^2
    assert np.abs(point[:, 0] - (0.08**2 - 0.03**2) / (2 * 0.03)).max() < 1e-15
    assert np.ptp(point[:, 1]) > 0.03
    assert ms.validate(model).passed


@pytest.mark.long
def test_a_body_on_a_single_rod_is_a_spherical_pendulum(file):
    text = f'name = "pendulum"\n[links.bob]\n{POINT}\n[points.P]\nlink = "bob"\n'
    text += rod("rod", 'link = "ground"', 'link = "bob"', 0.5)
    text += f"[guess.bob]\nat = [0.3, -0.3, {0.07**0.5!r}]\n"
    start = {"rod.x.v": 0.9, "rod.y.v": 0.9}
    result = ms.dynamics.run(ms.load(file(text), still=True), initial=start, duration=2.0, tolerance=1e-10)

    def rates(_, state):
        p, v, g = state[:3], state[3:], np.array([0.0, -9.81, 0.0])
        return [*v, *(g - p * (v @ v + p @ g) / (p @ p))]

    exact = solve_ivp(
        rates, (0.0, 2.0), [0.3, -0.3, 0.07**0.5, 0.9, 0.9, 0.0], "DOP853", rtol=1e-13, atol=1e-14
    )
    assert np.abs(result.motion.points["P"].position[-1] - exact.y[:3, -1]).max() < 1e-11


HUNG = model_text(
    "basic_constraints_hung.toml",
    point=POINT,
    post=rod("post", 'link = "ground", at = [0, 0.05, -0.08]', 'link = "bob"', 0.09),
    arm=rod("arm", 'link = "crank", at = [0.03, 0, 0]', 'link = "bob"', 0.09),
)


def test_axes_keep_their_angles_and_a_point_its_plane(file):
    model = ms.load(file(HUNG))
    assert ms.validate(model).passed
    angles = np.linspace(0.0, 6.0, 20)
    link = model.solve(angles, speed=1.0).links["bob"]
    assert np.abs(link.rotation[:, :, 2] @ [1.0, 0.0, 0.0] - 0.5).max() < 1e-14
    assert np.abs(link.rotation[:, :, 1] - [0.0, 1.0, 0.0]).max() < 1e-14
    # two circles in the plane y = 0
    ends = 0.03 * np.stack([np.cos(angles), np.zeros(20)], 1)
    first, second = np.sqrt(0.09**2 - 0.05**2), np.sqrt(0.09**2 - (0.03 * np.sin(angles)) ** 2)
    middle = np.array([0.0, -0.08])
    gap = ends - middle
    distance = np.linalg.norm(gap, axis=1)
    along = (distance**2 + first**2 - second**2) / (2 * distance)
    across = np.sqrt(first**2 - along**2)
    unit = gap / distance[:, None]
    exact = middle + along[:, None] * unit + across[:, None] * np.stack([unit[:, 1], -unit[:, 0]], 1)
    assert np.abs(link.position[:, [0, 2]] - exact).max() < 1e-14


def test_a_tendon_of_a_file_that_keeps_its_length_is_a_rod():
    text = model_text("basic_constraints_text.xml")
    model = ms.load(mujoco.MjSpec.from_string(text))
    (joint,) = (joint for joint in model.mechanism.joints if joint.name == "rod")
    assert (joint.kind, joint.length) == ("distance", pytest.approx(np.hypot(0.07, 0.06) + 0.001, abs=1e-15))
    motion = model.solve([0.0, 0.2], speed=1.0)
    ends = [motion.points[name].position for name in "PQ"]
    assert np.abs(np.linalg.norm(ends[0] - ends[1], axis=1) - joint.length).max() < 1e-15
