"""Files as CAD exports them: links overlap at their joints, and loop constraints are redundant."""

import mujoco
import numpy as np
import pytest
from model_files import copied, model_text

import mechsim as ms
from mechsim.simulation import simulate
from mechsim.simulation.closed_model import exclude_contacts
from mechsim.studies.validate import case_of

# a five-bar whose cranks slightly overlap the plates that carry them
FIVE_BAR = model_text("overlapping_links_five_bar.xml")
SWINGS = {"left": "0.11*sin(2*pi*t)", "right": "0.13*sin(2*pi*t)"}
BALL = """<body name="ball" pos="0 -.1 0"><freejoint/><geom size=".01"/></body>
<geom type="plane" size="1 1 1" pos="0 -.12 0" zaxis="0 1 0"/>"""


def solver(extra=""):
    return ms.load(copied(FIVE_BAR.replace("EXTRA", extra), ".xml"), drive=SWINGS)


def assert_follows(run, motion_laws):
    expected = motion_laws.state(run.motion.time)[0]
    for name, value in zip(motion_laws.drivers, expected, strict=True):
        assert run.motion.joints[name].value == pytest.approx(value, abs=1e-5)


def test_links_that_overlap_at_their_joints_do_not_brake_the_driver():
    case = case_of(solver())
    assert case.passed, case.verdict.reason
    # with contacts as stiff as the loops and recomputed accelerations the error was much larger
    assert case.run.estimate < 1e-12
    assert_follows(case.run, case.solver.motion_laws)
    assert "contacts do not act" in case.run.note


@pytest.mark.long
def test_bodies_independent_of_the_drivers_keep_their_contacts():
    run = simulate(solver(BALL), method="step")
    assert "so are contacts" in run.note
    assert_follows(run, solver(BALL).motion_laws)
    fallen = run.motion.links["ball"].position[-1]
    assert fallen[1] == pytest.approx(-0.11, abs=2e-3)
    assert np.isfinite(fallen).all()


def test_only_contacts_between_determined_bodies_are_excluded():
    random = np.random.default_rng(7)
    bodies = "".join(
        f'<body pos="{x} 0 0"><freejoint/><geom size=".1" contype="{random.integers(4)}" '
        f'conaffinity="{random.integers(4)}"/><geom size=".2" contype="{random.integers(9)}"/></body>'
        for x in range(12)
    )
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    determined = random.random(model.nbody) < 0.5

    def may_collide(kinds, affinities):
        result = np.bitwise_and.outer(kinds, affinities) != 0
        return result | result.T

    def masks():
        return may_collide(model.geom_contype, model.geom_conaffinity)

    before, is_determined = masks(), determined[model.geom_bodyid]
    exclude_contacts(model, determined)
    both_determined = np.logical_and.outer(is_determined, is_determined)
    assert before[both_determined].any()
    assert not masks()[both_determined].any()
    assert (masks() == before)[~both_determined].all()
    # the masks of bodies, which MuJoCo tests first, admit every pair that those of geoms admit
    whole = may_collide(model.body_contype, model.body_conaffinity)
    assert (whole[np.ix_(model.geom_bodyid, model.geom_bodyid)] | ~masks()).all()
