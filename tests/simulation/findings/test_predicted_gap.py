"""Predicted gaps of compliant loops against those of MuJoCo's own steps."""

import mujoco
import numpy as np
import pytest
from valid_scene import changed

from mechsim.mechanism.motion_laws import make_motion_laws
from mechsim.simulation.findings.inspected import EQUALITY, Inspected, driver_swing, wave
from mechsim.simulation.findings.predicted_gap import gaps_at_rest, gaps_in, impedance
from mechsim.simulation.mjcf_reader.reading import read_model

# a stiff servo moves the crank along its motion law
SERVO = ('kp="10" kv="0.1"', 'kp="200" kv="4"')
STIFFLY = ('timestep="0.001"', 'timestep="0.001" integrator="implicitfast"')
STIFF = 'solref="0.002 1"\n             solimp="0.9999 0.9999 0.001 0.5 2"'
COMPLIANT = [
    'solref="0.005 1" solimp="0.9 0.95 0.001 0.5 2"',
    'solref="0.01 0.7" solimp="0.5 0.99 0.0002 0.3 3"',
    'solref="-4000 -130" solimp="0.9 0.9 0.001 0.5 2"',
]


@pytest.fixture
def scene(file):
    def read(compliance, *changes):
        path = file(changed((STIFF, compliance), SERVO, STIFFLY, *changes))
        source = read_model(path)
        moves = make_motion_laws(source.mechanism, {"crank": wave(0.0, 1.0)}, 1.0)
        return Inspected(source, moves)

    return read


def stepped(scene, *, moving):
    """Return the largest gap in [m] after the initial transient."""
    model, data = scene.model, mujoco.MjData(scene.model)
    # contact between links would carry part of the load of the loop
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    law, largest = wave(0.0, 1.0), 0.0
    for _ in range(round(1.0 / model.opt.timestep)):
        if moving:
            position, rate, _ = law(np.array([data.time]))
            data.ctrl[0] = position[0] + 0.02 * rate[0]
        mujoco.mj_step(model, data)
        if data.time > (0.2 if moving else 0.9):
            largest = max(largest, float(np.linalg.norm(data.efc_pos[data.efc_type == EQUALITY])))
    return largest


@pytest.mark.parametrize("moving", [True, False], ids=["in motion", "at rest"])
@pytest.mark.parametrize("compliance", COMPLIANT)
def test_the_predicted_gap_is_within_a_factor_of_two(scene, compliance, moving):
    result = scene(compliance, *(() if moving else [('gravity="0 0 -9.81"', 'gravity="0 -9.81 0"')]))
    (reported,) = (gaps_in(result, driver_swing(result)) if moving else gaps_at_rest(result)).values()
    assert reported > 1e-6
    assert 0.5 <= reported / stepped(result, moving=moving) <= 2.0


@pytest.mark.parametrize(
    "solimp", [(0.9, 0.95, 0.001, 0.5, 2), (0.2, 0.8, 0.01, 0.3, 3), (0.5, 0.5, 0.1, 0.5, 1)]
)
def test_the_impedance_equals_that_of_mujoco(solimp):
    text = """<mujoco><worldbody><body><joint type="slide"/><geom size="1"/></body></worldbody><equality>
    <joint joint1="s" solimp="{}"/></equality></mujoco>""".replace('type="slide"', 'name="s" type="slide"')
    model = mujoco.MjModel.from_xml_string(text.format(" ".join(map(str, solimp))))
    data = mujoco.MjData(model)
    for gap in (1e-5, 2e-4, 6e-4, 3e-3, 0.2):
        data.qpos[0] = gap
        mujoco.mj_forward(model, data)
        assert impedance(np.array(solimp), gap) == pytest.approx(data.efc_KBIP[0, 2], abs=1e-12)
