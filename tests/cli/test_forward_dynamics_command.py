"""`mechsim dynamics` from an initial state, statics, modes and frequency response."""

import json

import numpy as np
import pytest
from model_files import model_text

from mechsim import files


@pytest.fixture
def command(mechsim):
    """Run `mechsim dynamics ANALYSIS four_bar` and return exit code, output and errors."""

    def run(*arguments):
        analysis, *options = ("forward", *arguments) if arguments[0].startswith("-") else arguments
        return mechsim("dynamics", analysis, "four_bar", *options)

    return run


@pytest.fixture
def facts(command):
    def run(*arguments):
        code, out, _ = command(*arguments, "--json")
        return code, json.loads(out)

    return run


def test_a_released_crank_agrees_with_mujoco(facts):
    code, run = facts("--initial", "crank.q=30deg", "--duration", "0.1s", "--samples", "10")
    assert code == 0
    assert run["outcome"] == "done"
    assert run["passed"]
    assert run["energy_error"] < 1e-10
    assert {check["method"] for check in run["checks"]} == {"step"}


def test_a_run_ends_at_an_event_and_writes_its_columns(tmp_path, command):
    table = tmp_path / "run.csv"
    arguments = ["--initial", "crank.v=20", "--until", "crank.q=30deg", "--method", "none", "-o", str(table)]
    code, out, _ = command(*arguments)
    assert code == 0
    assert "done at" in out
    (crank,) = (line.split() for line in out.splitlines() if line.split()[:1] == ["crank"])
    assert crank[3:5] == ["30", "deg"]
    header = table.read_text().splitlines()[0].split(",")
    assert {"t", "B.x", "rocker.q", "rocker.v", "rocker.a"} <= {*header}
    data = np.genfromtxt(table, delimiter=",", names=True)
    assert data["crank"][-1] == pytest.approx(np.deg2rad(30.0), abs=1e-10)


def test_a_spent_work_budget_is_an_outcome(facts):
    code, run = facts(
        "--initial", "crank.q=30deg", "--duration", "9s", "--budget", "1500", "--method", "none"
    )
    assert code == 1
    assert run["outcome"] == "work budget spent"
    assert "1,500 states" in run["reason"]
    assert 0.0 < run["duration"] < 9.0


def test_a_long_run_states_its_work_budget_at_once(command):
    long = ("--initial", "crank.q=30deg", "--duration", "1e9s", "--budget", "1000", "--method", "none")
    code, out, error = command(*long)
    assert code == 1
    assert "ends after 1,000 states at the latest" in error
    assert "work budget spent" in out
    assert "at the latest" not in command("--duration", "0.1s", "--method", "none")[2]


def test_an_unreached_event_is_reported(facts):
    code, run = facts("--until", "crank.q=900deg", "--duration", "0.01s", "--method", "none")
    assert code == 1
    assert run["outcome"] == "time over"
    assert "was not reached" in run["reason"]


@pytest.mark.long
def test_equilibria_are_listed_with_their_stability(facts):
    code, result = facts("statics", "--initial", "crank.q=30deg")
    assert code == 0
    assert [equilibrium["stable"] for equilibrium in result["equilibria"]] == [True, False]
    assert result["passed"]
    assert {check["method"] for check in result["checks"]} == {"pose"}
    assert result["holding"]["crank"] == pytest.approx(0.0035634582077113, rel=1e-9)


@pytest.mark.long
def test_without_loads_every_configuration_is_an_equilibrium(command, facts):
    code, out, _ = command("statics", "--gravity", "0,0,0", "--method", "none")
    assert code == 0
    assert "every configuration is an equilibrium" in out
    (rest,) = facts("statics", "--gravity", "0,0,0", "--method", "none")[1]["equilibria"]
    assert rest["everywhere"]


@pytest.mark.long
def test_tables_of_equilibria_and_modes_are_written(tmp_path, command):
    path = tmp_path / "table.csv"
    assert command("statics", "--method", "none", "-o", str(path))[0] == 0
    rows = np.genfromtxt(path, delimiter=",", names=True)
    # the crank's weight is balanced by that of coupler and rocker at both
    assert rows["crankq"] == pytest.approx([-1.75547, 1.40675], abs=1e-3)
    assert command("modes", "-o", str(path))[0] == 0
    row = np.genfromtxt(path, delimiter=",", names=True)
    assert row["simag"] == pytest.approx(2.0 * np.pi * row["frequency"], rel=1e-9)
    assert (row["crankreal"], row["damping_ratio"]) == (1.0, 0.0)


def test_modes_have_frequency_damping_ratio_and_shape(facts):
    code, result = facts("modes", "--initial", "crank.q=-95deg", "--motor", "crank=-1e-5*crank.v")
    assert code == 0
    (mode,) = result["modes"]
    assert mode["frequency"] == pytest.approx(4.19234, rel=1e-5)
    assert 0.0 < mode["damping_ratio"] < 1.0
    assert mode["shape"].keys() == {"crank", "A", "B"}


def test_a_frequency_response_is_tabulated(facts):
    code, result = facts("response", "crank:B.x", "--initial", "crank.q=-95deg")
    assert code == 0
    assert len(result["response"]["frequency"]) == len(result["response"]["magnitude"]) == 200


def test_distances_angles_and_expressions_are_quantities_of_a_run(tmp_path, facts):
    table = tmp_path / "run.csv"
    names = "distance:A,B,angle:crank,rocker,expr:A.x/B.y,crank.a"
    code, run = facts("--initial", "crank.q=30deg", "--duration", "0.1s", "--of", names, "-o", str(table))
    assert code == 0
    quantities = run["quantities"]
    assert [*quantities] == ["distance:A,B", "angle:crank,rocker", "expr:A.x/B.y", "crank.a"]
    assert quantities["distance:A,B"]["largest"] == pytest.approx(0.091, abs=1e-15)
    assert quantities["crank.a"]["unit"] == "rad/s2"
    columns = files.read(str(table))
    assert columns["expr:A.x/B.y"] == pytest.approx(columns["A.x"] / columns["B.y"])
    assert {"kinetic", "potential", "work", "lost"} <= columns.keys()


def test_an_angle_between_links_ends_a_run(facts):
    arguments = ["--initial", "crank.q=30deg", "--until", "angle:crank,rocker=170deg", "--method", "none"]
    code, run = facts(*arguments, "--of", "angle:crank,rocker")
    assert code == 0
    assert run["outcome"] == "done"
    assert run["quantities"]["angle:crank,rocker"]["final"] == pytest.approx(np.deg2rad(170.0), abs=1e-10)


def test_a_wrapped_angle_does_not_trigger_an_event(facts):
    arguments = ["--initial", "crank.q=30deg", "--duration", "0.3s", "--method", "none"]
    # the angle grows from 62 to 353 degrees and would jump if wrapped to -180 to 180
    code, run = facts(*arguments, "--until", "angle:crank,rocker=10deg")
    assert code == 1
    assert run["outcome"] == "time over"


@pytest.mark.long
def test_velocity_responses_are_displacements_times_frequency(facts):
    result = [
        facts("response", f"crank:{quantity}", "--initial", "crank.q=-95deg")[1]
        for quantity in ("B.x", "B.vx", "B.ax")
    ]
    frequency, displacement, velocity, acceleration = (
        np.array(result[i]["response"][name])
        for i, name in ((0, "frequency"), (0, "magnitude"), (1, "magnitude"), (2, "magnitude"))
    )
    np.testing.assert_allclose(velocity, 2.0 * np.pi * frequency * displacement, rtol=1e-9)
    np.testing.assert_allclose(acceleration, (2.0 * np.pi * frequency) ** 2 * displacement, rtol=1e-9)
    assert result[0]["unit"] == "m/(N m)"


@pytest.mark.long
def test_runs_modes_and_responses_are_plotted(tmp_path, command):
    run = ["--until", "crank.q=-20deg", "--duration", "0.05s", "--method", "none"]
    for i, arguments in enumerate((run, ["modes"], ["response", "crank:B.x"])):
        picture = tmp_path / f"{i}.png"
        code, _, error = command(*arguments, "--initial", "crank.q=-95deg", "-o", str(picture))
        assert (code, error) == (1 if i == 0 else 0, "")
        assert picture.stat().st_size > 10_000


def test_forces_of_a_file_without_model_are_noted(tmp_path, mechsim):
    (tmp_path / "pendulum.xml").write_text(model_text("forward_dynamics_command_pendulum.xml"))
    arguments = f"dynamics forward {tmp_path / 'pendulum.xml'} --initial pivot.q=0 --duration 0.1s".split()
    answer = mechsim(*arguments, "--samples", "5")
    assert answer.code == 0
    error = answer.err
    assert "left out of the dynamics" in error
    assert "actuators glue" in error
    assert "limits of the tendons cord" in error


def test_a_falling_weight_has_no_equilibrium(tmp_path, mechsim):
    (tmp_path / "fall.toml").write_text(model_text("forward_dynamics_command_fall.toml"))
    code, out, _ = mechsim("dynamics", "statics", str(tmp_path / "fall.toml"))
    assert code == 0
    assert "fall: no equilibrium found along the motion; --assemblies N" in " ".join(out.split())


@pytest.mark.long
def test_one_equilibrium_is_counted_in_the_singular(tmp_path, mechsim):
    path = tmp_path / "fall.toml"
    spring = 'forces.joint_springs.slide = { stiffness = 100, rest = "0.1 m" }\n'
    path.write_text(spring + model_text("forward_dynamics_command_fall.toml"))
    out = mechsim("dynamics", "statics", str(path), "--gravity", "0,0,0", "--method", "none").out
    assert out.splitlines()[0] == "fall: 1 equilibrium found along the motion"


def test_a_start_beyond_a_stop_names_the_options_that_choose_another(mechsim, tmp_path):
    path = tmp_path / "loop.xml"
    text = model_text("options_without_effect_loop.xml").replace(
        'name="rocker" axis', 'name="rocker" limited="true" range="0.5 1.2" axis'
    )
    run = ("dynamics", "forward", str(path), "--duration", "0.1s", "--method", "none")
    path.write_text(text)
    options = "--initial rocker.q=VALUE or --start JOINT=VALUE"
    answer = mechsim(*run)
    assert (answer.code, f"start within its range, by {options}" in answer.err) == (2, True), answer.err
    path.write_text(text.replace("</mujoco>", '<keyframe><key name="up" qpos="0 0 0"/></keyframe></mujoco>'))
    assert f"start within its range, by --key up, {options}" in mechsim(*run).err
    assert mechsim(*run, "--initial", "rocker.q=0.6").code == 0
