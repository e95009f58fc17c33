"""FMUs are valid, give the motion of mechsim's own runs, and reject what they cannot express."""

import ctypes
import subprocess
import zipfile
from dataclasses import replace
from itertools import product
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.codegen.assembly import assembly
from mechsim.codegen.fmu import fmu_archive
from mechsim.codegen.fmu_dynamics import dynamic_fmu
from mechsim.codegen.fmu_kinematics import kinematic_fmu
from mechsim.codegen.solver_code import solver_code
from mechsim.io import reference_data
from mechsim.kinetics.model import dynamic_model
from mechsim.mechanism.motors import TorqueSpeedLine

HEADERS = Path(fmpy.__file__).parent / "c-code"
# agreement of coordinates, points and energies with mechsim's own runs, relative to their largest value
AGREED = 1e-9
RELEASED = {"A.q": "30deg"}
WEIGHT = ms.Forces(gravity=(0.0, -9.81, 0.0))
MOTOR = replace(WEIGHT, motor=TorqueSpeedLine(0.4, 30.0))


def written(folder, model, standard=3):
    path = folder / f"model{standard}.fmu"
    path.write_bytes(fmu_archive(model, standard))
    assert validate_fmu(str(path)) == []
    return str(path)


def largest_error(result, run):
    """Return the largest error of an FMU's results relative to the largest value of each quantity."""
    exact = dict(run.columns())
    names = [name for name in result.dtype.names if name in exact]
    assert {name.rpartition(".")[2] for name in names} >= {"q", "v", "a", "x", "kinetic", "potential"}
    return max(
        np.abs(result[name] - exact[name]).max() / max(np.abs(exact[name]).max(), 1e-3) for name in names
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "forces", "initial", "standard"),
    [
        ("four_bar", WEIGHT, RELEASED, 2),
        ("four_bar", WEIGHT, RELEASED, 3),
        ("slider_crank", MOTOR, {}, 3),
        # ball joints, whose rotations are quaternions
        ("rssr", WEIGHT, {"crank.q": "20deg"}, 2),
    ],
)
def test_co_simulation_is_mechsims_own_run(tmp_path, name, forces, initial, standard):
    model = dynamic_model(ms.load(name), forces)
    path = written(tmp_path, dynamic_fmu(model, initial), standard)
    result = fmpy.simulate_fmu(path, fmi_type="CoSimulation", stop_time=1.0, output_interval=0.02)
    run = ms.dynamics.run(model, initial=initial, duration="1s", samples=50)
    assert largest_error(result, run) < AGREED


@pytest.fixture
def four_bar(tmp_path):
    """The released four-bar as an FMU."""
    return written(tmp_path, dynamic_fmu(dynamic_model(ms.load("four_bar"), WEIGHT), RELEASED))


def instantiated(path, kind):
    description = fmpy.read_model_description(path)
    instance = fmpy.instantiate_fmu(fmpy.extract(path), description, kind)
    instance.enterInitializationMode()
    return instance, {variable.name: variable.valueReference for variable in description.modelVariables}


@pytest.mark.long
def test_model_exchange_is_mechsims_own_run(four_bar):
    instance, references = instantiated(four_bar, "ModelExchange")
    instance.exitInitializationMode()
    instance.enterContinuousTimeMode()
    states, derivatives = (ctypes.c_double * 6)(), (ctypes.c_double * 6)()
    instance.getContinuousStates(states, 6)

    def right_hand_side(time, values):
        instance.setTime(time)
        instance.setContinuousStates((ctypes.c_double * 6)(*values), 6)
        instance.getContinuousStateDerivatives(derivatives, 6)
        return [*derivatives]

    solution = solve_ivp(right_hand_side, (0.0, 1.0), [*states], "DOP853", rtol=1e-12, atol=1e-12)
    run = ms.dynamics.run("four_bar", WEIGHT, initial=RELEASED, duration="1s")
    right_hand_side(1.0, solution.y[:, -1])
    (x,) = instance.getFloat64([references["C.x"]])
    assert abs(x - run.motion.points["C"].position[-1, 0]) < 1e-11
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.setTime(np.nan)
    for name, value in zip(("crank", "A", "B"), solution.y[:3, -1], strict=True):
        assert abs(value - run.motion.joints[name].value[-1]) < AGREED
    instance.terminate()
    instance.freeInstance()


@pytest.mark.long
def test_inputs_and_parameters_act_as_in_mechsim(tmp_path):
    spring, viscous = ms.JointSpring("rocker", 0.7, 0.2), ms.Friction("crank", viscous=0.01)
    model = dynamic_model(ms.load("four_bar"), replace(WEIGHT, joint_springs=(spring,), friction=(viscous,)))
    path = written(tmp_path, dynamic_fmu(model, RELEASED))
    changed = {"crank.effort": 0.05, "gravity.y": -3.0, "rocker.stiffness": 1.1, "crank.viscous": 0.02}
    result = fmpy.simulate_fmu(
        path, fmi_type="CoSimulation", start_values=changed, stop_time=1.0, output_interval=0.05
    )
    other = ms.Forces(
        gravity=(0.0, -3.0, 0.0),
        joint_springs=(ms.JointSpring("rocker", 1.1, 0.2),),
        friction=(ms.Friction("crank", viscous=0.02),),
        controllers=(ms.Controller("crank", "0.05"),),
    )
    run = ms.dynamics.run(model.with_forces(other), initial=RELEASED, duration="1s", samples=20)
    assert largest_error(result, run) < AGREED


@pytest.mark.long
def test_positions_and_torque_are_those_of_30_digits(tmp_path):
    table = reference_data.read(reference_data.folder(), "rssr")
    path = written(tmp_path, kinematic_fmu(solver_code(assembly(ms.load(table.mechanism)))))
    instance, references = instantiated(path, "CoSimulation")
    names = [f"P3.{letter}{axis}" for letter in ("", "v", "a") for axis in "xyz"]
    point, numbers = table.points["P3"], list[list[float]]()
    for angle in table.first:
        inputs = [references["crank.q"], references["crank.v"]]
        instance.setFloat64(inputs, [angle, table.speed])
        numbers.append(instance.getFloat64([references[name] for name in (*names, "crank.effort")]))
    instance.freeInstance()
    exact = [point.position, point.velocity, point.acceleration, table.drive_forces["crank"][:, None]]
    for result, values in zip(np.split(np.array(numbers), [3, 6, 9], axis=1), exact, strict=True):
        assert np.abs(result - values).max() < 1e-12 * np.abs(values).max()


@pytest.mark.long
@pytest.mark.parametrize("standard", [2, 3])
def test_positions_follow_signals(tmp_path, standard):
    source = ms.load("rssr")
    path = written(tmp_path, kinematic_fmu(solver_code(assembly(source))), standard)
    time = np.linspace(0.0, 1.0, 41)
    kinds = [("time", float), ("crank.q", float), ("crank.v", float), ("crank.a", float)]
    signals = np.array([(t, 2.0 * t + 0.5 * t**2, 2.0 + t, 1.0) for t in time], kinds)
    result = fmpy.simulate_fmu(
        path,
        fmi_type="ModelExchange",
        input=signals,
        stop_time=1.0,
        output_interval=0.025,
        record_events=False,
    )
    for row in result[::8]:
        t = row["time"]
        rocker = source.solve([2.0 * t + 0.5 * t**2], 2.0 + t, 1.0).joints["rocker"]
        assert abs(row["rocker.q"] - rocker.value[0]) < AGREED
        assert abs(row["rocker.v"] - rocker.rate[0]) < AGREED
        assert abs(row["rocker.a"] - rocker.acceleration[0]) < 10.0 * AGREED


@pytest.mark.long
def test_a_kept_state_continues_as_before(four_bar):
    instance, references = instantiated(four_bar, "CoSimulation")
    early = instance.getFMUState()
    instance.exitInitializationMode()
    instance.doStep(0.0, 0.1)
    kept = instance.getFMUState()
    read = instance.deserializeFMUState(instance.serializeFMUState(kept))
    instance.doStep(0.1, 0.1)
    after = instance.getFloat64([references["A.q"]])
    for state in (kept, read):
        instance.setFMUState(state)
        instance.doStep(0.1, 0.1)
        assert instance.getFloat64([references["A.q"]]) == after
        instance.freeFMUState(state)
    # a state kept before the end of the initialization takes parameters again
    instance.setFMUState(early)
    instance.setFloat64([references["gravity.y"]], [-1.0])
    instance.reset()
    instance.enterInitializationMode()
    assert instance.getFloat64([references["A.q"]])[0] == pytest.approx(np.radians(30.0), abs=1e-15)
    instance.freeInstance()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"A.q": 0.1}, "do not close the loops"),
        ({"A.v": 1.0}, "contradict the loops"),
        ({"kinetic": 1.0}, "no input, parameter or start value"),
        ({"crank.effort": np.nan}, "not finite"),
    ],
)
def test_invalid_values_are_reported(four_bar, capfd, values, message):
    instance, references = instantiated(four_bar, "CoSimulation")

    def started():
        instance.setFloat64([references[name] for name in values], [*values.values()])
        instance.exitInitializationMode()

    with pytest.raises(fmpy.fmi1.FMICallException):
        started()
    assert message in capfd.readouterr().out
    instance.freeInstance()


def test_equal_models_give_equal_files():
    first, second = (
        fmu_archive(dynamic_fmu(dynamic_model(ms.load("four_bar"), WEIGHT), RELEASED), 3) for _ in range(2)
    )
    assert first == second


@pytest.mark.long
@pytest.mark.parametrize("standard", [2, 3])
def test_sources_compile_without_warnings_and_with_the_standards_headers(tmp_path, standard):
    models = (
        dynamic_fmu(dynamic_model(ms.load("rssr"), MOTOR), {}),
        kinematic_fmu(solver_code(assembly(ms.load("rssr")))),
    )
    own, of_the_standard = (), (f'-DFMI_HEADER="fmi{standard}Functions.h"', f"-I{HEADERS}")
    for model in models:
        with zipfile.ZipFile(written(tmp_path, model, standard)) as archive:
            source = archive.extract("sources/fmu.c", tmp_path)
        for compiler, header in product(("gcc", "clang"), (own, of_the_standard)):
            flags = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", *header)
            result = subprocess.run([compiler, *flags, source], capture_output=True, text=True, check=False)
            assert result.returncode == 0, result.stderr
