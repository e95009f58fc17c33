"""The commands that a trade-off advises are taken by the command line."""

import shlex

from mechsim.simulation import Settings
from mechsim.studies.tradeoff import Build, Family, Point
from mechsim.studies.tradeoff.advice import command

SPEED = 20.0
SOFT = Settings(
    steps_per_turn=288,
    integrator="implicitfast",
    constant_steps=2.0,
    hardness=1.0,
    refsafe=True,
    diagexact=True,
    jacobian="dense",
)


def point(settings, build):
    return Point(Family(name="one", base=settings, rank=0, build=build), settings, {})


def test_a_command_has_an_option_for_every_setting(mechsim):
    words = shlex.split(command(point(SOFT, Build(cut=("slide",))), "slider_crank", SPEED))[1:]
    answer = mechsim(*words, "--json")
    assert answer.code in (0, 1), answer.err
    assert '"refsafe": true' in answer.out
    assert '"steps_per_turn": 288' in answer.out
