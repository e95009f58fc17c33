"""Every mechanism's verdict is shown a wrong mechanism and must say no, and why."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mechsim import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.mechanism import EX, EY, EZ, Mechanism
from mechsim.simulation import simulate
from mechsim.studies.validate import validate
from mechsim.verdict.judge import crosscheck

SPEED = 20.0 * np.pi

# mechanism -> what was built wrong, as parameters
WRONG = {
    "four_bar: coupler 0.1 % long": ("four_bar", {"coupler": 0.091 * 1.001}),
    "four_bar: other assembly": ("four_bar", {"branch": -1}),
    "slider_crank: rod 0.1 % long": ("slider_crank", {"rod": 0.2 * 1.001}),
    "slider_crank: slide 0.1 mm low": ("slider_crank", {"offset": 0.0099}),
    "rssr: coupler 0.1 % long": ("rssr", {"coupler": 0.046 * 1.001}),
    "rssr: coupler and rocker swapped": ("rssr", {"coupler": 0.0461, "rocker": 0.0269}),
    "rssr: rocker axis turned by 0.1 deg": ("rssr", {"gamma1": np.deg2rad(20.1)}),
    "rssr: sign of gamma2": ("rssr", {"gamma2": -np.deg2rad(30.0)}),
    "rssr: other assembly": ("rssr", {"branch": 1}),
    "rrsrr: link 0.1 % long": ("rrsrr", {"link": 0.039 * 1.001}),
    "rrsrr: sign of gamma2": ("rrsrr", {"gamma2": -np.deg2rad(15.0)}),
    "rrsrr: other assembly": ("rrsrr", {"branch": -1}),
    "warp_knitter: gear one tooth in a hundred off": ("warp_knitter", {"gear_ratio": -2.02}),
    "warp_knitter: another assembly of the triad": ("warp_knitter", {"assembly": 1}),
    "warp_knitter: rod 5 0.1 % long": ("warp_knitter", {"rod5": 0.049 * 1.001}),
    "looper: follower 0.1 % long": ("looper", {"follower": 0.0133 * 1.001}),
    "looper: other side": ("looper", {"side": -1}),
}


@pytest.mark.parametrize("case", WRONG)
@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_mechanism_built_wrong_is_refused(case, method):
    name, wrong = WRONG[case]
    drive = catalog.make(name)
    # the looper's other side cannot go round: its crank has a dead centre at 256 degrees
    turns = 0.5 if "side" in case else 1.0
    run = simulate(replace(drive, **wrong).mechanism, speed=SPEED, turns=turns, method=method, samples=36)
    verdict = crosscheck(run.motion, drive)
    assert not verdict.passed, str(verdict)
    assert verdict.reason
    if "assembly" in case:
        assert verdict.outcome in ("changed assembly", "missed")
        assert verdict.outcome == "changed assembly" or name == "warp_knitter"


@pytest.mark.parametrize("name", catalog.DRIVES)
@pytest.mark.parametrize("method", ["pose", "step"])
def test_the_mechanism_built_right_is_accepted(name, method):
    drive = catalog.make(name)
    run = simulate(drive.mechanism, speed=SPEED, method=method, samples=36)
    verdict = crosscheck(run.motion, drive, speed=SPEED)
    assert verdict.passed, str(verdict)


def test_a_crank_turning_backwards_is_refused():
    drive = catalog.make("looper")
    run = simulate(drive.mechanism, speed=-SPEED, samples=36, method="step")
    assert not crosscheck(run.motion, drive, speed=SPEED).passed


def test_the_looper_with_its_cylinder_along_z_as_paper_004_eq_6_has_it_is_refused():
    drive = catalog.make("looper")
    turned = _with_slide_along(drive.mechanism, EZ)
    try:
        run = simulate(turned, speed=SPEED, method="pose", samples=36)
    except catalog.base.AssemblyError:
        return  # cannot assemble: refused even sooner
    assert not crosscheck(run.motion, drive).passed


def _with_slide_along(mechanism: Mechanism, axis) -> Mechanism:
    slide = mechanism.joint("slide")
    turned = replace(slide, a=replace(slide.a, axis=axis, mark=EX if axis == EZ else EY))
    return replace(
        mechanism, joints=tuple(turned if joint.name == "slide" else joint for joint in mechanism.joints)
    )


@dataclass(frozen=True, kw_only=True)
class Lying:
    """A closed form that lies: its rocker point is off by a thousandth."""

    drive: ClosedForm

    def solve(self, *given):
        motion = self.drive.solve(*given)
        p3 = motion.points["P3"]
        return replace(motion, points={**motion.points, "P3": replace(p3, position=1.001 * p3.position)})

    def assembly_sign(self, points):
        return self.drive.assembly_sign(points)


def test_a_closed_form_that_lies_is_refused():
    drive = catalog.make("rssr")
    run = simulate(drive.mechanism, speed=SPEED, samples=36, method="step")
    assert not crosscheck(run.motion, Lying(drive=drive)).passed


SWINGING = {
    "four_bar": {"rocker": 0.030},
    "slider_crank": {"rod": 0.055},
    "rssr": {"rocker": 0.009},
    "rrsrr": {"link": 0.054},
}


@pytest.mark.parametrize("name", SWINGING)
def test_cranks_that_only_swing_are_validated_inside_their_range(name):
    swinging = catalog.make(name, **SWINGING[name])
    arcs = swinging.crank_range()
    assert not arcs.full
    assert arcs.arcs
    case = validate(swinging)
    assert case.passed, case.reason


def test_variants_of_a_mechanism_are_validated_with_it():
    case = validate(catalog.make("rssr"))
    assert any(check.quantity == "guided, step: orientation of coupler" for check in case.checks)
    assert case.passed
