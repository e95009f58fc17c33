"""Unassembled starts: the nearest assembly is found and reported, or the loops that lock."""

import re

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.errors import MobilityError
from mechsim.io.mjcf_source import read_mjcf
from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.kinematics.loops.start import assembled
from mechsim.simulation.mjcf_reader.reading import read_model

# collinear joints, as in hand-written files: the residual acts along the line and rotates nothing
IN_A_LINE = model_text("unassembled_starts_in_a_line.xml")


def _line(folder, rod, more=""):
    path = folder / "line.xml"
    path.write_text(IN_A_LINE.format(rod=rod, more=more))
    return path


def test_an_unassembled_start_closes_at_the_nearest_values_and_reports_them(tmp_path):
    solver = read_mjcf(str(_line(tmp_path, 0.07)))
    # the triangle with the crank on the line, by the law of cosines
    angle = np.arccos((0.04**2 + 0.07**2 - 0.08**2) / (2 * 0.04 * 0.07))
    joints = solver.solve([0.0]).joints
    assert joints["rod"].value[0] == pytest.approx(angle, abs=1e-12)
    note = solver.facts[-1]
    reported = dict(re.findall(r"(crank|rod|rocker) = (-?[\d.]+)", note))
    assert float(reported["rod"]) == pytest.approx(angle, abs=1e-3)
    assert float(reported["rocker"]) == pytest.approx(joints["rocker"].value[0], abs=1e-3)


def test_reported_values_are_those_of_joints_of_the_file_without_rounding(tmp_path):
    # a cam whose follower is written a radian away; its contact has joints of its own
    text = (ms.catalog.models() / "gallery" / "cam_follower.toml").read_text()
    guess = "[guess]\ncam = {}\nfollower = { at = [1, 30, 0], turn = { axis = [0, 0, 1], angle = 60 } }\n"
    (tmp_path / "cam.toml").write_text(text.partition("[formula]")[0] + guess)
    note = ms.load(str(tmp_path / "cam.toml")).facts[-1]
    assert set(re.findall(r"(\S+) = ", note)) == {"cam", "guide", "contact"}


def test_a_description_that_closes_far_from_its_guess_is_rejected_without_a_reader(tmp_path):
    as_written = read_model(str(_line(tmp_path, 0.07))).mechanism
    with pytest.raises(ms.AssemblyError, match=r"nearest assembly found is 1\.\d+ away.* rod = 1\.\d+ rad"):
        assembled(as_written)
    with pytest.raises(ms.AssemblyError, match="start near these values"):
        driver_determinacy(as_written)


@pytest.mark.long
def test_a_driver_moves_if_the_loops_do_not_close_at_its_start(tmp_path):
    # the crank's end reaches the circles of rod and rocker where it is 0.15 - 0.08 m from the pivot
    solver = read_mjcf(str(_line(tmp_path, 0.15)))
    (low, high) = solver.crank_range().arcs[0]
    limit = np.arccos((0.05**2 + 0.09**2 - 0.07**2) / (2 * 0.05 * 0.09))
    assert (low, high) == pytest.approx((limit, 2 * np.pi - limit), abs=1e-9)
    assert "crank = " in solver.facts[-1]


@pytest.mark.long
def test_loops_that_cannot_close_are_rejected_with_a_remedy(tmp_path):
    with pytest.raises(ms.AssemblyError, match=r"a gap of .* remains.* change the dimensions"):
        assembled(read_mjcf(str(_line(tmp_path, 0.25))).mechanism)


def test_an_out_of_plane_pin_is_reported_with_its_offset(tmp_path):
    path = _line(tmp_path, 0.07)
    offset = path.read_text().replace('pos="-.08 0 0"', 'pos="0 .07 .002"')
    path.write_text(offset)
    with pytest.raises(
        ms.AssemblyError, match=r"loop has a gap of .* m that no joint in its loop can close"
    ) as reported:
        assembled(read_mjcf(str(path)).mechanism)
    direction = [
        float(number) for number in re.findall(r"gap of \((.*)\) m", str(reported.value))[0].split(",")
    ]
    np.testing.assert_allclose(np.abs(direction), [0.0, 0.0, 0.002], atol=1e-9)
    path.write_text(offset.replace(".002", "0"))
    loops, q = assembled(read_mjcf(str(path)).mechanism)
    assert np.abs(loops.linearise(q)[0]).max() < 1e-12


# two rods between double arms: immobile with arms of unequal length; with
# a difference of 0.2 % the loop-closure error is at most 1e-7 of the characteristic length
TWO_RODS = model_text("unassembled_starts_two_rods.xml")


def test_loops_that_lock_a_driver_are_reported_by_name(tmp_path):
    path = tmp_path / "rods.xml"
    laws = {"crank": "0.3*sin(2*pi*t)"}
    path.write_text(TWO_RODS.format(active="true"))
    with pytest.raises(MobilityError, match=r"crank cannot move, for upper and lower .* lock"):
        ms.load(path, drive=laws).solve(t=np.linspace(0.0, 1.0, 21))
    path.write_text(TWO_RODS.format(active="false"))
    motion = ms.load(path, drive=laws, lock={"two": None}).solve(t=np.linspace(0.0, 1.0, 21))
    assert np.isfinite(motion.joints["arm"].value).all()
