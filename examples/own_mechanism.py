"""Describe your own mechanism once, and compare its loop equations with MuJoCo.

A spatial slider-crank: a crank on a slanted shaft drives a slider through a rod with a ball joint at
one end and a universal joint at the other. There is no closed form; `loops` solves the loop
equations of any mechanism.

Run: python examples/own_mechanism.py
"""

import numpy as np

import mechsim as ms
from mechsim import End, Joint, Link, Mechanism, Pose, loops

TIP = (0.03, 0.0, 0.0)

mechanism = Mechanism(
    name="slanted slider-crank",
    links=(Link("crank"), Link("rod"), Link("slider")),
    joints=(
        Joint("shaft", "revolute", End("ground", axis=(0.2, 0.0, 1.0)), End("crank")),
        Joint("ball", "spherical", End("crank", TIP), End("rod")),
        Joint("cross", "universal", End("rod", (0.14, 0.0, 0.0), axis=(0.0, 1.0, 0.0)), End("slider")),
        Joint(
            "slide",
            "prismatic",
            End("ground", (0.0, 0.01, 0.02), axis=(1.0, 0.0, 0.0)),
            End("slider", axis=(1.0, 0.0, 0.0)),
        ),
    ),
    driver="shaft",
    points={"tip": ("crank", TIP), "slider": ("slider", (0.0, 0.0, 0.0))},
    # approximate poses of the links at crank angle 0; they select the assembly mode
    guess={
        "rod": Pose(np.array([0.03, 0.0, 0.0]), np.eye(3)),
        "slider": Pose(np.array([0.17, 0.01, 0.02]), np.eye(3)),
    },
)


def main() -> None:
    speed = ms.units.rpm(600.0)
    run = ms.simulate(mechanism, speed=speed, tolerance=1e-7, samples=36)
    exact = loops.solve(mechanism, run.motion.angle, run.motion.speed, run.motion.acceleration)
    verdict = ms.crosscheck(run.motion, exact, tolerance=1e-7, speed=speed)
    stroke = exact.points["slider"].position[:, 0]
    print(f"the slider's stroke is {1e3 * (stroke.max() - stroke.min()):.2f} mm")
    print(verdict)
    assert verdict.passed

    poses = loops.assemble(mechanism, [0.0])
    print("degrees of freedom:", loops.dof_count(mechanism, poses))


if __name__ == "__main__":
    main()
