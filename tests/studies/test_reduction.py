import mujoco
import numpy as np
import pytest
from scene_texts import FINGER

import mechsim as ms
from mechsim.io.law_text import control_laws
from mechsim.studies.reduction.candidates import elements
from mechsim.studies.reduction.candidates.elements import (
    NotApplicable,
    RemovalCandidate,
    contacts,
    disconnected_bodies,
    limits,
    springs,
    visual_elements,
    with_candidate,
)
from mechsim.studies.reduction.reduced_scene import (
    ReducedSceneEvaluator,
    normalised,
    observe,
)
from mechsim.studies.reduction.search import reduce_scene, with_comment
from mechsim.studies.scene import run
from mechsim.studies.scene.scene import scene_of

LENGTH = 0.07
LIMIT = 1e-4 * LENGTH
CONTROL = "0.5*sin(2*pi*t)"
# a scene with more than its mechanism: a disconnected fan, visual-only geoms, a ball on a table
CLUTTER = FINGER.replace(
    "</worldbody>",
    """<light name="lamp" pos="0 0 1"/>
    <geom name="table" type="plane" size="1 1 0.1" pos="0 0 -0.1"/>
    <body name="ball" pos="0.3 0 -0.0905"><freejoint/><geom name="ball" size="0.01" mass="0.01"/></body>
    <body name="fan" pos="-0.1 0 0"><joint name="fan"/><geom name="blade" size="0.01" mass="0.01"/></body>
    <body name="shelf" pos="0 0 0.5"><geom name="board" size="0.1 0.1 0.01" type="box"/></body>
  </worldbody>
  <sensor><jointpos joint="knuckle"/></sensor>""",
).replace('<joint name="elbow"/>', '<joint name="elbow" range="-170 170" limited="true"/>')


def scene(folder, text, *, ctrl=CONTROL, drive=None, duration=0.5, track=("tip,pad@0.02,0,0",)):
    path = folder / "scene.xml"
    path.write_text(text)
    solver = ms.load(str(path), drive=drive, track=track)
    motion_laws = solver.motion_laws.by_name
    control = control_laws({"servo": ctrl} if ctrl else {})
    scene_object = scene_of(
        solver.source,
        solver.mechanism,
        joint_laws=motion_laws,
        ctrl=control,
        duration=duration,
        points=dict(solver.mechanism.points),
    )
    return scene_object, mujoco.MjSpec.from_file(str(path))


def evaluator_of(folder, text, **options):
    return ReducedSceneEvaluator.from_scene(*scene(folder, text, **options))


def observed(evaluator):
    tracked = frozenset(body for body, _ in evaluator.tracked.values())
    return observe(evaluator.spec, evaluator.full, tracked, LIMIT)


def path_of(text, body, law, duration):
    """Return times and positions of a point of a body in plain MuJoCo under control."""
    model = mujoco.MjModel.from_xml_string(text)
    data, servo = mujoco.MjData(model), model.actuator("servo").id
    rows = []
    while data.time < duration - 0.5 * model.opt.timestep:
        data.ctrl[servo] = law(data.time)
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        rotation = data.body(body).xmat.reshape(3, 3)
        rows.append((data.time, *(data.body(body).xpos + rotation @ (0.02, 0.0, 0.0))))
    return np.array(rows)


@pytest.fixture(scope="module")
def cluttered(tmp_path_factory):
    user, spec = scene(tmp_path_factory.mktemp("cluttered"), CLUTTER)
    return user, spec, ReducedSceneEvaluator.from_scene(user, spec)


@pytest.fixture(scope="module")
def rows(cluttered):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "MIN_MEASURED_TIME", 1e-4)
        return reduce_scene(*cluttered[:2], LIMIT)


@pytest.mark.slow
def test_a_reduced_scene_satisfies_its_tolerance_in_other_motions(rows):
    text = with_comment(rows, "scene.xml", LIMIT, "m")
    assert rows.kept(LIMIT)
    assert rows.left_out
    for law in (lambda t: 0.5 * np.sin(2 * np.pi * t), lambda t: 0.4 * np.sin(9 * t) ** 2):
        full, reduced_model = (path_of(scene_text, "pad", law, 0.5) for scene_text in (CLUTTER, text))
        interpolated = [np.interp(reduced_model[:, 0], full[:, 0], full[:, i]) for i in (1, 2, 3)]
        between = np.abs(np.diff(full[:, 1:], 2, axis=0)).max() / 8.0  # error of linear interpolation
        assert (
            np.linalg.norm(reduced_model[:, 1:] - np.transpose(interpolated), axis=1).max()
            <= LIMIT + 2.0 * between
        )


@pytest.mark.long
def test_the_file_lists_removed_elements_and_keeps_needed_ones(rows):
    text = with_comment(rows, "scene.xml", LIMIT, "m")
    model = mujoco.MjModel.from_xml_string(text)
    assert [item.candidate.what in text for item in rows.left_out] == [True] * len(rows.left_out)
    joints = {model.joint(j).name for j in range(model.njnt)}
    assert "fan" not in joints
    assert {"knuckle", "pivot", "elbow", "swing"} <= joints
    assert model.nsensor == model.nlight == 0
    assert model.actuator("servo").id == 0


def test_only_geoms_without_contact_are_removed_at_constant_mass(cluttered):
    _, _, evaluator = cluttered
    rows = observed(evaluator)
    assert rows.touched == {"table", "ball"}
    (removal,) = contacts(rows)
    spec = with_candidate(evaluator.spec, removal)
    assert (spec.geom("blade").contype, spec.geom("ball").contype) == (0, 1)
    geoms = next(c for c in visual_elements(rows) if "geoms" in c.what)
    reduced_model = with_candidate(evaluator.spec, geoms).compile()
    assert {reduced_model.geom(g).name for g in range(reduced_model.ngeom)} == {"table", "ball"}
    whole = evaluator.spec.copy().compile()
    assert np.allclose(reduced_model.body_mass, whole.body_mass, rtol=1e-15)


def test_only_disconnected_bodies_are_removed(cluttered):
    _, _, evaluator = cluttered
    (removal,) = disconnected_bodies(observed(evaluator))
    reduced_model = with_candidate(evaluator.spec, removal).compile()
    remaining = {reduced_model.body(b).name for b in range(reduced_model.nbody)}
    assert remaining == {"world", "crank", "rod", "lever", "pad", "shelf"}


def test_a_reached_limit_is_kept(tmp_path):
    text = CLUTTER.replace('name="knuckle"', 'name="knuckle" range="-15 15" limited="true"')
    evaluator = evaluator_of(tmp_path, text)
    removal, reached = limits(observed(evaluator))
    assert "knuckle" in reached.what
    reduced_model = with_candidate(evaluator.spec, removal).compile()
    assert reduced_model.jnt_limited[reduced_model.joint("knuckle").id]
    assert not reduced_model.jnt_limited[reduced_model.joint("elbow").id]


def test_a_normalised_scene_moves_as_the_original(cluttered):
    _, spec, evaluator = cluttered
    plain, named = spec.copy().compile(), evaluator.spec.copy().compile()
    states = []
    for model in (plain, named):
        data = mujoco.MjData(model)
        data.ctrl[0] = 0.3
        mujoco.mj_step(model, data, 200)
        states.append(data.qpos.copy())
    assert np.abs(states[0] - states[1]).max() < 1e-12


def test_the_evaluator_rejects_a_scene_without_a_needed_element(cluttered):
    _, _, evaluator = cluttered
    assert evaluator.errors(evaluator.scene(evaluator.spec)).trajectory == 0.0
    spring = next(c for c in springs(observed(evaluator)) if c.what == "spring of swing")
    assert evaluator.errors(evaluator.scene(with_candidate(evaluator.spec, spring))).trajectory > LIMIT
    heavy = RemovalCandidate("wrong", "a mass", lambda spec: setattr(spec.body("lever"), "mass", 0.3))
    wrong = evaluator.errors(evaluator.scene(with_candidate(evaluator.spec, heavy)))
    assert wrong.trajectory > LIMIT
    assert wrong.torque > 1e-3


def test_driven_elements_cannot_be_removed(cluttered):
    _, _, evaluator = cluttered
    spec = evaluator.spec.copy()
    spec.delete(spec.actuator("servo"))
    with pytest.raises(ValueError, match="servo has a motion law"):
        evaluator.scene(spec)
    with pytest.raises(NotApplicable, match="servo acts on joint knuckle"):
        elements.fuse(evaluator.spec.copy(), "knuckle", np.zeros(1))


def test_a_fused_joint_keeps_the_pose_of_its_body(tmp_path):
    spec = normalised(scene(tmp_path, FINGER)[1])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("swing").qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    pad = data.body("pad").xpos.copy(), data.body("pad").xquat.copy()
    elements.fuse(spec, "swing", np.array([0.3]))
    reduced_model = spec.compile()
    data = mujoco.MjData(reduced_model)
    mujoco.mj_kinematics(reduced_model, data)
    assert np.allclose(data.body("pad").xpos, pad[0], atol=1e-15)
    assert np.allclose(data.body("pad").xquat, pad[1], atol=1e-15)


SERVO = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="arm">
<inertial mass="1" pos="0.1 0 0" diaginertia="1e-3 1e-3 1e-3"/><joint name="j" armature="0.5"/></body>
</worldbody><actuator><position name="servo" joint="j" kp="100" kv="20"/></actuator></mujoco>"""


def test_a_scene_that_diverges_is_rejected(tmp_path):
    user, spec = scene(tmp_path, FINGER.replace('kv="0.02"', 'kv="50"'))
    with pytest.raises(ms.InputError, match="diverges over its motion"):
        reduce_scene(user, spec, 1e-5)


def test_a_stationary_tracked_point_is_rejected(tmp_path):
    user, spec = scene(tmp_path, SERVO, track=("P,arm@0,0,0",))
    with pytest.raises(ms.InputError, match=r"move by only 0 m.* track a point that moves"):
        reduce_scene(user, spec, 1e-5)
