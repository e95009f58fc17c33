"""Compiled solvers agree with reference data of 30 digits and reject inputs outside their range."""

import numpy as np
import pytest
from grids import grid
from motions import largest_difference

import mechsim as ms
from mechsim.errors import AssemblyError, InputError, MissingToolError, OutputError
from mechsim.io import reference_data
from mechsim.kinematics.solvers import KinematicSolver

# a spinning coupler, dyads, redundant equations, gears and a limited range
QUICK = ("rssr", "jansen", "bennett", "parallel_gripper")
ALL = reference_data.names(reference_data.folder())
# relative to the largest value; measured 7e-13 or less (`validation/speed/compiled_solver.py`)
ALLOWED = 1e-12


def errors(solver, name):
    """Return the largest errors of points and drive torques relative to their largest values."""
    table = reference_data.read(reference_data.folder(), name)
    motion = solver.solve(table.first, table.speed) if table.speed else solver.solve(t=table.first)
    points = [(motion.points[point], exact) for point, exact in table.points.items()]
    pairs = {
        name: [(getattr(mine, name), getattr(exact, name)) for mine, exact in points]
        for name in ("position", "velocity", "acceleration")
    }
    driven = (
        np.stack([getattr(motion.joints[driver], name) for driver in solver.drivers], 1)
        for name in ("value", "rate", "acceleration")
    )
    torques = dict(zip(solver.drivers, solver.solve_drivers(*driven).torques.T, strict=True))
    pairs["torque"] = [(torques[driver], exact) for driver, exact in table.drive_forces.items()]
    return {
        name: max(np.abs(mine - exact).max() for mine, exact in both)
        / max(np.abs(exact).max() for _, exact in both)
        for name, both in pairs.items()
    }


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in ALL]
)
def test_compiled_code_agrees_with_reference_data(compiled, name):
    reported = errors(compiled(name), name)
    assert max(reported.values()) <= ALLOWED, reported


@pytest.mark.long
def test_wrong_dimensions_disagree_with_reference_data(compiled):
    table = reference_data.read(reference_data.folder(), "rssr")
    wrong = ms.compile(table.mechanism, set={"coupler": "46.000001mm"})
    assert errors(wrong, "rssr")["position"] > 1e-9


@pytest.mark.long
@pytest.mark.parametrize("name", ["rssr", "jansen", "parallel_gripper", "slider_crank"])
def test_the_record_agrees_with_the_loop_equations(compiled, name):
    solver = compiled(name)
    source = solver.code.assembly.source
    angles = np.linspace(*((0.0, 6.0) if source.period > 6.0 else (0.0, source.period)), 25)
    model = KinematicSolver(source.mechanism, motion_laws=source.motion_laws)
    if source.motion_laws.crank:
        mine, exact = solver.solve(angles, 2.0, 3.0), model.solve(angles, 2.0, 3.0)
    else:
        mine, exact = solver.solve(t=[0.0, 0.2]), model.solve(t=[0.0, 0.2])
    assert mine.joints.keys() == exact.joints.keys()
    assert mine.spinning == exact.spinning
    for quantity in ("value", "rate", "acceleration"):
        assert largest_difference(mine, exact, quantity, kind="joints") < 1e-10
    for link, motion in exact.links.items():
        if link not in exact.spinning:
            assert np.abs(mine.links[link].rotation - motion.rotation).max() < 1e-12
            difference = mine.links[link].angular_acceleration - motion.angular_acceleration
            assert np.abs(difference).max() < 1e-10


@pytest.mark.long
@pytest.mark.parametrize("name", grid(("humanoid_ankle", "stewart_gough"), ("humanoid_ankle",)))
def test_the_map_is_the_derivative_of_configurations(compiled, name):
    solver = compiled(name)
    start = solver.code.assembly.start.values[solver.code.assembly.driven, 0]
    step = 1e-5
    first = step * np.eye(len(start))[0]
    around = [start, start + first, start - first]
    solved = solver.solve_drivers(around)
    gradient = (solved.motion[1, 0] - solved.motion[2, 0]) / (2.0 * step)
    balls = solver.code.assembly.loops.tree.ball_indices
    numbers = np.delete(np.arange(len(gradient)), balls)
    assert np.abs(gradient - solved.map[0, :, 0])[numbers].max() < 1e-6


@pytest.mark.parametrize(
    "name", ["four_bar", "rssr", "jansen", pytest.param("stephenson_six_bar", marks=pytest.mark.slow)]
)
def test_random_order_and_long_steps_keep_the_assembly_mode(compiled, name):
    solver, rng = compiled(name), np.random.default_rng(5)
    angles = rng.uniform(-np.pi, np.pi, 60)
    exact = KinematicSolver(solver.code.assembly.source.mechanism).solve(np.sort(angles))
    assert largest_difference(solver.solve(angles), exact, rows=np.argsort(angles)) < 1e-11


@pytest.mark.long
def test_angles_outside_the_range_are_rejected(compiled):
    solver = compiled("bricard")
    low, high = solver.code.assembly.interval
    with pytest.raises(AssemblyError, match=r"does not solve crank = 3\.7.*outside -0\.52"):
        solver.solve([1.0, high + 0.1])
    with pytest.raises(AssemblyError, match="outside"):
        solver.solve([low - 1e-6])
    solver.solve([high - 1e-3])
    for bad in (np.nan, np.inf, 1e9):
        with pytest.raises(AssemblyError):
            solver.solve_drivers([[bad]])
        with pytest.raises(AssemblyError, match="not reached"):
            compiled("rssr").solve_drivers([[bad]])


@pytest.mark.long
def test_a_fast_spin_within_a_step_is_resolved(compiled):
    # both cranks end nearly in one point, about which the other links turn
    ends = np.array([[2.452152, 0.477330], [1.564885, 1.936591]])
    solver = compiled("five_bar")
    long, short = (solver.solve_drivers(path).motion[-1, 0] for path in (ends, np.linspace(*ends, 300)))
    assert np.abs(long - short).max() < 1e-9


def test_a_missing_compiler_is_reported(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(MissingToolError, match="CC=no-such-compiler is not found; install gcc or clang"):
        ms.compile("rssr")
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingToolError, match="there is no C compiler"):
        ms.compile("rssr")


def test_an_unwritable_cache_is_reported(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(OutputError, match=r"cannot keep compiled code in .*set XDG_CACHE_HOME"):
        ms.compile("four_bar")


def test_a_failing_compiler_is_reported_by_name(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", "false")
    with pytest.raises(MissingToolError, match=r"the C compiler .*false fails: no message; set CC"):
        ms.compile("four_bar")


@pytest.mark.long
def test_invalid_input_is_rejected(compiled):
    with pytest.raises(InputError, match="columns; give 6: l1"):
        compiled("stewart_gough").solve_drivers([[0.0, 1.0]])
    with pytest.raises(InputError, match="are not finite"):
        compiled("rssr").solve([0.1], np.nan)
    with pytest.raises(InputError, match=r"of memory, and .* are available"):
        compiled("rssr").solve(np.broadcast_to(0.0, 10**12))
    with pytest.raises(InputError, match="no instants"):
        compiled("rssr").solve()
