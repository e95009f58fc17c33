"""The basic constraints as joints: a rod, a point on a line or plane, parallel and perpendicular axes."""

import mpmath
import mujoco
import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.kinetics import dynamic_model, prescribed
from mechsim.simulation.dynamics.prescribed_motion import driven

POINT = "inertia = { mass = 0.1, centre = [0, 0, 0], moments = [1e-5, 1e-5, 1e-5] }"


def rod(name, a, b, length):
    return f'[joints.{name}]\nkind = "distance"\nlength = {length}\na = {{ {a} }}\nb = {{ {b} }}\n'


def load(folder, text, **options):
    path = folder / "model.toml"
    path.write_text(text)
    return ms.load(str(path), **options)


def peaucellier(long, short, radius):
    """Return Peaucellier's linkage as six rods between the ground, the crank and three particles."""
    crank = f'link = "crank", at = [{radius}, 0, 0]'
    texts = [
        f"""name = "peaucellier"
drivers = ["crank"]
start = "20 deg"
motion_laws.crank = "20deg + 20deg*sin(2*pi*t)"
locked = {{ A = {{ turn = 0 }}, B = {{ turn = 0 }}, D = {{ turn = 0 }} }}
[links.crank]
outline = [[0, 0, 0], [{radius}, 0, 0]]
[joints.crank]
kind = "revolute"
a = {{ link = "ground", at = [{radius}, 0, 0] }}
b = {{ link = "crank" }}
"""
    ]
    for name, x, y in (("A", 0.083, 0.055), ("B", 0.097, -0.023), ("D", 0.093, 0.016)):
        texts.append(f'[links.{name}]\n{POINT}\n[points.{name}]\nlink = "{name}"\n')
        texts.append(f'[joints.{name}]\nkind = "planar"\na.link = "ground"\nb.link = "{name}"\n')
        texts.append(f"[guess.{name}]\nat = [{x}, {y}, 0]\n")
    for name in "AB":
        texts.append(rod(f"O{name}", 'link = "ground"', f'link = "{name}"', long))
        texts.append(rod(f"C{name}", crank, f'link = "{name}"', short))
        texts.append(rod(f"D{name}", 'link = "D"', f'link = "{name}"', short))
    return "".join(texts)


@pytest.mark.long
def test_peaucelliers_linkage_of_rods_draws_a_straight_line_by_both_methods(tmp_path):
    model = load(tmp_path, peaucellier(0.1, 0.04, 0.045))
    motion = model.solve(t=np.linspace(0.0, 1.0, 73))
    # inversion of the circle through O: OC * OD = L^2 - s^2
    assert np.abs(motion.points["D"].position[:, 0] - (0.1**2 - 0.04**2) / (2 * 0.045)).max() < 1e-15
    assert np.ptp(motion.points["D"].position[:, 1]) > 0.03
    assert ms.validate(model).passed


FOUR_BAR = model_text(
    "basic_constraints_four_bar.toml",
    rod=rod("rod", 'link = "crank", at = [0.03, 0, 0]', 'link = "rocker", at = [0.06, 0, 0]', 0.09),
)


def rocker_angle(theta):
    """Return the rocker's angle of the four-bar of lengths 0.1, 0.03, 0.09, 0.06 m, by two circles."""
    x, y = mpmath.mpf("0.1") - 0.03 * mpmath.cos(theta), -0.03 * mpmath.sin(theta)
    squared = x**2 + y**2
    cosine = (mpmath.mpf("0.09") ** 2 - squared - mpmath.mpf("0.06") ** 2) / (
        2 * mpmath.mpf("0.06") * mpmath.sqrt(squared)
    )
    return mpmath.atan2(y, x) + mpmath.acos(cosine)


def test_a_rod_transmits_the_force_that_its_rocker_needs(tmp_path):
    model, speed = load(tmp_path, FOUR_BAR), 20.0
    angles = np.linspace(0.3, 6.0, 7)
    forces = prescribed(dynamic_model(model), angles, speed, 0.0).forces
    reaction = forces.reactions["rod"]
    for i, theta in enumerate(angles):
        with mpmath.workdps(30):
            phi = float(rocker_angle(theta))
            second = speed**2 * float(mpmath.diff(rocker_angle, theta, 2))
        tip = 0.06 * np.array([np.cos(phi), np.sin(phi)])
        along = np.array([0.1, 0.0]) + tip - 0.03 * np.array([np.cos(theta), np.sin(theta)])
        along /= 0.09
        # moments about the rocker's pin: inertia and weight against the force along the massless rod
        needed = (1e-4 + 0.4 * 0.03**2) * second + 0.4 * 9.81 * 0.03 * np.cos(phi)
        tension = needed / (tip[0] * along[1] - tip[1] * along[0])
        assert np.abs(reaction.force[i] - [*(tension * along), 0.0]).max() < 1e-11 * abs(tension)
    assert np.abs(reaction.moment).max() < 1e-15
    for method in ("pose", "step"):
        by_mujoco = driven(model, speed=speed, turns=1, method=method).forces
        own = prescribed(dynamic_model(model), by_mujoco.angle, speed, 0.0).forces.reactions["rod"].force
        # 1000 Runge-Kutta steps; solved poses are exact
        limit = 1e-9 if method == "pose" else 1e-6
        worst = np.abs(by_mujoco.reactions["rod"].force - own).max()
        assert worst < limit * np.abs(own).max()


@pytest.mark.long
def test_a_body_on_a_single_rod_is_a_spherical_pendulum(tmp_path):
    text = f'name = "pendulum"\n[links.bob]\n{POINT}\n[points.P]\nlink = "bob"\n'
    text += rod("rod", 'link = "ground"', 'link = "bob"', 0.5)
    text += f"[guess.bob]\nat = [0.3, -0.3, {0.07**0.5!r}]\n"
    start = {"rod.x.v": 0.9, "rod.y.v": 0.9}
    result = ms.dynamics.run(load(tmp_path, text, still=True), initial=start, duration=2.0, tolerance=1e-10)

    def rates(_, state):
        p, v, g = state[:3], state[3:], np.array([0.0, -9.81, 0.0])
        return [*v, *(g - p * (v @ v + p @ g) / (p @ p))]

    exact = solve_ivp(
        rates, (0.0, 2.0), [0.3, -0.3, 0.07**0.5, 0.9, 0.9, 0.0], "DOP853", rtol=1e-13, atol=1e-14
    )
    assert np.abs(result.motion.points["P"].position[-1] - exact.y[:3, -1]).max() < 1e-11


LADDER = model_text("basic_constraints_ladder.toml", point=POINT)


def test_a_ladder_leans_on_a_line_with_the_normal_force_of_its_moments(tmp_path):
    model = load(tmp_path, LADDER)
    assert ms.validate(model).passed
    times = np.array([0.05, 0.3, 0.7])
    result = prescribed(dynamic_model(model), t=times)
    for i, t in enumerate(times):
        with mpmath.workdps(30):

            def angle(s):
                return mpmath.acos(-(0.3 + 0.2 * mpmath.sin(2 * mpmath.pi * s)))

            phi, second = float(angle(t)), float(mpmath.diff(angle, t, 2))
            drawn = float(mpmath.diff(lambda s: mpmath.cos(angle(s)), t, 2))
            lifted = float(mpmath.diff(lambda s: mpmath.sin(angle(s)), t, 2))
        # centre (-cos/2, sin/2) from the wall; wall force N along x on the top, foot force (X, Y)
        # N = m x'' - X, Y = m (y'' + g); moments about the centre
        x, y = 2 * -0.5 * drawn, 2 * (0.5 * lifted + 9.81)
        half = 0.5 * np.array([np.cos(phi), np.sin(phi)])
        wall = (0.16 * second + half[0] * y - half[1] * x) / (-2.0 * half[1])
        force = result.forces.reactions["wall"].force[i]
        assert np.abs(force[:2] - [wall, 0.0]).max() < 1e-11 * abs(wall)


HUNG = model_text(
    "basic_constraints_hung.toml",
    point=POINT,
    post=rod("post", 'link = "ground", at = [0, 0.05, -0.08]', 'link = "bob"', 0.09),
    arm=rod("arm", 'link = "crank", at = [0.03, 0, 0]', 'link = "bob"', 0.09),
)


def test_axes_keep_their_angles_and_a_point_its_plane(tmp_path):
    model = load(tmp_path, HUNG)
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
