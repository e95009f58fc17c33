"""Applying the remedy of a finding removes it and causes no other."""

import mujoco
import numpy as np
import pytest
from valid_scene import SOUND, changed

from mechsim.simulation.findings import findings
from mechsim.simulation.findings.inspected import EQUALITY
from mechsim.simulation.mjcf_reader.reading import read_model

HARD = 'solref="0.002 1"\n             solimp="0.9999 0.9999 0.001 0.5 2"'
AGAIN = '    <connect name="again" body1="coupler" body2="rocker" anchor="0.1 0 0"/>\n'
ROD, FAT_ROD = (f'fromto="0.008 0 0 0.09 0 0" size="{radius}"' for radius in (0.003, 0.02))
OTHER = '    <position name="other" joint="rocker" kp="5"/>\n'


def findings_in(tmp_path, text):
    path = tmp_path / "scene.xml"
    path.write_text(text)
    return findings(read_model(str(path)))


def finer(item):
    return f'timestep="{item.remedy.split()[4]}"'


# kind -> fault, and what its remedy replaces by what
REMEDIES = {
    "redundant": (("  </equality>", AGAIN + "  </equality>"), AGAIN, lambda item: ""),
    "collision": ((ROD, FAT_ROD), "<actuator>", lambda item: item.remedy.partition(",")[0] + "<actuator>"),
    "actuator": (("  </actuator>", OTHER + "  </actuator>"), OTHER, lambda item: ""),
    "limit": (
        ('range="-2 2"', 'range="0.2 2"'),
        'range="0.2 2"',
        lambda item: f'range="{0.2 - 1.01 * item.value:g} 2"',
    ),
    "refsafe": (('solref="0.002 1"', 'solref="0.0005 1"'), 'timestep="0.001"', finer),
    "timestep": (('solref="0.002 1"', 'solref="-4e6 -4000"'), 'timestep="0.001"', finer),
    "soft": ((HARD, ""), "anchor", lambda item: item.remedy.partition(" leaves")[0] + " anchor"),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", REMEDIES)
def test_applying_the_reported_remedy_removes_the_finding(kind, tmp_path):
    fault, old, new = REMEDIES[kind]
    wrong = changed(fault)
    (item,) = [item for item in findings_in(tmp_path, wrong) if item.kind == kind]
    right = wrong.replace(old, new(item))
    assert right != wrong
    assert findings_in(tmp_path, right) == ()


@pytest.mark.parametrize(("solref", "grows"), [("-4e6 -4000", True), ("0.002 1", False)])
def test_the_gap_grows_in_a_loop_reported_as_too_stiff(solref, grows, tmp_path):
    text = SOUND.replace('solref="0.002 1"', f'solref="{solref}"')
    reported = {item.kind for item in findings_in(tmp_path, text)}
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    largest = 0.0
    for _ in range(200):
        mujoco.mj_step(model, data)
        gap = data.efc_pos[data.efc_type == EQUALITY]
        largest = max(largest, float(np.linalg.norm(gap)))
    assert ("timestep" in reported) == grows
    assert (largest > 1e-3) == grows
