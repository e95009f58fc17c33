"""MJCF files solved by the loop equations, compared with laws of linkages and MuJoCo's constraints."""

import mujoco
import numpy as np
import pytest
from model_files import model_text

from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.io.mjcf_source import read_mjcf
from mechsim.io.model_source import Prescription
from mechsim.io.readers import load
from mechsim.io.scene_findings import scene_findings
from mechsim.mechanism.motion_laws import steady
from mechsim.report.facts import facts
from mechsim.simulation.mjcf_reader.reading import states_of

# five bars in an inclined plane: two cranks of 0.05 m, 0.1 m apart, rods of 0.09 m; closed by sites with an
# initial loop-closure error of 3 mm; one crank has another zero
FIVE_BAR = model_text("mjcf_source_five_bar.xml")


def five_bar(gap=3e-3, rod=0.09):
    """Return the text of the model with the cranks at 2 and 1 rad."""
    a, d = 0.05 * np.array([np.cos(2.0), np.sin(2.0)]), 0.05 * np.array([np.cos(1.0), np.sin(1.0)])
    middle = (a + d + [0.1, 0.0]) / 2.0
    diagonal = d - a + [0.1, 0.0]
    up = np.array([-diagonal[1], diagonal[0]]) / np.linalg.norm(diagonal)
    tip = middle + up * np.sqrt(rod**2 - (diagonal @ diagonal) / 4.0)
    p, q = tip - a, tip - d - [0.1, 0.0]
    angle = gap / rod
    q = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ q
    text, names = FIVE_BAR, ("ACOS", "ASIN", "DCOS", "DSIN", "PX", "PY", "QX", "QY")
    for name, value in zip(names, np.concatenate([a, d, p, q]).tolist(), strict=True):
        text = text.replace(name, repr(value))
    return text


def mujoco_residual(solver, motion):
    """Return MuJoCo's largest residual of the equalities of the file at the solved poses."""
    model = solver.source.spec.copy().compile()
    data, worst = mujoco.MjData(model), 0.0
    for row in states_of(model, {name: joint.value for name, joint in motion.joints.items()}, motion.links):
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        worst = max(worst, np.abs(data.efc_pos[data.efc_type == 0]).max(initial=0.0))
    return worst


def driven(path, states, duration=1.0, **options):
    solver = load(path, drive=states, duration=duration, **options)
    return solver, solver.solve(t=np.linspace(0.0, duration, 21))


def test_a_five_bar_with_an_initial_error_has_the_exact_motion(file):
    states = {"left": lambda t: (2.0 + 0.3 * np.sin(5 * t), 1.5 * np.cos(5 * t), -7.5 * np.sin(5 * t))}
    states["right"] = steady(7.28, 0.5)
    solver, motion = driven(file(five_bar()), states)
    left, right = motion.joints["left"].value, motion.joints["right"].value - 7.28 + 1.0
    a = 0.05 * np.column_stack([np.cos(left), np.sin(left)])
    d = [0.1, 0.0] + 0.05 * np.column_stack([np.cos(right), np.sin(right)])
    diagonal = d - a
    length = np.linalg.norm(diagonal, axis=1)[:, None]
    up = np.column_stack([-diagonal[:, 1], diagonal[:, 0]]) / length
    tip = a + diagonal / 2.0 + up * np.sqrt(0.09**2 - length**2 / 4.0)
    plane = solver.source.spec.copy().compile().body("plane")
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, plane.quat)
    truth = plane.pos + np.column_stack([tip, np.zeros(21)]) @ rotation.reshape(3, 3).T
    np.testing.assert_allclose(motion.points["P"].position, truth, atol=1e-14)
    assert solver.source.gap == pytest.approx(3e-3, rel=1e-3)
    assert any("loop-closure error of the file is 0.003 m" in fact for fact in solver.facts)
    assert mujoco_residual(solver, motion) < 1e-15


# a chain closed by a weld, with three hinges on one body; and a free body welded to it
WELDED = model_text("mjcf_source_welded.xml")


def test_a_spatial_chain_satisfies_the_weld_in_mujoco(file):
    solver = read_mjcf(file(WELDED))
    start = np.radians(400.0)
    assert solver.mechanism.start == pytest.approx(start)
    motion = solver.solve(start + np.linspace(-0.3, 0.3, 9))
    assert mujoco_residual(solver, motion) < 1e-14
    assert motion.joints["crank"].value[4] == pytest.approx(start)
    assert motion.joints["z"].value[4] == pytest.approx(0.0, abs=1e-12)
    assert set(motion.links) == {"a", "b", "c", "r", "load"}


def test_a_keyframe_is_the_initial_configuration(file):
    solver = read_mjcf(file(WELDED), Prescription(key="other"))
    assert solver.mechanism.start == 7.3
    assert solver.source.gap > 1e-3
    assert mujoco_residual(solver, solver.solve([7.3, 7.4])) < 1e-13


def test_a_joint_moves_to_its_locked_value_within_the_assembly_mode(file):
    path = file(five_bar())
    solver = read_mjcf(path, Prescription(drive={"left": "0"}, lock={"right": "8.0rad"}))
    assert solver.mechanism.locked == {"right": 8.0}
    motion = solver.solve([2.0, 2.1])
    _, moved = driven(path, {"left": steady(2.0, 0.1), "right": lambda t: (8.0 + 0 * t, 0 * t, 0 * t)})
    assert motion.points["P"].position[1] == pytest.approx(moved.points["P"].position[-1], abs=1e-13)


def test_an_unreachable_locked_value_is_rejected_with_the_configuration(file):
    with pytest.raises(AssemblyError, match=r"on the path to the locked position right = 6.28"):
        read_mjcf(file(five_bar(rod=0.078)), Prescription(drive={"left": "0"}, lock={"right": 6.28}))


def test_a_floating_base_is_reported_with_its_remedy(file):
    text = FIVE_BAR[: FIVE_BAR.index('<body name="d"')] + "</body></worldbody></mujoco>"
    text = text.replace('euler="0.4 -0.7 1.1">', '><freejoint name="root"/><geom size="1"/>')
    text = text.replace("ACOS ASIN", "0.1 0").replace("PX PY", "0.1 0")
    path = file(text)
    laws = {"left": steady(2.0, 1.0), "elbow": steady(-1.3, 0.5)}
    with pytest.raises(MobilityError, match=r"root can still move; .*--fix-base"):
        driven(path, laws)
    _, motion = driven(path, laws, fix_base=True)
    assert motion.joints["elbow"].value[-1] == pytest.approx(-0.8)


def test_nearly_parallel_axes_of_a_rounded_file_are_corrected(file):
    text = five_bar(0.0).replace('name="wrist"', 'name="wrist" axis="1e-6 -2e-6 1"')
    solver, motion = driven(file(text), {"left": steady(2.0, 0.2), "right": steady(7.28, 0.1)})
    # atan(hypot(1e-6, 2e-6)) in degrees
    assert any("0.000128 deg off parallel" in fact for fact in solver.facts)
    exact, truth = driven(file(five_bar(0.0)), {"left": steady(2.0, 0.2), "right": steady(7.28, 0.1)})
    assert exact.corrected == (0.0, 0.0)
    np.testing.assert_allclose(motion.points["P"].position, truth.points["P"].position, atol=1e-6)
    assert mujoco_residual(solver, motion) < 1e-6


def test_only_mobility_needs_no_driver(file):
    text = five_bar().replace('<motor joint="left"/><position joint="right"/>', "")
    path = file(text)
    with pytest.raises(InputError, match=r"model\.xml: nothing says what is driven.*left, elbow, right"):
        load(path)
    solver = load(path, still=True)
    output = facts(solver)
    assert output["mobility"].dofs == 2
    assert output["mobility"].drivers == ()
    assert len(output["mobility"].undetermined) == 2
    assert scene_findings(solver) is not None
    with pytest.raises(InputError, match="nothing is driven; name a driver"):
        solver.solve([0.0])


def test_a_model_with_one_free_body_is_valid(file):
    body = "<body><freejoint/><geom size='0.1'/></body>"
    solver = load(file(f"<mujoco><worldbody>{body}</worldbody></mujoco>"), still=True)
    assert facts(solver)["mobility"].dofs == 6
    assert scene_findings(solver) == ()
