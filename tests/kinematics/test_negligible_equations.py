"""Loops with negligible equations: a ball joint at the intersection of all axes, or on a shaft axis."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import load_model
from scipy.spatial.transform import Rotation

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

LAWS = {"crank": "1.1rad/s", "A": "0.4rad + 0.7rad*sin(t)", "B": "-0.3rad - 0.9rad*t"}


def spherical_linkage(drivers=tuple(LAWS)):
    """Return three revolute joints through one point and a redundant ball joint there."""
    laws = ", ".join(f"{name} = '{LAWS[name]}'" for name in drivers)
    return load_model("negligible_equations_spherical.toml", drivers=[*drivers], laws=laws)


def exact_points(values):
    """Return positions of the point by three rotations about the centre, (n, 3) in [m]."""
    mechanism, rotation = spherical_linkage().mechanism, Rotation.identity()
    for name, angle in zip(LAWS, values.T, strict=True):
        joint = mechanism.joint(name)
        a, b = (Rotation.from_matrix(end.frame) for end in (joint.a, joint.b))
        rotation = rotation * a * Rotation.from_euler("z", angle[:, None]) * b.inv()
    ball = mechanism.joint("O")
    return ball.a.point + rotation.apply(np.subtract(mechanism.points["P"][1], ball.b.point))


@pytest.mark.parametrize("method", ["closed", "pose", "step"])
def test_a_redundant_ball_joint_removes_no_dof_in_any_method(method):
    linkage = spherical_linkage()
    result = driver_determinacy(linkage.mechanism)
    assert (result.dofs, result.outcome, result.redundant_equations) == (3, "determined", 3)
    if method == "closed":
        moves = linkage.motion_laws
        motion = linkage.solve(t=np.linspace(0.0, moves.duration, 9))
    else:
        run = ms.simulate(linkage, method=method, samples=8)
        assert run.outcome == "passed"
        motion = run.motion
    values = np.stack([motion.joints[name].value for name in LAWS], 1)
    np.testing.assert_allclose(motion.points["P"].position, exact_points(values), rtol=0, atol=1e-15)
    t = np.linspace(0.0, 1.0, 9)
    expected = np.stack([1.1 * t, 0.4 + 0.7 * np.sin(t), -0.3 - 0.9 * t], 1)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-5 if method == "step" else 1e-14)


def test_undetermined_joints_are_reported_by_both_methods():
    linkage = spherical_linkage(["crank", "A"])
    with pytest.raises(MobilityError, match="underdetermined: with the drivers locked, B can still move"):
        linkage.solve(t=np.linspace(0.0, 1.0, 5))
    lone = spherical_linkage(["crank"])
    residual = mobility.residual_mobility(source.from_source(lone.mechanism))
    assert "point P" in residual.undetermined
    assert not residual.immobile_drivers


@pytest.fixture
def shaft():
    return shaft_in("m")


def shaft_in(length):
    """Return a shaft in two bearings, of which the second lies 0.07 units of length along the axis."""
    change = "drivers", f'units = {{ length = "{length}" }}\ndrivers'
    return load_model("negligible_equations_shaft.toml", change)


def written(linkage, tmp_path, *, exactly):
    """A file of MJCF, with all digits or with MuJoCo's six."""
    spec = source.assembled(linkage.mechanism, ms.Scene(level="motion"))
    path = tmp_path / "written.xml"
    path.write_text(to_xml(spec) if exactly else spec.to_xml())
    return str(path)


@pytest.mark.parametrize("length", ["m", "km"])
@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_shaft_in_two_bearings_can_turn(method, length):
    run = ms.simulate(shaft_in(length), method=method, speed=6.0, turns=0.3, samples=5)
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
    path = written(spherical_linkage(), tmp_path, exactly=False)
    model = ms.load(path, drive=LAWS)
    assert driver_determinacy(model.mechanism).dofs == 3
    motion = model.solve(t=np.linspace(0.0, 1.0, 7))
    values = np.stack([motion.joints[name].value for name in LAWS], 1)
    np.testing.assert_allclose(motion.points["P"].position, exact_points(values), rtol=0, atol=1e-6)


def test_undetermined_joints_stay_at_rest(tmp_path):
    path = written(spherical_linkage(), tmp_path, exactly=True)
    read = read_model(path, drivers=("crank", "A"))
    model = compiled(read.spec)
    rates = exact_closure(read.mechanism, model, {}).rates(read.qpos, {"crank": 1.1, "A": -0.7})
    assert rates.tolist() == [1.1, -0.7, 0.0]


def test_a_shaft_in_two_bearings_has_one_dof_at_every_angle(shaft):
    loops, own = assembled(shaft.mechanism)
    search = CurveSearch(free_loops(replace(loops, driven=()), own), lambda *_: None)
    search.add(Coordinates(own.values + np.linspace(0.0, 3.0, 7), np.repeat(own.turns, 7, -1)), counted=True)
    assert search.dofs.tolist() == [1] * 7
