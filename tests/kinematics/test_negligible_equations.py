"""Loops with negligible equations: a ball joint at the intersection of all axes, or on a shaft axis."""

import math
from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.errors import MobilityError
from mechsim.kinematics.continuation.free_loops import free_loops
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.kinematics.loops.start import assembled
from mechsim.simulation import mobility, source
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf.compiling import compiled, to_xml
from mechsim.simulation.mjcf_reader.reading import read_model
from mechsim.studies.scene.exact_closure import exact_closure
from mechsim.studies.trace import CurveSearch

AXES = {  # of each joint: axis and reference on its first and second link
    "crank": ((0.36, -0.48, 0.8), (0.8, 0.6, 0.0), (0.28, 0.0, 0.96), (0.0, 1.0, 0.0)),
    "A": ((-0.6, 0.64, 0.48), (0.8, 0.48, 0.36), (0.48, 0.6, 0.64), (0.8, 0.0, -0.6)),
    "B": ((0.0, -0.28, 0.96), (1.0, 0.0, 0.0), (0.8, -0.36, 0.48), (0.6, 0.48, -0.64)),
}
CHAIN = ("ground", "crank", "coupler", "rocker")
CENTRES = {
    "ground": (1.3, -0.7, 2.1),
    "crank": (0.31, 1.7, -0.9),
    "coupler": (-1.1, 0.23, 0.7),
    "rocker": (0.57, -0.3, 1.9),
}
TIP = (-0.83, 1.21, 0.37)
MOTION_LAWS = {"crank": "1.1rad/s", "A": "0.4rad + 0.7rad*sin(t)", "B": "-0.3rad - 0.9rad*t"}
# the second bearing lies 7 cm along the axis of the first
SHAFT = model_text("negligible_equations_shaft.toml")


def spherical_linkage(tmp_path, drivers):
    """Return three revolute joints through one point and a redundant ball joint there."""
    lines = ['name = "spherical"', f"drivers = {[*drivers]}", 'units = { length = "cm", angle = "rad" }']
    lines += ["[motion_laws]", *(f'{name} = "{MOTION_LAWS[name]}"' for name in drivers)]
    for (name, (u, x, v, y)), a, b in zip(AXES.items(), CHAIN[:-1], CHAIN[1:], strict=True):
        lines += [f"[joints.{name}]", 'kind = "revolute"']
        for side, link, axis, reference in (("a", a, u, x), ("b", b, v, y)):
            centre = [*CENTRES[link]]
            lines += [
                f'{side} = {{ link = "{link}", at = {centre}, axis = {[*axis]}, reference = {[*reference]} }}'
            ]
    ball = [
        f'{s} = {{ link = "{link}", at = {[*CENTRES[link]]} }}'
        for s, link in (("a", "ground"), ("b", "rocker"))
    ]
    lines += ["[joints.O]", 'kind = "spherical"', *ball]
    lines += ["[points]", f'P = {{ link = "rocker", at = {[*TIP]} }}']
    path = tmp_path / "spherical.toml"
    path.write_text("\n".join(lines) + "\n")
    return ms.load(str(path))


def frame(axis, reference):
    axis = np.array(axis) / np.linalg.norm(axis)
    across = np.array(reference) - np.dot(reference, axis) * axis
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(axis, across), axis])


def exact_point(values):
    """Return the position of the point by three rotations about the centre, in [m]."""
    rotation = np.eye(3)
    for (u, x, v, y), q in zip(AXES.values(), values, strict=True):
        spin = np.array([[math.cos(q), -math.sin(q), 0.0], [math.sin(q), math.cos(q), 0.0], [0.0, 0.0, 1.0]])
        rotation = rotation @ frame(u, x) @ spin @ frame(v, y).T
    return 1e-2 * (np.array(CENTRES["ground"]) + rotation @ (np.array(TIP) - CENTRES["rocker"]))


@pytest.mark.parametrize("method", ["closed", "pose", "step"])
def test_a_redundant_ball_joint_removes_no_dof_in_any_method(method, tmp_path):
    linkage = spherical_linkage(tmp_path, AXES)
    result = driver_determinacy(linkage.mechanism)
    assert (result.dofs, result.outcome, result.redundant_equations) == (3, "determined", 3)
    if method == "closed":
        moves = linkage.motion_laws
        motion = linkage.solve(t=np.linspace(0.0, moves.duration, 9))
    else:
        run = ms.simulate(linkage, method=method, samples=8)
        assert run.outcome == "passed"
        motion = run.motion
    values = np.stack([motion.joints[name].value for name in AXES], 1)
    for q, position in zip(values, motion.points["P"].position, strict=True):
        np.testing.assert_allclose(position, exact_point(q), rtol=0, atol=1e-15)
    t = np.linspace(0.0, 1.0, 9)
    expected = np.stack([1.1 * t, 0.4 + 0.7 * np.sin(t), -0.3 - 0.9 * t], 1)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-5 if method == "step" else 1e-14)


def test_undetermined_joints_are_reported_by_both_methods(tmp_path):
    linkage = spherical_linkage(tmp_path, ["crank", "A"])
    with pytest.raises(MobilityError, match="underdetermined: with the drivers locked, B can still move"):
        linkage.solve(t=np.linspace(0.0, 1.0, 5))
    lone = spherical_linkage(tmp_path, ["crank"])
    residual = mobility.residual_mobility(source.from_source(lone.mechanism))
    assert "point P" in residual.undetermined
    assert not residual.immobile_drivers


@pytest.fixture
def shaft(tmp_path):
    return shaft_in("m", tmp_path)


def shaft_in(length, tmp_path):
    path = tmp_path / "shaft.toml"
    path.write_text(SHAFT.replace("drivers", f'units = {{ length = "{length}" }}\ndrivers'))
    return ms.load(str(path))


def written(linkage, tmp_path, *, exactly):
    """A file of MJCF, with all digits or with MuJoCo's six."""
    spec = source.assembled(linkage.mechanism, ms.Scene(level="motion"))
    path = tmp_path / "written.xml"
    path.write_text(to_xml(spec) if exactly else spec.to_xml())
    return str(path)


@pytest.mark.parametrize("length", ["m", "km"])
@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_shaft_in_two_bearings_can_turn(method, length, tmp_path):
    run = ms.simulate(shaft_in(length, tmp_path), method=method, speed=6.0, turns=0.3, samples=5)
    assert run.outcome == "passed"


@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_redundant_bearing_has_no_reaction(method, shaft):
    forces = ms.Forces(gravity=(0.3, -9.81, 0.5))
    run = driven(shaft.mechanism, forces, method=method, speed=6.0, turns=0.3, samples=5)
    assert np.abs(run.forces.reactions["bearing"].force).max() <= 1e-12


@pytest.mark.parametrize("exactly", [True, False])
def test_three_redundant_equations_of_a_shaft_are_reported(exactly, shaft, tmp_path):
    (result,) = findings(read_model(written(shaft, tmp_path, exactly=exactly)))
    assert (result.kind, result.value) == ("redundant", 3)
    assert "3 constraint equations of the loops have rank 0" in result.message


def test_a_spherical_linkage_with_six_digits_has_the_exact_motion(tmp_path):
    path = written(spherical_linkage(tmp_path, AXES), tmp_path, exactly=False)
    moves = {"crank": "1.1rad/s", "A": "0.4rad + 0.7rad*sin(t)", "B": "-0.3rad - 0.9rad*t"}
    model = ms.load(path, drive=moves)
    assert driver_determinacy(model.mechanism).dofs == 3
    motion = model.solve(t=np.linspace(0.0, 1.0, 7))
    values = np.stack([motion.joints[name].value for name in AXES], 1)
    for q, position in zip(values, motion.points["P"].position, strict=True):
        np.testing.assert_allclose(position, exact_point(q), rtol=0, atol=1e-6)


def test_undetermined_joints_stay_at_rest(tmp_path):
    path = written(spherical_linkage(tmp_path, AXES), tmp_path, exactly=True)
    read = read_model(path, drivers=("crank", "A"))
    model = compiled(read.spec)
    rates = exact_closure(read.mechanism, model, {}).rates(read.qpos, {"crank": 1.1, "A": -0.7})
    assert rates.tolist() == [1.1, -0.7, 0.0]


def test_a_shaft_in_two_bearings_has_one_dof_at_every_angle(shaft):
    loops, own = assembled(shaft.mechanism)
    search = CurveSearch(free_loops(replace(loops, driven=()), own), lambda *_: None)
    search.add(Coordinates(own.values + np.linspace(0.0, 3.0, 7), np.repeat(own.turns, 7, -1)), counted=True)
    assert search.dofs.tolist() == [1] * 7
