"""Prescribed motions: drivers with motion laws, locked joints, tracked points and tables of poses."""

import re

import numpy as np
import pytest
from model_files import model_text

from mechsim.errors import InputError
from mechsim.io.driver_positions import poses_of_table
from mechsim.io.readers import load

FIVE_BAR = model_text("prescription_five_bar.toml")
BOOM = model_text("prescription_boom.toml")


def two_circles(left, right, arm=0.05, rod=0.09, ground=0.1):
    """Return the upper intersection of two circles about the ends of the arms."""
    a = np.stack([arm * np.cos(left), arm * np.sin(left)], 1)
    d = np.stack([ground + arm * np.cos(right), arm * np.sin(right)], 1)
    half = (d - a) / 2.0
    length = np.linalg.norm(half, axis=1)[:, None]
    return a + half + np.sqrt(rod**2 - length**2) * np.stack([-half[:, 1], half[:, 0]], 1) / length


def test_a_parameter_and_a_motion_law_can_be_set_together(file):
    laws = {"left": "100deg + 10deg*sin(t)", "right": "80deg + 0*t"}
    solver = load(file(FIVE_BAR), {"rod": "80 mm"}, drive=laws)
    position = solver.solve(t=[0.0]).points["P"].position[:, :2]
    np.testing.assert_allclose(
        position, two_circles(np.deg2rad([100.0]), np.deg2rad([80.0]), rod=0.08), atol=1e-14
    )


def test_a_boom_on_a_ram_follows_the_law_of_cosines(file):
    solver = load(file(BOOM), drive={"ram": "20mm/s"}, duration=2.0)
    time = np.linspace(0.0, 2.0, 21)
    motion = solver.solve(t=time)
    np.testing.assert_allclose(motion.joints["ram"].value, 0.52 + 0.02 * time, atol=1e-15)
    base = np.hypot(0.3, 0.2)
    between = np.arccos((base**2 + 0.4**2 - (0.52 + 0.02 * time) ** 2) / (2 * base * 0.4))
    np.testing.assert_allclose(motion.joints["foot"].value, between - np.arctan2(0.2, 0.3), atol=1e-13)
    columns = [name for name, _ in motion.columns()]
    assert columns[:3] == ["t", "ram", "tip.x"]


def test_another_driver_starts_at_its_initial_value(file):
    own = load(file(BOOM), drive={"ram": "20mm/s"}).solve(t=[0.0]).joints["foot"].value[0]
    solver = load(file(BOOM), drive={"foot": "3deg/s"})
    assert solver.mechanism.drivers == ("foot",)
    assert solver.mechanism.has_crank
    motion = solver.solve(t=[0.0])
    np.testing.assert_allclose(motion.joints["foot"].value, [own], atol=1e-14)
    np.testing.assert_allclose(motion.joints["ram"].value, [0.52], atol=1e-14)


@pytest.mark.parametrize(("value", "angle"), [(None, 120.0), ("100deg", 100.0), (np.deg2rad(100.0), 100.0)])
def test_a_locked_driver_is_at_rest_and_the_other_moves(file, value, angle):
    solver = load(file(FIVE_BAR), drive={"right": "10deg/s"}, lock={"left": value})
    assert solver.mechanism.drivers == ("right",)
    time = np.linspace(0.0, 1.0, 5)
    motion = solver.solve(t=time)
    expected = two_circles(np.full(5, np.deg2rad(angle)), np.deg2rad(60 + 10 * time))
    np.testing.assert_allclose(motion.points["P"].position[:, :2], expected, atol=1e-13)


def test_a_mechanism_of_the_catalogue_is_driven_by_any_of_its_joints():
    from mechsim import catalog

    solver = load("slider_crank", drive={"crank": "600rpm"}, duration=0.1)
    time = np.linspace(0.0, 0.1, 9)
    motion = solver.solve(t=time)
    exact = catalog.make("slider_crank").solve(20 * np.pi * time, 20 * np.pi)
    for quantity in ("position", "velocity", "acceleration"):
        result, expected = (getattr(item.points["B"], quantity) for item in (motion, exact))
        np.testing.assert_allclose(result, expected, atol=1e-12 * np.abs(expected).max())


def test_only_tracked_points_are_reported(file):
    solver = load(file(FIVE_BAR), track=["P", "knee,a@50mm,0,0", "d"])
    assert dict(solver.mechanism.points) == {
        "P": ("b", (0.09, 0.0, 0.0)),
        "knee": ("a", (0.05, 0.0, 0.0)),
        "d": ("d", (0.0, 0.0, 0.0)),
    }


def test_floating_bases_are_fixed_at_their_initial_pose(file):
    text = model_text("prescription_text.toml")
    solver = load(file(text), fix_base=True)
    position = solver.positions([0.0, np.pi / 2])["hand"]
    across = np.array([0.0, np.cos(0.5), np.sin(0.5)])
    pivot = np.array([1.0, 2.0, 3.0]) + 0.2 * across
    np.testing.assert_allclose(position, [pivot + np.array([0.3, 0, 0]), pivot + 0.3 * across], atol=1e-14)
    with pytest.raises(InputError, match="no floating link"):
        load(file(FIVE_BAR), fix_base=True)


def test_a_table_of_poses_keeps_the_assembly_mode_of_the_guess(file):
    rng = np.random.default_rng(3)
    left, right = np.deg2rad(rng.uniform(80, 150, 40)), np.deg2rad(rng.uniform(30, 100, 40))
    left[7], right[7] = left[6], right[6]
    poses = poses_of_table(load(file(FIVE_BAR)), {"left": left, "right": right}, "rows.csv")
    columns = dict(poses.columns())
    joints = [f"{name}.q" for name in ("left", "right", "A", "D", "P")]
    assert list(columns) == ["left", "right", "P.x", "P.y", "P.z", *joints]
    expected = two_circles(left, right)
    np.testing.assert_allclose(np.stack([columns["P.x"], columns["P.y"]], 1), expected, atol=1e-13)
    assert len(poses_of_table(load(file(FIVE_BAR)), {"left": left[:1], "right": right[:1]}, "rows.csv")) == 1


INVALID = [
    ({"drive": {"lift": "1"}}, "did you mean 'left'"),
    ({"drive": {"left": "3mm/s"}}, "a speed of rotation"),
    ({"drive": {"left": "10deg*t"}}, "right has no motion law; give each driver one: --drive"),
    ({"lock": {"knee": None}}, "no coordinate 'knee' to lock"),
    ({"lock": {"left": "3mm"}}, "is the wrong kind of unit"),
    ({"lock": ["left", "right"]}, "no coordinate is driven"),
    ({"track": ["Q"]}, "no point or link 'Q'"),
    ({"track": ["Q,arm@0,0,0"]}, "'arm'"),
    ({"track": ["Q,a@0,0"]}, "three numbers"),
    ({"key": "home"}, "no keyframes"),
    ({"duration": 2.0}, "no motion laws for a duration of"),
    ({"drive": {"left": "10deg*t", "right": "1rad*log(t-0.5)"}}, "is not finite"),
    ({"drive": {"left": "1deg*(1/t)", "right": "10deg*t"}}, "is not finite"),
    ({"drive": {"left": "10deg*t", "right": "10deg*t"}, "duration": 0.0}, "above 0"),
]


@pytest.mark.parametrize(("options", "words"), INVALID)
def test_an_invalid_prescription_is_rejected_in_one_line(file, options, words):
    with pytest.raises(InputError, match=re.escape(words)) as error:
        load(file(FIVE_BAR), **options)
    assert "\n" not in str(error.value)


def test_a_table_limits_the_duration(file, tmp_path):
    path = tmp_path / "left.csv"
    path.write_text("t,left\n" + "".join(f"{0.1 * i},{2 + 0.01 * i}\n" for i in range(8)))
    laws = {"left": str(path), "right": "10deg*t"}
    assert load(file(FIVE_BAR), drive=laws).motion_laws.duration == pytest.approx(0.7)
    with pytest.raises(InputError, match=r"ends at 0.7 s, before the duration, 1 s"):
        load(file(FIVE_BAR), drive=laws, duration=1.0)
