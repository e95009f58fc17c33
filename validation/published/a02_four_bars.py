"""A02, a row of N four-bars: at the horizontal pose the mobility jumps from 1 to N + 1.

Problem: IFToMM library of computational multibody benchmarks, A02; Gonzalez et al., Engineering with
Computers 26 (2010). 2 N + 1 uniform rods of 1 m and 1 kg, all cranks upright at the start, tip B0 of the
first at 1 m/s along x, gravity 9.81 m/s2 along -y.

Exact: all cranks stay parallel, so that I a'' = -P g cos a with I = (N + 1) / 3 + N, P = (N + 1) / 2 + N
for the crank angle a; integrated here by DOP853 at 1e-13 (its own uncertainty 1e-12 m).

Near the singular configuration the constraints need a low compliance, not a stiff time constant: integrator
"discrete" with a time constant of a thousandth of a step. Its rates are those of the middle of the step that
ends at an instant, and are compared there.

Run: python validation/published/a02_four_bars.py
"""

import sys
import time
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parent))

from table import Row, show

import mechsim as ms
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.masses import slender_rod
from mechsim.simulation.dynamics.forward_run import stepped_run

GRAVITY = 9.81
SETTINGS = ms.Settings(integrator="discrete", constant_steps=1e-3, compliance=1e-4)
# published position and velocity of B0 for N = 2 at 10 s
N2_AT_10S = ((0.3284581115, 0.9445185382), (1.4230514702, -0.4948688455))


def chain(n: int) -> ms.Mechanism:
    rod, end = slender_rod((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0), (1.0, 0.0, 0.0)
    upright = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    links, joints, guess = [], [], {}
    for i in range(n + 1):
        links.append(ms.Link(f"crank{i}", inertia=rod))
        pivot = ms.End("ground", (float(i), 0.0, 0.0))
        joints.append(ms.Joint(f"A{i}", "revolute", pivot, ms.End(f"crank{i}")))
        guess[f"crank{i}"] = ms.Pose(np.array([float(i), 0.0, 0.0]), upright)
    for i in range(n):
        links.append(ms.Link(f"rod{i}", inertia=rod))
        joints.append(ms.Joint(f"B{i}", "revolute", ms.End(f"crank{i}", end), ms.End(f"rod{i}")))
        joints.append(ms.Joint(f"C{i}", "revolute", ms.End(f"crank{i + 1}", end), ms.End(f"rod{i}", end)))
        guess[f"rod{i}"] = ms.Pose(np.array([float(i), 1.0, 0.0]), np.eye(3))
    points = {"B0": ("crank0", end), "last": (f"crank{n}", end)}
    bodies = tuple(links), tuple(joints)
    return ms.Mechanism(f"{n} four-bars", *bodies, "A0", points, guess=guess, start=np.pi / 2.0)


def exact(n: int, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return crank angle and speed at increasing times, (k,) each."""
    inertia, torque = (n + 1) / 3.0 + n, ((n + 1) / 2.0 + n) * GRAVITY

    def rates(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -torque / inertia * np.cos(y[0])]

    start = [np.pi / 2.0, -1.0]
    return tuple(solve_ivp(rates, (0.0, times[-1]), start, "DOP853", times, rtol=1e-13, atol=1e-13).y)


def tip(angle: np.ndarray) -> np.ndarray:
    """Return the position of B0 at crank angles, (k, 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], 1)


def rows(n: int, duration: float, timestep: float, position: float, velocity: float) -> list[Row]:
    started = time.perf_counter()
    times, weight = np.linspace(0.0, duration, 21), Forces(gravity=(0.0, -GRAVITY, 0.0))
    initial, substeps = {"A0": np.pi / 2.0}, round(duration / 20 / timestep)
    # loops are cut at the joints C
    tree_joints = {f"A{i}" for i in range(n + 1)} | {f"B{i}" for i in range(n)}
    run = stepped_run(chain(n), weight, initial, {"A0": -1.0}, times, substeps, SETTINGS, kept=tree_joints)
    seconds = time.perf_counter() - started
    motion = run.motion
    assert motion.time is not None
    b0, last = motion.points["B0"], motion.points["last"]
    angle, _ = exact(n, motion.time)
    _, speed = exact(n, np.maximum(motion.time - 0.5 * run.timestep, 0.0))
    parallel = last.position - b0.position - np.array([float(n), 0.0, 0.0])
    reason = "second order; library: 1e-1 low, 1e-3 high precision"
    return [
        Row(f"N = {n}: position of B0", _worst(b0.position[:, :2] - tip(angle)), position, "m", reason),
        Row(f"N = {n}: velocity of B0", _worst(motion.speed - speed), velocity, "m/s", "crank of 1 m"),
        Row(f"N = {n}: last crank not parallel", _worst(parallel), position, "m", "correct branch"),
        Row(f"N = {n}: {run.steps} steps, time", seconds, 60.0, "s", "for comparison"),
    ]


def reference_rows() -> list[Row]:
    angle, speed = (values[-1] for values in exact(2, np.array([0.0, 10.0])))
    position = np.array([np.cos(angle), np.sin(angle)])
    velocity = speed * np.array([-np.sin(angle), np.cos(angle)])
    return [
        Row("N = 2 at 10 s: position", _worst(position - N2_AT_10S[0]), 1e-10, "m", "10 digits"),
        Row("N = 2 at 10 s: velocity", _worst(velocity - N2_AT_10S[1]), 1e-10, "m/s", "10 digits"),
    ]


def _worst(difference: np.ndarray) -> float:
    return float(np.abs(difference).max())


if __name__ == "__main__":
    table = reference_rows()
    table += rows(2, 10.0, 2.5e-4, 1e-4, 1e-4)
    table += rows(40, 20.0, 1e-3, 5e-4, 5e-4)
    sys.exit(show("A02 N four-bars, MuJoCo against the exact reduction", table))
