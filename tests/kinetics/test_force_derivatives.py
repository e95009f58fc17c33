"""Derivatives of torques and reactions by dimensions, compared with perturbed models."""

import numpy as np
import pytest

from mechsim import catalog, dynamics
from mechsim.kinematics.derivatives.dimensions import changes
from mechsim.kinematics.derivatives.motion import followed_motion
from mechsim.kinematics.designs import own_designs
from mechsim.kinetics.derivatives import forces_along, model_numbers
from mechsim.mechanism.forces import Forces, Friction, JointSpring, Spring
from mechsim.mechanism.masses import with_inertia

ANGLES = np.array([0.4, 2.2, 3.9])
POSITION = ("ground", (0.2, 0.1, 0.02))
GRAVITY = Forces(gravity=(1.0, -9.81, 2.0))
LOADED = Forces(
    gravity=(1.0, -9.81, 2.0),
    friction=(Friction("crank", 1e-3, 1e-3),),
    joint_springs=(JointSpring("crank", 0.01, 0.2),),
    springs=(Spring("C", POSITION, 50.0, 0.01, 0.2),),
)


def force_derivatives(model, change, speed=1.0, acceleration=0.0):
    followed = followed_motion(model.solver, ANGLES)
    return forces_along(model, followed, change, speed, acceleration)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "forces", "dimension"),
    [
        ("four_bar", LOADED, "coupler"),
        ("four_bar", LOADED, "arm_angle"),
        # a coupler with a passive spin
        ("rssr", GRAVITY, "pivot.y"),
        ("warp_knitter", GRAVITY, "gear_ratio"),
        ("bennett", GRAVITY, "twist1"),
    ],
)
def test_derivatives_of_forces_agree_with_finite_differences(name, forces, dimension):
    designs = own_designs(catalog.make(name))

    def model(values):
        return dynamics.dynamic_model(designs.make(values), forces, diameter=0.004)

    def numbers(values):
        return model_numbers(with_inertia(designs.describe(values), diameter=0.004), forces)

    result = force_derivatives(model({}), changes(designs, [dimension], numbers), 30.0, 50.0)
    value = designs.dimensions[dimension].value
    step = 1e-5 * max(abs(value), 0.01)
    perturbed = [
        dict(dynamics.prescribed(model({dimension: value + k * step}), ANGLES, 30.0, 50.0).columns())
        for k in (-2, -1, 1, 2)
    ]
    reported = result.by[dimension]
    reactions = dynamics.prescribed(model({}), ANGLES, 30.0, 50.0).forces.reactions
    left_out = {f"{name}.{item}" for name, reaction in reactions.items() for item in reaction.undetermined}
    compared = [item for item in perturbed[0] if item not in {*left_out, "t", "angle", "speed"}]
    assert "torque" in compared
    assert len(compared) > 10
    for column in compared:
        a, b, c, d = (item[column] for item in perturbed)
        same_kind = [
            item for item in compared if item.rpartition(".")[2][:1] == column.rpartition(".")[2][:1]
        ]
        scale = max(np.abs(reported[item]).max() for item in same_kind)
        assert np.abs((a - 8 * b + 8 * c - d) / (12 * step) - reported[column]).max() <= 2e-7 * max(
            scale, 1e-3
        )
