"""Masses and joint forces of a file: inverse dynamics compared with MuJoCo's."""

import mujoco
import numpy as np
import pytest
from model_files import model_text

from mechsim import dynamics
from mechsim.io.mjcf_source import read_mjcf
from mechsim.io.model_source import Prescription
from mechsim.mechanism.motion_laws import make_motion_laws

ARM = model_text("mjcf_inverse_dynamics_arm.xml")
NAMES = ("shoulder", "yaw", "rail")
MIDDLES, REACHES, RATES = (0.2, -0.3, 0.02), (0.4, 0.3, 0.05), (3.0, 2.0, 5.0)


def waving(middle, reach, rate):
    def state(time):
        rotated = rate * time
        return (
            middle + reach * np.sin(rotated),
            reach * rate * np.cos(rotated),
            -reach * rate**2 * np.sin(rotated),
        )

    return state


def test_drive_forces_agree_with_inverse_dynamics_of_mujoco(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(ARM.format(dry=0.0))
    solver = read_mjcf(str(file), Prescription(drive=dict.fromkeys(NAMES, "0")))
    states = dict(zip(NAMES, map(waving, MIDDLES, REACHES, RATES), strict=True))
    moves = make_motion_laws(solver.mechanism, states, 1.0)
    limit = type(solver)(solver.mechanism, forces=solver.forces, source=solver.source, motion_laws=moves)
    times = np.linspace(0.0, 1.0, 7)
    result = dynamics.prescribed(dynamics.dynamic_model(limit, solver.forces), t=times).forces
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    value, rate, second = moves.state(times)
    for i in range(len(times)):
        data.qpos[:], data.qvel[:], data.qacc[:] = value[:, i], rate[:, i], second[:, i]
        mujoco.mj_inverse(model, data)
        mine = [result.drives[name][i] for name in NAMES]
        assert mine == pytest.approx(data.qfrc_inverse, rel=1e-9, abs=1e-12)
