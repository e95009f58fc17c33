"""`mechsim simulate --ctrl`: control of a file's own actuators, stepped with its own settings."""

import json

import mujoco
import numpy as np
import pytest
from scene_texts import FINGER

from mechsim import files


@pytest.fixture(autouse=True)
def finger(tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)


COMMAND = ("simulate", "finger.xml", "--ctrl", "servo=0.5*sin(2*pi*t)", "--duration", "0.4s")


def test_a_controlled_run_equals_plain_mujoco(mechsim, tmp_path):
    answer = mechsim(*COMMAND, "--samples", "21", "-o", "run.csv", "--json")
    reported = json.loads(answer.out)
    assert reported["outcome"] in ("passed", "failed")
    assert answer.code == (0 if reported["outcome"] == "passed" else 1)
    table = files.read(tmp_path / "run.csv")
    assert table["t"] == pytest.approx(np.linspace(0.0, 0.4, 21), abs=1e-12)
    model = mujoco.MjModel.from_xml_string(FINGER)
    data = mujoco.MjData(model)
    for _ in range(200):
        data.ctrl[0] = 0.5 * np.sin(2 * np.pi * data.time)
        mujoco.mj_step(model, data)
    assert table["knuckle.q"][-1] == pytest.approx(data.qpos[0], abs=1e-12)
    assert table["pad.x"][-1] == pytest.approx(0.07 - 0.06 * np.sin(data.qpos[2]), abs=1e-9)
    speed = np.gradient(table["pad.x"], table["t"])[5:-5]
    assert table["pad.vx"][5:-5] == pytest.approx(speed, abs=0.05 * np.abs(speed).max())
    assert len(table["effort:servo"]) == reported["rows"]
