"""Families of removal candidates: each changes a scene as stated, and a wrong one is rejected."""

import mujoco
import numpy as np
import pytest
from scene_texts import FINGER
from studies.test_reduction import LIMIT, evaluator_of, observed

from mechsim.studies.reduction.candidates import rods
from mechsim.studies.reduction.candidates.elements import fused_bodies, with_candidate


def test_a_rod_becomes_a_length_with_the_same_mass(tmp_path):
    smooth = FINGER.replace('name="elbow"', 'name="elbow" damping="0"')
    evaluator = evaluator_of(tmp_path, smooth, track=("P,lever@0,0.06,0",))
    result = observed(evaluator)
    assert [(chain.joints, chain.closing) for chain in rods.loose_chains(result)] == [(("elbow",), "closing")]
    specs = [with_candidate(evaluator.spec, rod) for rod in rods.rods_as_lengths(result)]
    whole, reduced_model = evaluator.spec.copy().compile(), specs[0].copy().compile()
    assert reduced_model.nv == whole.nv - 1
    assert reduced_model.body_mass.sum() == pytest.approx(whole.body_mass.sum(), rel=1e-14)
    right = min(evaluator.errors(evaluator.scene(spec)).trajectory for spec in specs)
    longer = specs[0].copy()
    data = longer.equality("closing").data
    data[0] += 1e-3
    longer.equality("closing").data = data
    assert right < 2e-4
    assert evaluator.errors(evaluator.scene(longer)).trajectory > 5e-4


def test_an_untracked_leaf_is_fused(tmp_path):
    evaluator = evaluator_of(tmp_path, FINGER, track=("P,lever@0,0.06,0",))
    removals = {direction.what: direction for direction in rods.passive_chains(observed(evaluator))}
    leaf = next(direction for what, direction in removals.items() if "pad" in what)
    reduced_model = evaluator.scene(with_candidate(evaluator.spec, leaf))
    assert "swing" not in [reduced_model.model.joint(j).name for j in range(reduced_model.model.njnt)]
    assert evaluator.errors(reduced_model).trajectory < 10 * LIMIT
    loop = next(direction for what, direction in removals.items() if "closing" in what)
    assert evaluator.errors(evaluator.scene(with_candidate(evaluator.spec, loop))).trajectory > 1e-3


def test_jointless_bodies_are_merged(tmp_path):
    text = FINGER.replace('name="swing" stiffness="0.05" damping="0.001"', 'name="swing"').replace(
        '<joint name="swing"/>',
        '<body name="nail"><inertial mass="1e-3" pos="0 0 0" diaginertia="1e-9 1e-9 1e-9"/></body>',
    )
    evaluator = evaluator_of(tmp_path, text, track=("nail",))
    (fused,) = fused_bodies(observed(evaluator))
    spec = with_candidate(evaluator.spec, fused)
    assert evaluator.errors(evaluator.scene(spec)).trajectory < LIMIT
    assert spec.compile().nbody < evaluator.named.nbody


def test_an_added_mass_updates_centre_and_moments(tmp_path):
    model = evaluator_of(tmp_path, FINGER).named
    body, rotation = model.body("rod").id, np.empty(9)
    own = float(model.body_mass[body]), model.body_ipos[body].copy(), model.body_inertia[body].copy()
    position, mass = np.array([0.01, -0.02, 0.03]), 0.05
    rods.add_weight(model, body, mass, position, np.zeros((3, 3)))
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axes = rotation.reshape(3, 3)
    about = lambda m, r: m * (r @ r * np.eye(3) - np.outer(r, r))  # noqa: E731
    centre = model.body_ipos[body]
    assert np.allclose(centre * (own[0] + mass), own[0] * own[1] + mass * position)
    origin = axes @ np.diag(model.body_inertia[body]) @ axes.T + about(own[0] + mass, centre)
    assert np.allclose(origin, np.diag(own[2]) + about(own[0], own[1]) + about(mass, position), atol=1e-18)
