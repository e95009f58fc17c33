"""Commands, fragments and snippets of a trade-off reproduce the measured errors."""

import mujoco
import numpy as np
import pytest

from mechsim.simulation import Settings
from mechsim.studies.tradeoff.methods import Build, SteppingMethod, build_model
from mechsim.studies.tradeoff.work_precision import Point, advice, fragment, snippet
from mechsim.subjects.readers import load

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


def point(settings, build=None):
    method = SteppingMethod(name="one", base=settings, rank=0, build=build or Build())
    return Point(method, settings, {})


@pytest.mark.parametrize(
    ("settings", "build"),
    [
        (STIFF, None),
        (COMPLIANT, None),
        (STIFF, Build(cut=("slide",))),
        (STIFF, Build(crank_drive="servo", gain=0.5)),
    ],
)
def test_a_snippet_reproduces_the_measured_run(settings, build):
    lines = snippet(point(settings, build), "slider_crank", SPEED)
    result = {}
    exec(lines, result)
    built = build_model(load("slider_crank").mechanism, None, SPEED, build or Build())
    motion, _ = built.motion(settings)
    positions = [motion.points["B"].position, result["motion"].points["B"].position]
    assert np.array_equal(*positions)


def test_a_fragment_is_mjcf_with_the_settings():
    text = fragment(point(COMPLIANT), SPEED)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco>{text}<worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<equality><joint joint1="j"/></equality></mujoco>'
    )
    assert model.opt.timestep == pytest.approx(COMPLIANT.timestep(SPEED), rel=1e-15)
    assert model.eq_solref[0] == pytest.approx([2.0 * COMPLIANT.timestep(SPEED), 1.0])
    assert not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)


def test_settings_without_option_or_element_have_only_a_snippet():
    assert fragment(point(STIFF), SPEED) is None
    reported = advice(point(STIFF, Build(crank_drive="servo")), "slider_crank", SPEED)
    assert reported["command"] is None
    assert reported["export"] is None
    assert reported["xml"] is None
    assert reported["python"]
