"""Natural frequencies and damping ratios of mechanisms with springs against 50 digits.

The linearised equations are independent of mechsim: positions by intersection of circles, mass and damping
matrices and the Hessian of the potential by differences in mpmath with 60 digits, about the equilibrium of
mpmath's Newton method. Only dimensions and inertias are read from the mechanism.

Run: python validation/published/natural_frequencies.py
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np

import mechsim as ms
from mechsim.mechanism.forces import Forces, Friction, JointSpring, Spring
from mechsim.mechanism.masses import with_inertia

DIGITS = 60
GRAVITY = 9.81
# independent coordinates -> link -> (x, y, angle) of its frame
Frames = Callable[..., dict[str, tuple[Any, Any, Any]]]


@dataclass(frozen=True)
class Case:
    """A planar mechanism, its forces, and its frames by independent coordinates.

    Attributes:
        name: of the catalogue.
        forces: springs between points and in drivers, viscous friction in drivers.
        frames: at 50 digits.
        guess: coordinates of the drivers near the equilibrium, in [rad].
    """

    name: str
    forces: Forces
    frames: Frames
    guess: tuple[float, ...]


def circles(a: Sequence[Any], b: Sequence[Any], first: Any, second: Any, side: int) -> tuple[Any, Any]:
    """Return the intersection of two circles on one side of the line between their centres."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    along = (first * first - second * second + square) / (2 * square)
    across = side * mp.sqrt(first * first / square - along * along)
    return a[0] + along * dx - across * dy, a[1] + along * dy + across * dx


def angle(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return mp.atan2(b[1] - a[1], b[0] - a[0])


def four_bar(phi: Any) -> dict[str, tuple[Any, Any, Any]]:
    dimensions = ms.catalog.make("four_bar")
    crank, coupler, rocker, ground = (
        mp.mpf(value)
        for value in (dimensions.crank, dimensions.coupler, dimensions.rocker, dimensions.ground)
    )
    a, pivot = (crank * mp.cos(phi), crank * mp.sin(phi)), (ground, mp.mpf(0))
    b = circles(a, pivot, coupler, rocker, 1)
    return {
        "crank": (mp.mpf(0), mp.mpf(0), phi),
        "coupler": (*a, angle(a, b)),
        "rocker": (*pivot, angle(pivot, b)),
    }


def slider_crank(phi: Any) -> dict[str, tuple[Any, Any, Any]]:
    dimensions = ms.catalog.make("slider_crank")
    crank, rod, offset = mp.mpf(dimensions.crank), mp.mpf(dimensions.rod), mp.mpf(dimensions.offset)
    a = crank * mp.cos(phi), crank * mp.sin(phi)
    b = a[0] + mp.sqrt(rod**2 - (offset - a[1]) ** 2), offset
    return {"crank": (mp.mpf(0), mp.mpf(0), phi), "rod": (*a, angle(a, b)), "slider": (*b, mp.mpf(0))}


def five_bar(left: Any, right: Any) -> dict[str, tuple[Any, Any, Any]]:
    arm, forearm, half = mp.mpf(0.06), mp.mpf(0.08), mp.mpf(0.03)
    a = -half + arm * mp.cos(left), arm * mp.sin(left)
    b = half + arm * mp.cos(right), arm * mp.sin(right)
    tool = circles(a, b, forearm, forearm, 1)
    return {
        "arm_l": (-half, mp.mpf(0), left),
        "arm_r": (half, mp.mpf(0), right),
        "forearm_l": (*a, angle(a, tool)),
        "forearm_r": (*b, angle(b, tool)),
    }


CASES = (
    Case(
        "four_bar",
        Forces(
            gravity=(0.0, -GRAVITY, 0.0),
            springs=(Spring("C", ("ground", (0.02, 0.15, 0.0)), 40.0, 0.06),),
            friction=(Friction("crank", viscous=2e-5),),
        ),
        four_bar,
        (1.0,),
    ),
    Case(
        "slider_crank",
        Forces(
            gravity=(0.0, -GRAVITY, 0.0),
            springs=(Spring("B", ("ground", (0.4, 0.03, 0.0)), 150.0, 0.2),),
            joint_springs=(JointSpring("crank", 0.8, 0.7),),
            friction=(Friction("crank", viscous=1e-3),),
        ),
        slider_crank,
        (0.7,),
    ),
    Case(
        "five_bar",
        Forces(
            gravity=(0.0, -GRAVITY, 0.0),
            springs=(Spring("P", ("ground", (0.01, 0.2, 0.0)), 25.0, 0.08),),
            joint_springs=(JointSpring("left", 0.02, 2.0), JointSpring("right", 0.03, 1.1)),
            friction=(Friction("left", viscous=1e-5), Friction("right", viscous=2e-5)),
        ),
        five_bar,
        (2.1, 1.0),
    ),
)


def exact(case: Case) -> tuple[list[Any], list[tuple[Any, Any]]]:
    """Return the equilibrium, and (frequency in [Hz], damping ratio) of each mode, at 50 digits."""
    mechanism = with_inertia(ms.load(case.name).mechanism)
    count = len(case.guess)

    def position(frames: dict[str, tuple[Any, Any, Any]], link: str, local: Sequence[float]) -> Any:
        if link == "ground":
            return mp.mpf(local[0]), mp.mpf(local[1])
        x, y, angle_of_link = frames[link]
        cos, sin, u, v = mp.cos(angle_of_link), mp.sin(angle_of_link), mp.mpf(local[0]), mp.mpf(local[1])
        return x + cos * u - sin * v, y + sin * u + cos * v

    def end(frames: dict[str, tuple[Any, Any, Any]], location: Any) -> Any:
        return position(frames, *(mechanism.points[location] if isinstance(location, str) else location))

    def potential(*u: Any) -> Any:
        frames = case.frames(*u)
        total = mp.mpf(0)
        for link in mechanism.links:
            assert link.inertia is not None
            height = position(frames, link.name, link.inertia.centre)[1]
            total += mp.mpf(link.inertia.mass) * mp.mpf(GRAVITY) * height
        for spring in case.forces.springs:
            a, b = end(frames, spring.a), end(frames, spring.b)
            length = mp.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)
            total += mp.mpf(spring.stiffness) / 2 * (length - mp.mpf(spring.rest)) ** 2
        for spring in case.forces.joint_springs:
            value = u[mechanism.drivers.index(spring.joint)]
            total += mp.mpf(spring.stiffness) / 2 * (value - mp.mpf(spring.rest)) ** 2
        return total

    def order(*axes: int) -> tuple[int, ...]:
        return tuple(axes.count(k) for k in range(count))

    def gradient(*u: Any) -> list[Any]:
        return [mp.diff(potential, u, order(k)) for k in range(count)]

    u = [*mp.findroot(gradient, case.guess, tol=mp.mpf(10) ** (-2 * DIGITS // 3))]
    mass, damping, stiffness = (mp.zeros(count) for _ in range(3))
    rates = {
        link.name: [
            [
                mp.diff(lambda *v, i=i, link=link: _state(case, link, v, position)[i], u, order(k))
                for i in range(3)
            ]
            for k in range(count)
        ]
        for link in mechanism.links
    }
    for i in range(count):
        for j in range(count):
            stiffness[i, j] = mp.diff(potential, u, order(i, j))
            for link in mechanism.links:
                assert link.inertia is not None
                first, second = rates[link.name][i], rates[link.name][j]
                linear = first[0] * second[0] + first[1] * second[1]
                moment = mp.mpf(link.inertia.moments[2][2])
                mass[i, j] += mp.mpf(link.inertia.mass) * linear + moment * first[2] * second[2]
    for friction in case.forces.friction:
        k = mechanism.drivers.index(friction.joint)
        damping[k, k] += mp.mpf(friction.viscous)
    matrix = mp.zeros(2 * count)
    inverse = mp.inverse(mass)
    matrix[:count, count:] = mp.eye(count)
    matrix[count:, :count] = -inverse * stiffness
    matrix[count:, count:] = -inverse * damping
    values = [value for value in mp.eig(matrix)[0] if value.imag > 0]
    modes = [(abs(value) / (2 * mp.pi), -value.real / abs(value)) for value in values]
    return u, sorted(modes, key=lambda mode: mode[0])


def _state(case: Case, link: Any, u: Any, position: Any) -> Any:
    frames = case.frames(*u)
    return (*position(frames, link.name, link.inertia.centre), frames[link.name][2])


def errors(case: Case) -> list[tuple[str, float, float, float]]:
    """Return frequency, its relative error, and error of the damping ratio of each mode of mechsim."""
    with mp.workdps(DIGITS):
        u, modes = exact(case)
        solver = ms.load(case.name)
        initial = {f"{name}.q": float(value) for name, value in zip(solver.mechanism.drivers, u, strict=True)}
        computed = ms.dynamics.modes(ms.dynamics.dynamic_model(solver, case.forces), initial=initial)
        return [
            (
                mp.nstr(frequency, 30),
                float(abs(mp.mpf(mode.frequency) / frequency - 1)),
                float(abs(mp.mpf(mode.damping_ratio) - ratio)),
                float(ratio),
            )
            for (frequency, ratio), mode in zip(modes, computed, strict=True)
        ]


def main() -> None:
    head = f"{'natural frequency [Hz]':36s} {'damping':>9s} {'rel. error':>11s} {'of damping':>12s}"
    print(f"{'mechanism':14s} {head}")
    worst = 0.0
    for case in CASES:
        for frequency, error, of_ratio, ratio in errors(case):
            print(f"{case.name:14s} {frequency:36s} {ratio:9.4f} {error:11.1e} {of_ratio:12.1e}")
            worst = max(worst, error, of_ratio)
    print(f"worst {worst:.1e}, limit 1e-9")
    assert np.isfinite(worst)
    assert worst <= 1e-9


if __name__ == "__main__":
    main()
