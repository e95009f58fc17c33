"""Laws of motion of all mechanisms of the catalogue and the gallery, and of all joints, by every method.

Derivatives are differences of eighth order inside the test, and distances are those of the description.
"""

from functools import cache

import driven_mechanisms as machines
import mechanisms as kinds
import numpy as np
import pytest
from loop_laws import rates_by_six_coordinates
from model_files import model_mechanism
from strategies import EPS

import mechsim as ms
from mechsim.io import gallery
from mechsim.io.toml_writer import to_toml
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.masses import with_inertia
from mechsim.mechanism.motion_laws import make_motion_laws
from mechsim.simulation import simulate

# couplings by functions have tests of their own (test_coupling_functions.py, test_toml_cams.py)
BY_FUNCTION = {"cam_follower", "geneva_drive"}
WITHOUT_GEARS = [*kinds.everything(), model_mechanism("rates_are_derivatives_rocking_slide.toml")]
# swapping the sides of a coupled joint would reverse its coupling
KINDS = {item.name: item for item in WITHOUT_GEARS}
KINDS |= {f"{item.name}, sides swapped": kinds.swapped(item) for item in WITHOUT_GEARS}
KINDS |= {"rack and cam": machines.rack_and_cam(), "press": machines.press()}
KINDS |= {
    name: model_mechanism(f"rates_are_derivatives_{name}.toml") for name in ("bevel_wheels", "racks", "plate")
}
WAVES = {
    "driven five-bar": (machines.five_bar(), {"left": (2.0, 0.3, 6.0, 0.2), "right": (1.0, 0.4, 9.0, 1.0)}),
    "driven boom": (machines.boom(), {"stroke": (0.8, 0.1, 2.0)}),
    "plate on a tool": (machines.table(backwards=False), {"tool": (0.0, 1.0, 3.0)}),
    "plate on a tool, sides swapped": (machines.table(backwards=True), {"tool": (0.0, 1.0, 3.0)}),
}
CATALOGUE = [name for name in (*ms.catalog.MECHANISMS, *gallery.files()) if name not in BY_FUNCTION]
NAMES = [*CATALOGUE, *KINDS, *WAVES]
STEP, MIDDLE, SPEED, ACCELERATION = 2e-3, 4, 1.3, -2.1
WEIGHTS = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
# their loops have many bodies or many redundant equations
COSTLY = ("peaucellier_lipkin", "parallel_gripper", "stewart_gough", "delta_robot")
mechanisms = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in COSTLY else name for name in NAMES]
)


@cache
def solver_of(name):
    """Return the solver of a mechanism."""
    if name in CATALOGUE:
        return ms.load(name)
    if name in KINDS:
        return KinematicSolver(KINDS[name])
    mechanism, waves = WAVES[name]
    laws = {driver: machines.sinusoidal(*wave) for driver, wave in waves.items()}
    return KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, laws, 2.0))


def reachable(solver):
    """Return an interval of crank angles; polynomials of polynomials keep a plate near its start."""
    start = solver.mechanism.start
    return (start, start + 0.5) if solver.mechanism.name == "plate" else solver.crank_range().arcs[0]


def instants(solver):
    """Return the arguments of `solve` for nine instants, and their step."""
    if not solver.motion_laws.crank:
        end = solver.motion_laws.duration
        return {"t": 0.37 * end + 1e-3 * end * (np.arange(9) - MIDDLE)}, 1e-3 * end
    low, high = reachable(solver)
    time = STEP * (np.arange(9) - MIDDLE)
    angles = 0.6 * low + 0.4 * high + SPEED * time + 0.5 * ACCELERATION * time**2
    return {"angles": angles, "speed": SPEED + ACCELERATION * time, "acceleration": ACCELERATION}, STEP


@cache
def motion(name):
    """Return a solver, its motion at nine instants, and their step."""
    solver = solver_of(name)
    arguments, step = instants(solver)
    return solver, solver.solve(**arguments), step


def assert_derivative(rate, values, step, terms=0.0):
    """Check a rate by differences of values, which round as terms whose sizes add up to `terms`."""
    expected = np.tensordot(WEIGHTS, values, 1) / step
    scale = max(np.abs(expected).max(), np.ptp(values, axis=0).max() / step, 1e-3)
    rounding = np.abs(WEIGHTS).sum() * np.finfo(float).eps * terms / step
    assert np.abs(rate[MIDDLE] - expected).max() <= 1e-9 * scale + rounding


@mechanisms
def test_rates_are_derivatives(name):
    _, result, step = motion(name)
    for item in (*result.points.values(), *result.links.values()):
        assert_derivative(item.velocity, item.position, step)
        assert_derivative(item.acceleration, item.velocity, step)
    # rates of links and dependent joints are sums of joint rates, zero for a plate that only shifts
    turns = sum(np.abs(joint.rate).max() for joint in result.joints.values())
    for link in result.links.values():
        change = np.tensordot(WEIGHTS, link.rotation, 1) / step @ link.rotation[MIDDLE].T
        spin = link.angular_velocity[MIDDLE]
        assert np.abs(change - np.cross(np.eye(3), spin)).max() <= 1e-9 * max(np.abs(spin).max(), 1.0)
        assert_derivative(link.angular_acceleration, link.angular_velocity, step, turns)
    for joint in result.joints.values():
        assert_derivative(joint.rate, np.unwrap(joint.value), step)
        assert_derivative(joint.acceleration, joint.rate, step, turns)


@mechanisms
def test_loops_close_and_points_keep_their_places_on_links(name):
    solver, result, _ = motion(name)
    length = solver.mechanism.characteristic_length
    poses = {link: ms.Pose(item.position, item.rotation) for link, item in result.links.items()}
    driver = solver.mechanism.drivers[0]
    angles = result.angle if solver.motion_laws.crank else result.joints[driver].value
    gaps, orientations = ms.loops.residual_norms(solver.mechanism, poses, angles)
    assert gaps.max() <= 64 * EPS * length
    assert orientations.max() <= 64 * EPS
    for point, (link, local) in solver.mechanism.points.items():
        expected = local if link == GROUND else poses[link].position + poses[link].rotation @ np.array(local)
        assert np.abs(result.points[point].position - expected).max() <= 16 * EPS * length


@mechanisms
def test_both_sets_of_loop_equations_have_the_same_motion(name):
    """By tree coordinates, which formulas do not use, and by six coordinates of each link."""
    solver, result, _ = motion(name)
    if not solver.motion_laws.crank:
        pytest.skip("six coordinates know the angle of a crank")
    poses = {link: ms.Pose(item.position, item.rotation) for link, item in result.links.items()}
    state = result.angle, result.speed, result.acceleration
    tree = ms.loops.solve(solver.mechanism, *state)
    assert tree.joints.keys() == {name for joint in solver.mechanism.joints for name in joint.coordinates}
    for other in (tree, rates_by_six_coordinates(solver.mechanism, poses, *state)):
        for kind, quantities in (
            ("points", ("position", "velocity", "acceleration")),
            ("links", ("rotation", "angular_velocity", "angular_acceleration")),
            ("joints", ("rate", "acceleration")),
        ):
            # a link that spins passively has any rotation about its line
            for item in getattr(result, kind).keys() - set(result.spinning):
                measured = getattr(result, kind)[item]
                for quantity in quantities:
                    expected = getattr(getattr(other, kind)[item], quantity)
                    limit = 1e-11 * max(1.0, np.abs(expected).max())
                    assert np.abs(getattr(measured, quantity) - expected).max() <= limit, (item, quantity)


@mechanisms
def test_mujoco_has_the_same_configurations_and_rates(name):
    solver = solver_of(name)
    laws = {"motion_laws": solver.motion_laws}
    if solver.motion_laws.crank:
        low, high = reachable(solver)
        laws = {"speed": 1.3, "turns": 0.1 * min(1.0, (high - low) / (2.0 * np.pi))}
    run = simulate(solver, method="pose", samples=9, **laws).motion
    exact = solver.solve_as(run)
    for point, measured in run.points.items():
        for quantity in ("position", "velocity", "acceleration"):
            expected = getattr(exact.points[point], quantity)
            limit = 1e-11 * max(1.0, np.abs(expected).max())
            assert np.abs(getattr(measured, quantity) - expected).max() <= limit, (point, quantity)


def energy(mechanism, result, gravity):
    """Return kinetic energy and that of the weight, by König's theorem, (n,) in [J]."""
    total = np.zeros(len(result))
    for link in mechanism.links:
        body, item = link.inertia, result.links[link.name]
        arm = item.rotation @ np.array(body.centre)
        velocity = item.velocity + np.cross(item.angular_velocity, arm)
        spin = np.einsum("nji,nj->ni", item.rotation, item.angular_velocity)
        total += 0.5 * body.mass * (velocity**2).sum(1) + 0.5 * ((spin @ body.matrix) * spin).sum(1)
        total -= body.mass * (item.position + arm) @ gravity
    return total


@mechanisms
def test_the_power_of_the_drivers_is_the_rate_of_energy(name):
    solver, _, step = motion(name)
    mechanism, gravity = with_inertia(solver.mechanism), (1.3, -4.2, -8.1)
    model = ms.dynamics.dynamic_model(solver, ms.Forces(gravity=gravity), mechanism=mechanism)
    study = ms.dynamics.prescribed(model, **instants(solver)[0])
    result, forces = motion(name)[1], study.forces
    power = (
        sum(effort * result.joints[driver].rate for driver, effort in forces.drives.items())
        if forces.drives
        else forces.torque * result.speed
    )
    values = energy(mechanism, result, np.array(gravity))
    expected = WEIGHTS @ values / step
    assert abs(power[MIDDLE] - expected) <= 1e-8 * max(np.abs(power).max(), np.ptp(values) / step)


@mechanisms
def test_a_written_description_has_the_same_motion(name, tmp_path):
    solver, _, _ = motion(name)
    path = tmp_path / "written.toml"
    path.write_text(to_toml(solver.mechanism), "utf-8")
    again = ms.load(str(path)).mechanism
    assert again.joints == solver.mechanism.joints
    assert again.couplings == solver.mechanism.couplings
    assert dict(again.points) == dict(solver.mechanism.points)
