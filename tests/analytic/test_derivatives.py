"""Derivatives of motions by dimensions: against 50 digits, against motions next to, and where none are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from exact_solutions import DIGITS, four_bar_b_place, rssr_p3_place
from mpmath import mp

from mechsim.analytic import catalog
from mechsim.analytic.derivatives.dimensions import DesignFamily, catalog_designs, changes, placed_designs
from mechsim.analytic.derivatives.motion import motion_derivatives
from mechsim.analytic.derivatives.parameter_vector import numbers_of
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import AssemblyError, InputError
from mechsim.subjects import readers
from mechsim.subjects.readers import parametric_model

SPEED = 7.0
ANGLES = np.array([0.3, 1.1, 2.9, 4.4])


def in_digits(place, drive, parameter, angle):
    """Derivatives by a parameter of place, velocity and acceleration at constant speed, with 50 digits."""
    whole, _, axis = parameter.partition(".")

    def places(value, at):
        own = {item: getattr(drive, item) for item in drive.__dataclass_fields__}
        own[whole] = value
        if axis:
            own[whole] = list(getattr(drive, whole))
            own[whole]["xyz".index(axis)] = value
        return place(SimpleNamespace(**own), at)

    def value(of, order):
        return [mp.diff(lambda v, t, i=i: places(v, t)[i], of, (1, order)) for i in range(3)]

    with mp.workdps(DIGITS):
        begin = getattr(drive, whole)
        of = (mp.mpf(begin["xyz".index(axis)] if axis else begin), mp.mpf(float(angle)))
        return [np.array([float(item) for item in value(of, k)]) * SPEED**k for k in range(3)]


@pytest.mark.parametrize(
    ("name", "point", "place", "parameters"),
    [
        ("rssr", "P3", rssr_p3_place, ["crank", "coupler", "rocker", "pivot.y", "gamma1", "gamma2"]),
        ("four_bar", "B", four_bar_b_place, ["ground", "crank", "coupler", "rocker"]),
    ],
)
def test_derivatives_of_positions_and_rates_agree_with_50_digits(name, point, place, parameters):
    drive = catalog.make(name)
    result = motion_derivatives(drive, changes(catalog_designs(drive), parameters), ANGLES, SPEED)
    for parameter in parameters:
        moved = result.by[parameter].points[point]
        for i, angle in enumerate(ANGLES[:1]):
            reported = moved.position[i], moved.velocity[i], moved.acceleration[i]
            for own, exact in zip(reported, in_digits(place, drive, parameter, angle), strict=True):
                assert np.abs(own - exact).max() <= 2e-12 * np.abs(exact).max()


def differences(of: DesignFamily, name, angles, speed, part=1e-5):
    """Motions next to one, and the step between them, for a difference of fourth order."""
    value = of.dimensions[name].value
    step = part * max(abs(value), 0.01)
    return [of.make({name: value + k * step}).solve_along(angles, speed) for k in (-2, -1, 1, 2)], step


@pytest.mark.parametrize(
    ("model", "given", "names"),
    [
        ("warp_knitter", {}, ["rod3", "phase", "gear_ratio", "base_k.y"]),
        ("looper", {}, ["frame_angle", "axis_z"]),
        ("bennett", {}, ["twist0"]),
        ("rsur", {}, ["rocker", "z"]),
        ("rack_steering", {"drive": {"pinion": "40deg*sin(2*pi*t)"}}, ["radius", "arm", "inward"]),
        ("humanoid_ankle", {"drive": dict.fromkeys(("left", "right"), "9deg*sin(2*pi*t)")}, ["crank"]),
    ],
)
def test_derivatives_agree_with_finite_differences(model, given, names):
    of = parametric_model(model, **given)
    form = of.make({})
    turning = form.mechanism.has_crank and not given
    angles = form.mechanism.start + ANGLES[:3] if turning else ANGLES[:2] / 10.0 * form.motion_laws.rate
    speed = SPEED if turning else form.motion_laws.rate
    result = motion_derivatives(form, changes(of, names), angles, speed)
    kinds = {"points": ("position", "velocity", "acceleration"), "joints": ("value", "rate")}
    for name in names:
        neighbours, step = differences(of, name, angles, speed)
        for kind, part in ((kind, part) for kind, parts in kinds.items() for part in parts):
            reported = {item: getattr(moved, part) for item, moved in getattr(result.by[name], kind).items()}
            # a closed form does not tell joints of several coordinates
            shared = [item for item in reported if item in getattr(neighbours[0], kind)]
            size = max(0.1, *(np.abs(reported[item]).max() for item in shared))
            for item in shared:
                a, b, c, d = (getattr(getattr(motion, kind)[item], part) for motion in neighbours)
                assert np.abs((a - 8 * b + 8 * c - d) / (12 * step) - reported[item]).max() <= 1e-7 * size


def test_joint_position_and_rocker_length_have_the_same_derivative():
    drive = catalog.make("rssr")
    of = placed_designs(LoopForm(drive.mechanism))
    own = changes(of, ["P3.b.at.x"])
    result = motion_derivatives(drive, own, ANGLES)
    by_rocker = motion_derivatives(drive, changes(catalog_designs(drive), ["rocker"]), ANGLES)
    # the tracked point P3 is of the rocker's length too: the joint's angle tells both alike
    reported = result.by["P3.b.at.x"].joints["rocker"].value
    assert (
        np.abs(reported - by_rocker.by["rocker"].joints["rocker"].value).max()
        <= 1e-12 * np.abs(reported).max()
    )


def test_a_dimension_that_violates_redundant_equations_is_rejected():
    drive = catalog.make("four_bar")
    of = placed_designs(drive)
    motion_derivatives(drive, changes(of, ["A.a.at.x"]), ANGLES)
    with pytest.raises(AssemblyError, match=r"A\.a\.at\.z alone makes redundant loop equations inconsistent"):
        motion_derivatives(drive, changes(of, ["A.a.at.z"]), ANGLES)


def test_derivatives_at_a_change_point_are_rejected():
    drive = catalog.make("four_bar", ground=0.1, coupler=0.1, crank=0.04, rocker=0.04)
    change = changes(catalog_designs(drive), ["coupler"])
    with pytest.raises(AssemblyError, match="is a change point, where derivatives"):
        motion_derivatives(drive, change, [1.0, np.pi - 1e-6])


def test_a_description_with_a_kink_is_rejected():
    drive = catalog.make("four_bar")
    plain = catalog_designs(drive)
    bent = replace(
        plain, describe=lambda v: plain.describe({"arm": abs(v.get("crank", 0.032) - 0.032) + 0.05})
    )
    with pytest.raises(InputError, match=r"no derivative by crank at 0\.032: it has a kink"):
        changes(bent, ["crank"])


def test_derivatives_of_another_mechanism_are_rejected():
    drive = catalog.make("four_bar")
    other = changes(catalog_designs(catalog.make("rssr")), ["crank"])
    with pytest.raises(InputError, match="has shape"):
        motion_derivatives(drive, other, ANGLES)


def test_a_perturbed_file_is_described_without_assembly(monkeypatch):
    of, near = parametric_model("hoeken"), {"arm": 0.176}
    made = of.make(near).mechanism

    def refused(mechanism):
        raise AssemblyError("nothing is to be put together")

    monkeypatch.setattr(readers, "with_closed_guess", refused)
    with pytest.raises(AssemblyError):
        of.make(near)
    assert (numbers_of(of.describe(near)) == numbers_of(made)).all()
