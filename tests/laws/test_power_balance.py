"""Independent energy balance: the drive power equals energy rates plus friction losses.

The test computes energies, losses and loads from the motion of links and joints only, so that a force that
either method leaves out, or takes with the wrong sign, shows in the drivers' power.
"""

from dataclasses import replace

import numpy as np
import pytest
from grids import grid

import mechsim as ms
from mechsim.mechanism.forces import Couple, located
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.masses import with_inertia
from mechsim.simulation.dynamics.prescribed_motion import driven

# in [rad/s], and instants after the first
SPEED, SAMPLES = 20.0, 250
PUSH, TWIST = (0.7, -1.1, 0.4), (0.02, -0.03, 0.05)
# eighth-order differences on an even grid
DIFFERENCES = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
CRANKS = ("slider_crank", "rssr", "watt_six_bar", "quick_return", "cardan_joint", "rsur", "rack_steering")
SEVERAL_DRIVERS = ("five_bar", "humanoid_ankle", "stewart_gough")


def every_force(mechanism):
    """Return forces of every kind."""
    single_dof = [item.name for item in mechanism.joints if item.kind in ("revolute", "prismatic")]
    point = [name for name, (link, _) in mechanism.points.items() if link != GROUND][-1]
    link = located(mechanism, point)[0]
    return ms.Forces(
        gravity=(1.3, -4.2, -8.1),
        friction=(ms.Friction(single_dof[-1], 0.02, 0.03), ms.Friction(single_dof[0], 0.004, 0.006)),
        springs=(ms.Spring((GROUND, (0.02, 0.03, 0.11)), point, 40.0, 0.03, 0.5),),
        joint_springs=(ms.JointSpring(single_dof[-1], 0.3, 0.1),),
        loads=(ms.Load(point, ms.load_profile.constant(PUSH)),),
        couples=(Couple(link, ms.load_profile.constant(TWIST)),),
    )


def point_motion(mechanism, motion, location):
    """Return position and velocity of a location, (n, 3) each."""
    link, local = located(mechanism, location)
    if link == GROUND:
        return np.broadcast_to(local, (len(motion), 3)), np.zeros((len(motion), 3))
    motion_and_forces = motion.links[link]
    arm = motion_and_forces.rotation @ np.array(local)
    return motion_and_forces.position + arm, motion_and_forces.velocity + np.cross(
        motion_and_forces.angular_velocity, arm
    )


def joint(mechanism, motion, name):
    """Return the motion of a joint; in MuJoCo's motion the driven joint has the name crank."""
    joints = motion.joints
    return joints["crank"] if name not in joints and name == mechanism.crank.name else joints[name]


def energy_of(mechanism, forces, motion):
    """Return kinetic and potential energy of links and springs, (n,) in [J]."""
    energy = np.zeros(len(motion))
    for link in mechanism.links:
        body, motion_and_forces = link.inertia, motion.links[link.name]
        location, velocity = point_motion(mechanism, motion, (link.name, body.centre))
        spin = np.einsum("nji,nj->ni", motion_and_forces.rotation, motion_and_forces.angular_velocity)
        energy += 0.5 * body.mass * (velocity**2).sum(1) + 0.5 * ((spin @ body.matrix) * spin).sum(1)
        energy -= body.mass * location @ np.array(forces.gravity)
    for item in forces.springs:
        line = point_motion(mechanism, motion, item.b)[0] - point_motion(mechanism, motion, item.a)[0]
        energy += 0.5 * item.stiffness * (np.linalg.norm(line, axis=1) - item.rest) ** 2
    for item in forces.joint_springs:
        motion_and_forces = joint(mechanism, motion, item.joint)
        deflection = motion_and_forces.value - item.rest
        if motion_and_forces.unit == "rad":
            deflection = np.angle(np.exp(1j * deflection))
        energy += 0.5 * item.stiffness * deflection**2
    return energy


def power_lost(mechanism, forces, motion):
    """Return the power lost in friction and dampers minus that of loads, (n,) in [W]."""
    power = np.zeros(len(motion))
    for item in forces.friction:
        rate = joint(mechanism, motion, item.joint).rate
        power += item.viscous * rate**2 + item.coulomb * np.abs(rate)
    for item in forces.springs:
        (a, a_speed), (b, b_speed) = (
            point_motion(mechanism, motion, location) for location in (item.a, item.b)
        )
        line = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
        power += item.damping * (line * (b_speed - a_speed)).sum(1) ** 2
    for item in forces.loads:
        power -= point_motion(mechanism, motion, item.location)[1] @ np.array(PUSH)
    for item in forces.couples:
        power -= motion.links[item.link].angular_velocity @ np.array(TWIST)
    return power


def drive_power(record, motion):
    """Return the power of the drivers, (n,) in [W]."""
    if not record.drives:
        return record.torque * record.speed
    return sum(effort * motion.joints[name].rate for name, effort in record.drives.items())


def motion_and_forces(solver, mechanism, forces, method):
    """Return motion and forces by MuJoCo's poses, its steps, or formulas at the same instants."""
    options = {"speed": SPEED} if solver.motion_laws.crank else {"motion_laws": solver.motion_laws}
    run = driven(mechanism, forces, method="step" if method == "step" else "pose", samples=SAMPLES, **options)
    if method != "formulas":
        return run.motion, run.forces
    model, motion = ms.dynamics.dynamic_model(solver, forces, mechanism=mechanism), run.motion
    study = ms.dynamics.prescribed(
        model, motion.angle, motion.speed, motion.acceleration, time=motion.time, as_run=motion
    )
    return motion, study.forces


def relative_imbalance(mechanism, forces, motion, record):
    """Return the largest imbalance away from jumps of springs, relative to the largest drive power."""
    step = (motion.time[-1] - motion.time[0]) / (len(motion) - 1)
    energy_rate = np.convolve(energy_of(mechanism, forces, motion), DIFFERENCES[::-1], "valid") / step
    power = drive_power(record, motion)
    imbalance = power[4:-4] - energy_rate - power_lost(mechanism, forces, motion)[4:-4]
    smooth = np.ones(len(motion))
    for item in forces.joint_springs:
        deflection = np.angle(np.exp(1j * (joint(mechanism, motion, item.joint).value - item.rest)))
        smooth *= np.abs(deflection) < 3.0
    valid = np.convolve(smooth, np.ones(9), "valid") == 9.0
    assert valid.mean() > 0.8
    return np.abs(imbalance[valid]).max() / np.abs(power).max()


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step", "formulas"])
@pytest.mark.parametrize("name", grid(CRANKS, ("slider_crank", "rssr", "cardan_joint")))
def test_crank_power_balances_energies_losses_and_loads(name, method):
    solver = ms.load(name)
    mechanism, forces = with_inertia(solver.mechanism), every_force(solver.mechanism)
    motion, record = motion_and_forces(solver, mechanism, forces, method)
    # measured 8e-10, the error of the differences, and 5e-9 for steps
    assert relative_imbalance(mechanism, forces, motion, record) < (5e-8 if method == "step" else 5e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "method"),
    grid(
        (
            *((name, method) for name in SEVERAL_DRIVERS for method in ("pose", "step")),
            ("five_bar", "formulas"),
            ("humanoid_ankle", "formulas"),
        ),
        ("five_bar",),
    ),
)
def test_the_power_of_several_drivers_balances(name, method):
    solver = ms.load(name)
    mechanism, forces = with_inertia(solver.mechanism), every_force(solver.mechanism)
    motion, record = motion_and_forces(solver, mechanism, forces, method)
    # drive forces are constant over a step, so accelerations lag by half a step: measured 7.7e-4
    assert relative_imbalance(mechanism, forces, motion, record) < (3e-3 if method == "step" else 1e-8)


@pytest.mark.long
@pytest.mark.parametrize("omitted", ["gravity", "friction", "springs", "joint_springs", "loads", "couples"])
def test_an_omitted_force_breaks_the_balance(omitted):
    solver = ms.load("rsur")
    mechanism, forces = with_inertia(solver.mechanism), every_force(solver.mechanism)
    motion, record = motion_and_forces(solver, mechanism, forces, "pose")
    incomplete = replace(forces, **{omitted: getattr(ms.Forces(), omitted)})
    assert relative_imbalance(mechanism, incomplete, motion, record) > 1e-3
