"""Limits of joints over a motion: between its instants too, and how far a crank may move within them."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.mechanism.limits import INSTANTS, Ranges, check_instants, extremes, require_within
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import ROUNDING, Array
from mechsim.numerics.newton import root


@dataclass(frozen=True, slots=True)
class JointRanges:
    """Limits of joints, checked over a motion.

    Attributes:
        mechanism: the mechanism.
        ranges: joint -> lower and upper limit, in [m] or [rad].
        solve: path parameters (n,) -> motion.
        label: path parameter -> name of the instant in messages.
    """

    mechanism: Mechanism
    ranges: Ranges
    solve: Callable[[Array], Motion]
    label: Callable[[float], str]

    def require(self, motion: Motion) -> None:
        """Raise AssemblyError for a motion in which a joint leaves its range, between instants too."""
        if motion.speed.any() and np.ptp(motion.angle) > 0.0:
            # instants at which the loops do not close are not part of the request
            dense = None
            with suppress(AssemblyError):
                dense = self._with_extremes(check_instants(motion.angle.min(), motion.angle.max()))
            if dense is not None:
                self._require(*dense)
        self._require(motion.angle, {name: joint.value for name, joint in motion.joints.items()})

    def reach(self, start: float, end: float) -> float | None:
        """Return the crank angle reached from a start towards an end, in [rad]; None if there is none."""
        parameters, values = self._with_extremes(np.linspace(min(start, end), max(start, end), INSTANTS + 1))
        if not values:
            return end
        if end < start:
            parameters, values = parameters[::-1], {name: value[::-1] for name, value in values.items()}
        excess = self._excess(values)
        slack = ROUNDING * max(1.0, *(float(np.abs(value).max()) for value in values.values()))
        if not (excess > slack).any():
            return end
        first = int(np.argmax(excess > slack))
        if first == 0:
            return None
        inside, outside = float(parameters[first - 1]), float(parameters[first])
        if excess[first - 1] >= 0.0:
            return inside
        return root(
            lambda angle: float(self._excess(self._values(np.array([angle])))[0]), *sorted((inside, outside))
        )

    def _excess(self, values: Mapping[str, Array]) -> Array:
        """Return the largest violation of a joint range, (n,); negative within all ranges."""
        limits = [(value, *self.ranges[name]) for name, value in values.items()]
        return np.max([np.maximum(low - value, value - high) for value, low, high in limits], axis=0)

    def _with_extremes(self, instants: Array) -> tuple[Array, dict[str, Array]]:
        """Return path parameters (n,) with those of the extrema in between, and the joint values there."""
        values = self._values(instants)
        between = extremes(instants, values.values())
        if not len(between):
            return instants, values
        more = self._values(between)
        order = np.argsort(parameters := np.concatenate([instants, between]), kind="stable")
        return parameters[order], {name: np.concatenate([values[name], more[name]])[order] for name in values}

    def _values(self, parameter: Array) -> dict[str, Array]:
        joints = self.solve(parameter).joints
        return {name: joints[name].value for name in self.ranges if name in joints}

    def _require(self, parameter: Array, values: Mapping[str, Array]) -> None:
        require_within(
            self.mechanism.name,
            self.ranges,
            values,
            {name: self.mechanism.unit(name) for name in self.ranges},
            lambda index: self.label(float(parameter[index])),
            "move the drivers less",
        )
