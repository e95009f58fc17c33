"""Velocity plans of the warp-knitting mechanism, as in Koshel and Koshel (docs/explanation/sources.md).

One crank is stopped, and a rod drives instead of the other crank: the class III group then consists of
class II groups, and the plan is drawn from the pole, vector by vector, from a first vector of length 1. The
crank that actually drives determines the scale. The velocities of both plans are added, eqs (6)-(8).
"""

from typing import NamedTuple

import numpy as np

from mechsim.kinematics.vector_method.triad import cross, flat


class Plan(NamedTuple):
    """Ends of the vectors from the pole, (2,), in plan units, the scale in [m/s], and velocities, (3,)."""

    vectors: dict[str, np.ndarray]
    scale: float
    velocities: dict[str, np.ndarray]


def velocity_plans(linkage, angle, speed, speed2=None) -> tuple[Plan, Plan, dict[str, np.ndarray]]:
    """Return the plans with crank 2 and with crank 1 stopped, and the velocities of A, B, C, D, K."""
    pins = {name: complex(flat(path)[0]) for name, path in linkage.positions([angle]).items()}
    pins |= {"O1": 0j, "O2": complex(*linkage.pivot2), "E": complex(*linkage.pivot_rocker)}
    speed2 = linkage.gear_ratio * speed if speed2 is None else speed2
    first = _plan(pins, "CD", ("B", "A", "O1"), speed)
    second = _plan(pins, "BA", ("C", "D", "O2"), speed2)
    return first, second, {name: first.velocities[name] + second.velocities[name] for name in "ABCDK"}


def _plan(pins: dict[str, complex], driving: str, driven: tuple[str, str, str], speed: float) -> Plan:
    """Draw a plan from the point of the base link on the driving rod and the rod's fixed end."""
    (p, stand), (q, pin, pivot) = driving, driven
    first = 1j * (pins[p] - pins[stand]) / abs(pins[p] - pins[stand])
    # the first vector has one direction; if the crank then rotates backwards, the other
    for direction in (1.0, -1.0):
        vector = {stand: 0j, p: direction * first}
        # V_K = V_C + V_KC with V_KC across KC, and V_K across KE: eq. (1), in eq. (4) from B
        vector["K"] = _crossing(vector[p], 1j * (pins["K"] - pins[p]), 1j * (pins["K"] - pins["E"]))
        # the plan contains a figure similar to the base link
        vector[q] = vector[p] + (vector["K"] - vector[p]) * (pins[q] - pins[p]) / (pins["K"] - pins[p])
        # V_A = V_B + V_AB with V_AB across AB, and V_A across O1A: eq. (2), in eq. (4) D from C
        vector[pin] = _crossing(vector[q], 1j * (pins[pin] - pins[q]), 1j * (pins[pin] - pins[pivot]))
        if cross(pins[pin] - pins[pivot], vector[pin]) * speed >= 0.0:
            break
    # eqs (3) and (5)
    scale = abs(speed) * abs(pins[pin] - pins[pivot]) / abs(vector[pin])
    ends = {name: np.array([v.real, v.imag]) for name, v in vector.items()}
    return Plan(ends, scale, {name: np.append(scale * end, 0.0) for name, end in ends.items()})


def _crossing(start: complex, along: complex, ray: complex) -> complex:
    """Return the intersection of the line from `start` along `along` with that from the pole along `ray`."""
    return ray * (cross(along, start) / cross(along, ray))
