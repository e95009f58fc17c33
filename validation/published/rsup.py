"""A spatial slider-crank R-S-U-P whose initial values are exact fractions.

Problem: IFToMM library of computational multibody benchmarks, after E. J. Haug, Computer Aided
Kinematics and Dynamics of Mechanical Systems. Crank 0.08 m about x at (0, 0.1, 0.12), rod 0.3 m, slide
along x; 0.12, 0.5 and 2 kg; 6 rad/s with the crank upright, gravity 9.81 m/s2 along -z, 5 s.

Of the universal joint the published angular velocity of the rod, (144, -72, 60) / 85 rad/s, leaves this
pair of axes: x on the slider, and on the rod the direction that is (0, -6, 5) at the start, across both x
and the line from the slide to the shaft. Centres of mass are taken in the middle of crank and rod.

Run: python validation/published/rsup.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from table import Row, energy_error, show

import mechsim as ms
from mechsim import dynamics
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.links import Inertia
from mechsim.simulation.dynamics.forward_run import stepped_run

X = (1.0, 0.0, 0.0)
SPIN = np.array([144.0, -72.0, 60.0]) / 85.0
FORCES = Forces(gravity=(0.0, 0.0, -9.81))


def rsup() -> ms.Mechanism:
    along, across = np.array([2.0, -1.0, -2.0]) / 3.0, np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)
    rod = np.column_stack([along, across, np.cross(along, across)])
    cross = tuple((rod.T @ np.array([0.0, -6.0, 5.0]) / np.sqrt(61.0)).tolist())
    links = (
        ms.Link("crank", inertia=Inertia(0.12, (0.0, 0.04, 0.0), np.diag([1e-4, 1e-5, 1e-4]))),
        ms.Link("rod", inertia=Inertia(0.5, (0.15, 0.0, 0.0), np.diag([4e-4, 4e-3, 4e-3]))),
        ms.Link("slider", inertia=Inertia(2.0, (0.0, 0.0, 0.0), np.diag([1e-4] * 3))),
    )
    shaft = ms.End("ground", (0.0, 0.1, 0.12), X, (0.0, 1.0, 0.0))
    joints = (
        ms.Joint("shaft", "revolute", shaft, ms.End("crank", axis=X, reference=(0.0, 1.0, 0.0))),
        ms.Joint("ball", "spherical", ms.End("crank", (0.0, 0.08, 0.0)), ms.End("rod")),
        ms.Joint("cross", "universal", ms.End("slider", axis=X), ms.End("rod", (0.3, 0.0, 0.0), cross)),
        ms.Joint("slide", "prismatic", ms.End("ground", axis=X), ms.End("slider", axis=X)),
    )
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    guess = {
        "crank": ms.Pose(np.array([0.0, 0.1, 0.12]), upright),
        "rod": ms.Pose(np.array([0.0, 0.1, 0.2]), rod),
        "slider": ms.Pose(np.array([0.2, 0.0, 0.0]), np.eye(3)),
    }
    points = {"slider": ("slider", (0.0, 0.0, 0.0)), "centre": ("rod", (0.15, 0.0, 0.0))}
    return ms.Mechanism("rsup", links, joints, "shaft", points, guess=guess, start=np.pi / 2.0)


def rows(duration: float = 5.0, timestep: float = 5e-4, compared: float = 0.5) -> list[Row]:
    times, start = np.linspace(0.0, duration, 501), {"shaft": np.pi / 2.0}
    run = stepped_run(rsup(), FORCES, start, {"shaft": 6.0}, times, round(times[1] / timestep))
    motion = run.motion
    assert motion.time is not None
    slider, centre = motion.points["slider"], motion.points["centre"]
    spin = motion.links["rod"].angular_velocity[0]
    early = motion.time <= compared
    model, records = dynamics.dynamic_model(rsup(), FORCES), int(early.sum()) - 1
    exact = dynamics.run(model, initial={"shaft.v": 6.0}, duration=motion.time[records], samples=records)
    error = float(np.abs(exact.motion.angle - motion.angle[early]).max())
    return [
        _start("slider at the start", slider.position, (0.2, 0.0, 0.0), "m"),
        _start("its speed", slider.velocity, (0.24, 0.0, 0.0), "m/s"),
        _start("rod centre's velocity", centre.velocity, (0.12, -0.24, 0.0), "m/s"),
        Row("rod's angular velocity", float(np.abs(spin - SPIN).max()), 1e-13, "rad/s", "rounding"),
        Row(f"energy over {duration:g} s", energy_error(run), 1e-6, "1", "fourth order: 1.0e-7 measured"),
        Row(f"crank angle over {compared:g} s", error, 1e-6, "rad", "against the reduced equation"),
    ]


def _start(quantity: str, result: np.ndarray, exact: tuple[float, float, float], unit: str) -> Row:
    return Row(quantity, float(np.abs(result[0] - exact).max()), 1e-14, unit, "rounding")


if __name__ == "__main__":
    sys.exit(show("R-S-U-P, MuJoCo and the reduced equation", rows()))
