"""Wrong units, dampers too stiff for the step, controls beyond a range: faults and near misses."""

import json

import mujoco
import numpy as np
import pytest
from model_files import changed_model, changed_text, model_text

import mechsim as ms
from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader.reading import read_model


@pytest.mark.long
def test_two_mechanisms_ten_metres_apart_are_no_mistake_of_units():
    spec, other = (mujoco.MjSpec.from_string(model_text("closed_four_bar.xml")) for _ in range(2))
    spec.attach(other, prefix="second ", frame=spec.worldbody.add_frame(pos=[12.0, 0.0, 0.0]))
    assert len(spec.equalities) == 2
    assert "MS103" not in {violation.rule for violation in ms.check(spec)}


# z = -h d / I at which the growth of a step of RK4 is 1: 1 + z + z^2/2 + z^3/6 + z^4/24 = 1
RK4_LIMIT = float(
    -min(root.real for root in np.roots([1 / 24, 1 / 6, 1 / 2, 1, 0]) if abs(root.imag) < 1e-12)
)
INERTIA, STEP = 0.02, 0.004
PENDULUM = model_text("units_and_damping_pendulum.xml")
EXPLICIT = 'integrator="Euler"><flag eulerdamp="disable"/></option'
TENDON = '<tendon><fixed name="cable" damping="{}"><joint joint="hinge" coef="1"/></fixed></tendon>'
SERVO = '<actuator><{} name="servo" joint="hinge" {}="{}"/></actuator>'
# text of a damper or spring, option, element, limit times the step (or its square) over the inertia
LIMITS = {
    "joint damping with RK4": ({"joint": 'damping="{}"'}, 'integrator="RK4"', "hinge", RK4_LIMIT, 1),
    "joint damping, Euler without eulerdamp": ({"joint": 'damping="{}"'}, EXPLICIT, "hinge", 2.0, 1),
    "tendon damping with Euler": ({"rest": TENDON}, "", "cable", 2.0, 1),
    "velocity servo with Euler": ({"rest": SERVO.format("velocity", "kv", "{}")}, "", "servo", 2.0, 1),
    "position servo with Euler": ({"rest": SERVO.format("position", "kp", "{}")}, "", "servo", 4.0, 2),
    "joint spring with implicitfast": (
        {"joint": 'stiffness="{}"'},
        'integrator="implicitfast"',
        "hinge",
        4.0,
        2,
    ),
}


def pendulum(option="", joint="", rest=""):
    text = PENDULUM.format(step=STEP, option=option, inertia=INERTIA, joint=joint, rest=rest)
    return text.replace("</option/>", "</option>")


@pytest.mark.long
@pytest.mark.parametrize("case", LIMITS)
def test_the_limit_of_a_damper_or_spring_is_that_of_the_integrator(case, file):
    texts, option, element, limit, order = LIMITS[case]
    for factor in (0.95, 1.05):
        value = factor * limit * INERTIA / STEP**order
        path = file(pendulum(option, **{key: text.format(value) for key, text in texts.items()}))
        violations = [v for v in ms.check(path) if v.rule == "MS114"]
        assert [v.object for v in violations] == ([element] if factor > 1.0 else [])
        # MuJoCo itself, from a small rate
        model = mujoco.MjModel.from_xml_path(path)
        data = mujoco.MjData(model)
        data.qvel[0] = 1e-6
        for _ in range(60):
            mujoco.mj_step(model, data)
        assert (abs(data.qvel[0]) > 1e-5) == (factor > 1.0)
    # the step of the remedy is stable
    assert violations[0].value * 0.9 <= 1.05 ** (1 / order) <= violations[0].value
    # the ratio of steps is 1 at the limit
    assert violations[0].gap == violations[0].value - 1.0


def test_implicit_damping_is_stable_at_any_size(file):
    for option in ("", 'integrator="implicitfast"'):
        path = file(pendulum(option, 'damping="1e4"'))
        assert "MS114" not in {violation.rule for violation in ms.check(path)}


@pytest.mark.long
def test_a_rejected_file_among_several_is_its_own_finding(tmp_path, mechsim):
    bar = "models/closed_four_bar.xml"
    files = {
        "negative": [bar, 'joint name="A"', 'joint name="A" damping="-.5"'],
        "broken": "<mujoco><nothing/></mujoco>",
        "sound": [bar, 'joint name="crank"', 'joint name="crank" range="1 2"'],
    }
    for name, text in files.items():
        (tmp_path / f"{name}.xml").write_text(changed_text(text))
    paths = [str(tmp_path / f"{name}.xml") for name in files]

    answer = mechsim("check", *paths, "--output-format", "json")
    violations = {(finding["rule"], finding["file"]) for finding in json.loads(answer.out)["findings"]}
    assert answer.code == 1
    assert {("MS113", paths[0]), ("MS100", paths[1]), ("MS105", paths[2])} <= violations
    assert [file for rule, file in violations if rule == "MS100"] == [paths[1]]
    assert mechsim("check", paths[1]).code == 2


@pytest.mark.long
def test_a_fixed_base_adds_no_contact():
    for fix_base in (False, True):
        read = read_model(changed_model("units_and_damping_hips.xml"), fix_base=fix_base)
        assert "collision" not in {finding.kind for finding in findings(read)}
        model = read.spec.copy().compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
    # links two joints apart collide in the file, too
    knee = 'pos="0 0 -.3"><joint name="knee"', 'pos="0 0 -.01"><joint name="knee"'
    path = changed_model("units_and_damping_hips.xml", knee)
    for fix_base in (False, True):
        kinds = [finding.kind for finding in findings(read_model(path, fix_base=fix_base))]
        assert ("collision" in kinds) == (not fix_base)


SAG = model_text("units_and_damping_sag.xml")


@pytest.mark.parametrize(("time_constant", "large"), [(0.02, False), (1.0, True)])
def test_a_gap_beyond_the_linear_range_is_called_large(time_constant, large, file):
    path = file(SAG.format(time_constant))
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    for _ in range(20_000):
        mujoco.mj_step(model, data)
    sag, length = abs(float(data.qpos[0])), 1.0
    (violation,) = [v for v in ms.check(path) if v.rule == "MS110"]
    assert ("large gap" in violation.message) == large
    if large:
        assert violation.value <= 0.1 * length < sag
    else:
        assert violation.value == pytest.approx(sag, rel=0.1)


URDF = model_text("units_and_damping_urdf.urdf")


@pytest.mark.long
def test_findings_with_loops_of_a_second_file_name_the_file(tmp_path):
    moments = 'ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"'
    inertial = f'<inertial><mass value=".1"/><inertia {moments}/></inertial>'
    links = "".join(f'<link name="{n}">{inertial}</link>' for n in ("arm", "rod", "lever", "pin_a", "pin_b"))
    model, loops = tmp_path / "knee.urdf", tmp_path / "knee.yaml"
    model.write_text(URDF.format(links))
    loops.write_text("closed_loop: [['pin_a','pin_b']]\ntype: ['6d']\nname_mot: ['crank']\n")
    violations = ms.check(str(model), loops=str(loops))
    assert violations
    assert {violation.file for violation in violations} == {str(model)}
