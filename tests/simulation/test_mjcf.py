from dataclasses import replace

import mechanisms
import mujoco
import numpy as np
import pytest
from model_files import stated_mechanism

import mechsim as ms
from mechsim import loops
from mechsim.simulation import loop_jacobian
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.mjcf.generator import generate
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.source import assembled

CATALOGUE = ("rssr", "four_bar", "slider_crank")
EVERYTHING = [
    *(ms.catalog.make(name).mechanism for name in CATALOGUE),
    ms.catalog.make("rssr", guide=True).mechanism,
    *mechanisms.everything(),
    *(mechanisms.swapped(mechanism) for mechanism in mechanisms.everything()),
]


def model_of(mechanism: ms.Mechanism, **scene: object) -> mujoco.MjModel:
    return assembled(mechanism, ms.Scene(**scene)).compile()


def test_each_joint_kind_maps_to_mujoco_joints() -> None:
    hinge, slide, ball = (int(getattr(mujoco.mjtJoint, f"mjJNT_{k}")) for k in ("HINGE", "SLIDE", "BALL"))
    kinds = {}
    for mechanism in (ms.catalog.make("rssr").mechanism, mechanisms.rsup(), mechanisms.rscr()):
        model = model_of(mechanism)
        kinds |= {model.joint(i).name: int(model.jnt_type[i]) for i in range(model.njnt)}
    assert kinds["crank"] == kinds["rocker"] == kinds["pivot"] == hinge
    assert kinds["P2"] == ball
    assert kinds["slide"] == slide
    assert (kinds["cross.1"], kinds["cross.2"]) == (hinge, hinge)
    assert (kinds["sleeve.way"], kinds["sleeve.turn"]) == (slide, hinge)


@pytest.mark.parametrize("mechanism", EVERYTHING, ids=lambda m: m.name)
def test_the_reference_configuration_satisfies_the_loop_equations(mechanism: ms.Mechanism) -> None:
    model = model_of(mechanism)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.qpos0[read_loops(model).crank_address] == pytest.approx(mechanism.start, abs=1e-15)
    exact = loops.solve(mechanism, [mechanism.start])
    for name, point in exact.points.items():
        # both converged by Newton's method to rounding, from the same guess
        assert np.abs(data.site(name).xpos - point.position[0]).max() < 1e-14


@pytest.mark.parametrize("mechanism", EVERYTHING, ids=lambda m: m.name)
def test_numbers_round_trip_exactly_through_the_text(mechanism: ms.Mechanism) -> None:
    spec = assembled(mechanism, ms.Scene())
    made, read = spec.compile(), mujoco.MjModel.from_xml_string(to_xml(spec))
    for field in (
        "body_pos",
        "body_mass",
        "body_ipos",
        "body_inertia",
        "jnt_pos",
        "qpos0",
        "dof_armature",
        "site_pos",
        "eq_data",
        "eq_solref",
        "eq_solimp",
    ):
        assert np.array_equal(getattr(made, field), getattr(read, field)), field
    # MuJoCo normalises these vectors again when it reads them
    for field in ("body_quat", "jnt_axis"):
        assert np.abs(getattr(made, field) - getattr(read, field)).max() <= 2.0**-52, field
    assert made.opt.timestep == read.opt.timestep
    assert made.opt.integrator == read.opt.integrator
    assert made.opt.disableflags == read.opt.disableflags


@pytest.mark.parametrize("name", CATALOGUE)
def test_plain_mujoco_reads_the_text_and_turns_the_crank(name: str) -> None:
    text = to_xml(assembled(ms.catalog.make(name).mechanism, ms.Scene()))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    speed = 2.0 * np.pi
    loops = read_loops(model)
    data.qvel[:] = speed * loop_jacobian.tangent(loops, loops.linearise(data.qpos[None])[1])[0]
    for _ in range(100):
        mujoco.mj_step(model, data)
    rotation = data.qpos[loops.crank_address] - model.qpos0[loops.crank_address]
    # the drive inertia keeps the speed: 100 steps of 1e-4 s at one turn a second
    assert rotation == pytest.approx(0.01 * speed, abs=1e-9)
    # the loop stays closed far below a link 0.1 % long
    assert np.abs(loops.residual(data.qpos[None])).max() < 1e-8


def test_drive_inertia_and_gravity_depend_on_the_scene_level() -> None:
    mechanism = ms.catalog.make("four_bar").mechanism
    pose, motion, dynamics = (model_of(mechanism, level=level) for level in ("pose", "motion", "dynamics"))
    assert pose.dof_armature[0] == 0.0 < motion.dof_armature[0]
    # the user of a picture scene turns the crank; under dynamics the crank is free
    assert generate(mechanism, ms.Scene(level="picture")).compile().dof_armature[0] == motion.dof_armature[0]
    assert dynamics.dof_armature[0] == 0.0
    assert not motion.opt.gravity.any()
    assert dynamics.opt.gravity.any()


def test_an_unassemblable_loop_is_rejected() -> None:
    valid = ms.catalog.make("four_bar").mechanism
    unreachable = tuple(
        replace(joint, a=replace(joint.a, point=(0.5, 0.0, 0.0))) if joint.name == "rocker" else joint
        for joint in valid.joints
    )
    with pytest.raises(ms.AssemblyError, match="the loops do not close at crank angle") as reported:
        assembled(replace(valid, joints=unreachable), ms.Scene())
    assert "\n" not in str(reported.value)


def test_an_open_chain_has_no_constraints() -> None:
    assert model_of(stated_mechanism("mjcf_arm.toml")).neq == 0


def test_inertia_tensors_round_trip_exactly():
    text = """<mujoco><worldbody><body name="a"><joint name="j"/><inertial pos="0 0 0.1" mass="1"
    fullinertia="0.0123456789012 0.02 0.03 0.001 0.002 0.003"/></body></worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(text)
    first, reread = spec.compile(), mujoco.MjModel.from_xml_string(to_xml(spec.copy()))
    for attribute in ("body_inertia", "body_iquat", "body_ipos", "body_mass"):
        assert np.array_equal(getattr(reread, attribute), getattr(first, attribute))
