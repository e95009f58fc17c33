"""Fragments of MJCF of a trade-off contain the measured settings."""

import mujoco
import pytest

from mechsim.simulation import Settings
from mechsim.studies.tradeoff.methods import SteppingMethod
from mechsim.studies.tradeoff.work_precision import Point, advice, fragment

SPEED = 20.0
STIFF = Settings(steps_per_turn=144, constant_steps=14.4)
COMPLIANT = Settings(
    steps_per_turn=288,
    integrator="implicitfast",
    constant_steps=2.0,
    compliance=1.0,
    refsafe=True,
    diagexact=True,
)


def point(settings):
    return Point(SteppingMethod(name="one", base=settings, rank=0), settings, {})


def test_a_fragment_is_mjcf_with_the_settings():
    text = fragment(point(COMPLIANT), SPEED)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco>{text}<worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<equality><joint joint1="j"/></equality></mujoco>'
    )
    assert model.opt.timestep == pytest.approx(COMPLIANT.timestep(SPEED), rel=1e-15)
    assert model.eq_solref[0] == pytest.approx([2.0 * COMPLIANT.timestep(SPEED), 1.0])
    assert not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)


def test_settings_that_no_file_contains_have_only_a_command():
    reported = advice(point(STIFF), "slider_crank", SPEED)
    assert reported["command"].startswith("mechsim simulate slider_crank")
    assert reported["xml"] is None
