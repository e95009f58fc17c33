"""Closed configurations: assembled according to MuJoCo, within limits, reproducible, in the model's order."""

import mujoco
import numpy as np
import pytest
from model_files import model_text, replaced

import mechsim as ms
from mechsim.simulation.state import dense_rows

FOUR_BAR = model_text("closed_configurations_four_bar.xml")


def four_bar(*changes: tuple[str, str]) -> mujoco.MjModel:
    """Return the model with changed texts."""
    return mujoco.MjModel.from_xml_string(replaced(FOUR_BAR, changes))


@pytest.fixture
def model() -> mujoco.MjModel:
    return four_bar()


def test_samples_are_assembled_within_limits_and_reproducible(model: mujoco.MjModel) -> None:
    states = ms.sample(model, 50, seed=3)
    assert states.qpos.shape == (50, model.nq)
    assert 0 < states.accepted <= 1
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    for qpos, qvel in zip(states.qpos, states.qvel, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        assert np.abs(data.efc_pos[rows]).max() < 1e-13
        assert np.abs(dense_rows(data)[rows] @ qvel).max() < 1e-12
    assert np.abs(states.qpos[:, 7]).max() <= np.radians(40) + 1e-9
    assert np.array_equal(states.qpos, ms.sample(model, 50, seed=3).qpos)


def test_disabled_limits_are_ignored(model: mujoco.MjModel) -> None:
    with pytest.raises(ms.errors.InputError, match="joint crank is outside its limits"):
        ms.closed_qpos(model, {"crank": 0.75})
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    assert ms.closed_qpos(model, {"crank": 0.75})[0, 7] == 0.75


PARALLELOGRAM = model_text("closed_configurations_parallelogram.xml")


def parallelograms(count: int) -> mujoco.MjModel:
    bodies = "".join(PARALLELOGRAM.format(n=n, z=n) for n in range(count))
    loops = "".join(f'<connect site1="a{n}" site2="b{n}"/>' for n in range(count))
    loops += "".join(f'<joint joint1="crank{n}" joint2="crank0"/>' for n in range(1, count))
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{bodies}</worldbody><equality>{loops}</equality>"
        '<actuator><motor joint="crank0"/></actuator></mujoco>'
    )


@pytest.mark.parametrize("count", [1, 2, 15])
def test_samples_of_parallelograms_stay_between_their_change_points(count: int) -> None:
    states = ms.sample(parallelograms(count), 100)
    cranks, rockers = states.qpos[:, 0], states.qpos[:, 2]
    # at a right angle all links lie in line
    assert np.abs(cranks).max() < np.pi / 2
    assert rockers == pytest.approx(cranks, abs=1e-9)


def test_an_overconstrained_linkage_keeps_its_assembly_mode_over_a_turn() -> None:
    states = ms.sample("bennett", 100)
    assert states.accepted == 1.0
    assert np.ptp(states.qpos[:, 0]) > 5.0


def test_closing_a_start_does_not_move_the_floating_base() -> None:
    floating = (
        ('<body><joint name="crank"', '<body><freejoint/><geom size=".1"/><body><joint name="crank"'),
        ("</body></worldbody>", "</body></body></worldbody>"),
        (".02 .06 0", ".02 .062 0"),
    )
    states = ms.sample(four_bar(*floating), 50)
    assert states.accepted > 0.5
    assert np.ptp(states.qpos[:, :14], axis=0).max() == 0.0


# the coupler's axis is parallel to the others but for rounding, so that the loop closes only to rounding
ROUNDED = ('name="coupler" axis="0 0 1"', 'name="coupler" axis="2e-6 1e-6 1"')


def test_rounded_dimensions_of_redundant_loops_are_tolerated(model: mujoco.MjModel) -> None:
    states = ms.sample(four_bar(ROUNDED), 50)
    assert 1e-9 < states.residual.max() < 1e-5
    assert ms.closed_qpos(model, {"crank": states.qpos[:, 7]}) == pytest.approx(states.qpos, abs=1e-5)


@pytest.mark.long
def test_rounded_dimensions_do_not_excuse_an_unreachable_position() -> None:
    model = four_bar(ROUNDED, ('range="-40 40" limited="true"', ""))
    # distances of the joints: 0.03, 0.0632, 0.0632 and 0.0806 m; moved off, the loop cannot close
    model.body_pos[model.jnt_bodyid[3]] = [0.17, 0.0, 0.0]
    with pytest.raises(ms.errors.AssemblyError):
        ms.closed_qpos(model, {"crank": 0.1})


def test_a_reference_outside_the_limits_is_replaced() -> None:
    model = four_bar(('name="rocker"', 'name="rocker" range="15 60" limited="true"'))
    states = ms.sample(model, 20)
    rocker = states.qpos[:, model.joint("rocker").qposadr[0]]
    assert np.all(rocker >= np.radians(15) - 1e-9)
    assert states.residual.max() < 1e-12


def test_a_joint_that_starts_beyond_its_limits_does_not_reject_draws_of_others() -> None:
    """A hinge, and a pair of coupled hinges that starts beyond the limits of its passive one."""
    spec = mujoco.MjSpec()
    for name in ("hip", "knee", "motor"):
        body = spec.worldbody.add_body()
        body.add_joint(name=name)
        body.add_geom(size=[0.1, 0, 0])
    spec.joint("knee").range, spec.joint("knee").limited = [-150, -5], True
    coupling = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1="knee", name2="motor")
    coupling.data[:2] = 0.0, 1.0
    drawn = ms.sample(spec, 50).qpos
    assert (np.degrees(drawn[:, 1]) >= -150).all()
    assert (np.degrees(drawn[:, 1]) <= -5).all()
    np.testing.assert_allclose(drawn[:, 1], drawn[:, 2], atol=1e-12)
    # uniform over a revolution
    assert np.ptp(drawn[:, 0]) > np.pi
    spec.add_actuator(target="hip", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    with pytest.raises(ms.AssemblyError, match="knee stays at the start, which is outside its limits"):
        ms.sample(spec, 50, lock_others=True)


def test_the_coupled_joint_with_the_narrower_travel_is_drawn() -> None:
    finger = (
        '<body><joint name="p{0}" range="0 0.6"/><geom size="0.01"/><body pos="0.04 0 0">'
        '<joint name="d{0}" range="0 3.14"/><geom size="0.01"/></body></body>'
    )
    rows = '<joint joint1="d{0}" joint2="p{0}" polycoef="0 1.08 0 0 0"/>'
    fingers, couplings = ("".join(text.format(i) for i in range(6)) for text in (finger, rows))
    xml = (
        f'<mujoco><compiler angle="radian" autolimits="true"/><worldbody>{fingers}</worldbody>'
        f"<equality>{couplings}</equality></mujoco>"
    )
    states = ms.sample(mujoco.MjModel.from_xml_string(xml), 20)
    # 1.08 times 0.6 rad is within 3.14 rad: every drawn position is admissible
    assert states.accepted == 1.0
    assert np.ptp(states.qpos[:, ::2], axis=0).min() > 0.3
    np.testing.assert_allclose(states.qpos[:, 1::2], 1.08 * states.qpos[:, ::2], atol=1e-12)


def closure_point(crank: float, side: float) -> np.ndarray:
    """Return where circles about the crank's end and the rocker's pivot intersect, by the law of cosines."""
    end, pivot = 0.03 * np.array([np.cos(crank), np.sin(crank)]), np.array([0.07, -0.04])
    line = pivot - end
    height = np.sqrt(0.06**2 + 0.02**2 - line @ line / 4)
    return (end + pivot) / 2 + side * height * np.array([-line[1], line[0]]) / np.linalg.norm(line)


def test_a_keyframe_selects_the_assembly_of_samples_maps_and_configurations() -> None:
    first, second = (closure_point(0.0, side) for side in (1.0, -1.0))
    assert first == pytest.approx([0.09, 0.02], abs=1e-15)
    turns = [
        np.arctan2(*(second - base)[::-1]) - np.arctan2(*(first - base)[::-1])
        for base in (np.array([0.03, 0.0]), np.array([0.07, -0.04]))
    ]
    qpos = " ".join(map(str, [0, 0, 2, 1, 0, 0, 0, 0, *turns]))
    key = f'<keyframe><key name="other" qpos="{qpos}"/></keyframe></mujoco>'
    model = four_bar(("</mujoco>", key))
    data = mujoco.MjData(model)
    states = [(None, 1.0), ("other", -1.0)]
    for key, side in states:
        samples = ms.sample(model, 20, key=key).qpos
        for row in (*ms.closed_qpos(model, {"crank": [0.1, -0.6]}, key=key), *samples):
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            assert data.site("a").xpos[:2] == pytest.approx(closure_point(row[7], side), abs=1e-12)
        table = ms.joint_map(model, {"crank": (-0.3, 0.3)}, ["a.x"], points=3, key=key)
        assert table.output[:, 0] == pytest.approx(
            [closure_point(q, side)[0] for q in (-0.3, 0.0, 0.3)], abs=1e-12
        )
    with pytest.raises(ms.InputError, match="'nosuch'; there are other"):
        ms.sample(model, 5, key="nosuch")


FREE_LINKS = model_text("closed_configurations_free_links.xml")


def test_free_joints_of_loops_are_drawn_unless_they_are_fixed() -> None:
    model = mujoco.MjModel.from_xml_string(FREE_LINKS)
    states = ms.sample(model, 200)
    # two bars on balls: both rotate freely, and the second is at the end of the first
    first, second = states.qpos[:, 3:7], states.qpos[:, 10:14]
    assert np.ptp(first, axis=0).min() > 0.5
    assert np.ptp(second, axis=0).min() > 0.5
    w, x, y, z = first.T
    end = 0.2 * np.stack([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)], 1)
    np.testing.assert_allclose(states.qpos[:, 7:10], end + np.array([0.0, 0.0, 1.0]), atol=1e-12)
    with pytest.raises(ms.InputError, match="leave out --fix-base"):
        ms.sample(four_bar(("<freejoint/>", "")), 5, fix_base=True)


@pytest.mark.long
def test_loops_without_a_common_joint_are_rejected_one_by_one() -> None:
    # each loop alone accepts a half or a quarter of the draws: the rocker's limits exclude the others
    model = parallelograms(5)
    model.eq_active0[5:] = 0
    model.jnt_limited[2::3], model.jnt_range[2::3] = 1, (0.0, 1.5)
    model.jnt_limited[0::3], model.jnt_range[0::3] = 1, (-1.5, 1.5)
    states = ms.sample(model, 60)
    # drawn together, less than 0.5 to the power of 5 would be accepted
    assert states.accepted > 0.2
    assert states.residual.max() < 1e-12
    assert states.qpos[:, 2::3].min() >= 0.0
    assert np.abs(np.corrcoef(states.qpos[:, 0::3].T) - np.eye(5)).max() < 0.5


def test_other_joints_can_be_locked() -> None:
    arm = '<body><joint name="arm" axis="0 0 1"/><geom size=".1"/></body></worldbody>'
    model = four_bar(("</worldbody>", arm))
    assert np.ptp(ms.sample(model, 20).qpos[:, -1]) > 1.0
    locked = ms.sample(model, 20, lock_others=True).qpos
    assert np.ptp(locked[:, -1]) == 0.0
    assert np.ptp(locked[:, 7]) > 0.5
    with pytest.raises(ms.InputError, match="--lock others leaves none to draw"):
        ms.sample(mujoco.MjModel.from_xml_string(FREE_LINKS), 5, lock_others=True)


@pytest.mark.long
def test_an_open_file_starts_in_the_assembly_of_every_command(file) -> None:
    text = FOUR_BAR.replace('site name="a" pos=".06 .02 0"', 'site name="a" pos=".02 .06 0"')
    path = file(text.replace('<body pos="0 0 2"><freejoint/><geom size=".1"/></body>', ""))
    solver = ms.load(path)
    assert any("does not close" in fact or "do not close" in fact for fact in solver.facts)
    rocker = solver.solve([0.3]).joints["rocker"].value[0]
    assert ms.closed_qpos(path, {"crank": 0.3})[0, 2] == pytest.approx(rocker, abs=1e-9)
    gap = next(finding for finding in ms.check(path) if finding.rule == "MS102")
    start = float(gap.remedy.split("rocker = ")[1].split(",")[0].split()[0])
    assert start == pytest.approx(solver.solve([0.0]).joints["rocker"].value[0], rel=1e-3)
    # the other assembly on request
    other = ms.sample(path, 20, start={"rocker": -start}).qpos[:, 2]
    assert np.sign(other).mean() != np.sign(start)
