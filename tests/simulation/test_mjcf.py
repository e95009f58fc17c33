import mujoco
import numpy as np

import mechsim as ms
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.mjcf.generator import generate
from mechsim.simulation.source import assembled


def model_of(mechanism: ms.Mechanism, **scene: object) -> mujoco.MjModel:
    return assembled(mechanism, ms.Scene(**scene)).compile()


def test_drive_inertia_and_gravity_depend_on_the_scene_level() -> None:
    mechanism = ms.catalog.make("four_bar").mechanism
    pose, motion, dynamics = (model_of(mechanism, level=level) for level in ("pose", "motion", "dynamics"))
    assert pose.dof_armature[0] == 0.0 < motion.dof_armature[0]
    # the user of a picture scene turns the crank; under dynamics the crank is free
    assert generate(mechanism, ms.Scene(level="picture")).compile().dof_armature[0] == motion.dof_armature[0]
    assert dynamics.dof_armature[0] == 0.0
    assert not motion.opt.gravity.any()
    assert dynamics.opt.gravity.any()


def test_inertia_tensors_round_trip_exactly():
    text = """<mujoco><worldbody><body name="a"><joint name="j"/><inertial pos="0 0 0.1" mass="1"
    fullinertia="0.0123456789012 0.02 0.03 0.001 0.002 0.003"/></body></worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(text)
    first, reread = spec.compile(), mujoco.MjModel.from_xml_string(to_xml(spec.copy()))
    for attribute in ("body_inertia", "body_iquat", "body_ipos", "body_mass"):
        assert np.array_equal(getattr(reread, attribute), getattr(first, attribute))
