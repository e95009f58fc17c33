"""The cause of a difference is reported with its size; unexplained and absent differences have no cause."""

from dataclasses import replace

import numpy as np
import pytest
from motions import largest_difference

import mechsim as ms
from mechsim.io.readers import parametric_model
from mechsim.mechanism.quantities import quantity
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, evaluation_points

SPEED = 20 * np.pi


def findings_of(function, model="four_bar", **options):
    return ms.validate(model, against=function, stepped=False, **options)


def bar(offset=0.0, scale=1.0, **changed):
    """Return the formula of a four-bar with other dimensions and transformed crank angles."""
    solver = ms.catalog.make("four_bar", **changed)

    def function(angle):
        motion = solver.solve(scale * angle + offset)
        points = {name: motion.points[name].position for name in ("B", "C")}
        return points | {"rocker": motion.joints["rocker"].value}

    return function


def with_changed_values(change):
    """Return the correct formula of a four-bar with changed values."""
    return lambda angle: change(bar()(angle))


def points(change):
    return with_changed_values(lambda v: v | {name: change(v[name]) for name in ("B", "C")})


def on(name, change):
    return with_changed_values(lambda v: v | {name: change(v[name])})


SHIFT, TINY_SHIFT = np.array([0, 1e-4, 0]), np.array([0, 1.2e-6, 0])
SMALL_ROTATION = np.array([[np.cos(0.01), -np.sin(0.01), 0], [np.sin(0.01), np.cos(0.01), 0], [0, 0, 1]])
RIGHT = {
    name: getattr(ms.catalog.make("four_bar"), name) for name in ("crank", "coupler", "rocker", "ground")
}
CASES = {
    "coupler": (bar(coupler=1.001 * RIGHT["coupler"]), "dimension", "coupler", 1e-3),
    "rocker": (bar(rocker=0.95 * RIGHT["rocker"]), "dimension", "rocker", -0.05),
    "crank": (bar(crank=1.0001 * RIGHT["crank"]), "dimension", "crank", 1e-4),
    "offset": (bar(offset=0.02), "offset", "crank", 0.02),
    "quarter": (bar(offset=1.5), "offset", "crank", 1.5),
    "sense": (bar(scale=-1.0), "sense", "crank", -1.0),
    "assembly": (bar(branch=-ms.catalog.make("four_bar").branch), "assembly", "branch = -1", None),
    "mm": (points(lambda v: 1000 * v), "units", "", 1000.0),
    "degrees": (on("rocker", np.rad2deg), "degrees", "", 180 / np.pi),
    "of a driver": (bar(scale=np.pi / 180), "degrees", "crank", np.pi / 180),
    "swapped": (with_changed_values(lambda v: v | {"B": v["C"], "C": v["B"]}), "swapped", "B, C", None),
    "mirror": (points(lambda v: v * [1, -1, 1]), "mirror", "x, -y, z", None),
    "shifted": (points(lambda v: v + SHIFT), "frame", "y", 1e-4),
    "turned": (points(lambda v: v @ SMALL_ROTATION.T), "frame", "turn about z", 0.01),
    "zero": (on("rocker", lambda v: v + 0.1), "offset", "rocker", 0.1),
    "joint direction": (on("rocker", np.negative), "sense", "rocker", -1.0),
    "late": (
        with_changed_values(lambda v: {name: np.roll(item, 2, 0) for name, item in v.items()}),
        "delay",
        "samples",
        2.0,
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_the_cause_of_a_difference_is_reported_with_its_size(name):
    function, kind, what, by = CASES[name]
    result = findings_of(function)
    first = result.findings[0]
    assert not result.passed
    assert (first.kind, first.object) == (kind, what), result.why
    assert first.certain
    assert first.explains > 0.999
    assert by is None or first.value == pytest.approx(by, rel=1e-3)


@pytest.mark.long
def test_an_unexplained_difference_is_reported_as_such():
    result = findings_of(points(lambda v: v + 1e-4 * np.sin(7 * np.arange(len(v)))[:, None]))
    assert not result.passed
    assert not any(item.certain for item in result.findings)
    assert "none of the tested causes" in result.findings[-1].message


def test_a_difference_just_above_its_tolerance_has_no_cause():
    result = findings_of(points(lambda v: v + TINY_SHIFT), tolerance=1e-6)
    assert not result.passed
    assert [item.kind for item in result.findings] == ["none"]


def test_equally_good_causes_are_all_reported():
    # the causes are indistinguishable for a point on a circle about the origin
    result = findings_of(
        lambda angle: {"A": ms.catalog.make("four_bar").solve(angle + 0.02).points["A"].position}
    )
    assert {(item.kind, item.object) for item in result.findings} == {
        ("offset", "crank"),
        ("frame", "turn about z"),
    }
    assert "as does another" in result.why


@pytest.mark.long
def test_a_phase_error_of_a_motion_law_is_reported():
    solver = ms.load("five_bar")
    late = ms.load(
        "five_bar", drive={"left": "120deg + 25deg*sin(2*pi*(t-0.01))", "right": "60deg + 20deg*sin(4*pi*t)"}
    )

    def values_of_function(other):
        return lambda drivers, t: {"P": other.solve(t=t).points["P"].position}

    first = findings_of(values_of_function(late), solver).findings[0]
    assert (first.kind, first.object, first.certain) == ("phase", "left", True)
    assert first.value == pytest.approx(0.01, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "slip"), [("warp_knitter", 2.0), ("warp_knitter", -0.5), ("planetary_gear", 0.75)]
)
def test_a_wrong_gear_ratio_is_reported(model, slip):
    solver = ms.load(model)
    if model == "warp_knitter":
        wrong, ratio = solver.with_parameters(gear_ratio=slip), solver.gear_ratio
    else:
        first, second = solver.mechanism.gears
        gears = (first, replace(second, ratio=slip))
        wrong, ratio = solver.with_mechanism(replace(solver.mechanism, gears=gears)), second.ratio

    def function(angle):
        return {name: point.position for name, point in wrong.solve(angle).points.items()}

    cause = findings_of(function, model).findings[0]
    assert (cause.kind, cause.explains) == ("gear", pytest.approx(1.0))
    assert cause.value == pytest.approx((slip - ratio) / abs(ratio))
    assert f"is {slip:g} instead of {ratio:g}" in cause.message


@pytest.mark.long
def test_a_displaced_joint_is_reported_without_parameters():
    solver = ms.load("four_bar")
    mechanism = solver.mechanism
    joint = mechanism.joints[-1]
    x, y, z = joint.a.point
    moved = replace(joint, a=replace(joint.a, point=(x + 1e-4, y, z)))
    other = replace(mechanism, joints=(*mechanism.joints[:-1], moved))
    result = findings_of(lambda angle: {"B": ms.loops.solve(other, angle).points["B"].position}, mechanism)
    assert result.findings[0].kind == "dimension"
    assert result.findings[0].object.startswith(f"{joint.name}.")
    assert result.findings[0].certain


@pytest.mark.parametrize(
    ("factor", "kind"), [(0.0, "gravity"), pytest.param(None, "mass", marks=pytest.mark.slow)]
)
def test_wrong_gravity_or_mass_is_found_from_a_torque(factor, kind):
    solver = ms.catalog.make("four_bar")
    dynamic_model = ms.dynamics.dynamic_model(solver, ms.Forces(gravity=(0.0, -9.81, 0.0)))
    evaluation = replace(evaluation_points(solver, SPEED), dynamic_model=dynamic_model)
    if factor is None:
        item, *rest = dynamic_model.mechanism.links
        heavy = replace(item.inertia, mass=1.1 * item.inertia.mass)
        other = replace(
            dynamic_model,
            mechanism=replace(dynamic_model.mechanism, links=(replace(item, inertia=heavy), *rest)),
        )
    else:
        other = dynamic_model.with_forces(ms.Forces(gravity=(0.0, -9.81 * factor, 0.0)))
    named = quantity("torque:crank", solver.mechanism)
    candidate = Candidate(named, replace(evaluation, dynamic_model=other).exact(named))
    result = agreement(evaluation, [candidate], "the test", None, parametric_model(solver))
    assert result.findings[0].kind == kind, result.why
    assert result.findings[0].certain


def test_shifted_instants_keep_the_assembly_mode_of_the_first():
    parallelogram = ms.catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.1, rocker=0.04)
    angle = np.linspace(2.0, 3.0, 5) + np.pi
    steady = np.ones(5)
    evaluation = EvaluationPoints(parallelogram, angle, steady, 0.0 * steady)
    late = replace(evaluation, angle=angle - 3.0).motion
    exact = parallelogram.starting_at(angle).solve(angle - 3.0)
    assert largest_difference(exact, parallelogram.solve(angle - 3.0)) > 0.01
    assert largest_difference(late, exact) <= 1e-15
