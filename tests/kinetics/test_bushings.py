"""Bushings against an integration in maximal coordinates, the derivative of their energy, and exact modes."""

from dataclasses import replace

import numpy as np
from model_files import stated_mechanism
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.mechanism.links import GROUND
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven

MASS, CENTRE, MOMENTS = 2.0, np.array([0.02, 0.01, -0.03]), np.diag([0.01, 0.02, 0.015])
GRAVITY = np.array([0.5, -9.81, 1.0])
RANDOM = np.random.default_rng(3)
# a full matrix: displacements and rotations are coupled
ROOT = RANDOM.normal(size=(6, 6)) * np.repeat([1.0, 0.1], 3)[:, None]
STIFFNESS = np.diag([4e3, 3e3, 5e3, 8.0, 12.0, 5.0]) + 40.0 * ROOT @ ROOT.T
DAMPING = np.diag([2.0, 1.0, 3.0, 0.01, 0.02, 0.01]) + 0.01 * ROOT @ ROOT.T
MOUNT = ms.Bushing(
    "mount",
    ms.End(GROUND, (0.0, 0.0, 0.1), (0.0, 1.0, 0.0)),
    ms.End("block", (0.01, 0.0, 0.0), (0.0, 1.0, 0.0)),
    tuple(map(tuple, STIFFNESS)),
    tuple(map(tuple, DAMPING)),
)
# the block of this mass and these moments
BLOCK = stated_mechanism("bushings_block.toml")
WITH_MOUNT = ms.Forces(gravity=tuple(GRAVITY), bushings=(MOUNT,))


START = {"free.q": (0.6, 0.3, -0.5, 0.8), "free.x": 0.01, "free.y": 0.02, "free.w": (1.0, -2.0, 3.0)}


def test_without_damping_the_energy_is_that_of_the_deflection():
    undamped = replace(MOUNT, damping=((0.0,) * 6,) * 6)
    run = ms.dynamics.run(BLOCK, replace(WITH_MOUNT, bushings=(undamped,)), initial=START, duration=1.0)
    link = run.motion.links["block"]
    moved = (
        link.position + link.rotation @ np.array(MOUNT.b.point) - np.array(MOUNT.a.point)
    ) @ MOUNT.a.frame
    rotated = Rotation.from_matrix(MOUNT.a.frame.T @ link.rotation @ MOUNT.b.frame).as_rotvec()
    x = np.hstack([moved, rotated])
    assert np.abs(rotated).max() > 0.5
    stored = 0.5 * np.einsum("ni,ij,nj->n", x, STIFFNESS, x)
    weight = -MASS * (link.position + link.rotation @ CENTRE) @ GRAVITY
    np.testing.assert_allclose(run.potential, stored + weight, rtol=0, atol=1e-11)
    total = run.kinetic + run.potential
    assert np.ptp(total) < 1e-10 * np.abs(total).max()


def test_drive_torque_and_reactions_agree_with_mujoco():
    solver = ms.catalog.make("slider_crank", crank=0.03, rod=0.1)
    a = ms.End("rod", (0.01, 0.0, 0.02))
    b = ms.End("slider", (0.0, 0.01, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    forces = ms.Forces(bushings=(replace(MOUNT, a=a, b=b),), gravity=tuple(GRAVITY))
    model = ms.dynamics.dynamic_model(solver, forces)
    run = driven(solver.mechanism, forces, speed=5.0, turns=1)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    without = ms.dynamics.dynamic_model(solver, replace(forces, bushings=()))
    assert not crosscheck_driven(run, without).passed
