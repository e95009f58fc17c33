"""Quantities as text with units in Python give the results of SI numbers, or an error."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven

RSSR = "rssr"
# one turn per second, in rad/s
ONE_TURN = ms.units.parse_speed("60rpm")


def same(item, other):
    """Return whether two records have bitwise equal columns."""
    first, second = dict(item.columns()), dict(other.columns())
    return first.keys() == second.keys() and all(np.array_equal(first[k], second[k]) for k in first)


def test_catalogue_parameters_are_read_with_units():
    from_text = ms.catalog.make(
        RSSR, crank="14mm", gamma1="10deg", pivot=("39mm", -0.008, "4 mm"), branch="-1"
    )
    assert from_text == ms.catalog.make(
        RSSR, crank=0.014, gamma1=np.deg2rad(10.0), pivot=(0.039, -0.008, 0.004), branch=-1
    )
    assert ms.catalog.make(RSSR, pivot="39,-8,4mm") == ms.catalog.make(RSSR, pivot=(0.039, -0.008, 0.004))


def test_motions_accept_speeds_and_angles_as_text():
    for solver in (ms.catalog.make(RSSR), ms.load(RSSR)):
        expected = solver.solve(np.deg2rad(np.arange(0, 91, 30)), ms.units.rpm(600))
        from_text = solver.solve("0:90:30deg", speed="600rpm")
        np.testing.assert_allclose(from_text.angle, expected.angle, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(from_text.speed, expected.speed)
    loops = ms.load("klann")
    from_text, expected = loops.solve("0.1", speed="60rpm"), loops.solve([0.1], ONE_TURN)
    assert same(from_text, expected)


def test_runs_accept_speeds_and_tolerances_as_text():
    solver = ms.catalog.make(RSSR)
    options = {"samples": 8}
    from_text = ms.simulate(solver.mechanism, speed="600rpm", tolerance="10um", **options)
    expected = ms.simulate(solver.mechanism, speed=20.0 * np.pi, tolerance=1e-5, **options)
    assert from_text.tolerance == 1e-5
    assert same(from_text.motion, expected.motion)


def test_dynamics_accept_speeds_and_sizes_as_text():
    model = ms.dynamics.dynamic_model(ms.catalog.make(RSSR), diameter="5mm")
    assert model.masses == ms.dynamics.dynamic_model(ms.catalog.make(RSSR), diameter=0.005).masses
    from_text = ms.dynamics.prescribed(model, "0:90:45deg", "60rpm")
    np.testing.assert_array_equal(from_text.forces.speed, np.full(3, ONE_TURN))
    assert same(
        driven(model.mechanism, model.forces, speed="60rpm", samples=4).forces,
        driven(model.mechanism, model.forces, speed=ONE_TURN, samples=4).forces,
    )
    assert ms.dynamics.fluctuation(model, "60rpm").mean == ONE_TURN
    free = ms.dynamics.run(model, initial={"crank.v": "60rpm"}, duration="5 ms")
    assert free.time[-1] == 0.005
    # rates are projected onto the loops: rounding
    assert free.motion.speed[0] == pytest.approx(ONE_TURN, rel=1e-14)


def test_studies_accept_speeds_as_text():
    from_text = ms.sensitivity("four_bar", "C.vx", "crank", angles="0:90:45deg", speed="60rpm")
    expected = ms.sensitivity("four_bar", "C.vx", "crank", angles=np.deg2rad([0, 45, 90]), speed=ONE_TURN)
    np.testing.assert_allclose(
        from_text.derivatives("C.vx")["crank"], expected.derivatives("C.vx")["crank"], rtol=1e-13
    )
    swept = [
        ms.sweep("four_bar", {"crank": [0.03]}, "max:C.vx", speed=speed) for speed in ("60rpm", ONE_TURN)
    ]
    np.testing.assert_array_equal(swept[0]["max:C.vx"], swept[1]["max:C.vx"])
