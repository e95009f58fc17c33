"""Documented tolerances by method: a change in the table must be repeated here, with its reason."""

import re

import pytest

from mechsim.compare.quantities import (
    CRANK_DRIVE,
    DRIVERS,
    FORCES,
    MOTION,
    QUANTITIES,
)
from mechsim.numerics.arrays import EPS

# method -> fraction of the scale, factor of the requested tolerance, power of the conditioning
FORCE = {"pose": (1e-10, 0.0, 5), "step": (1e-5, 0.0, 0)}
ENERGY = {"pose": (1e-12, 0.0, 3), "step": (1e-8, 0.0, 0)}
POWER = {"pose": (1e-10, 0.0, 5), "step": (4e-7, 0.0, 0)}
ANGLE = {"pose": (1024 * EPS, 0.0, 1), "step": (0.0, 10.0, 1)}
DRIVER = {"pose": (20000 * EPS, 0.0, 0), "step": (0.001, 0.0, 0)}
FUNCTIONS = {
    "velocity": {"closed form": (1024 * EPS, 0.0, 3)},
    "acceleration": {"closed form": (4096 * EPS, 0.0, 5)},
}
DOCUMENTED = {
    "position": {"pose": (512 * EPS, 0.0, 1), "step": (0.0, 1.0, 0)},
    "velocity": {"pose": (2048 * EPS, 0.0, 3), "step": (0.0, 30.0, 2), **FUNCTIONS["velocity"]},
    "acceleration": {"pose": (8192 * EPS, 0.0, 5), "step": (0.0, 300.0, 4), **FUNCTIONS["acceleration"]},
    "displacement": {"pose": (128 * EPS, 0.0, 1), "step": (0.0, 1.0, 0)},
    "loop": {"pose": (256 * EPS, 0.0, 0), "step": (0.0, 10.0, 0)},
    "drive speed": {"pose": (2000 * EPS, 0.0, 0), "step": (1e-8, 0.0, 0)},
    "drive": {"pose": (20000 * EPS, 0.0, 0), "step": (1e-7, 0.0, 0)},
    "drive torque": {**FORCE, "step": (1e-6, 0.0, 0)},
    "accelerations under these forces": {
        "pose": (1e-8, 0.0, 0),
        "step": (0.001, 0.0, 0),
    },
    **dict.fromkeys(("angle", "orientation"), ANGLE),
    **dict.fromkeys(("driver angle", "driver displacement"), DRIVER),
    **dict.fromkeys(("force", "moment", "gear torque", "mesh force", "driver effort"), FORCE),
    **dict.fromkeys(("kinetic energy", "potential energy"), ENERGY),
    **dict.fromkeys(("power loads", "power lost"), POWER),
}
MEASURED = re.compile(r"measured (?P<number>[\d.]+(e-\d+)?)")


@pytest.mark.parametrize("name", DOCUMENTED)
def test_tolerances_have_the_documented_values(name):
    result = {
        route: (limit.fixed, limit.requested, limit.power) for route, limit in QUANTITIES[name].bounds.items()
    }
    assert result == {
        route: pytest.approx(row, rel=1e-12, abs=0.0) for route, row in DOCUMENTED[name].items()
    }


def test_every_quantity_has_a_unique_name_and_a_documented_tolerance():
    assert len(QUANTITIES) == len((*MOTION, *CRANK_DRIVE, *DRIVERS, *FORCES))
    assert DOCUMENTED.keys() == QUANTITIES.keys()


def test_tolerances_are_at_most_a_hundred_times_the_measured_errors():
    stated = 0
    for row in QUANTITIES.values():
        for limit in row.bounds.values():
            output = MEASURED.search(limit.reason)
            if output:
                unit = EPS if " eps" in limit.reason else 1.0
                stated += 1
                # rounding errors were measured over random linkages, and their tolerances are close to them
                low, high = (3.0, 30.0) if " eps" in limit.reason else (1.2, 100.01)
                assert low <= limit.fixed / (float(output["number"]) * unit) <= high, (row.name, limit.reason)
    assert stated >= 10
