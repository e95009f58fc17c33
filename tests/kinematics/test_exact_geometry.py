"""Rounded dimensions of overconstrained loops are corrected by the smallest change that assembles them."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.assur import assur_groups
from mechsim.kinematics.loops.mobility import checked_start, driver_determinacy
from mechsim.kinematics.loops.rounded_geometry import DIMENSION_TOLERANCE, corrected
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics import loop_solver
from mechsim.numerics.banded import BandedSystems, SparseMatrices

# their loops assemble only with parallel axes or under Bennett's condition
OVERCONSTRAINED = ["four_bar", "slider_crank", "bennett"]


def with_random_errors(mechanism: ms.Mechanism, by: float) -> ms.Mechanism:
    """Return a mechanism with random relative errors in points and axes."""
    random = np.random.default_rng(3)

    def off(end):
        vectors, scales = (end.point, end.axis, end.reference), (mechanism.characteristic_length, 1.0, 1.0)
        point, axis, reference = (
            tuple(np.array(vector) + scale * random.uniform(-by, by, 3))
            for vector, scale in zip(vectors, scales, strict=True)
        )
        return replace(end, point=point, axis=axis, reference=reference)

    joints = tuple(replace(joint, a=off(joint.a), b=off(joint.b)) for joint in mechanism.joints)
    return replace(mechanism, joints=joints)


def largest_change(result):
    """Return the largest shift in [m] and rotation in [rad] of a correction, rounded angles included."""
    shifts, rotations = ([np.linalg.norm(change[i]) for change in result.changes] for i in (2, 3))
    return max([result.moved, *shifts]), max([result.rotated, *rotations])


@pytest.mark.long
@pytest.mark.parametrize("name", OVERCONSTRAINED)
def test_a_rounded_linkage_moves_after_correction(name):
    whole = ms.catalog.make(name).mechanism
    angles = whole.start + np.linspace(-0.4, 0.4, 5)
    off = with_random_errors(whole, 1e-6)
    with pytest.raises(ms.MechsimError):
        ms.loops.solve(off, angles)
    result = corrected(off)
    shift, rotation = largest_change(result)
    assert shift < 1e-5 * whole.characteristic_length
    assert 0.0 < rotation < 1e-5
    exact, motion = ms.loops.solve(whole, angles), ms.loops.solve(result.mechanism, angles)
    for link in exact.links:
        np.testing.assert_allclose(
            motion.links[link].position, exact.links[link].position, atol=3e-5 * whole.characteristic_length
        )


@pytest.mark.long
@pytest.mark.parametrize("name", OVERCONSTRAINED)
def test_errors_above_rounding_are_not_corrected(name):
    off = with_random_errors(ms.catalog.make(name).mechanism, 1000.0 * DIMENSION_TOLERANCE)
    assert corrected(off).mechanism is off


@pytest.mark.parametrize("name", ms.catalog.MECHANISMS)
def test_exact_dimensions_are_not_changed(name):
    mechanism = ms.catalog.make(name).mechanism
    assert corrected(mechanism).mechanism is mechanism


def row_of_four_bars(count: int, uneven: float = 0.2) -> ms.Mechanism:
    """Return four-bars in a row, of which the rocker of each is the crank of the next."""
    tips = [(i + uneven * (-1.0) ** i, 1.0 + 0.5 * uneven * (i % 3), 0.0) for i in range(count + 1)]
    pivots = [(float(i), 0.0, 0.0) for i in range(count + 1)]
    joints = [
        ms.Joint(f"A{i}", "revolute", ms.End("ground", pivot), ms.End(f"crank{i}", pivot))
        for i, pivot in enumerate(pivots)
    ]
    for i in range(count):
        joints += [
            ms.Joint(f"{name}{i}", "revolute", ms.End(f"crank{k}", tips[k]), ms.End(f"rod{i}", tips[k]))
            for name, k in (("B", i), ("C", i + 1))
        ]
    links = [ms.Link(f"crank{i}") for i in range(count + 1)] + [ms.Link(f"rod{i}") for i in range(count)]
    points = {"P": (f"crank{count}", tips[count])}
    return ms.Mechanism("row", tuple(links), tuple(joints), "A0", points)


@pytest.mark.parametrize("count", [1, 24])
def test_a_long_row_of_exact_loops_is_not_changed(count):
    """Its smallest singular value falls as 1 / count, as that of a loop with rounded angles."""
    row = row_of_four_bars(count)
    assert corrected(row).mechanism is row
    # Gruebler: three degrees of freedom of each link, without two in each joint
    assert driver_determinacy(row).dofs == 3 * (2 * count + 1) - 2 * (3 * count + 1)


def test_a_long_row_is_one_dyad_after_another():
    """Its rods and the cranks that they drive, in order, class II of Artobolevskii."""
    groups = assur_groups(row_of_four_bars(24)).groups
    assert [group.links for group in groups] == [(f"crank{i + 1}", f"rod{i}") for i in range(24)]
    assert {(group.class_, group.order) for group in groups} == {(2, 2)}


@pytest.mark.parametrize("whole", [ms.catalog.make("four_bar").mechanism, row_of_four_bars(2)])
def test_the_correction_of_an_axis_is_no_larger_than_its_error(whole):
    joints = list(whole.joints)
    joints[-1] = replace(joints[-1], b=replace(joints[-1].b, axis=(3e-6, 0.0, 1.0), reference=None))
    result = corrected(replace(whole, joints=tuple(joints)))
    assert 0.3e-6 < largest_change(result)[1] < 3e-6 * (1.0 + 1e-6)


def row_by_circles(count: int, angles: np.ndarray) -> np.ndarray:
    """Return the tip of the last crank at angles from the start, (n, 2), by circles that intersect."""
    tips = [complex(i + 0.2 * (-1.0) ** i, 1.0 + 0.1 * (i % 3)) for i in range(count + 1)]
    tip = tips[0] * np.exp(1j * angles)
    for i in range(count):
        pivot, rod, crank = i + 1.0, abs(tips[i + 1] - tips[i]), abs(tips[i + 1] - (i + 1.0))
        gap = pivot - tip
        along = (abs(gap) ** 2 + rod**2 - crank**2) / (2.0 * abs(gap))
        across = 1j * np.sqrt(rod**2 - along**2)
        options = [tip + (along + side * across) * gap / abs(gap) for side in (1.0, -1.0)]
        nearer = abs(options[0] - tips[i + 1]) < abs(options[1] - tips[i + 1])
        tip = np.where(nearer, *options)
    return np.stack([tip.real, tip.imag], 1)


def test_a_long_row_is_solved_without_dense_matrices(monkeypatch):
    """Its Jacobian has one entry for each coordinate of each loop, factorised next to the diagonal."""
    row, angles = KinematicSolver(row_of_four_bars(60)), np.linspace(0.0, 0.02, 4)
    solver = checked_start(row.mechanism)
    assert solver.band.numbers <= 8 * 2 * 60
    # joints of a kind at one distance from the frame are evaluated together
    assert (len(solver.loops.tree.groups), len(solver.loops.groups)) == (2, 1)
    row.solve([0.0])
    for kind in (SparseMatrices, BandedSystems):
        monkeypatch.setattr(kind, "dense", property(lambda matrices: pytest.fail("dense")))
    motion = row.solve(angles)
    np.testing.assert_allclose(motion.points["P"].position[:, :2], row_by_circles(60, angles), atol=1e-11)
    np.testing.assert_allclose(motion.conditioning[0], conditioning_of(solver), rtol=1e-9)


def test_derivatives_of_a_long_row_are_those_by_dense_matrices(monkeypatch):
    row, derivatives = row_of_four_bars(12), []
    for least in (10, 10_000):
        monkeypatch.setattr(loop_solver, "MIN_UNKNOWNS", least)
        table = ms.sensitivity(row, ["P.x", "P.vx", "P.ax"], "A1.at.x", angles=[0.01, 0.02])
        derivatives.append([*table.by["A1.at.x"].values()])
    assert np.abs(derivatives[1]).min() > 1e-6
    np.testing.assert_allclose(*derivatives, rtol=1e-9)


@pytest.mark.long
def test_a_long_row_is_traced_in_a_band_as_by_dense_matrices(monkeypatch):
    row, curves = row_of_four_bars(10), []
    for least in (10, 10_000):
        monkeypatch.setattr(loop_solver, "MIN_UNKNOWNS", least)
        curves.append(ms.trace(row, starts=0).curves[0])
    banded, dense = curves
    assert [curve.traced.segments[-1].solver.band is None for curve in curves] == [False, True]
    assert banded.length == pytest.approx(dense.length, rel=1e-9)
    np.testing.assert_allclose(banded.dead_centres, dense.dead_centres, atol=1e-9)
    paths = [curve.samples(9).points["P"] for curve in curves]
    np.testing.assert_allclose(*paths, atol=1e-7)


def conditioning_of(solver) -> float:
    """Return the smallest singular value of all equations by the unknowns."""
    jacobian = solver.loops.linearise(solver.reference)[1][..., 0]
    return np.linalg.svd(jacobian[:, solver.loops.unknown], compute_uv=False)[-1]
