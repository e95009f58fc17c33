"""`--lock others` locks undetermined joints and no others."""

import numpy as np
import pytest
from model_files import FOLDER, copied
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mechsim as ms
from mechsim.errors import MobilityError
from mechsim.kinematics.loops.mobility import driver_determinacy

# an arm of two hinges on a floating base, a head on a ball, and a four-bar of which only one hinge is driven
ROBOT = FOLDER / "lock_others_robot.xml"


@pytest.mark.long
def test_undriven_joints_outside_the_driven_loop_are_locked():
    laws, times = {"motor": "0.2*t"}, np.linspace(0.0, 1.0, 3)
    with pytest.raises(MobilityError, match="underdetermined"):
        ms.load(ROBOT, drive=laws).solve(t=times)
    solver = ms.load(ROBOT, drive=laws, lock_others=True)
    assert set(solver.mechanism.locked) == {"shoulder", "elbow"}
    assert driver_determinacy(solver.mechanism).outcome == "determined"
    by_hand = ms.load(ROBOT, drive=laws, lock=("float", "shoulder", "elbow", "neck"))
    path, same = (item.solve(t=times).points["B1"].position for item in (solver, by_hand))
    np.testing.assert_allclose(path, same, atol=1e-12)
    assert np.linalg.norm(path[-1] - path[0]) > 1e-3
    assert ms.simulate(solver, method="pose", samples=5).outcome == "passed"


@pytest.mark.long
def test_in_a_loop_only_the_necessary_joints_are_locked():
    solver = ms.load(ROBOT, drive={"shoulder": "0.2*t"}, lock_others=True)
    assert "elbow" in solver.mechanism.locked
    assert len({"motor", "A", "C"} & set(solver.mechanism.locked)) == 1


def test_a_lock_at_a_value_leaves_the_other_joint_of_an_open_chain_free():
    """The second rod then swings about a fixed pivot; points at rest are compared to rounding."""
    solver = ms.load(FOLDER / "lock_others_two_rods.xml", lock={"j1": "30deg"}, still=True)
    run = ms.dynamics.run(solver, initial={"j2.q": 0.1}, duration=0.2)
    np.testing.assert_allclose(run.motion.joints["j1"].value, np.pi / 6, atol=1e-12)
    # a uniform capsule: mass of cylinder and half spheres, about its end
    length, radius = 0.3, 0.01
    cylinder, balls = np.pi * radius**2 * length, 4.0 / 3.0 * np.pi * radius**3
    axial = cylinder * (length**2 / 12.0 + radius**2 / 4.0)
    axial += balls * (0.4 * radius**2 + length**2 / 4.0 + 0.375 * length * radius)
    inertia, mass = axial + (cylinder + balls) * (length / 2.0) ** 2, cylinder + balls

    def rate(_, state):
        # the angle of the second rod to the horizontal, positive downwards
        return [state[1], mass * 9.81 * length / 2.0 * np.cos(state[0] + np.pi / 6) / inertia]

    exact = solve_ivp(rate, (0.0, 0.2), [0.1, 0.0], rtol=1e-11, atol=1e-12).y[0, -1]
    assert run.motion.joints["j2"].value[-1] == pytest.approx(exact, abs=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("suffix", ["xml", "toml"])
def test_of_a_rod_between_balls_only_the_spin_is_locked(suffix):
    # a point off the axis of the rod is tracked: its spin alone is undetermined
    path = FOLDER / "lock_others_rod.xml"
    if suffix == "toml":
        path = copied(ms.export(path, format="toml").text)
    solver = ms.load(path, drive={"crank": "0.6*sin(2*pi*t)"}, lock_others=True)
    assert solver.facts[-1].endswith(": A (one rotation)")
    motion = solver.solve(t=np.linspace(0.0, 1.0, 21))

    def stretch(rocker, crank):
        ends = np.array([0.1 * np.cos(crank), 0.1 * np.sin(crank), 0.0])
        ends -= [0.4, 0.2 - 0.3 * np.sin(rocker), -0.2 + 0.3 * np.cos(rocker)]
        return np.linalg.norm(ends) - np.sqrt(0.14)

    angles = 0.6 * np.sin(2.0 * np.pi * motion.time)
    exact = [brentq(stretch, -0.8, 0.8, args=(angle,), xtol=1e-15) for angle in angles]
    np.testing.assert_allclose(motion.joints["C"].value, exact, atol=1e-13)
    assert ms.simulate(solver, method="pose", samples=5).outcome == "passed"


@pytest.mark.long
def test_the_range_of_an_rssr_with_a_locked_spin_ends_where_the_rod_is_too_short():
    """A(q) and B(p) are L apart for some p if |A - C|^2 + b^2 - L^2 is at most 2 b times A - C in B's plane.

    Beyond the end, states that a polynomial predicts can be so far away that residuals overflow.
    """
    arcs = ms.load(FOLDER / "lock_others_rssr.toml", lock_others=True).crank_range().arcs
    axis = np.array([1.0, 0.3, 0.2]) / np.linalg.norm([1.0, 0.3, 0.2])

    def discriminant(q):
        arm = np.array([0.03 * np.cos(q) - 0.09, 0.03 * np.sin(q), -0.02])
        in_plane = np.linalg.norm(arm - axis * (arm @ axis))
        return 2.0 * 0.06 * in_plane - abs(arm @ arm + 0.06**2 - 0.1**2)

    ends = [brentq(discriminant, 0.0, 1.0), brentq(discriminant, 1.0, 3.0)]
    np.testing.assert_allclose(arcs, [ends], rtol=0, atol=1e-9)
