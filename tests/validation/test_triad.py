import numpy as np
import pytest
import triad as study

from mechsim.kinematics.vector_method import triad

EPS = np.finfo(np.float64).eps
# published poses, with angles within one revolution
REFERENCE = np.array(
    [
        (-15.150496, 5.144167, -0.378489),
        (-3.623487, 15.584298, -0.637971),
        (3.233389, -15.669882, -0.055809),
        (15.045358, -5.444005, 0.228719),
        (15.137333, 5.182774, -0.073656),
        (15.296369, 4.692663, -0.120310),
    ]
)


def plane(points: np.ndarray) -> np.ndarray:
    return points @ np.array([1.0, 1j])


def existing_poses(poses: np.ndarray) -> np.ndarray:
    return poses[np.isfinite(poses[..., 0])]


def test_the_reference_triad_has_its_six_published_poses():
    poses = triad.triad_modes([(0, 0), (52, 0), (49, 42)], [(0, 0), (58, 0), (38, 49)], [16, 21, 12])
    wrapped = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
    order = np.lexsort((poses[:, 1], poses[:, 0]))
    result = np.column_stack([poses[:, :2], wrapped])[order]
    # printed with six decimals
    assert np.abs(result - REFERENCE).max() <= 1e-6


def test_legs_of_every_pose_keep_their_lengths():
    pivots, platform, legs = study.random_triads(2000, seed=1)
    poses = triad.triad_modes(pivots, platform, legs)
    ends = plane(poses[..., :2])[..., None] + np.exp(1j * poses[..., 2:]) * plane(platform)[:, None]
    differences = abs(abs(ends - plane(pivots)[:, None]) - legs[:, None])
    # angle and position are rounded once more; the triads have lengths of at most 3
    assert np.nanmax(differences) <= 16 * EPS * 3.0
    assert np.isfinite(differences).any()


def test_poses_are_sorted_by_angle_within_one_revolution():
    poses = triad.triad_modes(*study.random_triads(500, seed=2))
    for angles in poses[..., 2]:
        angles = angles[np.isfinite(angles)]
        assert ((angles >= 0.0) & (angles < 2 * np.pi)).all()
        assert (np.diff(angles) >= 0.0).all()


def test_poses_agree_with_intersections_of_coupler_curves():
    problems = study.random_triads(1000, seed=3)
    poses = triad.triad_modes(*problems)
    assert study.disagreements(poses, study.CouplerCurves(*problems).roots()).size == 0
    counts = np.bincount(np.isfinite(poses[..., 0]).sum(1), minlength=7)
    assert counts[[1, 3, 5]].sum() == 0
    assert (counts[[0, 2, 4, 6]] > 0).all()


@pytest.mark.slow
def test_sixty_digits_give_the_same_number_of_poses():
    problems = study.random_triads(30, seed=4)
    poses = triad.triad_modes(*problems)
    for pose, *problem in zip(poses, *problems, strict=True):
        assert len(existing_poses(pose)) == study.exact_count(*problem)


@pytest.mark.parametrize("fault", ["missed", "invented", "moved"])
def test_the_comparison_of_methods_rejects_a_wrong_list_of_poses(fault):
    problems = study.random_triads(40, seed=5)
    poses = triad.triad_modes(*problems)
    others = [existing_poses(pose) for pose in poses]
    wrong = next(j for j, other in enumerate(others) if 2 <= len(other) < 6)
    if fault == "missed":
        poses[wrong, 0] = np.nan
    elif fault == "invented":
        poses[wrong, -1] = poses[wrong, 0] + 0.1
    else:
        poses[wrong, 0, 1] += 1e-5
    assert study.disagreements(poses, others).tolist() == [wrong]


def test_poses_move_and_scale_with_the_pivots():
    pivots, platform, legs = study.random_triads(300, seed=8)
    scale, rotation, shift = 1e-6, np.exp(0.7j), 3e-6 - 5e-6j
    moved = scale * rotation * plane(pivots) + shift
    poses = triad.triad_modes(np.stack([moved.real, moved.imag], -1), scale * platform, scale * legs)
    back = (plane(poses[..., :2]) - shift) / rotation / scale
    transformed = np.stack([back.real, back.imag, poses[..., 2] - 0.7], -1)
    others = [existing_poses(pose) for pose in transformed]
    assert study.disagreements(triad.triad_modes(pivots, platform, legs), others, 1e-9).size == 0


def test_two_poses_of_equal_angle_are_both_returned():
    # a platform similar to its collinear pivots: poses come in pairs of equal angle, and
    # the sextic has double roots only
    pivots = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
    platform, legs = 0.7 * pivots, [0.5, 0.6, 0.81]
    poses = existing_poses(triad.triad_modes(pivots, platform, legs))
    assert len(poses) == 4
    assert np.abs(poses[0, 2] - poses[1, 2]) < 1e-7
    assert np.abs(poses[2, 2] - poses[3, 2]) < 1e-7
    assert np.abs(poses[0, :2] - poses[1, :2]).max() > 0.5
    ends = plane(poses[:, :2])[:, None] + np.exp(1j * poses[:, 2:]) * plane(platform)
    assert np.abs(abs(ends - plane(pivots)) - legs).max() <= 16 * EPS


def test_two_poses_vanish_together_at_a_dead_centre():
    pivots, platform, legs = (array[0] for array in study.random_triads(1, seed=11))

    def count(longer: float) -> int:
        return len(existing_poses(triad.triad_modes(pivots, platform, [legs[0], legs[1], legs[2] + longer])))

    low, high = 0.0, 3.0
    assert count(low) > 0
    assert count(high) == 0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if count(middle) else (low, middle)
    assert count(low - 1e-9) == 2
    assert count(low + 1e-12) == 0
