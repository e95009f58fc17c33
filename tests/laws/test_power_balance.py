"""Independent balance of power: the drivers and all other forces change the energy of the links.

Energies follow from the motion of the links only, and the power of springs, friction, loads and couples from
their descriptions (`equilibrium.py`), so that a force that either method leaves out, or takes with the wrong
sign, shows in the drivers' power.
"""

from dataclasses import replace

import numpy as np
import pytest
from equilibrium import Posture, actions
from grids import grid
from laws.test_motion import WEIGHTS, energy

import mechsim as ms
from mechsim.mechanism.forces import Couple, located
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.masses import with_inertia
from mechsim.simulation.dynamics.prescribed_motion import driven

# in [rad/s], and instants after the first
SPEED, SAMPLES = 20.0, 250
PUSH, TWIST = (0.7, -1.1, 0.4), (0.02, -0.03, 0.05)
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
        joint_springs=(ms.JointSpring(single_dof[-1], 0.3, 0.1), ms.JointSpring(single_dof[-1], 0.2, -0.4)),
        loads=(ms.Load(point, ms.load_profile.constant(PUSH)),),
        couples=(Couple(link, ms.load_profile.constant(TWIST)),),
    )


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
    """Return the largest imbalance of power, relative to the largest power of the drivers."""
    posture, acting = Posture(motion), np.zeros(len(motion))
    for item in actions(mechanism, forces, motion, record):
        if item.name.startswith(("spring", "friction", "load", "couple ")):
            for link, sign in ((item.on, 1.0), (item.by, -1.0)):
                if link is not None:
                    power = item.force * posture.velocity(link, item.point) + item.moment * posture.spin(link)
                    acting += sign * power.sum(1)
    drivers = (
        sum(effort * motion.joints[name].rate for name, effort in record.drives.items())
        if record.drives
        else record.torque * record.speed
    )
    step = (motion.time[-1] - motion.time[0]) / (len(motion) - 1)
    rate = np.convolve(energy(mechanism, motion, np.array(forces.gravity)), WEIGHTS[::-1], "valid") / step
    return np.abs((drivers + acting)[4:-4] - rate).max() / np.abs(drivers).max()


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "method"),
    grid(
        [(name, method) for name in (*CRANKS, *SEVERAL_DRIVERS) for method in ("pose", "step", "formulas")],
        ("slider_crank", "rssr", "cardan_joint", "five_bar"),
    ),
)
def test_the_power_of_drivers_balances_energies_losses_and_loads(name, method):
    solver = ms.load(name)
    mechanism, forces = with_inertia(solver.mechanism), every_force(solver.mechanism)
    motion, record = motion_and_forces(solver, mechanism, forces, method)
    # measured 8e-10, the error of the differences, and 5e-9 for steps; forces of several drivers are constant
    # over a step, so accelerations lag by half a step: measured 7.7e-4
    several, stepped = name in SEVERAL_DRIVERS, method == "step"
    limit = (3e-3 if stepped else 1e-8) if several else (5e-8 if stepped else 5e-9)
    assert relative_imbalance(mechanism, forces, motion, record) < limit


@pytest.mark.long
@pytest.mark.parametrize("omitted", ["gravity", "friction", "springs", "joint_springs", "loads", "couples"])
def test_an_omitted_force_breaks_the_balance(omitted):
    solver = ms.load("rsur")
    mechanism, forces = with_inertia(solver.mechanism), every_force(solver.mechanism)
    motion, record = motion_and_forces(solver, mechanism, forces, "pose")
    incomplete = replace(forces, **{omitted: getattr(ms.Forces(), omitted)})
    assert relative_imbalance(mechanism, incomplete, motion, record) > 1e-3
