"""A05, stiff flyball governor: a shaft that turns freely, a slider on it, two arms, two stiff spring-dampers.

Problem: IFToMM library of computational multibody benchmarks, A05. A cube of 0.1 m and arms of 1 m of
3000 kg/m3, 5 kg at the arms' ends, springs of 8e5 N/m with dampers of 4e4 N s/m between the arms' middles and
the slider; the shaft starts at one revolution per second, everything else at rest relative to it.

The reference is Lagrange's equation of shaft, arm and slider, derived by hand; the angular momentum about the
shaft is constant. It is integrated by DOP853 at a relative tolerance of 1e-13.

Run: python validation/published/a05_governor.py [seconds, default 1]
"""

import sys
from dataclasses import dataclass
from time import process_time

import numpy as np
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.mechanism.forces import Forces, Spring
from mechsim.mechanism.links import Inertia, combine
from mechsim.numerics.arrays import Array

GRAVITY, DENSITY, SIDE, LENGTH, CUBE = 9.81, 3000.0, 0.01, 1.0, 0.1
STIFFNESS, DAMPING, REST, BALL = 8e5, 4e4, 0.5, 5.0
# distance of arms and of spring ends on the slider from the axis, in [m]
OFFSET = 0.05
ANGLE, HEIGHT, SPEED = np.deg2rad(30.0), 0.5, 2.0 * np.pi
ROD = DENSITY * SIDE * SIDE * LENGTH
SLIDER = DENSITY * CUBE**3
# moments of a rod along it and across it about its middle
ALONG, ACROSS = ROD * SIDE**2 / 6.0, ROD * (LENGTH**2 + SIDE**2) / 12.0


def governor() -> ms.Mechanism:
    """Return the governor; arms point along their frames' x axes."""
    rod = Inertia(ROD, (0.5 * LENGTH, 0.0, 0.0), np.diag([ALONG, ACROSS, ACROSS]))
    # a point mass has no moments: a millionth of the rod's
    ball = Inertia(BALL, (LENGTH, 0.0, 0.0), np.diag([1e-12] * 3))
    arm = combine([rod, ball])
    cube = SLIDER * CUBE**2 / 6.0
    links = (
        ms.Link("shaft", inertia=Inertia(ROD, (0.0, 0.0, 0.5), np.diag([ACROSS, ACROSS, ALONG]))),
        ms.Link("slider", inertia=Inertia(SLIDER, (0.0, 0.0, 0.0), np.diag([cube] * 3))),
        ms.Link("left", inertia=arm),
        ms.Link("right", inertia=arm),
    )
    joints = [
        ms.Joint("shaft", "revolute", ms.End("ground"), ms.End("shaft")),
        ms.Joint("slider", "prismatic", ms.End("shaft"), ms.End("slider")),
    ]
    guess = {"slider": ms.Pose(np.array([0.0, 0.0, HEIGHT]), np.eye(3))}
    for name, side in (("right", 1.0), ("left", -1.0)):
        # the right arm rotates about -y, so that a positive angle is below the horizontal
        axis, outwards = (0.0, side, 0.0), (side, 0.0, 0.0)
        shaft = ms.End("shaft", (side * OFFSET, 0.0, LENGTH), axis, outwards)
        arm_end = ms.End(name, axis=(0.0, 1.0, 0.0), reference=(1.0, 0.0, 0.0))
        joints.append(ms.Joint(name, "revolute", shaft, arm_end))
        cos, sin = np.cos(ANGLE), np.sin(ANGLE)
        rotation = np.array([[side * cos, 0.0, side * sin], [0.0, side, 0.0], [-sin, 0.0, cos]])
        guess[name] = ms.Pose(np.array([side * OFFSET, 0.0, LENGTH]), rotation)
    return ms.Mechanism("governor", links, tuple(joints), driver=(), points={}, guess=guess)


def forces() -> Forces:
    """Return weight and the two spring-dampers."""
    middle, constants = (0.5 * LENGTH, 0.0, 0.0), (STIFFNESS, REST, DAMPING)
    ends = {name: ("slider", (side * OFFSET, 0.0, 0.0)) for name, side in (("right", 1.0), ("left", -1.0))}
    springs = tuple(Spring(end, (name, middle), *constants) for name, end in ends.items())
    return Forces(gravity=(0.0, 0.0, -GRAVITY), springs=springs)


def moment_about_shaft(angle: float) -> tuple[float, float]:
    """Return the moment of inertia about the shaft at an angle of the arms, and its derivative."""
    cos, sin = np.cos(angle), np.sin(angle)
    fixed = ALONG + SLIDER * CUBE**2 / 6.0
    value = fixed + 2.0 * (ALONG * sin**2 + ACROSS * cos**2)
    gradient = 4.0 * (ALONG - ACROSS) * sin * cos
    for mass, distance in ((ROD, 0.5 * LENGTH), (BALL, LENGTH)):
        radius = OFFSET + distance * cos
        value += 2.0 * mass * radius**2
        gradient -= 4.0 * mass * radius * distance * sin
    return value, gradient


def rates(_: float, state: Array, momentum: float) -> list[float]:
    """Return the rates of shaft angle, arm angle, slider height, and of the last two's rates."""
    _, angle, height, angle_rate, height_rate = state
    cos, sin = np.cos(angle), np.sin(angle)
    moment, gradient = moment_about_shaft(angle)
    speed = momentum / moment
    across, above = 0.5 * LENGTH * cos, LENGTH - 0.5 * LENGTH * sin - height
    length = np.hypot(across, above)
    by_angle = (-0.5 * LENGTH * sin * across - 0.5 * LENGTH * cos * above) / length
    by_height = -above / length
    force = 2.0 * (STIFFNESS * (length - REST) + DAMPING * (by_angle * angle_rate + by_height * height_rate))
    arm = 2.0 * (ACROSS + ROD * 0.25 * LENGTH**2 + BALL * LENGTH**2)
    weight = 2.0 * GRAVITY * (0.5 * ROD + BALL) * LENGTH * cos
    second = (0.5 * gradient * speed**2 + weight - force * by_angle) / arm
    return [speed, angle_rate, height_rate, second, -GRAVITY - force * by_height / SLIDER]


@dataclass(frozen=True)
class Comparison:
    """Largest errors of a run: angles in [rad] and the slider in [m]."""

    shaft: float
    arm: float
    slider: float
    steps: int


def compare(seconds: float, samples: int = 50, height: float = HEIGHT) -> Comparison:
    """Return the errors of a run; `height` is the initial height of the slider in the reference."""
    initial = {"shaft.v": SPEED, "slider.q": HEIGHT}
    run = ms.dynamics.run(governor(), forces(), initial=initial, duration=seconds, samples=samples)
    start, momentum = [0.0, ANGLE, height, 0.0, 0.0], moment_about_shaft(ANGLE)[0] * SPEED
    settings = {"args": (momentum,), "rtol": 1e-13, "atol": 1e-14}
    exact = solve_ivp(rates, (0.0, seconds), start, "DOP853", run.time, **settings).y
    angles = [run.motion.joints[name].value for name in ("shaft", "right", "slider")]
    return Comparison(*np.abs(angles - exact[:3]).max(1).tolist(), run.steps)


if __name__ == "__main__":
    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    start = process_time()
    result = compare(duration)
    print(
        f"A05 governor, {duration:g} s: shaft {result.shaft:.1e} rad, arm {result.arm:.1e} rad, slider "
        f"{result.slider:.1e} m, {result.steps:,d} steps, {process_time() - start:.1f} s of processor time"
    )
