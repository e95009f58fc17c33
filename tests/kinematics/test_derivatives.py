"""Derivatives of motions by dimensions, compared with finite differences."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.io.readers import parametric_model
from mechsim.kinematics.derivatives.dimensions import changes
from mechsim.kinematics.derivatives.motion import motion_derivatives
from mechsim.kinematics.designs import DesignFamily, own_designs, placed_designs
from mechsim.kinematics.solvers import KinematicSolver

SPEED = 7.0
ANGLES = np.array([0.3, 1.1, 2.9, 4.4])
QUANTITIES = [("points", name) for name in ("position", "velocity", "acceleration")]
QUANTITIES += [("joints", name) for name in ("value", "rate")]


def neighbouring_motions(designs: DesignFamily, name, angles, speed, relative_step=1e-5):
    """Return motions of perturbed designs and their step, for a fourth-order difference."""
    value = designs.dimensions[name].value
    step = relative_step * max(abs(value), 0.01)
    return [designs.make({name: value + k * step}).solve_along(angles, speed) for k in (-2, -1, 1, 2)], step


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "options", "names"),
    [
        ("warp_knitter", {}, ["rod3", "phase", "gear_ratio", "base_k.y"]),
        ("rsur", {}, ["rocker", "z"]),
        ("rack_steering", {"drive": {"pinion": "40deg*sin(2*pi*t)"}}, ["radius", "arm", "inward"]),
    ],
)
def test_derivatives_agree_with_finite_differences(model, options, names):
    designs = parametric_model(model, **options)
    solver = designs.make({})
    rotating = solver.mechanism.has_crank and not options
    angles = solver.mechanism.start + ANGLES[:3] if rotating else ANGLES[:2] / 10.0 * solver.motion_laws.rate
    speed = SPEED if rotating else solver.motion_laws.rate
    result = motion_derivatives(solver, changes(designs, names), angles, speed)
    for name in names:
        neighbours, step = neighbouring_motions(designs, name, angles, speed)
        for kind, quantity in QUANTITIES:
            derivatives = getattr(result.by[name], kind)
            reported = {item: getattr(derivatives[item], quantity) for item in derivatives}
            # closed forms do not report joints of several coordinates
            shared = [item for item in reported if item in getattr(neighbours[0], kind)]
            scale = max(0.1, *(np.abs(reported[item]).max() for item in shared))
            for item in shared:
                a, b, c, d = (getattr(getattr(motion, kind)[item], quantity) for motion in neighbours)
                assert np.abs((a - 8 * b + 8 * c - d) / (12 * step) - reported[item]).max() <= 1e-7 * scale


def test_joint_position_and_rocker_length_have_the_same_derivative():
    linkage = ms.catalog.make("rssr")
    designs = placed_designs(KinematicSolver(linkage.mechanism))
    own = changes(designs, ["P3.b.at.x"])
    result = motion_derivatives(linkage, own, ANGLES)
    by_rocker = motion_derivatives(linkage, changes(own_designs(linkage), ["rocker"]), ANGLES)
    # the joint angle depends equally on both dimensions
    reported = result.by["P3.b.at.x"].joints["rocker"].value
    assert (
        np.abs(reported - by_rocker.by["rocker"].joints["rocker"].value).max()
        <= 1e-12 * np.abs(reported).max()
    )
