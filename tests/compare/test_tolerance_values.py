"""Documented tolerances by method: a change in the table must be repeated here, with its reason."""

import re
from functools import cache

import pytest
from catalog_faults import SWINGING
from grids import grid

from mechsim import catalog, loops
from mechsim.compare import quantities
from mechsim.compare.crosscheck import crosscheck
from mechsim.compare.tolerances import WELL_CONDITIONED
from mechsim.kinematics.loops.motion import conditioning_of
from mechsim.mechanism.motion_laws import swing
from mechsim.numerics.arrays import EPS
from mechsim.simulation import Settings, simulate
from mechsim.studies import validate
from mechsim.studies.validate import case_of

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
        route: (limit.fixed, limit.requested, limit.power)
        for route, limit in quantities.QUANTITIES[name].bounds.items()
    }
    assert result == {
        route: pytest.approx(row, rel=1e-12, abs=0.0) for route, row in DOCUMENTED[name].items()
    }


def test_every_quantity_has_a_unique_name_and_a_documented_tolerance():
    assert len(quantities.QUANTITIES) == len(
        (*quantities.MOTION, *quantities.CRANK_DRIVE, *quantities.DRIVERS, *quantities.FORCES)
    )
    assert DOCUMENTED.keys() == quantities.QUANTITIES.keys()


def test_tolerances_are_at_most_a_hundred_times_the_measured_errors():
    stated = 0
    for row in quantities.QUANTITIES.values():
        for limit in row.bounds.values():
            output = MEASURED.search(limit.reason)
            if output:
                unit = EPS if " eps" in limit.reason else 1.0
                stated += 1
                # rounding errors were measured over random linkages, and their tolerances are close to them
                low, high = (3.0, 30.0) if " eps" in limit.reason else (1.2, 100.01)
                assert low <= limit.fixed / (float(output["number"]) * unit) <= high, (row.name, limit.reason)
    assert stated >= 10


def near_a_dead_centre(name, fraction):
    """Return a mechanism that swings over a fraction of its range, and that swing."""
    linkage = catalog.make(name, **SWINGING[name])
    low, high = linkage.crank_range().arcs[0]
    return linkage, swing(0.5 * (low + high), 0.5 * fraction * (high - low), 20.0)


@pytest.mark.long
def test_validation_reduces_steps_until_the_run_converges(monkeypatch):
    # a random warp knitter near a dead centre fails with 1000 steps per revolution, this one with four
    monkeypatch.setattr(validate, "STEPS", 4)
    linkage = catalog.make("warp_knitter")
    assert simulate(linkage.mechanism, speed=60.0, settings=Settings(steps_per_turn=4)).outcome == "diverged"
    case = case_of(linkage)
    assert case.passed, case.verdict.reason
    assert case.run.steps > 4


@cache
def close_to_a_dead_centre(name):
    """Return a mechanism, and its solved configurations over 0.9999 of its range."""
    linkage, profile = near_a_dead_centre(name, 0.9999)
    return linkage, simulate(linkage.mechanism, profile=profile, method="pose", samples=72)


@pytest.mark.long
@pytest.mark.parametrize("name", grid(SWINGING, ("four_bar",)))
def test_configurations_near_a_dead_centre_pass(name):
    linkage, run = close_to_a_dead_centre(name)
    verdict = crosscheck(run, linkage)
    assert run.outcome == verdict.outcome == "passed", str(verdict)


@pytest.mark.long
@pytest.mark.parametrize("name", grid(SWINGING, ("four_bar",)))
@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_link_too_long_by_a_thousandth_fails_near_a_dead_centre(name, method):
    # at 0.98 of its range a slider-crank has a conditioning of 0.17
    linkage, profile = near_a_dead_centre(name, 0.995 if name == "slider_crank" else 0.98)
    longer = next(item for item in ("coupler", "rod", "link", "rod3") if hasattr(linkage, item))
    wrong = linkage.with_parameters(**{longer: 1.001 * getattr(linkage, longer)})
    settings = Settings() if method == "step" else None
    run = simulate(wrong.mechanism, profile=profile, method=method, settings=settings, samples=72)
    verdict = crosscheck(run.motion, linkage)
    assert not verdict.passed
    # the run includes poorly conditioned instants
    conditioning = conditioning_of(linkage.mechanism, linkage.solve(run.motion.angle))
    assert conditioning.min() < WELL_CONDITIONED


@pytest.mark.long
@pytest.mark.parametrize("name", grid(["four_bar", "rssr", "slider_crank", "rrsrr"], ("four_bar",)))
def test_both_methods_report_the_conditioning_of_the_loops(name):
    """The methods use different coordinates: conditionings are similar, and fall at a dead centre."""
    linkage, run = close_to_a_dead_centre(name)
    simulated, exact = (
        run.motion.conditioning,
        conditioning_of(linkage.mechanism, linkage.solve(run.motion.angle)),
    )
    own = loops.solve(linkage.mechanism, run.motion.angle).conditioning
    for item in (simulated, own):
        assert 0.05 < (item / exact).min() <= (item / exact).max() < 20.0
    for item in (simulated, own, exact):
        assert item[0] < 0.1 * item.max()
