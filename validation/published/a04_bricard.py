"""A04, Bricard's linkage: five rods and six hinges with a redundant constraint and mobility one.

Problem: IFToMM library of computational multibody benchmarks, A04. Five rods of 1 m and 1 kg, 0.1 m
square, six hinges at (0,0,0), (1,0,0), (1,-1,0), (1,-1,1), (0,-1,1), (0,0,1) with axes y, z, x, y, z, x;
gravity 9.81 m/s2 along -y; 10 s. The library compares the conserved energy; it has no table of numbers.

Run: python validation/published/a04_bricard.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from table import Row, energy_error, show

import mechsim as ms
from mechsim.mechanism.forces import Forces
from mechsim.simulation.dynamics.forward_run import stepped_run

MODEL = Path(__file__).parents[1] / "suites" / "models" / "exudyn" / "bricardMechanism.toml"


def bricard() -> ms.Mechanism:
    return ms.load(str(MODEL)).mechanism


def rows(duration: float = 10.0, timestep: float = 1.25e-4, energy_tolerance: float = 1e-6) -> list[Row]:
    mechanism = bricard()
    dofs = ms.loops.dof_count(mechanism, ms.loops.assemble(mechanism, [0.0]))
    times, weight = np.linspace(0.0, duration, 201), Forces(gravity=(0.0, -9.81, 0.0))
    run = stepped_run(mechanism, weight, {"J1": 0.0}, {"J1": 0.0}, times, round(times[1] / timestep))
    reason = "redundant rows with compliance; second order"
    return [
        Row("rank of the loop equations, less 29", abs(dofs.rank - 29.0), 0.0, "1", "one row is redundant"),
        Row("redundant rows, less 1", abs(dofs.redundant - 1.0), 0.0, "1", "overconstrained"),
        Row("mobility, less 1", abs(dofs.mobility - 1.0), 0.0, "1", "movable"),
        Row(f"energy over {duration:g} s", energy_error(run), energy_tolerance, "1", reason),
        Row("loop-closure error", _closure_error(mechanism, run.motion), 1e-5, "m", "limit of the library"),
    ]


def _closure_error(mechanism: ms.Mechanism, motion: ms.Motion) -> float:
    """Return the largest distance in [m] between the two points of a joint."""

    def position(end: ms.End) -> np.ndarray:
        if end.link == "ground":
            return np.array(end.point)
        link = motion.links[end.link]
        return link.position + link.rotation @ np.array(end.point)

    return max(float(np.abs(position(joint.a) - position(joint.b)).max()) for joint in mechanism.joints)


if __name__ == "__main__":
    sys.exit(show("A04 Bricard, MuJoCo", rows()))
