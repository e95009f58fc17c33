from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scene_texts import FINGER, scene

from mechsim.errors import AssemblyError, InputError
from mechsim.studies.scene.converged_reference import compute_reference, hardened
from mechsim.studies.scene.errors import SceneEvaluator, cubic_interpolation
from mechsim.studies.scene.run import run_scene, step_times

FED, DRIVEN = {"servo": "0.5*sin(2*pi*t)"}, {"knuckle": "0.5*sin(2*pi*t)"}


@pytest.fixture(scope="module")
def fed(tmp_path_factory):
    return scene(tmp_path_factory.mktemp("fed"), ctrl=FED)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    return scene(tmp_path_factory.mktemp("driven"), drive=DRIVEN)


def test_a_run_is_what_a_loop_in_python_gets_of_the_file(fed):
    model = mujoco.MjModel.from_xml_path(fed.path)
    data, states = mujoco.MjData(model), []
    for _ in range(250):
        data.ctrl[0] = 0.5 * np.sin(2 * np.pi * data.time)
        mujoco.mj_step(model, data)
        states.append(data.qpos.copy())
    run = run_scene(fed, records=None)
    assert np.abs(run.qpos[1:] - states).max() < 1e-12
    assert run.time[-1] == pytest.approx(0.5)


def test_the_closure_of_a_closed_state_is_that_state_and_of_one_that_is_open_by_a_little_as_far(fed):
    closure = fed.closure
    assert closure.drivers == ("knuckle",)
    state = closure.moved_to(fed.start[0], {"knuckle": 0.4})
    run = replace(run_scene(fed, records=2), qpos=state[None])
    assert closure.errors(run.qpos, run.points).max() < 1e-14
    aside = run.qpos.copy()
    aside[0, 2] += 1e-4  # the lever turns 0.05 m off its point, and the rod with it
    moved = replace(run, qpos=aside)
    assert 1e-6 < closure.errors(moved.qpos, moved.points).max() < 1e-5


def test_a_state_that_no_closed_pose_is_near_is_infinitely_wrong(fed):
    far = fed.start[0][None] + np.array([3.0, 0.0, 0.0, 0.0])
    run = replace(run_scene(fed, records=2), qpos=far)
    assert fed.closure.errors(run.qpos, run.points).max() > 1e-2


def test_points_that_drivers_leave_open_belong_where_they_are(fed):
    state = fed.closure.moved_to(fed.start[0], {"knuckle": 0.2})
    swung = state + np.array([0.0, 0.0, 0.0, 0.7])
    run = replace(run_scene(fed, records=2), qpos=swung[None])
    assert fed.closure.errors(run.qpos, run.points).max() < 1e-14


def test_a_prescribed_joint_is_where_its_motion_law_is_and_starts_closed_with_its_rates(driven):
    run = run_scene(driven)
    assert SceneEvaluator().errors(run).drive_error < 1e-9
    qpos, qvel = driven.start
    assert qvel[0] == pytest.approx(np.pi)
    model, step = driven.model, 1e-6
    later = qpos.copy()
    mujoco.mj_integratePos(model, later, qvel, step)
    run = replace(run, qpos=later[None])
    assert driven.closure.errors(run.qpos, run.points).max() < 1e-10  # the square of the step


def test_harder_loops_and_smaller_steps_err_less_and_tend_to_the_limit(driven):
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


def test_the_torque_of_a_drive_does_the_work_that_energy_and_dampers_take(tmp_path):
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


def test_what_breaks_is_stated_and_never_a_number(driven):
    model = hardened(driven.model, 0.02, "Euler")
    model.eq_solref[:] = -1e9, -1.0
    run = run_scene(driven, model)
    assert "state became invalid" in run.broken
    errors = SceneEvaluator().errors(run)
    assert np.isinf([errors.closure, errors.trajectory, errors.torque]).all()
    assert np.isinf(run.seconds_per_second)


def test_a_tracked_point_on_a_body_is_where_mujoco_has_it(fed):
    run = run_scene(fed, records=4)
    data = mujoco.MjData(fed.model)
    data.qpos[:] = run.qpos[3]
    mujoco.mj_kinematics(fed.model, data)
    points = dict(zip(fed.tracked, run.points[3], strict=True))
    for name in ("crank", "rod", "lever", "pad"):
        assert data.body(name).xpos == pytest.approx(points[name], abs=1e-15)


def test_where_a_loop_is_closed_is_tracked_by_itself(fed):
    run = run_scene(fed, records=20)
    points = dict(zip(fed.tracked, np.moveaxis(run.points, 1, 0), strict=True))
    open_by = np.linalg.norm(points["closing@rod"] - points["closing@lever"], axis=1).max()
    assert open_by > 1e-7
    assert SceneEvaluator().errors(run).closure > 0.4 * open_by


def test_a_finer_step_costs_more_a_simulated_second(fed):
    fine = hardened(fed.model, 1e-4, "RK4")
    coarse, dear = step_times([(fed, fed.model), (fed, fine)], 2)
    assert 0.0 < coarse < dear  # eighty times as many evaluations


def test_the_shortest_motion_has_a_time_under_a_limit_of_processor_time_too(fed):
    """Such a limit lets the clock of a process tell milliseconds only."""
    resource = pytest.importorskip("resource")
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    spent = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    before = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (int(spent) + 1000, hard))
    try:
        seconds = [
            run_scene(fed, records=2, duration=float(fed.model.opt.timestep)).seconds for _ in range(20)
        ]
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, before)
    assert min(seconds) > 0.0


def test_cubics_meet_between_known_instants():
    known = np.linspace(0.0, 1.0, 21)
    values = np.stack([known**3, 1.0 - known**2], 1)
    time = np.array([0.0, 0.013, 0.5, 0.987, 1.0])
    assert cubic_interpolation(known, values, time) == pytest.approx(
        np.stack([time**3, 1.0 - time**2], 1), abs=1e-14
    )


def test_an_actuator_that_is_not_there_is_rejected(tmp_path):
    with pytest.raises(InputError, match=r"--ctrl names 'motor'; actuators of the model are servo"):
        scene(tmp_path, ctrl={"motor": "1"})


def test_motion_laws_that_begin_where_no_loop_closes_are_rejected(tmp_path):
    with pytest.raises(AssemblyError, match="on the path to the start of the motion laws"):
        scene(tmp_path, drive={"pivot": "3 + t"})


def test_balls_and_free_bodies_are_closed_in_their_own_coordinates(tmp_path):
    text = """<mujoco><option gravity="0 0 -1"/><worldbody>
      <body name="crank"><joint name="crank" axis="1 0 0"/>
        <geom type="capsule" fromto="0 0 0 0 .02 0" size=".002"/>
        <body name="rod" pos="0 .02 0"><joint name="ball" type="ball"/>
          <geom type="capsule" fromto="0 0 0 .05 .01 .03" size=".002"/></body></body>
      <body name="slider" pos=".05 .03 .03"><joint name="slide" type="slide" axis="1 .2 0"/>
        <geom size=".004"/></body>
      <body name="loose" pos="0 1 0"><freejoint name="free"/><geom size=".01"/></body>
      </worldbody><equality><connect name="end" body1="rod" body2="slider" anchor=".05 .01 .03"/></equality>
      <contact><exclude body1="rod" body2="slider"/></contact></mujoco>"""
    item = scene(tmp_path, text=text, drive={"crank": "0.5 + 3*t"}, duration=0.1)
    run = run_scene(item, hardened(item.model, 1e-4, "RK4"), records=100)
    assert SceneEvaluator().errors(run).closure < 1e-8
    qpos, qvel = item.start
    later = qpos.copy()
    mujoco.mj_integratePos(item.model, later, qvel, 1e-6)
    moved = replace(run, qpos=later[None])
    assert item.closure.errors(moved.qpos, moved.points).max() < 1e-10


def test_next_to_flywheels_the_solver_stops_at_the_same_cost_as_without_them(fed, driven):
    # MuJoCo stops where an iteration gains less than tolerance times mean inertia times degrees of freedom
    plain, wheeled = (item.model.opt.tolerance * item.model.stat.meaninertia for item in (fed, driven))
    assert driven.model.stat.meaninertia > 1e6 * fed.model.stat.meaninertia
    assert wheeled == pytest.approx(plain, rel=1e-9)
