"""Public functions reject wrong arguments in one sentence with value and remedy."""

import ast
import importlib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mechsim as ms

LINKAGE = ms.catalog.make("rssr")
MECHANISM = LINKAGE.mechanism
RUN = ms.simulate(LINKAGE, speed=10.0, turns=0.1)
NAN = float("nan")


def simulated(**options):
    return ms.simulate(MECHANISM, **({"speed": 10.0, "turns": 0.1} | options))


def pendulum_of_no_size():
    joint = ms.Joint("crank", "revolute", ms.End("ground"), ms.End("bob"))
    return ms.Mechanism("dot", (ms.Link("bob"),), (joint,), "crank", {"P": ("bob", (0.0, 0.0, 0.0))})


def guessed(**pose):
    whole = {"position": np.zeros(3), "rotation": np.eye(3)} | pose
    return replace(MECHANISM, guess={name: ms.Pose(**whole) for name in MECHANISM.guess})


REJECTED = {
    "no source": (lambda: ms.simulate(None, speed=10.0), "a NoneType cannot be simulated; give a mechanism"),
    "speed in mm": (lambda: simulated(speed="600mm"), "the crank speed '600mm' has unit 'mm'"),
    "speed as list": (lambda: simulated(speed=[1.0, 2.0]), "give a finite speed"),
    "turns as text": (lambda: simulated(turns="2"), "2 turns requested; give a finite number"),
    "no turns": (lambda: simulated(turns=None), "None turns requested"),
    "tolerance in seconds": (lambda: simulated(tolerance="1us"), "the tolerance '1us' has unit 'us'"),
    "half a sample": (lambda: simulated(samples=2.5), "2.5 samples requested; take a whole number"),
    "settings as text": (
        lambda: simulated(settings="rk4"),
        "settings is of type str; give one of type Settings",
    ),
    "scene as text": (lambda: simulated(scene="motion"), "scene is of type str; give one of type Scene"),
    "profile as function": (
        lambda: simulated(profile=np.sin),
        "profile is of type ufunc; give one of type CrankProfile",
    ),
    "no points": (lambda: ms.simulate(replace(MECHANISM, points={}), speed=10.0), "no point to track"),
    "no size in MuJoCo": (lambda: ms.simulate(pendulum_of_no_size(), speed=10.0), "dot has no extent"),
    "no size by the loops": (lambda: ms.loops.solve(pendulum_of_no_size(), [0.0]), "dot has no extent"),
    "guess not a number": (lambda: guessed(position=np.full(3, NAN)), "position of shape .* or with NaN"),
    "guess too short": (lambda: guessed(rotation=np.eye(2)), r"rotation of shape \(2, 2\)"),
    "guess of nothing": (
        lambda: replace(MECHANISM, guess={"crank": None}),
        "is of type NoneType; give one of type Pose",
    ),
    "start as text": (lambda: replace(MECHANISM, start="0"), "start is 0 rad; give a finite crank angle"),
    "links as names": (lambda: replace(MECHANISM, links=("crank",)), "is of type str; give one of type Link"),
    "no joints": (
        lambda: replace(MECHANISM, joints=None),
        "joints of 'rssr' are of type NoneType; give a tuple",
    ),
    "a point of two": (
        lambda: replace(MECHANISM, points={"P": ("crank", (0.0, 1.0))}),
        "three finite numbers",
    ),
    "a point without place": (lambda: replace(MECHANISM, points={"P": "crank"}), "give a link and three"),
    "a joint between names": (
        lambda: ms.Joint("j", "revolute", "ground", "crank"),
        "is of type str; give one of type End",
    ),
    "an axis as text": (lambda: ms.End("crank", axis="z"), "axis z of a joint .* three finite numbers"),
    "a gear as text": (lambda: replace(MECHANISM, gears=(ms.Gear("crank", "crank", "2"),)), "ratio of gear"),
    "no mechanism by the loops": (lambda: ms.loops.solve(None, [0.0]), "a mechanism is of type NoneType"),
    "no crank angles": (lambda: ms.loops.solve(MECHANISM, []), "must be a list of finite numbers"),
    "half a range": (lambda: ms.loops.solve(MECHANISM, "0:1"), "must be start:stop:step"),
    "loop speed as words": (lambda: ms.loops.solve(MECHANISM, [0.0], "fast"), "speed 'fast' is not a"),
    "a name of nothing": (lambda: ms.catalog.make(None), "there is no mechanism None"),
    "a mechanism for a run": (
        lambda: ms.crosscheck(LINKAGE, LINKAGE),
        "is of type .*; give one of type Motion",
    ),
    "nothing to compare": (lambda: ms.crosscheck(RUN.motion, None), "the analytic side is of type NoneType"),
    "places as text": (
        lambda: ms.crosscheck(RUN.motion, lambda f: {"P3": "x"}),
        "type function; give a motion",
    ),
    "a load as text": (lambda: ms.Load("P3", "3 N"), "the load on P3 is of type str"),
    "a spring as text": (lambda: ms.Spring("P2", "P3", "soft"), "stiffness of the spring .* is soft"),
    "gravity as text": (lambda: ms.Forces(gravity="down"), "gravity is down m/s2; give three finite"),
    "no dynamic model": (
        lambda: ms.dynamics.prescribed(LINKAGE, [0.0], 1.0),
        "type KinematicSolver; give one of type DynamicModel",
    ),
    "rods for nothing": (lambda: ms.masses.with_inertia(None), "a mechanism is of type NoneType"),
    "density as text": (lambda: ms.masses.with_inertia(MECHANISM, "steel"), "density of the rods is steel"),
    "a number for text": (lambda: ms.units.parse_length(3.0), "the length must be text such as"),
    "text for rpm": (lambda: ms.units.rpm("600 rpm"), r"or read text by units\.parse_speed"),
    "an unknown unit": (lambda: ms.units.parse("3", "mm"), "the value cannot be converted to 'mm'"),
}


@pytest.mark.parametrize("name", REJECTED)
def test_wrong_arguments_are_rejected_in_one_sentence(name):
    wrong, output = REJECTED[name]
    with pytest.raises(ms.InputError, match=output) as rejected:
        wrong()
    assert "\n" not in str(rejected.value)


PUBLIC = """
    Agreement AssemblyError Certificate Check Controller Coupling End Forces Friction Gear Inertia
    InputError Joint JointSpring Link Load Look Mechanism MechsimError Motion MotionLaws Pose Run Scene
    Settings Spring Tolerance Validation Verdict __version__ assemblies catalog certify check closed_qpos
    compile crosscheck dynamics export fit formulas identify joint_map list load load_profile loops masses
    motors moved plot plots reduce render sample sensitivity show simulate simulation sweep testing
    tolerance_study trace tune units validate vectors view
"""
NAMES = PUBLIC.split()


def test_dir_lists_exactly_the_public_names():
    assert dir(ms) == sorted(NAMES) == sorted(ms.__all__)
    for name in NAMES:
        assert getattr(ms, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        getattr(ms, "nothing")  # noqa: B009


@pytest.mark.parametrize(
    "line",
    [
        "from mechsim import catalog, loops, load_profile, dynamics, motors, plots, masses, units",
        "import mechsim as ms; ms.Look, ms.plots.motion_plot, ms.load_profile.constant",
        "import mechsim as ms; ms.masses.with_inertia, ms.motors, ms.simulation.simulate",
        "from mechsim import *; catalog.make('rssr'), Look",
    ],
)
def test_documented_imports_work(line):
    exec(compile(line, "a user's script", "exec"), {})


def test_declarations_for_type_checkers_match_the_runtime():
    tree = ast.parse(Path(ms.__file__).read_text())
    (block,) = [n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    reported = {}
    for statement in block.body:
        home = importlib.import_module(statement.module)
        reported |= {item.asname or item.name: (home, item.name) for item in statement.names}
    assert set(reported) == set(NAMES) - {"__version__"}
    for name, (home, name_in_home) in reported.items():
        inside = f"{home.__name__}.{name_in_home}"
        declared = (
            vars(home).get(name_in_home) if name_in_home in vars(home) else importlib.import_module(inside)
        )
        assert getattr(ms, name) is declared
    assert (Path(ms.__file__).parent / "py.typed").is_file()


MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize(
    "source",
    ["four_bar", MODELS / "four_bar.xml", mujoco.MjSpec.from_file(str(MODELS / "four_bar.xml"))],
    ids=["name", "path", "object"],
)
def test_dynamics_accepts_names_files_and_mujoco_objects(source):
    run = ms.dynamics.run(source, initial={"crank.q": "30deg"}, duration="10ms", samples=2)
    assert run.motion.joints["crank"].value[0] == pytest.approx(np.pi / 6.0, abs=1e-12)


def test_validate_runs_every_method_without_a_formula():
    result = ms.validate("four_bar", stepped=False)
    assert result.passed
    assert {check.method for check in result.checks} == {"formula", "pose"}
    assert ms.validate("four_bar", stepped=False, speed="1rpm").why == result.why
