from dataclasses import replace

import mechanisms
import mujoco
import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation import loop_jacobian
from mechsim.simulation.drivers import PARAMETER_JOINT, find_drivers
from mechsim.simulation.model_loops import ModelLoops, read_loops
from mechsim.simulation.source import assembled
from mechsim.simulation.state import quaternion_addresses

EVERYTHING = [
    *(ms.catalog.make(name).mechanism for name in ("rssr", "four_bar", "slider_crank")),
    ms.catalog.make("rssr", guide=True).mechanism,
    *mechanisms.everything(),
]


def loops_of(mechanism: ms.Mechanism) -> ModelLoops:
    return read_loops(assembled(mechanism, ms.Scene()).compile())


def states_near(loops: ModelLoops, n: int, reach: float) -> np.ndarray:
    rng = np.random.default_rng(11)
    steps = reach * rng.normal(size=(n, loops.model.nv))
    return loops.displaced(np.repeat(loops.model.qpos0[None], n, 0), steps)


def test_the_rank_of_a_batch_includes_every_state() -> None:
    loops = read_loops(user('<connect body1="b" body2="c" anchor=".2 .05 0"/>'))
    jacobians, right = np.zeros((2, 3, 3)), np.array([[2.0, 5.0, 0.0], [3.0, 0.0, 7.0]])[..., None]
    jacobians[:, 0, loops.free[0]] = jacobians[0, 1, loops.free[1]] = jacobians[1, 2, loops.free[1]] = 1.0
    rates = loop_jacobian.solve(loops, jacobians, right)[..., 0]
    np.testing.assert_allclose(rates, [[2.0, 5.0], [3.0, 7.0]], rtol=1e-14)


@pytest.mark.parametrize("mechanism", EVERYTHING, ids=lambda m: m.name)
def test_perturbed_loops_close_with_the_crank_locked(mechanism: ms.Mechanism) -> None:
    loops = loops_of(mechanism)
    perturbed = states_near(loops, 20, 1e-2)
    closed = loop_jacobian.close(loops, perturbed)
    assert np.array_equal(closed[:, loops.crank_address], perturbed[:, loops.crank_address])
    # rounding of a Newton step, relative to the longest link
    assert loops.closure_error(loops.residual(closed)).max() < 1e-14
    for first in quaternion_addresses(loops.model):
        assert np.linalg.norm(closed[:, first : first + 4], axis=1) == pytest.approx(1.0, abs=1e-15)


USER = model_text("model_loops_user.xml")


def user(equality: str, crank: str = "crank", **kinds: str) -> mujoco.MjModel:
    """Return a model with an equality, a crank, and kinds of joints that are no hinges."""
    text = USER.format(equality=equality, crank=crank)
    for joint, kind in kinds.items():
        text = text.replace(f'"{joint}"', f'"{joint}" type="{kind}"', 1)
    return mujoco.MjModel.from_xml_string(text)


def test_an_unassemblable_state_is_rejected_with_its_crank_angle() -> None:
    loops = loops_of(ms.catalog.make("four_bar", crank=0.06, ground=0.1, coupler=0.05, rocker=0.05).mechanism)
    states = np.repeat(loops.model.qpos0[None], 2, 0)
    states[1, loops.crank_address] = np.pi
    with pytest.raises(
        ms.AssemblyError, match=r"do not close at crank angle 3\.14159 rad: a closure error of"
    ):
        loop_jacobian.close(loops, states)


def test_newtons_method_stops_at_rounding_above_its_tolerance(monkeypatch) -> None:
    loops = loops_of(ms.catalog.make("rssr").mechanism)
    monkeypatch.setattr(loop_jacobian, "NEWTON", replace(loop_jacobian.NEWTON, tolerance=0.0))
    steps: list[int] = []
    original = loops.displaced
    monkeypatch.setattr(
        ModelLoops, "displaced", lambda _, qpos, step: steps.append(len(qpos)) or original(qpos, step)
    )
    closed = loop_jacobian.close(loops, states_near(loops, 20, 1e-2))
    assert loops.closure_error(loops.residual(closed)).max() < 1e-14
    # quadratic convergence from 1e-2: three steps to rounding and a few that detect it
    assert len(steps) < 7


@pytest.mark.parametrize(("joint", "kind", "scale"), [("j", "hinge", 1.0), ("k", "slide", 0.3)])
def test_coupled_slide_errors_are_relative_to_the_model_size(joint, kind, scale) -> None:
    loops = read_loops(user(f'<joint joint1="{joint}" polycoef=".06 0 0 0 0"/>', **{joint: kind}))
    state = loops.model.qpos0[None]
    assert loops.closure_error(loops.residual(state))[0] == pytest.approx(0.06 / scale)


def test_driven_slide_errors_are_relative_to_the_model_size() -> None:
    model = user("", PARAMETER_JOINT, k="slide")
    loops = read_loops(model, drivers=find_drivers(model, ("j", "k")))
    offsets = np.zeros((3, model.nq))
    offsets[1, 1], offsets[2, 2] = 0.06, 0.06
    gaps = loops.closure_error(loops.residual(model.qpos0 + offsets))
    assert gaps == pytest.approx([0.0, 0.06, 0.06 / loops.characteristic_length])
    assert loops.characteristic_length == pytest.approx(0.3)


@pytest.mark.parametrize(("kind", "scale"), [("hinge", 1.0), ("slide", 0.3)])
def test_conditioning_is_the_smallest_scaled_singular_value(kind, scale) -> None:
    first = '<joint joint1="j" joint2="crank" polycoef=".1 .2 0 0 0"/>'
    second = '<joint joint1="k" joint2="j" polycoef="0 .15 .1 0 0"/>'
    loops = read_loops(user(first + second, k=kind))
    states = np.array([[0.3, 0.2, 0.0], [0.1, -0.9, 0.0]])
    gradient = (0.15 + 0.2 * states[:, 1]) / scale
    required = [np.linalg.svd([[1.0, 0.0], [-item, 1.0]])[1][-1] for item in gradient]
    assert loop_jacobian.conditioning(loops, loops.linearise(states)[1]) == pytest.approx(required)
    # a joint with a motion law is no unknown, and its constraint has no columns
    with_motion_law = user(second, PARAMETER_JOINT, k=kind)
    driven = read_loops(with_motion_law, drivers=find_drivers(with_motion_law, ("j",)))
    assert loop_jacobian.conditioning(driven, driven.linearise(states)[1]) == pytest.approx(1.0)


def test_loops_close_with_another_locked_coordinate_than_the_crank() -> None:
    loops = loops_of(ms.catalog.make("four_bar").mechanism)
    model = loops.model
    locked = np.array([dof for dof in range(model.nv) if model.joint(model.dof_jntid[dof]).name == "rocker"])
    assert len(locked) == 1
    states = states_near(loops, 3, 0.02)
    step = loop_jacobian.nearest_steps(loops, np.delete(np.arange(model.nv), locked))
    closed = loop_jacobian.close(loops, states, step)
    address = model.jnt_qposadr[model.dof_jntid[locked]]
    assert np.array_equal(closed[:, address], states[:, address])
    assert np.abs(closed[:, loops.crank_address] - states[:, loops.crank_address]).min() > 1e-6
    assert loops.closure_error(loops.residual(closed)).max() < 1e-14
    # no crank angle closes the loop with the rocker half a revolution away
    states[:, address] += np.pi
    with pytest.raises(ms.AssemblyError, match="do not close"):
        loop_jacobian.close(loops, states, step)
