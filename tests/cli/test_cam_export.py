"""Profiles of cams as files."""

import csv
import json

import numpy as np
from model_files import model_text

CAM = model_text("cam_export_cam.toml")


def test_a_profile_is_written_as_table_and_drawings(mechsim, tmp_path):
    (tmp_path / "cam.toml").write_text(CAM)
    for output in ("cam.csv", "cam.dxf", "cam.svg"):
        answer = mechsim("export", "cam.toml", "--cam", "contact", "-o", output, "--json")
        assert answer.code == 0, answer.err
        assert json.loads(answer.out)["output"] == output
    row = list(csv.DictReader((tmp_path / "cam.csv").read_text().splitlines()))[480]
    q = 2 * np.pi / 3
    s, rate = 0.005 * (1 - np.cos(q)), 0.005 * np.sin(q)
    x, y = rate * np.cos(q) + (0.025 + s) * np.sin(q), (0.025 + s) * np.cos(q) - rate * np.sin(q)
    assert abs(float(row["x"]) - x) < 1e-16
    assert abs(float(row["curvature_radius"]) - (0.025 + s + 0.005 * np.cos(q))) < 1e-16
    lines = (tmp_path / "cam.dxf").read_text().split("\n")
    vertices = [
        (float(lines[i + 4]), float(lines[i + 6])) for i, line in enumerate(lines) if line == "VERTEX"
    ]
    assert len(vertices) == 1440
    assert np.abs(np.array(vertices[480]) - [1e3 * x, 1e3 * y]).max() < 1e-9
    assert (tmp_path / "cam.svg").read_text().split(" Z")[0].count(" L") == 1439
    assert mechsim("export", "cam.toml", "--cam", "contact").out.startswith("q,lift,x,y,")
    for wrong in (
        ["--cam", "guide"],
        ["--cam", "contact", "-o", "cam.png"],
        ["--cam", "contact", "--scene", "pose"],
    ):
        assert mechsim("export", "cam.toml", *wrong).code == 2
