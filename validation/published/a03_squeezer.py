"""A03, Andrews' squeezing mechanism: seven bodies, one degree of freedom, six loop equations, a stiff spring.

Problem and reference at 0.03 s: IVP test set (CWI Amsterdam / Bari), problem Andrews; Hairer & Wanner,
Solving Ordinary Differential Equations II, section VII.7. The initial angles follow from
beta and Theta by closing the loops.

Two methods: MuJoCo stepped by RK4, and the reduced equation by DOP853. The error is stated as scd, the
correct digits of the worst of the seven angles.

Run: python validation/published/a03_squeezer.py
"""

import csv
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from table import Row, energy_error, show

import mechsim as ms
from mechsim import dynamics
from mechsim.mechanism.forces import Forces, Spring
from mechsim.mechanism.links import Inertia
from mechsim.mechanism.motors import ConstantTorque
from mechsim.simulation.dynamics.forward_run import SteppedRun, stepped_run

MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
INERTIAS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
XA, YA, XB, YB, XC, YC = -0.06934, -0.00227, -0.03635, 0.03273, 0.014, 0.072
D, DA, E, EA, RR, RA = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092
SS, SA, SB, SC, SD, TA, TB = 0.035, 0.01874, 0.01043, 0.018, 0.02, 0.02308, 0.00916
U, UA, UB, ZF, ZT, FA = 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421
CENTRES = ((RA, 0), (-DA, 0), (SB, -SA), (0, EA - E), (TA, TB), (ZF - FA, 0), (-UB, -UA))
TORQUE, STIFFNESS, REST = 0.033, 4530.0, 0.07785
END = 0.03

NAMES = ("beta", "Theta", "gamma", "phi", "delta", "Omega", "epsilon")
START = (
    -0.0617138900142764496,
    0.0,
    0.455279819163070380,
    0.222668390165885885,
    0.487364979543842550,
    -0.222668390165885885,
    1.23054744454982120,
)
TABLE = Path(__file__).parents[1] / "external_data" / "andrews_squeezer.csv"


def squeezer() -> ms.Mechanism:
    links = tuple(
        ms.Link(f"K{i + 1}", inertia=Inertia(mass, (*map(float, centre), 0.0), np.diag([moment] * 3)))
        for i, (mass, centre, moment) in enumerate(zip(MASSES, CENTRES, INERTIAS, strict=True))
    )
    joints = (
        _hinge("beta", "ground", (0, 0), "K1", (0, 0)),
        _hinge("Theta", "K1", (RR, 0), "K2", (0, 0)),
        _hinge("gamma", "ground", (XB, YB), "K3", (0, 0)),
        _hinge("delta", "ground", (XA, YA), "K5", (0, 0)),
        _hinge("phi", "K5", (ZT, 0), "K4", (0, 0)),
        _hinge("epsilon", "ground", (XA, YA), "K7", (0, 0)),
        _hinge("Omega", "K7", (0, -U), "K6", (0, 0)),
        _hinge("E3", "K3", (0, -SS), "K2", (-D, 0)),
        _hinge("E4", "K4", (0, -E), "K2", (-D, 0)),
        _hinge("E6", "K6", (ZF, 0), "K2", (-D, 0)),
    )
    beta, theta, gamma, phi, delta, omega, epsilon = START
    guess = {
        "K1": _pose(0.0, 0.0, beta),
        "K2": _pose(RR * np.cos(beta), RR * np.sin(beta), beta + theta),
        "K3": _pose(XB, YB, gamma),
        "K4": _pose(XA + ZT * np.cos(delta), YA + ZT * np.sin(delta), phi + delta),
        "K5": _pose(XA, YA, delta),
        "K6": _pose(XA + U * np.sin(epsilon), YA - U * np.cos(epsilon), omega + epsilon),
        "K7": _pose(XA, YA, epsilon),
    }
    points = {"E": ("K2", (-D, 0.0, 0.0)), "D": ("K3", (SD, -SC, 0.0))}
    return ms.Mechanism("squeezer", links, joints, "beta", points, guess=guess, start=beta)


def forces() -> Forces:
    spring = Spring(("ground", (XC, YC, 0.0)), "D", STIFFNESS, REST)
    return Forces(springs=(spring,), motor=ConstantTorque(TORQUE))


def stepped() -> SteppedRun:
    settings, times = ms.Settings(constant_steps=100.0, compliance=1e-6), np.linspace(0.0, END, 11)
    start = {"beta": START[0]}
    # loops are cut at the other joints
    return stepped_run(squeezer(), forces(), start, {"beta": 0.0}, times, 600, settings, kept={*NAMES})


def reference() -> np.ndarray:
    """Return the published angles in the order of `NAMES`, (7,) in [rad]."""
    lines = [line for line in TABLE.read_text().splitlines() if not line.startswith("#")]
    angles = {row["name"]: float(row["angle"]) for row in csv.DictReader(lines)}
    return np.array([angles[name] for name in NAMES])


def digits(angles: np.ndarray) -> float:
    """Return the scd of the seven angles."""
    return float(-np.log10(np.abs(angles / reference() - 1.0).max()))


def stepped_rows() -> list[Row]:
    run = stepped()
    joints = [run.motion.joints[name].value for name in NAMES]
    start = np.array([joint[0] for joint in joints])
    work = TORQUE * (joints[0] - joints[0][0])
    return [
        Row("initial angles", float(np.abs(start - START).max()), 1e-14, "rad", ""),
        Row("MuJoCo: digits short of 9", 9.0 - digits(_at_end(joints)), 1.0, "scd", "target 8; 9.1 measured"),
        Row("MuJoCo: time", run.seconds, 1.0, "s", "target"),
        Row("MuJoCo: energy against work", energy_error(run, work), 1e-9, "1", "fourth order"),
    ]


def _at_end(joints: list[np.ndarray]) -> np.ndarray:
    return np.array([joint[-1] for joint in joints])


def reduced_rows() -> list[Row]:
    """Return the rows of the reduced equation."""
    start = time.perf_counter()
    run = dynamics.run(dynamics.dynamic_model(squeezer(), forces()), duration=END, samples=1)
    seconds = time.perf_counter() - start
    missing_digits = 10.0 + float(np.log10(abs(run.motion.angle[-1] / reference()[0] - 1.0)))
    return [
        Row("reduced equation: digits short of 10", missing_digits, 1.0, "scd", "target 9; 10.1 measured"),
        Row("reduced equation: time", seconds, 10.0, "s", "target: seconds"),
        Row("reduced equation: energy against work", run.energy_error, 1e-9, "1", "DOP853 at 3e-13"),
    ]


def _hinge(name: str, a: str, at_a: tuple, b: str, at_b: tuple) -> ms.Joint:
    ends = (ms.End(link, (float(x), float(y), 0.0)) for link, (x, y) in ((a, at_a), (b, at_b)))
    return ms.Joint(name, "revolute", *ends)


def _pose(x: float, y: float, angle: float) -> ms.Pose:
    c, s = np.cos(angle), np.sin(angle)
    return ms.Pose(np.array([x, y, 0.0]), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


if __name__ == "__main__":
    sys.exit(show("A03 Andrews' squeezer at 0.03 s", stepped_rows() + reduced_rows()))
