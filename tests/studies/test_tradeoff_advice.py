"""What a trade-off advises runs: each command, fragment and snippet gives the errors that were measured."""

import mujoco
import numpy as np
import pytest

from mechsim.simulation import Settings
from mechsim.studies.tradeoff.methods import Build, SteppingMethod, build_model
from mechsim.studies.tradeoff.work_precision import Point, advice, fragment, snippet
from mechsim.subjects.readers import load

SPEED = 20.0
HARD = Settings(steps_per_turn=144, constant_steps=14.4)
SOFT = Settings(
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
    [(HARD, None), (SOFT, None), (HARD, Build(cut=("slide",))), (HARD, Build(crank_drive="servo", gain=0.5))],
)
def test_a_snippet_runs_and_gives_what_was_measured(settings, build):
    lines = snippet(point(settings, build), "slider_crank", SPEED)
    result = {}
    exec(lines, result)
    built = build_model(load("slider_crank").mechanism, None, SPEED, build or Build())
    motion, _ = built.motion(settings)
    places = [motion.points["B"].position, result["motion"].points["B"].position]
    assert np.array_equal(*places)


def test_a_fragment_is_mjcf_that_states_the_settings():
    text = fragment(point(SOFT), SPEED)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco>{text}<worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<equality><joint joint1="j"/></equality></mujoco>'
    )
    assert model.opt.timestep == pytest.approx(SOFT.timestep(SPEED), rel=1e-15)
    assert model.eq_solref[0] == pytest.approx([2.0 * SOFT.timestep(SPEED), 1.0])
    assert not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)


def test_what_no_file_or_option_can_state_is_not_stated():
    assert fragment(point(HARD), SPEED) is None
    reported = advice(point(HARD, Build(crank_drive="servo")), "slider_crank", SPEED)
    assert reported["command"] is None
    assert reported["export"] is None
    assert reported["xml"] is None
    assert reported["python"]
