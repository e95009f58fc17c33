"""Command `mechsim fit`."""

import json

import numpy as np
import pytest

from mechsim import catalog, files

ANGLES = np.linspace(0.0, 6.0, 7)


@pytest.fixture
def fit(mechsim):
    return lambda *options: mechsim("fit", *options)


@pytest.fixture
def table(tmp_path):
    motion = catalog.make("four_bar", coupler=0.0913).solve(ANGLES)
    columns = {"angle": ANGLES, "rocker.q": motion.joints["rocker"].value, "rocker.q±": np.full(7, 1e-4)}
    files.write_table(tmp_path / "measured.csv", columns)


@pytest.mark.long
def test_a_fit_is_reported_and_written_with_its_uncertainty(fit, table, tmp_path):
    arguments = ("four_bar", "--to", "measured.csv", "--vary", "coupler")
    code, out, err = fit(*arguments, "--json", "-o", "fit.json")
    assert code == 0, err
    reported = json.loads(out)
    item = {name: reported[name]["coupler"] for name in ("values", "deviations", "units")}
    assert (reported["outcome"], item["units"]) == ("fitted", "m")
    assert item["values"] == pytest.approx(0.0913, rel=1e-9)
    assert 0.0 < item["deviations"] < 1e-4
    assert json.loads((tmp_path / "fit.json").read_text()) == reported
    code, out, err = fit(*arguments, "-o", "rows.csv")
    assert code == 0, err
    assert "coupler" in out
    rows = files.read(tmp_path / "rows.csv")
    assert np.abs(rows["rocker.q.left"]).max() <= 1e-9


@pytest.mark.long
def test_the_crank_speed_comes_from_the_table(fit, tmp_path):
    motion = catalog.make("four_bar", coupler=0.0913).solve(ANGLES, speed=31.0)
    crank, rocker = (motion.joints[name].rate for name in ("crank", "rocker"))
    files.write_table(tmp_path / "rates.csv", {"angle": ANGLES, "crank.v": crank, "rocker.v": rocker})
    arguments = ("four_bar", "--to", "rates.csv", "--vary", "coupler")
    code, out, err = fit(*arguments, "--json")
    assert code == 0, err
    assert json.loads(out)["values"]["coupler"] == pytest.approx(0.0913, rel=1e-9)
    code, out, err = fit(*arguments, "--speed", "600rpm")
    assert (code, "62.83 rad/s, but the crank of the table rotates at 31 rad/s" in err) == (2, True)
    files.write_table(tmp_path / "angles.csv", {"angle": ANGLES, "rocker": motion.joints["rocker"].value})
    code, out, err = fit("four_bar", "--to", "angles.csv", "--vary", "coupler", "--speed", "600rpm")
    assert (code, "--speed has no effect" in err) == (2, True)


@pytest.mark.long
def test_undetermined_dimensions_have_exit_code_1(fit, table):
    code, out, err = fit("four_bar", "--to", "measured.csv", "--vary", "coupler,arm")
    assert code == 1, err
    assert "no measured quantity depends on arm" in out
    assert "unknown" in out


def test_the_zero_of_the_encoder_is_identified_by_its_name(fit, table):
    code, out, err = fit("four_bar", "--to", "measured.csv", "--vary", "coupler,crank.offset", "--json")
    assert code == 0, err
    assert abs(json.loads(out)["values"]["crank.offset"]) < 1e-5
    assert "coupler" in json.loads(out)["values"]


@pytest.mark.long
def test_masses_and_friction_are_identified_from_torques(fit, mechsim, tmp_path):
    code, out, err = mechsim("export", "slider_crank", "--format", "toml")
    assert code == 0, err
    text = out + "\n[forces]\ngravity = [0, -9.81, 0]\nfriction.slide = { viscous = 0.9, coulomb = 0.6 }\n"
    (tmp_path / "rubbing.toml").write_text(text)
    code, _, err = mechsim(
        *("dynamics", "inverse", "rubbing.toml", "--speed", "60rpm", "--method", "none", "-o", "log.csv")
    )
    assert code == 0, err
    arguments = ("slider_crank", "--to", "log.csv", "--vary")
    code, out, err = fit(*arguments, "slider.mass,slide.viscous,slide.coulomb", "-o", "found.json")
    assert code == 0, err
    assert "predicted from 270" in out
    written = json.loads((tmp_path / "found.json").read_text())
    assert written["values"]["slide.viscous"] == pytest.approx(0.9, rel=1e-6)
    assert written["deviations"]["slide.coulomb"] < 1e-6
    # at constant speed the moment of inertia of the crank has no effect
    code, out, err = fit(*arguments, "crank.mass,crank.com.x,slide.viscous,slide.coulomb")
    assert (code, "only together: crank.mass*com.x" in out) == (1, True), err
