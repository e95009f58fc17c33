"""Springs with a law of length and rate in TOML files, against integrations by scipy and closed forms."""

import numpy as np
import pytest
from model_files import changed_model, copied, load_model
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import mechsim as ms
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.model import dynamic_model
from mechsim.simulation.dynamics.prescribed_motion import driven as simulate_driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_equilibrium, crosscheck_forward

G = 9.81
# a mass above the ground on a strut, the spring


def strut(spring, units=""):
    return load_model("toml_springs_strut.toml", spring=spring, units=units, still=True)


def height_of(tension, end):
    """Return the strut's height and rate at the end, by scipy."""

    def falls(_, y):
        return [y[1], -G - tension(*y) / 2.0]

    return solve_ivp(falls, (0.0, end), [0.4, -1.0], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def test_lengths_in_an_expression_are_in_the_unit_of_the_file():
    si = strut('force = "-100 N*(0.4/l)**1.3 + 20*v"')
    mm = strut('force = "-100 N*(gap/l)**1.3 + 0.02*v"', 'units.length = "mm"\nparameters.gap = 400')
    heights = [ms.dynamics.run(x, duration="0.5s").motion.joints["height"].value[-1] for x in (si, mm)]
    assert abs(heights[0] - heights[1]) < 1e-12


@pytest.mark.long
def test_a_table_over_the_length_and_one_over_the_rate(tmp_path):
    lengths, rates = np.linspace(0.1, 0.8, 15), np.linspace(-6.0, 6.0, 25)
    forces, damping = 400.0 * (lengths - 0.4) - 9e3 * (0.4 - lengths) ** 3, 8.0 * np.tanh(2.0 * rates) + rates
    np.savetxt(tmp_path / "gas.csv", np.c_[lengths, forces], delimiter=",", header="l,force", comments="")
    np.savetxt(tmp_path / "oil.csv", np.c_[rates, damping], delimiter=",", header="v,force", comments="")
    oil = f'[forces.springs.oil]\njoint = "height"\nforce = "{tmp_path / "oil.csv"}"'
    solver = strut(f'force = "{tmp_path / "gas.csv"}"\npreload = "-5 N"\n{oil}')
    run = ms.dynamics.run(solver, duration="1s", samples=50)
    gas, oil_force = (CubicSpline(x, y, bc_type="natural") for x, y in ((lengths, forces), (rates, damping)))
    exact = height_of(lambda x, v: gas(x) + oil_force(v) - 5.0, 1.0)
    assert abs(run.motion.joints["height"].value[-1] - exact[0]) < 1e-8
    assert run.energy_error < 1e-10
    assert run.lost[-1] > 0.5
    again = ms.load(copied(to_toml(solver)), still=True)
    assert again.forces.nonlinear_springs == solver.forces.nonlinear_springs


def test_a_motion_beyond_its_table_ends(tmp_path):
    lengths = np.linspace(0.35, 0.6, 6)
    np.savetxt(
        tmp_path / "f.csv", np.c_[lengths, 0.0 * lengths], delimiter=",", header="l,force", comments=""
    )
    solver = strut(spring := f'force = "{tmp_path / "f.csv"}"')
    run = ms.dynamics.run(solver, duration="1s")
    # free fall from 0.4 m at 1 m/s
    end = (np.sqrt(1.0 + 2.0 * G * 0.05) - 1.0) / G
    assert run.outcome == "failed"
    assert "l leaves its range from 0.35 to 0.6 in table" in run.reason
    assert abs(run.time[-1] - end) < 1e-9
    assert np.isfinite(run.potential).all()
    path = changed_model("toml_springs_strut.toml", spring=spring, units="")
    moved = ms.load(path, drive={"height": "0.1*t + 0.55"}, duration="1s")
    with pytest.raises(ms.InputError, match=r"l leaves its range from 0\.35 to 0\.6"):
        ms.dynamics.prescribed(dynamic_model(moved), t=[0.0, 1.0])


def arm_rates(t, y):
    """Return the derivatives of the double pendulum's state, by Lagrange's equations."""
    q, v = y[:2], y[2:]
    a, b = q[0], q[0] + q[1]
    m1, m2, l1, c1, c2, i1, i2 = 1.0, 0.6, 0.5, 0.25, 0.2, 0.02, 0.008
    coupling = m2 * l1 * c2 * np.cos(q[1])
    m11 = i1 + m1 * c1**2 + i2 + m2 * (l1**2 + c2**2) + 2.0 * coupling
    m12, m22 = i2 + m2 * c2**2 + coupling, i2 + m2 * c2**2
    h = m2 * l1 * c2 * np.sin(q[1])
    force = np.array(
        [
            h * (2.0 * v[0] * v[1] + v[1] ** 2) - G * ((m1 * c1 + m2 * l1) * np.cos(a) + m2 * c2 * np.cos(b)),
            -h * v[0] ** 2 - G * m2 * c2 * np.cos(b),
        ]
    )
    force[1] -= 3.0 * (q[1] - np.radians(20.0)) + 0.2 * v[1] + 0.5 + 0.4 * np.sin(2.0 * q[1])
    tip = np.array([0.5 * np.cos(a) + 0.4 * np.cos(b), 0.5 * np.sin(a) + 0.4 * np.sin(b)])
    jacobian = np.array([[-tip[1], -0.4 * np.sin(b)], [tip[0], 0.4 * np.cos(b)]])
    line = tip - [0.3, 0.4]
    length = np.linalg.norm(line)
    tension = 30.0 * max(length / 0.6 - 1.0, 0.0) ** 2 + 0.5 * (line @ jacobian @ v) / length
    force -= tension * (jacobian.T @ line) / length
    return [*v, *np.linalg.solve([[m11, m12], [m12, m22]], force)]


@pytest.mark.long
def test_a_double_pendulum_with_two_springs():
    """The run against scipy, then against MuJoCo; its equilibrium has no generalised force.

    A torsion spring is in its elbow, and a spring leads from its tip to the ground.
    """
    solver = load_model("toml_springs_arm.toml", still=True)
    run = ms.dynamics.run(solver, duration="0.5s", samples=20)
    start = [np.radians(-60.0), 0.0, 0.0, 2.0]
    exact = solve_ivp(arm_rates, (0.0, 0.5), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    reached = [run.motion.joints[name].value[-1] for name in ("hip", "elbow")]
    assert np.abs(np.array(reached) - exact[:2]).max() < 1e-8
    assert run.energy_error < 1e-10
    model = dynamic_model(solver)
    assert crosscheck_forward(run, model, initial_values(model, {})).passed
    rest = next(each for each in ms.dynamics.equilibria(solver) if each.stable)
    at_rest = arm_rates(0.0, np.array([rest.q["hip"], rest.q["elbow"], 0.0, 0.0]))
    assert np.abs(at_rest).max() < 1e-8
    assert crosscheck_equilibrium(rest, model).passed


def test_inverse_dynamics_of_a_loop_with_springs():
    """Both methods agree with springs between two links, in a joint of the tree and in one that is cut."""
    joints = "".join(
        f'[forces.springs.{name}]\njoint = "{name}"\nstiffness = {k}\nforce = "0.3*v*abs(v)"\n'
        for name, k in (("A", 2.0), ("B", 3.0), ("C", 4.0))
    )
    solver = load_model("toml_springs_four_bar.toml", more=joints, still=True)
    model = dynamic_model(solver)
    run = simulate_driven(solver, speed=8.0, samples=24)
    assert crosscheck_driven(run, model).passed
    # without the springs it is another mechanism
    assert not crosscheck_driven(run, model.with_forces(ms.Forces())).passed
