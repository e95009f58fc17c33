"""Command `mechsim fit`."""

import json

import pytest


@pytest.mark.long
def test_masses_and_friction_are_identified_from_torques(mechsim, tmp_path):
    code, out, err = mechsim("export", "slider_crank", "--format", "toml")
    assert code == 0, err
    text = out + "\n[forces]\ngravity = [0, -9.81, 0]\nfriction.slide = { viscous = 0.9, coulomb = 0.6 }\n"
    (tmp_path / "rubbing.toml").write_text(text)
    code, _, err = mechsim(
        *("dynamics", "inverse", "rubbing.toml", "--speed", "60rpm", "--method", "none", "-o", "log.csv")
    )
    assert code == 0, err
    arguments = ("slider_crank", "--to", "log.csv", "--vary")
    code, out, err = mechsim("fit", *arguments, "slider.mass,slide.viscous,slide.coulomb", "-o", "found.json")
    assert code == 0, err
    assert "predicted from 270" in out
    written = json.loads((tmp_path / "found.json").read_text())
    assert written["values"]["slide.viscous"] == pytest.approx(0.9, rel=1e-6)
    assert written["deviations"]["slide.coulomb"] < 1e-6
    # at constant speed the moment of inertia of the crank has no effect
    code, out, err = mechsim("fit", *arguments, "crank.mass,crank.com.x,slide.viscous,slide.coulomb")
    assert (code, "only together: crank.mass*com.x" in out) == (1, True), err
