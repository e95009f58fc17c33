"""One design has one assembly, whatever command makes it, and it is the one nearest to the stated values."""

import numpy as np
import pytest
from model_files import model_text, stated_mechanism

import mechsim as ms
from mechsim.kinematics.loops.start import start_poses
from mechsim.studies.scene.scene import open_scene


@pytest.mark.long
@pytest.mark.parametrize("start", [pytest.param("", marks=pytest.mark.slow), "start = 135"])
def test_a_changed_design_has_the_same_assembly_in_solve_and_sweep(tmp_path, start):
    path = tmp_path / "four_bar.toml"
    path.write_text(model_text("one_assembly_four_bar.toml", start=start))
    table = ms.sweep(str(path), vary={"base": np.array([0.052, 0.058, 0.062])}, measure=["at:30deg:B.y"])
    for base, swept in zip((0.052, 0.058, 0.062), table["at:30deg:B.y"].values.ravel(), strict=True):
        solved = ms.load(path, {"base": base}).positions([np.pi / 6])["B"][0]
        assert solved[1] == pytest.approx(float(swept), abs=1e-12)
        # both circles about the crank's end and the pivot pass through B
        crank_end = 0.01 * np.array([np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0])
        assert np.linalg.norm(solved - crank_end) == pytest.approx(0.04, abs=1e-12)
        assert np.linalg.norm(solved - [base, 0.0, 0.0]) == pytest.approx(0.03, abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("height", [0.25, -0.25])
def test_a_stated_pose_is_kept_if_the_other_links_can_follow(height):
    pose = start_poses(stated_mechanism("one_assembly_platform.toml", height=height))[0]["plate"]
    np.testing.assert_allclose(pose.position, [0.0, 0.0, height], atol=1e-12)
    np.testing.assert_allclose(pose.rotation, np.eye(3), atol=1e-12)


# crank 0.1 m at (0, 1), rod 0.3 m, rocker 0.2 m at (0.4, 0.8) in the plane x, z
FOUR_BAR_XML = model_text("one_assembly_four_bar.xml")


@pytest.mark.long
@pytest.mark.parametrize("requested", [2.0, 2.5, 4.0, -2.0, -3.7])
def test_the_assembly_nearest_to_a_requested_angle_is_chosen_by_every_command(tmp_path, requested):
    path = tmp_path / "loop.xml"
    path.write_text(FOUR_BAR_XML)
    # the other end of the rocker is the first one's mirror image in the line from crank to pivot
    end, pivot, first = np.array([0.1, 1.0]), np.array([0.4, 0.8]), np.array([0.4, 1.0])
    along = (pivot - end) / np.linalg.norm(pivot - end)
    other = end + 2.0 * ((first - end) @ along) * along - (first - end) - pivot
    angles = [turns + angle for angle in (0.0, np.arctan2(*other)) for turns in (-2 * np.pi, 0.0, 2 * np.pi)]
    expected = min(angles, key=lambda angle: abs(angle - requested))
    start = {"rocker": f"{requested}rad"}
    solved = ms.load(path, drive={"crank": "0.1rad*t"}, start=start).solve(t=[0.0])
    assert solved.joints["rocker"].value[0] == pytest.approx(expected, abs=1e-12)
    # tune, reduce and simulate under controls start in the state that they write
    for motion in ({"ctrl": {"m": 0.1}}, {"drive": {"crank": "0.1rad*t"}}):
        scene = open_scene(str(path), duration=0.1, start=start, **motion)[0]
        assert np.exp(1j * scene.start[0][2]) == pytest.approx(np.exp(1j * expected), abs=1e-12)
        assert scene.own_start
