"""Designs stepped in one batch move as single designs and pass the same checks."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.analytic.formulas.many_designs import closed_form_starts
from mechsim.model.design_arrays import started_designs
from mechsim.simulation import Settings
from mechsim.simulation.design_models import design_models, quaternions, shared_model
from mechsim.simulation.stepped_designs import (
    check_designs,
    design_motion,
    first_open_angle,
    stepped_designs,
)

STEPS, SPEED = 60, 40.0
SETTINGS = Settings(steps_per_turn=STEPS, jacobian="dense")
# generic dimensions with universal, prismatic, spherical and planar connections
VARIED = {
    "four_bar": {"crank": [0.031, 0.034], "ground": [0.101, 0.095], "arm_angle": [0.4, 0.6]},
    "slider_crank": {"crank": [0.047, 0.052], "offset": [0.011, 0.0]},
    "rssr": {"crank": [0.0125, 0.0137], "pivot.x": [0.036, 0.037], "gamma1": [0.3, 0.35]},
    "rrsrr": {"crank": [0.0131, 0.0129], "gamma2": [0.2, 0.25]},
}


def models_of(name, rows):
    solver = ms.catalog.make(name)
    like = shared_model(solver.mechanism)
    return design_models(
        like, closed_form_starts(solver.closed_form, {key: np.array(values) for key, values in rows.items()})
    )


def forms_of(name, rows):
    from mechsim.analytic.derivatives.dimensions import own_designs

    make = own_designs(ms.catalog.make(name)).make
    return [make({key: values[i] for key, values in rows.items()}) for i in range(2)]


@pytest.mark.long
@pytest.mark.parametrize("name", VARIED)
def test_batched_designs_move_as_single_designs(name):
    rows = VARIED[name]
    stepped = stepped_designs(models_of(name, rows), SETTINGS, SPEED, STEPS, 1)
    verdict = check_designs(stepped)
    assert stepped.valid.all()
    assert verdict.same_assembly.all()
    assert (verdict.estimate <= verdict.tolerance).all()
    motion = design_motion(stepped, np.arange(2), np.arange(STEPS), "rates")
    for i, solver in enumerate(forms_of(name, rows)):
        single = ms.simulate(solver, speed=SPEED, settings=SETTINGS, method="step", samples=STEPS).motion
        rows_of_design = slice(i * STEPS, (i + 1) * STEPS)
        # same arithmetic except the order of sums: measured 4e-16 of the size, 1e-13 of accelerations
        for point, item in single.points.items():
            for kind, limit in (("position", 1e-14), ("velocity", 1e-12), ("acceleration", 1e-9)):
                expected, actual = (
                    getattr(item, kind)[:STEPS],
                    getattr(motion.points[point], kind)[rows_of_design],
                )
                np.testing.assert_allclose(
                    actual, expected, atol=limit * np.abs(expected).max(), err_msg=f"{point} {kind}"
                )
        for joint, item in single.joints.items():
            np.testing.assert_allclose(
                motion.joints[joint].value[rows_of_design], item.value[:STEPS], atol=1e-13
            )
            largest = np.abs(item.acceleration).max()
            actual = motion.joints[joint].acceleration[rows_of_design]
            np.testing.assert_allclose(actual, item.acceleration[:STEPS], atol=1e-9 * largest + 1e-9)


def test_closed_form_starts_equal_those_of_descriptions():
    for name, rows in VARIED.items():
        solver = ms.catalog.make(name)
        by_formula = closed_form_starts(
            solver.closed_form, {key: np.array(values) for key, values in rows.items()}
        )
        described = started_designs(solver.mechanism, [item.mechanism for item in forms_of(name, rows)])
        for joint, ends in described.arrays.ends.items():
            for computed, expected in zip(by_formula.arrays.ends[joint], ends, strict=True):
                np.testing.assert_allclose(computed, expected, atol=1e-15)
        for link, pose in described.guess.items():
            np.testing.assert_allclose(by_formula.guess[link].rotation, pose.rotation, atol=1e-14)
        np.testing.assert_array_equal(
            by_formula.arrays.characteristic_length,
            [item.mechanism.characteristic_length for item in forms_of(name, rows)],
        )


def test_a_design_that_changes_assembly_fails_the_check():
    stepped = stepped_designs(models_of("four_bar", VARIED["four_bar"]), SETTINGS, SPEED, STEPS, 1)
    # the rocker of the second design off by 1e-3 rad, then both in the other assembly mode half way
    off = stepped.qpos.copy()
    off[1, 30:] += [0.0, 1e-3, 0.0]
    verdict = check_designs(replace(stepped, qpos=off))
    assert (verdict.estimate <= verdict.tolerance).tolist() == [True, False]
    other = models_of("four_bar", VARIED["four_bar"] | {"branch": [-1, -1]})
    swapped = stepped.qpos.copy()
    swapped[:, 30:] = stepped_designs(other, SETTINGS, SPEED, STEPS, 1).qpos[:, 30:]
    assert not check_designs(replace(stepped, qpos=swapped)).same_assembly.any()


@pytest.mark.long
def test_an_unreachable_crank_angle_is_reported():
    solver = ms.load("watt_six_bar")
    designs = [ms.load("watt_six_bar", {"crank": crank}).mechanism for crank in (0.025, 0.06)]
    models = design_models(shared_model(solver.mechanism), started_designs(solver.mechanism, designs))
    open_at = first_open_angle(stepped_designs(models, SETTINGS, SPEED, STEPS, 1), np.arange(2))
    assert np.isnan(open_at[0])
    arcs = ms.load("watt_six_bar", {"crank": 0.06}).crank_range().arcs
    assert not any(low < open_at[1] < high for low, high in arcs)


def test_quaternions_agree_with_mujoco():
    rng = np.random.default_rng(3)
    turns = np.linalg.qr(rng.normal(size=(200, 3, 3)))[0]
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    turns = np.concatenate([turns, [np.eye(3), np.diag([-1.0, -1, 1]), np.diag([1.0, -1, -1])]])
    for rotation, computed in zip(turns, quaternions(turns), strict=True):
        expected = np.empty(4)
        mujoco.mju_mat2Quat(expected, rotation.ravel())
        assert abs(abs(computed @ expected) - 1.0) < 1e-14
