"""`mechsim dynamics inverse` and `forward --turns`: JSON, files, exit codes, one line for invalid input."""

import json

import numpy as np
import pytest
from model_files import model_text

from mechsim import files


@pytest.mark.long
def test_a_prescribed_crank_is_reported_as_json_and_table(mechsim, tmp_path):
    csv, plot = tmp_path / "out.csv", tmp_path / "out.svg"
    arguments = ("--speed", "3000rpm", "--samples", "36", "--json", "-o", str(csv), "-o", str(plot))
    code, out, _ = mechsim("dynamics", "inverse", "four_bar", *arguments)
    reported = json.loads(out)
    assert code == 0
    assert reported["outcome"] == "passed"
    assert reported["reactions"]["A"]["not_determined"] == ["fz", "mx", "my"]
    assert 0.0 < reported["fluctuation"]["coefficient"] < 2.0
    table = files.read(csv)
    assert np.abs(table["torque"]).max() == pytest.approx(abs(reported["torque"]["largest"]), rel=1e-15)
    assert {"crank.fx", "rocker.mz", "frame.fx", "kinetic", "power_lost"} <= set(table)
    assert plot.read_bytes().startswith(b"<?xml")


def test_a_turn_without_mean_torque_and_flywheel_has_no_speed_fluctuation_in_its_text(mechsim):
    _, out, _ = mechsim("dynamics", "inverse", "four_bar", "--samples", "12", "--method", "none")
    assert "speed fluctuation" not in out


def test_couplings_are_reported_with_their_transmission(mechsim, monkeypatch, tmp_path):
    csv = tmp_path / "out.csv"
    arguments = ("--samples", "8", "--json", "-o", str(csv))
    code, out, _ = mechsim("dynamics", "inverse", "planetary_gear", *arguments)
    reported = json.loads(out)["couplings"]["carrier-planet"]
    assert code == 0
    # the ring is fixed to the frame
    assert (reported["by"], reported["links"], reported["unit"]) == ("teeth", ["planet", "ground"], "N m")
    table = files.read(csv)
    force = np.hypot(table["mesh carrier-planet.fx"], table["mesh carrier-planet.fy"])
    assert force.max() == pytest.approx(reported["force"]["largest"], rel=1e-12)
    # torque divided by the radius of the planet
    assert force == pytest.approx(np.abs(table["gear carrier-planet"]) / 0.018, rel=1e-9)
    arguments = ("--samples", "8", "--method", "none")
    monkeypatch.setenv("COLUMNS", "160")
    _, out, _ = mechsim("dynamics", "inverse", "parallel_gripper", *arguments)
    assert "ideal transmission: acts in reverse on ground" in " ".join(out.split())
    assert "teeth of right-left on driver_l" in out


def test_gravity_and_a_load_table_change_the_torque(mechsim, tmp_path):
    load = tmp_path / "load.csv"
    revolution = repr(2.0 * np.pi)
    load.write_text(f"angle,P3.fx,P3.fz,crank\n0,0,1,0\n2,3,0,0.01\n{revolution},0,1,0\n")
    words = ("dynamics", "inverse", "rssr", "--method", "none", "--json", "--samples", "12")
    without_loads, loaded = mechsim(*words), mechsim(*words, "--load", str(load), "--gravity", "0,0,-9.81")
    assert (without_loads[0], loaded[0]) == (0, 0)
    item, other = json.loads(without_loads[1]), json.loads(loaded[1])
    assert item["outcome"] is None
    assert other["torque"]["largest"] != item["torque"]["largest"]
    assert other["power_balance"] <= 1e-12


@pytest.mark.long
def test_a_motor_too_weak_to_start_is_reported(mechsim, tmp_path):
    plot = tmp_path / "free.png"
    motor = ("--motor", "line:0.05,3000rpm", "--turns", "1", "--samples", "30", "--method", "none")
    code, out, _ = mechsim("dynamics", "forward", "rssr", *motor, "--json", "-o", str(plot))
    reported = json.loads(out)["free"]
    assert code == 0
    assert reported["outcome"] == "done"
    assert reported["turns"] == pytest.approx(1.0)
    assert reported["energy_error"] <= 1e-9
    assert plot.read_bytes().startswith(b"\x89PNG")
    weak = ("four_bar", "--motor", "constant:1e-5", "--turns", "1")
    code, out, _ = mechsim("dynamics", "forward", *weak)
    assert code == 1
    assert out.startswith("four_bar: cannot start at ")


@pytest.mark.long
def test_a_crank_that_cannot_turn_fully_swings(mechsim):
    arguments = ("--set", "crank=0.2", "--set", "rocker=0.19", "--set", "coupler=0.05", "--samples", "24")
    code, out, _ = mechsim("dynamics", "inverse", "four_bar", *arguments, "--json")
    reported = json.loads(out)
    assert reported["fluctuation"] is None
    assert (code, reported["outcome"]) == (0, "passed")


@pytest.mark.parametrize(
    ("text", "output"),
    [
        ("angle,P3.fz\n0,1\n3,2\n6,1\n", "does not span one revolution"),
        ("angle,P3.fz\n0,1\n3,2\n2,1\n", "does not increase"),
        ("P3.fz\n0\n1\n", "has no column angle [rad] or t [s]"),
        ("angle,P9.fz\n0,1\n6.283185307179586,1\n", "no point 'P9'"),
        ("angle,force\n0,1\n6.283185307179586,1\n", "has columns force"),
        ("angle\n0\n6.283185307179586\n", "holds no load"),
    ],
)
def test_an_invalid_load_table_is_rejected(mechsim, tmp_path, text, output):
    load = tmp_path / "load.csv"
    load.write_text(text)
    code, _, err = mechsim("dynamics", "inverse", "rssr", "--load", str(load))
    assert code == 2
    assert output in err


@pytest.mark.long
def test_couples_and_gears_change_the_torque(mechsim, tmp_path):
    load = tmp_path / "load.csv"
    revolution = repr(2.0 * np.pi)
    load.write_text(f"angle,rocker.mx,rocker.mz\n0,0.01,0\n3,0,0.02\n{revolution},0.01,0\n")
    arguments = ("rssr", "--json", "--samples", "6", "--method", "pose")
    output = [
        json.loads(mechsim("dynamics", "inverse", *arguments, *options)[1])
        for options in ((), ("--load", str(load)))
    ]
    assert all(item["outcome"] == "passed" for item in output)
    torques = [item["torque"]["rms"] for item in output]
    assert abs(torques[1] / torques[0] - 1.0) > 1e-6
    geared = ("--motor", "line:0.005,30000rpm,10")
    without_loads = ("--motor", "line:0.05,3000rpm")
    free = ("rssr", "--json", "--samples", "6", "--method", "none", "--turns", "0.1")
    ends = [
        json.loads(mechsim("dynamics", "forward", *free, *options)[1])["free"]
        for options in (geared, without_loads)
    ]
    assert ends[0]["seconds"] == pytest.approx(ends[1]["seconds"], rel=1e-9)


FIVE_BAR = model_text("dynamics_five_bar.toml")
MOVED = ("--drive", "left=2+0.3*sin(6*t)", "--drive", "right=1+0.4*sin(9*t)", "--samples", "20")


@pytest.mark.long
def test_each_of_several_drivers_has_its_torque(mechsim, tmp_path):
    file = tmp_path / "five_bar.toml"
    file.write_text(FIVE_BAR)
    table = tmp_path / "out.csv"
    arguments = (str(file), *MOVED, "--json", "-o", str(table), "-o", str(tmp_path / "out.svg"))
    code, out, _ = mechsim("dynamics", "inverse", *arguments)
    reported = json.loads(out)
    assert code == 0
    assert reported["outcome"] == "passed"
    assert reported["drives"].keys() == {"left", "right"}
    assert {item["unit"] for item in reported["drives"].values()} == {"N m"}
    assert 0.0 <= reported["drives"]["left"]["at_time"] <= 1.0
    # gravity of the file is normal to the plane and has no effect
    rows = np.genfromtxt(table, delimiter=",", names=True)
    assert np.ptp(rows["potential"]) == pytest.approx(0.0, abs=1e-12)
    # gravity of the command line replaces it, also if it is the default of mechanisms without loads
    code, _, _ = mechsim("dynamics", "inverse", *arguments, "--gravity", "0,-9.81,0", "--method", "none")
    assert code == 0
    assert np.ptp(np.genfromtxt(table, delimiter=",", names=True)["potential"]) > 1e-3


def test_a_motor_of_a_file_is_replaced_by_the_prescribed_motion(mechsim, tmp_path):
    (tmp_path / "wheel.toml").write_text(model_text("dynamics_wheel.toml"))
    answer = mechsim("dynamics", "inverse", "wheel.toml", "--method", "none", "--json")
    assert answer.code == 0
    # a balanced wheel at a constant speed needs no torque
    assert abs(json.loads(answer.out)["torque"]["largest"]) < 1e-12
    assert "replaces the motor" in answer.err
    answer = mechsim("dynamics", "forward", "wheel.toml", "--duration", "3s", "--method", "none", "--json")
    # 2 N m accelerate 0.5 kg m2 for 3 s
    assert json.loads(answer.out)["final"]["axle.v"] == pytest.approx(12.0, rel=1e-9)
