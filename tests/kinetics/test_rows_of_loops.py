"""Dynamics of rows of many four-bars: no operation grows faster than their number."""

import numpy as np
import pytest
from driven_mechanisms import sinusoidal
from kinematics.test_exact_geometry import row_of_four_bars

import mechsim as ms
from mechsim.kinematics.loops import start
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import equilibria, linearization, prescribed, prescribed_motion, reactions
from mechsim.kinetics.initial_state import InitialValues
from mechsim.kinetics.model import dynamic_model
from mechsim.mechanism.masses import with_inertia
from mechsim.mechanism.motion_laws import make_motion_laws
from mechsim.simulation import model_loops, simulate
from mechsim.simulation.dynamics import inverse_dynamics
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_forward

ANGLES = np.linspace(0.0, 0.1, 4)


def solved(count):
    return prescribed(dynamic_model(row_of_four_bars(count)), ANGLES, speed=3.0)


def test_reactions_of_a_row_are_those_of_one_dense_balance(monkeypatch):
    by_blocks = solved(5)
    monkeypatch.setattr(reactions, "DENSE_LINKS", 1000)
    dense = solved(5)
    largest = max(np.abs(reaction.force).max() for reaction in dense.forces.reactions.values())
    for name, reaction in by_blocks.forces.reactions.items():
        expected = dense.forces.reactions[name]
        assert np.abs(reaction.force - expected.force).max() <= 1e-11 * largest
        assert np.abs(reaction.moment - expected.moment).max() <= 1e-11 * largest
        assert (reaction.is_determined == expected.is_determined).all()
        assert np.abs(reaction.projector - expected.projector).max() <= 1e-12
    assert by_blocks.indeterminacy == dense.indeterminacy == 15
    # the balance, by Newton and Euler, gives the torque of virtual power
    assert np.abs(by_blocks.second_torque / by_blocks.forces.torque - 1.0).max() <= 1e-10


def factorised(monkeypatch, count):
    """Return the shapes of the matrices that the forces of a row are solved with."""
    shapes, factorise = [], np.linalg.qr

    def recorded(matrix, **options):
        shapes.append(matrix.shape)
        return factorise(matrix, **options)

    with monkeypatch.context() as context:
        context.setattr(np.linalg, "qr", recorded)
        solved(count)
    return shapes


def test_matrices_of_a_row_do_not_grow_and_their_number_is_linear(monkeypatch):
    """Each has the components of a few joints, in the plane or across it."""
    short, middle, long = (factorised(monkeypatch, count) for count in (4, 8, 16))
    assert len(long) - len(middle) == 2 * (len(middle) - len(short))
    assert {shape[1:] for shape in long} == {shape[1:] for shape in middle}
    assert max(shape[1] for shape in long) <= 12


def test_chunks_of_instants_give_the_same_forces(monkeypatch):
    whole = solved(4)
    monkeypatch.setattr(prescribed_motion, "BATCH_LINKS", 1)
    one_by_one = solved(4)
    assert np.allclose(one_by_one.forces.torque, whole.forces.torque, rtol=1e-13)
    assert (one_by_one.forces.unbounded == whole.forces.unbounded).all()
    for name, reaction in one_by_one.forces.reactions.items():
        assert np.allclose(reaction.force, whole.forces.reactions[name].force, rtol=1e-12, atol=1e-9)
        assert (reaction.is_determined == whole.forces.reactions[name].is_determined).all()


def test_equilibria_of_a_row_by_sparse_loops_are_those_of_whole_matrices(monkeypatch):
    model = dynamic_model(row_of_four_bars(3))
    whole = equilibria(model)
    for module in (start, linearization):
        monkeypatch.setattr(module, "SPARSE", 1)
    sparse = equilibria(model)
    assert [each.stable for each in sparse] == [each.stable for each in whole]
    for own, expected in zip(sparse, whole, strict=True):
        assert max(abs(own.q[name] - value) for name, value in expected.q.items()) <= 1e-9
        for mode, other in zip(own.modes, expected.modes, strict=True):
            assert abs(mode.eigenvalue - other.eigenvalue) <= 1e-8 * abs(other.eigenvalue)


def test_minima_and_maxima_of_the_potential_alternate_around_the_curve_of_a_long_row():
    stable = [each.stable for each in equilibria(dynamic_model(row_of_four_bars(50, 0.02)), starts=1)]
    assert 2 * sum(stable) == len(stable) > 0


def test_forces_of_a_row_in_mujoco_by_sparse_loops_are_those_of_whole_matrices(monkeypatch):
    runs, rates, motion = [], [], {"speed": 3.0, "turns": 0.01, "samples": 4}
    drawn, maps, row = [], [], row_of_four_bars(16)
    for least in (1, 1000):
        for module in (inverse_dynamics, model_loops):
            monkeypatch.setattr(module, "SPARSE", least)
        runs.append(driven(row, **motion))
        rates.append(simulate(row, method="pose", **motion).motion.joints["A16"].rate)
        drawn.append(ms.sample(row, 20))
        maps.append(ms.joint_map(row, {"A0": ("10deg", "20deg")}, ["A16"], points=3))
    assert drawn[0].accepted == drawn[1].accepted < 1.0
    np.testing.assert_allclose(drawn[0].qpos, drawn[1].qpos, atol=1e-11)
    np.testing.assert_allclose(maps[0].jacobian_derivative, maps[1].jacobian_derivative, rtol=1e-8)
    sparse, whole = runs
    np.testing.assert_allclose(*rates, rtol=1e-13)
    assert np.abs(sparse.forces.torque / whole.forces.torque - 1.0).max() <= 1e-9
    largest = max(np.abs(reaction.force).max() for reaction in whole.forces.reactions.values())
    for name, reaction in whole.forces.reactions.items():
        assert np.abs(sparse.forces.reactions[name].force - reaction.force).max() <= 1e-9 * largest
    np.testing.assert_allclose(sparse.motion.conditioning, whole.motion.conditioning, rtol=1e-11)
    largest = max(np.abs(link.angular_acceleration).max() for link in whole.motion.links.values())
    for name, link in whole.motion.links.items():
        own = sparse.motion.links[name]
        assert np.abs(own.angular_acceleration - link.angular_acceleration).max() <= 1e-12 * largest
        assert np.abs(own.acceleration - link.acceleration).max() <= 1e-12 * largest
        assert np.abs(own.position - link.position).max() <= 1e-14


def four_bars_alone(count):
    """Return equal four-bars next to one another, each with a driver."""
    links, joints = [], []
    for i in range(count):
        corners = [(i + x, y, 0.0) for x, y in ((0.0, 0.0), (0.1, 0.2), (0.5, 0.4), (0.6, 0.0))]
        chain = ["ground", f"crank{i}", f"coupler{i}", f"rocker{i}", "ground"]
        links += [ms.Link(name) for name in chain[1:4]]
        joints += [
            ms.Joint(f"{name}{i}", "revolute", ms.End(a, point), ms.End(b, point))
            for name, a, b, point in zip("ABCD", chain, chain[1:], corners, strict=False)
        ]
    drivers = tuple(f"A{i}" for i in range(count))
    return ms.Mechanism("alone", tuple(links), tuple(joints), drivers, {"P": ("rocker0", corners[2])})


def test_each_of_many_four_bars_takes_the_torque_of_one():
    records = {}
    for count in (1, 16):
        mechanism = with_inertia(four_bars_alone(count), diameter=0.01)
        law = dict.fromkeys(mechanism.drivers, sinusoidal(0.1, 0.3, 6.0))
        laws = make_motion_laws(mechanism, law, 0.5)
        solver = KinematicSolver(mechanism, motion_laws=laws)
        analytic = prescribed(dynamic_model(solver), t=np.linspace(0.0, 0.5, 6)).forces
        records[count] = analytic, driven(mechanism, motion_laws=laws, samples=5).forces
    for alone, many in zip(records[1], records[16], strict=True):
        expected = alone.drives["A0"]
        for torque in many.drives.values():
            assert np.abs(torque - expected).max() <= 1e-10 * np.abs(expected).max()
        for name in "ABCD":
            force = alone.reactions[f"{name}0"].force
            last = many.reactions[f"{name}15"].force
            assert np.abs(last - force).max() <= 1e-10 * np.abs(force).max()


@pytest.mark.parametrize("count", [1, pytest.param(24, marks=pytest.mark.long)])
def test_a_row_of_parallelograms_falls_like_a_pendulum_by_displacements_near_rounding(count):
    """n cylinders move with the tips, and n + 1 rotate: (n + (n + 1) k^2) a'' = (n + (n + 1) / 2) g a."""
    model, rate = dynamic_model(with_inertia(row_of_four_bars(count, 0.0), diameter=0.01)), 1e-6
    run = ms.dynamics.run(model, initial={"A0.v": rate}, duration=0.05, samples=50)
    inertia = count + (count + 1) * (1.0 / 3.0 + 0.01**2 / 16.0)
    fall = np.sqrt(9.81 * (count + (count + 1) / 2.0) / inertia)
    error = run.motion.joints["A0"].value - rate * np.sinh(fall * run.time) / fall
    assert np.abs(error).max() <= 1e-14 * count
    assert run.steps < 20
    wrong, values = model.with_forces(ms.Forces(gravity=(0.0, -9.82, 0.0))), InitialValues({}, {"A0": rate})
    assert [crosscheck_forward(run, each, values).passed for each in (model, wrong)] == [True, False]
