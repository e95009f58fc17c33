"""Both methods detect a fault of the shared Newton's method, each by its own residual."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics import newton
from mechsim.numerics.continuation import ContinuationPath
from mechsim.simulation import loop_jacobian, simulate
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.source import from_source

CORRECT = newton.newton


def unconverged(system, q, settings, solve=None):
    """Return the initial guess instead of a solution."""
    return CORRECT(system, q, replace(settings, max_iterations=0), solve)


def plant(monkeypatch, fault):
    users = [
        module
        for name, module in sys.modules.items()
        if name.startswith("mechsim.") and getattr(module, "newton", None) is CORRECT
    ]
    assert {name.split(".")[1] for name in (user.__name__ for user in users)} >= {"kinematics", "simulation"}
    for user in users:
        monkeypatch.setattr(user, "newton", fault)


@pytest.mark.parametrize("name", [pytest.param("rssr", marks=pytest.mark.slow), "four_bar"])
def test_both_methods_reject_unconverged_configurations(name, monkeypatch):
    mechanism, angles = ms.catalog.make(name).mechanism, np.linspace(0.0, 6.0, 20)
    assert simulate(mechanism, speed=1.0, method="pose").outcome == "passed"
    KinematicSolver(mechanism).solve(angles, speed=1.0)
    plant(monkeypatch, unconverged)
    with pytest.raises(ms.AssemblyError, match="the crank cannot pass"):
        simulate(mechanism, speed=1.0, method="pose")
    with pytest.raises(ms.AssemblyError, match="the crank cannot pass"):
        KinematicSolver(mechanism).solve(angles, speed=1.0)


@pytest.mark.long
@pytest.mark.parametrize("name", ["rssr", "four_bar"])
def test_both_methods_correct_small_errors_and_reject_large_ones(name, monkeypatch):
    linkage, chunks = ms.catalog.make(name), ContinuationPath.chunks
    model = KinematicSolver(linkage.mechanism)

    def plant_offset(offset):
        def off(path, s):
            return ((solver, index, rows + offset) for solver, index, rows in chunks(path, s))

        monkeypatch.setattr(ContinuationPath, "chunks", off)

    plant_offset(1e-6)
    run = simulate(linkage, speed=1.0, method="pose", samples=20)
    exact = linkage.positions(run.motion.angle)
    for motion in (run.motion, model.solve(run.motion.angle)):
        for point, positions in exact.items():
            assert np.abs(motion.points[point].position - positions).max() < 1e-13
    plant_offset(0.1)
    with pytest.raises(ms.AssemblyError):
        simulate(linkage, speed=1.0, method="pose", samples=20)
    with pytest.raises(ms.AssemblyError):
        model.solve(run.motion.angle)


def test_mujoco_states_are_checked_by_their_own_residual(monkeypatch):
    closed = from_source(ms.catalog.make("rssr").mechanism)
    loops = read_loops(closed.model)
    assert loops.closure_error(loops.residual(loop_jacobian.close(loops, closed.qpos[None]))) < 1e-13

    def off(system, q, settings, solve=None):
        result = CORRECT(system, q, settings, solve)
        step = np.full((len(q), loops.model.nv), 1e-6)
        return replace(result, q=system.retract(result.q, step))

    plant(monkeypatch, off)
    with pytest.raises(ms.AssemblyError, match="do not close at crank angle"):
        loop_jacobian.close(loops, closed.qpos[None])
