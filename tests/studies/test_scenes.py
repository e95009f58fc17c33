from dataclasses import replace

import mujoco
import numpy as np
import pytest
from model_files import model_text
from scene_texts import DRIVEN, FINGER, scene

from mechsim.errors import AssemblyError
from mechsim.studies.scene.converged_reference import compute_reference, hardened
from mechsim.studies.scene.errors import SceneEvaluator, cubic_interpolation, sampled_run
from mechsim.studies.scene.run import run_scene
from mechsim.studies.scene.scene import open_scene


@pytest.mark.parametrize("samples", [2, 3, 8, 11, 601])
def test_any_number_of_samples_is_evenly_spaced(controlled, samples):
    """Between two steps, a state is off the straight line by 0.26 of the largest second difference.

    The remainder of a cubic in Newton's form: t(t-1)/2 and t(t-1)(t-2)/6 times differences of order 2 and 3.
    """
    run = run_scene(controlled, records=None)
    sampled = sampled_run(run, samples)
    assert sampled.time == pytest.approx(np.linspace(0.0, 0.5, samples), abs=1e-15)
    for values, between in ((run.qpos, sampled.qpos), (run.qvel, sampled.qvel)):
        straight = np.stack([np.interp(sampled.time, run.time, column) for column in values.T], 1)
        curvature = np.abs(np.diff(values, n=2, axis=0)).max()
        assert np.abs(between - straight).max() <= 0.26 * curvature


def test_closure_errors_measure_the_distance_to_the_closed_state(controlled):
    closure = controlled.closure
    assert closure.drivers == ("knuckle",)
    state = closure.moved_to(controlled.start[0], {"knuckle": 0.4})
    run = replace(run_scene(controlled, records=2), qpos=state[None])
    assert closure.errors(run.qpos, run.points).max() < 1e-14
    perturbed = run.qpos.copy()
    perturbed[0, 2] += 1e-4  # rotates the lever by 1e-4 rad on an arm of 0.05 m
    moved = replace(run, qpos=perturbed)
    assert 1e-6 < closure.errors(moved.qpos, moved.points).max() < 1e-5


def test_a_state_far_from_closed_poses_has_a_large_error(controlled):
    distant = controlled.start[0][None] + np.array([3.0, 0.0, 0.0, 0.0])
    run = replace(run_scene(controlled, records=2), qpos=distant)
    assert controlled.closure.errors(run.qpos, run.points).max() > 1e-2


def test_points_undetermined_by_the_drivers_have_no_error(controlled):
    state = controlled.closure.moved_to(controlled.start[0], {"knuckle": 0.2})
    swung = state + np.array([0.0, 0.0, 0.0, 0.7])
    run = replace(run_scene(controlled, records=2), qpos=swung[None])
    assert controlled.closure.errors(run.qpos, run.points).max() < 1e-14


def test_a_prescribed_joint_follows_its_motion_law_from_a_closed_start(driven):
    run = run_scene(driven)
    assert SceneEvaluator().errors(run).drive_error < 1e-9
    qpos, qvel = driven.start
    assert qvel[0] == pytest.approx(np.pi)
    model, step = driven.model, 1e-6
    later = qpos.copy()
    mujoco.mj_integratePos(model, later, qvel, step)
    run = replace(run, qpos=later[None])
    assert driven.closure.errors(run.qpos, run.points).max() < 1e-10  # second order in the step


@pytest.mark.long
def test_stiffer_loops_and_smaller_steps_converge_to_the_reference(driven):
    limit = compute_reference(driven, 1e-8)
    assert not limit.broken
    assert limit.errors[0] < 1e-8
    assert 1.5 < limit.order < 2.5
    published = SceneEvaluator(limit.run, forces=True).errors(run_scene(driven))
    hard = SceneEvaluator(limit.run, forces=True).errors(
        run_scene(driven, hardened(driven.model, 1e-4, "RK4"))
    )
    assert hard.closure < 1e-3 * published.closure
    assert hard.trajectory < 1e-2 * published.trajectory
    assert hard.torque < 0.1 * published.torque


def test_the_drive_torque_balances_the_energy(tmp_path):
    text = FINGER.replace('damping="0.002"', 'damping="0"').replace('damping="0.001"', 'damping="0"')
    text = text.replace('<position name="servo" joint="knuckle" kp="0.5" kv="0.02"/>', "")
    scene_ = scene(tmp_path, text=text, drive=DRIVEN)
    run = run_scene(scene_, hardened(scene_.model, 5e-5, "RK4"), records=2000)
    energies = []
    plain = mujoco.MjModel.from_xml_string(text)
    plain.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(plain)
    for qpos, qvel in zip(run.qpos, run.qvel, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(plain, data)
        energies.append(data.energy.sum())
    power = run.forces[:, 0] * run.qvel[:, 0]
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(run.time))])
    change = np.array(energies) - energies[0]
    assert np.abs(work - change).max() < 1e-5 * np.abs(change).max()


def test_a_diverged_run_has_infinite_errors(driven):
    model = hardened(driven.model, 0.02, "Euler")
    model.eq_solref[:] = -1e9, -1.0
    run = run_scene(driven, model)
    assert "state became invalid" in run.broken
    errors = SceneEvaluator().errors(run)
    assert np.isinf([errors.closure, errors.trajectory, errors.torque]).all()
    assert np.isinf(run.seconds_per_second)


def test_tracked_body_points_agree_with_mujoco(controlled):
    run = run_scene(controlled, records=4)
    data = mujoco.MjData(controlled.model)
    data.qpos[:] = run.qpos[3]
    mujoco.mj_kinematics(controlled.model, data)
    points = dict(zip(controlled.tracked, run.points[3], strict=True))
    for name in ("crank", "rod", "lever", "pad"):
        assert data.body(name).xpos == pytest.approx(points[name], abs=1e-15)


def test_loop_points_are_tracked_automatically(controlled):
    run = run_scene(controlled, records=20)
    points = dict(zip(controlled.tracked, np.moveaxis(run.points, 1, 0), strict=True))
    closure_error = np.linalg.norm(points["closing@rod"] - points["closing@lever"], axis=1).max()
    assert closure_error > 1e-7
    assert SceneEvaluator().errors(run).closure > 0.4 * closure_error


def test_a_short_run_is_timed_under_a_processor_time_limit(controlled):
    """Such a limit reduces the resolution of the process clock to milliseconds."""
    resource = pytest.importorskip("resource")
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    spent = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    before = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (int(spent) + 1000, hard))
    try:
        seconds = [
            run_scene(controlled, records=2, duration=float(controlled.model.opt.timestep)).seconds
            for _ in range(20)
        ]
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, before)
    assert min(seconds) > 0.0


def test_cubic_interpolation_is_exact_for_cubics():
    instants = np.linspace(0.0, 1.0, 21)
    values = np.stack([instants**3, 1.0 - instants**2], 1)
    time = np.array([0.0, 0.013, 0.5, 0.987, 1.0])
    assert cubic_interpolation(instants, values, time) == pytest.approx(
        np.stack([time**3, 1.0 - time**2], 1), abs=1e-14
    )


def test_a_scene_with_actuators_between_sites_closes_at_independent_joints(tmp_path):
    cylinder = (
        '<tendon><spatial name="line"><site site="foot"/><site site="lug"/></spatial></tendon>'
        '<actuator><position name="lift" tendon="line" kp="9" kv="1"/></actuator></mujoco>'
    )
    text = FINGER[: FINGER.index("<actuator>")] + cylinder
    text = text.replace("<worldbody>", '<worldbody><site name="foot" pos="0.02 -0.04 0"/>')
    text = text.replace('<body name="rod"', '<site name="lug" pos="0.02 0 0"/><body name="rod"')
    (tmp_path / "finger.xml").write_text(text)
    item, _ = open_scene(str(tmp_path / "finger.xml"), ctrl={"lift": "0.045"}, duration=0.1)
    assert set(item.mechanism.drivers) == {"knuckle", "swing"}
    run = run_scene(item)
    errors = SceneEvaluator().errors(run)
    assert run.displacement_range > 1e-4
    # a soft loop: not zero, and far below the motion
    assert 1e-9 < errors.closure < 0.1 * run.displacement_range


def test_an_unreachable_start_of_motion_laws_is_rejected(tmp_path):
    with pytest.raises(AssemblyError, match="on the path to the start of the motion laws"):
        scene(tmp_path, drive={"pivot": "3 + t"})


def test_ball_joints_and_free_bodies_close_in_their_own_coordinates(tmp_path):
    text = model_text("scenes_text.xml")
    item = scene(tmp_path, text=text, drive={"crank": "0.5 + 3*t"}, duration=0.1)
    run = run_scene(item, hardened(item.model, 1e-4, "RK4"), records=100)
    assert SceneEvaluator().errors(run).closure < 1e-8
    qpos, qvel = item.start
    later = qpos.copy()
    mujoco.mj_integratePos(item.model, later, qvel, 1e-6)
    moved = replace(run, qpos=later[None])
    assert item.closure.errors(moved.qpos, moved.points).max() < 1e-10


def test_drive_inertia_does_not_change_the_solver_tolerance(controlled, driven):
    # MuJoCo stops if an iteration gains less than tolerance times mean inertia times degrees of freedom
    plain, with_drive_inertia = (
        item.model.opt.tolerance * item.model.stat.meaninertia for item in (controlled, driven)
    )
    assert driven.model.stat.meaninertia > 1e6 * controlled.model.stat.meaninertia
    assert with_drive_inertia == pytest.approx(plain, rel=1e-9)
