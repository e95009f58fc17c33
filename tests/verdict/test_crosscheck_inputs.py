"""The verdict on every mechanism rejects a wrong mechanism and states the reason."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from catalog_faults import FAULTS, SWINGING
from grids import grid

from mechsim import catalog
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError
from mechsim.model.links import EX, EY, EZ
from mechsim.model.mechanism import Mechanism
from mechsim.simulation import simulate
from mechsim.studies.validate import case_of
from mechsim.verdict.crosscheck import crosscheck

SPEED = 20.0 * np.pi

# each fault by one method, each mechanism by both
CASES = [
    (name, fault, ("pose", "step")[i % 2])
    for name in catalog.MECHANISMS
    for i, fault in enumerate(FAULTS[name])
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "fault", "method"), CASES)
def test_a_wrong_mechanism_fails(name, fault, method):
    linkage = catalog.make(name)
    wrong = linkage.with_parameters(**FAULTS[linkage.name][fault])
    # a crank with a dead centre, as on the looper's other side, makes half a revolution
    turns = 1.0 if wrong.crank_range().full else 0.5
    run = simulate(wrong.mechanism, speed=SPEED, turns=turns, method=method, samples=36)
    verdict = crosscheck(run.motion, linkage)
    assert not verdict.passed, str(verdict)
    assert verdict.reason
    if "assembly" in fault:
        assert verdict.outcome == "changed assembly"


@pytest.mark.long
@pytest.mark.parametrize("name", grid(catalog.MECHANISMS))
@pytest.mark.parametrize("method", ["pose", "step"])
def test_the_correct_mechanism_passes(name, method):
    linkage = catalog.make(name)
    run = simulate(linkage.mechanism, speed=SPEED, method=method, samples=36)
    verdict = crosscheck(run.motion, linkage, speed=SPEED)
    assert verdict.passed, str(verdict)


def test_a_crank_that_rotates_backwards_fails():
    linkage = catalog.make("looper")
    run = simulate(linkage.mechanism, speed=-SPEED, samples=36, method="step")
    assert not crosscheck(run.motion, linkage, speed=SPEED).passed


def test_a_looper_with_a_wrong_cylinder_axis_fails():
    linkage = catalog.make("looper")
    rotated = _with_slide_along(linkage.mechanism, EZ)
    try:
        run = simulate(rotated, speed=SPEED, method="pose", samples=36)
    except AssemblyError:
        return  # cannot assemble: rejected even sooner
    assert not crosscheck(run.motion, linkage).passed


def _with_slide_along(mechanism: Mechanism, axis) -> Mechanism:
    slide = mechanism.joint("slide")
    rotated = replace(slide, a=replace(slide.a, axis=axis, reference=EX if axis == EZ else EY))
    return replace(
        mechanism, joints=tuple(rotated if joint.name == "slide" else joint for joint in mechanism.joints)
    )


@dataclass(frozen=True, kw_only=True)
class WrongClosedForm:
    """A wrong closed form: its rocker point is off by a thousandth."""

    solver: KinematicSolver

    def solve(self, *arguments):
        motion = self.solver.solve(*arguments)
        p3 = motion.points["P3"]
        return replace(motion, points={**motion.points, "P3": replace(p3, position=1.001 * p3.position)})

    def assembly_sign(self, points):
        return self.solver.assembly_sign(points)


def test_a_wrong_closed_form_fails():
    linkage = catalog.make("rssr")
    run = simulate(linkage.mechanism, speed=SPEED, samples=36, method="step")
    assert not crosscheck(run.motion, WrongClosedForm(solver=linkage)).passed


@pytest.mark.parametrize("name", grid(SWINGING, ("four_bar",)))
def test_swinging_cranks_are_validated_within_their_range(name):
    swinging = catalog.make(name, **SWINGING[name])
    arcs = swinging.crank_range()
    assert not arcs.full
    assert arcs.arcs
    case = case_of(swinging)
    assert case.passed, case.verdict.reason


def test_variants_of_a_mechanism_are_validated():
    case = case_of(catalog.make("rssr"))
    assert any(check.title == "guided, step: orientation of coupler" for check in case.verdict.checks)
    assert case.passed
