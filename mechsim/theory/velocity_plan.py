"""Velocity plans of the two-crank warp-knitting mechanism, constructed as in Koshel and Koshel.

One crank is stopped, and a rod drives instead of the other crank: the class III group then consists of class
    II
groups, and the plan can be drawn from the pole, vector by vector, from a first vector of any length. The
crank that actually drives determines the scale. The velocities of both plans, one for each crank, are added.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.analytic.vector_method.triad import cross, flat
from mechsim.errors import AssemblyError
from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array

# sine below which two lines of a plan count as parallel: their intersection loses too many digits
PARALLEL = 1e-9
# lines of a plan: (from, to) connects the ends of two vectors and represents a relative velocity
LINES = {
    "crank2": (("c", "k"), ("c", "b"), ("b", "k"), ("b", "a")),
    "crank1": (("b", "k"), ("b", "c"), ("c", "k"), ("c", "d")),
}


@dataclass(frozen=True, slots=True)
class Plan:
    """The velocity plan with one crank stopped.

    Attributes:
        stopped: the stopped crank, "crank1" or "crank2".
        driver: the rod that drives the drawing.
        pole: origin of all vectors, (2,), in plan units.
        vectors: end of each point's vector relative to the pole, (2,), in plan units.
        lines: (from, to) ends of vectors connected by a line: a relative velocity.
        scale: velocity in [m/s] of one plan unit.
    """

    stopped: str
    driver: str
    pole: Array
    vectors: Mapping[str, Array]
    lines: tuple[tuple[str, str], ...]
    scale: float

    __repr__ = short_repr

    @property
    def velocities(self) -> dict[str, Array]:
        """Velocity of each point with this crank stopped: A, B, C, D, K -> (3,) in [m/s]."""
        return {point.upper(): np.append(self.scale * vector, 0.0) for point, vector in self.vectors.items()}


@dataclass(frozen=True, slots=True)
class VelocityPlan:
    """Both plans at a crank angle and their sum.

    Attributes:
        angle: angle of crank 1 in [rad].
        speeds: speeds of crank 1 and crank 2 in [rad/s].
        crank2_stopped: plan with crank 1 driving alone; its scale is eq. (3).
        crank1_stopped: plan with crank 2 driving alone; its scale is eq. (5).
        velocities: absolute velocities, A, B, C, D, K -> (3,) in [m/s]; eqs (6)-(8).
    """

    angle: float
    speeds: tuple[float, float]
    crank2_stopped: Plan
    crank1_stopped: Plan
    velocities: Mapping[str, Array]

    __repr__ = short_repr


def velocity_plan(
    mechanism: Any, angle: float, speed: float, speed2: float | None = None, *, first: float = 1.0
) -> VelocityPlan:
    """Build the velocity plans at a crank angle.

    Args:
        mechanism: the mechanism.
        angle: angle of crank 1 in [rad]; the gears determine that of crank 2.
        speed: speed of crank 1 in [rad/s].
        speed2: speed of crank 2 in [rad/s]; the default follows from the gears.
        first: length of the first vector, pc or pb, in plan units; any but zero.

    Returns:
        The plans, their scales and the velocities.

    Raises:
        AssemblyError: where a plan cannot be drawn: KC or KB lies along KE, or the rod that drives
            the drawing cannot move the crank.

    Accuracy: relative error a few ulp divided by the sine of the angle between intersecting lines of the
        plan.

    Source: Koshel and Koshel (docs/explanation/sources.md), eqs (1)-(8).
    """
    points = mechanism.positions([angle])
    positions = {name: complex(flat(path)[0]) for name, path in points.items()}
    positions |= {"O1": 0j, "O2": complex(*mechanism.pivot2), "E": complex(*mechanism.pivot_rocker)}
    second_speed = float(mechanism.gear_ratio * speed if speed2 is None else speed2)
    first_plan = _plan(positions, "crank2", "rod5", ("C", "D"), ("B", "A", "O1"), speed, first)
    second_plan = _plan(positions, "crank1", "rod3", ("B", "A"), ("C", "D", "O2"), second_speed, first)
    velocities = {name: first_plan.velocities[name] + second_plan.velocities[name] for name in "ABCDK"}
    return VelocityPlan(float(angle), (float(speed), second_speed), first_plan, second_plan, velocities)


def _plan(
    positions: Mapping[str, complex],
    stopped: str,
    driver: str,
    driving: tuple[str, str],
    driven: tuple[str, str, str],
    speed: float,
    first: float,
) -> Plan:
    """Draw the plan with one crank stopped.

    `driving` names the point of the base link on the driving rod, then the fixed end of the rod;
    `driven` the point of the base link on the other rod, that rod's crank pin, the crank's pivot.
    """
    (p, stand), (q, pin, pivot) = driving, driven
    # the first vector has one direction; if the crank then rotates backwards, the other
    for direction in (1.0, -1.0):
        vector = {
            stand: 0j,
            p: direction
            * first
            * 1j
            * (positions[p] - positions[stand])
            / abs(positions[p] - positions[stand]),
        }
        # V_K = V_C + V_KC with V_KC across KC, and V_K across KE: eq. (1), in eq. (4) from B
        vector["K"] = _crossing(
            vector[p],
            1j * (positions["K"] - positions[p]),
            1j * (positions["K"] - positions["E"]),
            f"K{p}",
            "KE",
        )
        # the plan contains a figure similar to the base link
        vector[q] = vector[p] + (vector["K"] - vector[p]) * (positions[q] - positions[p]) / (
            positions["K"] - positions[p]
        )
        # V_A = V_B + V_AB with V_AB across AB, and V_A across O1A: eq. (2), in eq. (4) D from C
        vector[pin] = _crossing(
            vector[q],
            1j * (positions[pin] - positions[q]),
            1j * (positions[pin] - positions[pivot]),
            f"{pin}{q}",
            f"{pin}{pivot}",
        )
        rotated = cross(positions[pin] - positions[pivot], vector[pin])
        if rotated * speed >= 0.0:
            break
    if abs(vector[pin]) <= PARALLEL * abs(first):
        raise AssemblyError(
            f"no velocity plan with {stopped} stopped: {driver} cannot move the other crank in this pose, "
            f"so p{pin.lower()} is a point; choose another crank angle"
        )
    # eqs (3) and (5)
    scale = abs(speed) * abs(positions[pin] - positions[pivot]) / abs(vector[pin])
    ends = {name.lower(): np.array([v.real, v.imag]) for name, v in sorted(vector.items())}
    return Plan(stopped, driver, np.zeros(2), ends, LINES[stopped], float(scale))


def _crossing(start: complex, along: complex, ray: complex, line1: str, line2: str) -> complex:
    """Return the intersection of the line from `start` along `along` with that from the pole along `ray`."""
    sine = cross(along, ray) / (abs(along) * abs(ray))
    if not abs(sine) > PARALLEL:
        raise AssemblyError(
            f"no velocity plan: {line1} lies along {line2}, so that their velocities do not cross; "
            "choose another crank angle"
        )
    return ray * (cross(along, start) / cross(along, ray))
