"""Tables of laws, functions, loads and poses may state units in their headers, as `q [deg]`."""

import numpy as np
from model_files import model_text

import mechsim as ms
from mechsim import files

ANGLES = np.linspace(0.0, 2.0 * np.pi, 37)
IN_SI = {"q": ANGLES, "value": 0.004 * np.sin(0.5 * ANGLES) ** 2}
IN_DEGREES = {"q [deg]": np.rad2deg(ANGLES), "value [mm]": 1e3 * IN_SI["value"]}


def cam(folder, law):
    files.write_table(folder / "law.csv", law)
    path = folder / "cam.toml"
    roller = 'kind = "roller", radius = "6 mm", offset = "3 mm"'
    guide = 'kind = "prismatic"\na = { link = "ground", at = [0.003, 0, 0], axis = [0, 1, 0] }'
    guide += '\nb = { link = "follower", axis = [0, 1, 0] }'
    path.write_text(
        model_text("toml_cams_model.toml", follower=roller, guide=guide, at=[0, 0, 0], law='"law.csv"')
    )
    return ms.load(path)


def test_the_law_of_a_cam_in_degrees_and_millimetres_is_that_in_si(tmp_path):
    for law in (IN_SI, IN_DEGREES):
        centre = cam(tmp_path, law).solve(ANGLES, speed=1.0).joints["guide"].value
        # the roller starts on the base circle of 25 mm; a table is met at its rows
        lift = centre - np.sqrt(0.031**2 - 0.003**2)
        assert np.abs(lift - IN_SI["value"]).max() < 1e-15


def test_a_motion_law_in_milliseconds_and_degrees_passes_through_its_rows(tmp_path):
    time, angle = np.linspace(0.0, 0.3, 13), np.deg2rad(np.linspace(10.0, 70.0, 13))
    files.write_table(tmp_path / "law.csv", {"t [ms]": 1e3 * time, "value [deg]": np.rad2deg(angle)})
    law = str(tmp_path / "law.csv")
    motion = ms.load("four_bar", drive={"crank": law}).solve(t=time)
    assert np.abs(motion.joints["crank"].value - angle).max() < 1e-14
