"""Derivatives of motions by dimensions, compared with 50 digits and with finite differences."""

from types import SimpleNamespace

import numpy as np
import pytest
from exact_solutions import DIGITS, four_bar_b_place, rssr_p3_place
from mpmath import mp

import mechsim as ms
from mechsim.io import prescription
from mechsim.io.readers import parametric_model
from mechsim.kinematics.derivatives.dimensions import changes, numbers_of
from mechsim.kinematics.derivatives.motion import motion_derivatives
from mechsim.kinematics.designs import DesignFamily, own_designs, placed_designs
from mechsim.kinematics.solvers import KinematicSolver

SPEED = 7.0
ANGLES = np.array([0.3, 1.1, 2.9, 4.4])


def exact_derivatives(function, linkage, parameter, angle):
    """Return derivatives of position, velocity and acceleration by a parameter, with 50 digits."""
    name, _, axis = parameter.partition(".")

    def moved(value, time):
        own = {item: getattr(linkage, item) for item in linkage.parameters}
        own[name] = value
        if axis:
            own[name] = list(getattr(linkage, name))
            own[name]["xyz".index(axis)] = value
        return function(SimpleNamespace(**own), time)

    def value(point, order):
        return [mp.diff(lambda v, t, i=i: moved(v, t)[i], point, (1, order)) for i in range(3)]

    with mp.workdps(DIGITS):
        nominal = getattr(linkage, name)
        point = (mp.mpf(nominal["xyz".index(axis)] if axis else nominal), mp.mpf(float(angle)))
        return [np.array([float(item) for item in value(point, k)]) * SPEED**k for k in range(3)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "point", "function", "parameters"),
    [
        ("rssr", "P3", rssr_p3_place, ["crank", "coupler", "rocker", "pivot.y", "gamma1", "gamma2"]),
        ("four_bar", "B", four_bar_b_place, ["ground", "crank", "coupler", "rocker"]),
    ],
)
def test_derivatives_of_positions_and_rates_agree_with_50_digits(name, point, function, parameters):
    linkage = ms.catalog.make(name)
    result = motion_derivatives(linkage, changes(own_designs(linkage), parameters), ANGLES, SPEED)
    for parameter in parameters:
        moved = result.by[parameter].points[point]
        for i, angle in enumerate(ANGLES[:1]):
            reported = moved.position[i], moved.velocity[i], moved.acceleration[i]
            for own, exact in zip(
                reported, exact_derivatives(function, linkage, parameter, angle), strict=True
            ):
                assert np.abs(own - exact).max() <= 2e-12 * np.abs(exact).max()


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
        pytest.param("looper", {}, ["frame_angle", "axis_z"], marks=pytest.mark.slow),
        ("bennett", {}, ["twist0"]),
        ("rsur", {}, ["rocker", "z"]),
        ("rack_steering", {"drive": {"pinion": "40deg*sin(2*pi*t)"}}, ["radius", "arm", "inward"]),
        ("humanoid_ankle", {"drive": dict.fromkeys(("left", "right"), "9deg*sin(2*pi*t)")}, ["crank"]),
    ],
)
def test_derivatives_agree_with_finite_differences(model, options, names):
    designs = parametric_model(model, **options)
    solver = designs.make({})
    rotating = solver.mechanism.has_crank and not options
    angles = solver.mechanism.start + ANGLES[:3] if rotating else ANGLES[:2] / 10.0 * solver.motion_laws.rate
    speed = SPEED if rotating else solver.motion_laws.rate
    result = motion_derivatives(solver, changes(designs, names), angles, speed)
    kinds = {"points": ("position", "velocity", "acceleration"), "joints": ("value", "rate")}
    for name in names:
        neighbours, step = neighbouring_motions(designs, name, angles, speed)
        for kind, quantity in (
            (kind, quantity) for kind, quantities in kinds.items() for quantity in quantities
        ):
            reported = {
                item: getattr(motion_derivative, quantity)
                for item, motion_derivative in getattr(result.by[name], kind).items()
            }
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


def test_a_perturbed_file_is_described_without_assembly(monkeypatch):
    designs, values = parametric_model("hoeken"), {"arm": 0.176}
    assembled = designs.make(values).mechanism

    def rejected(mechanism):
        raise ms.AssemblyError("no assembly is needed")

    monkeypatch.setattr(prescription, "closed_start", rejected)
    with pytest.raises(ms.AssemblyError):
        designs.make(values)
    assert (numbers_of(designs.describe(values)) == numbers_of(assembled)).all()
