"""The path of a triad whose pivots move with cranks, with certified steps.

Newton's method from a known pose converges at the next crank angle, to the only solution nearby, if the
Newton-Kantorovich theorem holds for every crank angle in between. Steps are as long as the theorem allows.
Therefore the assembly mode cannot change unnoticed, and steps shrink to zero where modes meet.
"""

import cmath
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.kinematics.vector_method.triad import closed_triads, determinant, inverse, leg_vectors, moments
from mechsim.numerics.arrays import Array, shifted_into
from mechsim.numerics.jets import Values

Complex = NDArray[np.complex128]

# the theorem requires at most 1/2; the margin keeps Newton's method fast
MAX_KANTOROVICH = 0.4
# a shorter step, in [rad], means that a dead centre is reached: it is ten to a hundred such steps ahead
MIN_STEP = 1e-9
# largest displacement from the last node to its dead centre, in [rad]; usual are 1e-4
MAX_DISPLACEMENT = 1e-2
# largest number of steps; more are needed only with dimensions at which steps vanish
MAX_STEPS = 2_000_000
# six assembly modes can follow one another before the first returns
MAX_PERIODS = 6


@dataclass(frozen=True, slots=True)
class Pivots:
    """Three pivots on cranks: centre, crank length in [m], ratio to the angle of crank 1, phase in [rad].

    A pivot on the frame has crank length 0.
    """

    centres: tuple[complex, complex, complex]
    cranks: tuple[float, float, float]
    ratios: tuple[float, float, float]
    phases: tuple[float, float, float]

    def positions(self, angle: float) -> list[complex]:
        """Return the pivots at one crank angle."""
        driven = zip(self.centres, self.cranks, self.ratios, self.phases, strict=True)
        return [centre + cmath.rect(crank, ratio * angle + phase) for centre, crank, ratio, phase in driven]

    def positions_of(self, angles: Values) -> list[Any]:
        """Return the pivots at many crank angles, three (n,); as jets for angles as a jet."""
        driven = zip(self.centres, self.cranks, self.ratios, self.phases, strict=True)
        return [
            centre + crank * np.exp(1j * (ratio * angles + phase)) for centre, crank, ratio, phase in driven
        ]


@dataclass(frozen=True, slots=True)
class Node:
    """A pose on the path and its determinant, which is zero in a singular pose."""

    angle: float
    position: complex
    direction: complex
    determinant: float


class TriadPath:
    """All poses that a triad reaches from a pose by crank rotation to either side; extended on demand."""

    def __init__(
        self,
        pivots: Pivots,
        platform: tuple[complex, complex, complex],
        legs: tuple[float, float, float],
        start: tuple[complex, complex],
        period: float | None = None,
    ):
        """Start at crank angle 0.

        Args:
            pivots: the moving pivots.
            platform: points of the link in its frame, in [m].
            legs: lengths in [m].
            start: position and orientation of the link at crank angle 0, complex.
            period: crank angle in [rad] after which the pivots repeat; None if never.
        """
        # poses refer to the centre of the points, about which the bounds are tightest
        self._middle = sum(platform) / 3.0
        self._pivots, self._legs, self._period = pivots, legs, period
        self._platform = [point - self._middle for point in platform]
        self._extent = max(abs(point) for point in self._platform)
        self._travel = [crank * abs(ratio) for crank, ratio in zip(pivots.cranks, pivots.ratios, strict=True)]
        # rate of rotation of a gradient: |second derivative of (leg^2 - r^2)/2| over (shift/size, angle)
        self._arms = [(self._extent**2 + abs(point) ** 2) ** 0.5 for point in self._platform]
        self._bends = [
            arm**2 + 2.0 * leg * abs(point)
            for arm, leg, point in zip(self._arms, legs, self._platform, strict=True)
        ]
        position, phase = complex(start[0]), complex(start[1])
        first = self._node(0.0, position + phase * self._middle, phase)
        self._nodes: dict[int, list[Node]] = {1: [first], -1: [first]}
        self._ends: dict[int, float | None] = {1: None, -1: None}
        self._table: tuple[Array, Complex, Complex] | None = None
        self._round: float | None = None

    def end(self, side: int, target: float) -> float | None:
        """Return the dead centre before a crank angle (side +1 up, -1 down), or None."""
        nodes = self._nodes[side]
        while self._ends[side] is None and side * nodes[-1].angle < side * target:
            self._advance(side)
        end = self._ends[side]
        return end if end is not None and side * end < side * target else None

    def round(self) -> float | None:
        """Return the crank angle after which the pose of the triad repeats, in [rad].

        None if the path ends at a dead centre or the pivots never repeat.
        """
        if self._round is None and self._period is not None:
            first = self._nodes[1][0]
            for number in range(1, MAX_PERIODS + 1):
                angle = number * self._period
                if self.end(1, angle) is not None:
                    break
                position, phase = self._on_table(np.array([angle]))
                if abs(phase[0] - first.direction) + abs(position[0] - first.position) / self._extent < 1e-7:
                    self._round = angle
                    break
        return self._round

    def poses(self, angles: Array) -> tuple[Complex, Complex]:
        """Return position and orientation of the link at crank angles, (n,) each; NaN beyond a dead centre.

        A crank angle beyond a dead centre is replaced by a periodic one on the path, if there is one. If the
        path is longer than the pivots' period, all angles of a call are shifted by the same number of
        periods.

        Accuracy: Newton's method to rounding.
        """
        angles = self._reduced(angles)
        bounds = self.end(-1, float(angles.min())), self.end(1, float(angles.max()))
        # the last segment before a dead centre is not certified: it needs more steps and a check
        position, phase = self._on_table(angles, 5 if bounds == (None, None) else 16)
        for side, limit in zip((-1, 1), bounds, strict=True):
            if limit is not None:
                last = self._nodes[side][-1]
                beyond = side * angles > side * limit
                beyond |= (side * angles > side * last.angle) & ~(
                    abs(phase - last.direction) < MAX_DISPLACEMENT
                )
                position[beyond] = phase[beyond] = np.nan
        return position - phase * self._middle, phase

    def _reduced(self, angles: Array) -> Array:
        """Return crank angles on the path with the same pivot positions as the requested ones."""
        low, high, period = float(angles.min()), float(angles.max()), self._period
        if period is None:
            return angles
        if max(high, -low) <= period and self.end(-1, low) is None and self.end(1, high) is None:
            return angles
        whole = self.round()
        if whole is not None:
            return angles - whole * np.floor(angles / whole)
        # a periodic path with a dead centre on one side has one on the other
        limit = (1 + MAX_PERIODS) * period
        low, high = self.end(-1, -limit), self.end(1, limit)
        if low is None or high is None or high - low >= period:
            # a path without a gap between its ends continues on another path
            return angles if low is None or high is None else shifted_into(angles, (low, high), 0.0, period)
        back = np.ceil(np.maximum(angles - high, 0.0) / period)
        return angles - period * (back - np.ceil(np.maximum(low - angles, 0.0) / period))

    def _on_table(self, angles: Array, steps: int = 5) -> tuple[Complex, Complex]:
        """Solve from the certified node of each angle, the nearest towards zero."""
        if self._table is None:
            nodes = [*self._nodes[-1][:0:-1], *self._nodes[1]]
            self._table = (
                np.array([node.angle for node in nodes]),
                np.array([node.position for node in nodes]),
                np.array([node.direction for node in nodes]),
            )
        table_angles, positions, turns = self._table
        up = np.searchsorted(table_angles, angles, side="right") - 1
        index = np.where(
            angles >= 0.0, up, np.minimum(np.searchsorted(table_angles, angles), len(table_angles) - 1)
        )
        pivots = self._pivots.positions_of(angles)
        return closed_triads(positions[index], turns[index], pivots, self._platform, self._legs, steps)

    def _node(self, angle: float, position: complex, phase: complex) -> Node:
        vectors = leg_vectors(position, phase, self._pivots.positions(angle), self._platform)
        return Node(angle, position, phase, determinant(vectors, moments(vectors, phase, self._platform)))

    def _advance(self, side: int) -> None:
        """Take the longest certified step, or find the dead centre ahead."""
        nodes = self._nodes[side]
        current = nodes[-1]
        step = self._longest_step(current)
        if step < MIN_STEP:
            self._ends[side] = self._dead_centre(nodes)
            return
        if len(nodes) > MAX_STEPS:
            raise AssemblyError(
                f"the triad needs more than {MAX_STEPS} steps to reach crank angle {current.angle:.6g} rad; "
                "request fewer revolutions"
            )
        angle = current.angle + side * step
        position, phase = closed_triads(
            current.position,
            current.direction,
            self._pivots.positions(angle),
            self._platform,
            self._legs,
            steps=5,
        )
        nodes.append(self._node(angle, position, phase))
        self._table = None

    def _longest_step(self, node: Node) -> float:
        """Return a crank step in [rad] over which Newton's method from a node converges."""
        if node.determinant == 0.0:
            return 0.0
        vectors = leg_vectors(
            node.position, node.direction, self._pivots.positions(node.angle), self._platform
        )
        shift, turning = inverse(vectors, moments(vectors, node.direction, self._platform))
        gains = [abs(complex(abs(s) / self._extent, t)) for s, t in zip(shift, turning, strict=True)]
        second_derivative = sum(gain * b for gain, b in zip(gains, self._bends, strict=True))
        travel = sum(g * leg * v for g, leg, v in zip(gains, self._legs, self._travel, strict=True))
        step = MAX_KANTOROVICH / (second_derivative * travel) if travel > 0.0 else np.pi
        while not self._certified(gains, second_derivative, step):
            step *= 0.8
        return step

    def _certified(self, gains: list[float], second_derivative: float, step: float) -> bool:
        """Whether the Newton-Kantorovich theorem holds for all crank angles within a step.

        For displacements of at most d the leg errors are r d + d^2/2 and the gradients change by d times the
        arm; the second derivatives are bounded while no leg grows to twice its length.
        """
        moves = [v * step for v in self._travel]
        terms = list(zip(gains, moves, self._legs, self._arms, strict=True))
        rotated = sum(gain * move * arm for gain, move, _, arm in terms)
        if rotated >= 0.5:
            return False
        newton = sum(gain * move * (leg + 0.5 * move) for gain, move, leg, _ in terms) / (1.0 - rotated)
        if newton * second_derivative / (1.0 - rotated) > MAX_KANTOROVICH:
            return False
        return all(move + 2.0 * newton * arm <= leg for _, move, leg, arm in terms)

    def _dead_centre(self, path: list[Node]) -> float:
        """Return where the determinant d vanishes, by angle = end + p d^2 + q d^3 through three nodes."""
        last = path[-1]
        sizes = abs(np.array([node.determinant for node in path[-5000:]]))
        if len(path) < 3 or sizes[-1] == 0.0 or not sizes.max() >= 3.0 * sizes[-1]:
            return last.angle
        nodes = [last]
        for factor in (1.7, 3.0):
            nodes.append(path[-5000:][np.nonzero(sizes >= factor * sizes[-1])[0][-1]])
        d = np.array([node.determinant for node in nodes]) / last.determinant
        ahead = np.array([node.angle - last.angle for node in nodes])
        end = np.linalg.solve(np.stack([np.ones(3), d**2, d**3], 1), ahead)[0]
        return last.angle + float(end)
