"""Masses and joint forces of a file: inverse dynamics compared with MuJoCo's."""

import mujoco
import numpy as np
import pytest
from model_files import copied, model_text

from mechsim import dynamics, load

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


def test_drive_forces_agree_with_inverse_dynamics_of_mujoco():
    text, times = ARM.format(dry=0.0), np.linspace(0.0, 1.0, 7)
    laws = {
        name: f"{middle} + {reach}*sin({rate}*t)"
        for name, middle, reach, rate in zip(NAMES, MIDDLES, REACHES, RATES, strict=True)
    }
    solver = load(copied(text, ".xml"), drive=laws)
    result = dynamics.prescribed(dynamics.dynamic_model(solver, solver.forces), t=times).forces
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    value, rate, second = solver.motion_laws.state(times)
    for i in range(len(times)):
        data.qpos[:], data.qvel[:], data.qacc[:] = value[:, i], rate[:, i], second[:, i]
        mujoco.mj_inverse(model, data)
        mine = [result.drives[name][i] for name in NAMES]
        assert mine == pytest.approx(data.qfrc_inverse, rel=1e-9, abs=1e-12)
