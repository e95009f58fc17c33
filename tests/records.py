"""Records of forces, zero where a test states nothing else."""

from typing import Any

import numpy as np

from mechsim.mechanism.force_record import ForceRecord, Reaction
from mechsim.numerics.arrays import Array

ZERO = ("acceleration", "torque", "kinetic", "potential", "power_in", "power_loads", "power_lost", "residual")


def force_record(angle: Array, force: Array | None = None, **fields: Any) -> ForceRecord:
    """Return the forces of a mechanism of 0.1 m at crank angles (n,), with one reaction."""
    zero, flat = np.zeros(len(angle)), np.zeros((len(angle), 3))
    reaction = Reaction(
        link="rod", by="crank", force=flat if force is None else force, moment=flat, point=flat
    )
    values = {"characteristic_length": 0.1, "time": None, "angle": angle, "speed": zero + 2.0, "gears": {}}
    values |= {"reactions": {"A": reaction}, "sliding": np.ones((len(angle), 1))}
    return ForceRecord(**(dict.fromkeys(ZERO, zero) | values | fields))
