"""Every link is in equilibrium under all reported forces, by both methods."""

import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import driven_mechanisms as machines
import equilibrium
import gear_trains
import numpy as np
import pytest
from every_force import every_force
from model_files import stated_mechanism

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.motion_laws import make_motion_laws
from mechsim.simulation.dynamics.prescribed_motion import driven

ROBUSTNESS = Path(__file__).parents[2] / "validation" / "robustness"
GALLERY = Path(__file__).parents[2] / "models" / "gallery"
# seeds of random linkages that cover every kind of joint, gears, a rack and polynomials
LINKAGES = (16, 17, 19, 22, 33, 38, 43, 54)
# joints with friction that the check describes
RUBBING = ("revolute", "prismatic", "spherical", "cylindrical", "screw")
TRAINS = (0, 1, 2, 3)
METHODS = ("analytic", "MuJoCo")
# relative to the largest force; measured rounding at most 5e-15
BALANCED = 1e-12
TWO_ARMS = {"left": (2.0, 0.3, 6.0, 0.2), "right": (1.0, 0.4, 9.0, 1.0)}


@dataclass(frozen=True)
class Case:
    """A mechanism with inertias, its forces, and the motion laws of its drivers over a second."""

    mechanism: ms.Mechanism
    forces: ms.Forces
    laws: dict

    @property
    def moves(self):
        return make_motion_laws(self.mechanism, self.laws, 1.0)


def solved(case: Case, method: str) -> tuple[ms.Motion, ForceRecord]:
    """Return motion and forces at six instants by one of the methods."""
    moves = case.moves
    if method == "MuJoCo":
        run = driven(case.mechanism, case.forces, motion_laws=moves, method="pose", samples=5)
        return run.motion, run.forces
    model = ms.dynamics.dynamic_model(KinematicSolver(case.mechanism, motion_laws=moves), case.forces)
    time = np.linspace(0.0, 1.0, 6)
    return model.solver.solve(t=time), ms.dynamics.prescribed(model, t=time).forces


@cache
def linkage(seed: int) -> Case:
    """Return a random linkage of the robustness study with a random inertia on every link."""
    sys.path.insert(0, str(ROBUSTNESS))
    try:
        from random_mechanism_files import random_mechanism
    finally:
        sys.path.remove(str(ROBUSTNESS))
    case_data, chance = random_mechanism(seed), np.random.default_rng(seed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drawn.toml"
        path.write_text(case_data.text, "utf-8")
        mechanism = ms.load(path).mechanism
    length = mechanism.characteristic_length

    def inertia() -> ms.Inertia:
        spread = chance.normal(size=(3, 3))
        spread = spread @ spread.T + 0.5 * np.eye(3)
        moments = 0.05 * length**2 * (np.trace(spread) * np.eye(3) - spread)
        centre = tuple((0.3 * length * chance.normal(size=3)).tolist())
        return ms.Inertia(1.0, centre, tuple(tuple(row) for row in moments.tolist()))

    mechanism = replace(mechanism, links=tuple(replace(item, inertia=inertia()) for item in mechanism.links))
    start = case_data.pose[len(case_data.pose) - len(case_data.names) :]
    laws = {
        case_data.names[i]: machines.sinusoidal(start[i], 0.05 * swing, 2.0, 0.3)
        for i, swing in zip(case_data.drivers, case_data.amplitudes, strict=True)
    }
    return Case(mechanism, acting(mechanism), laws)


@cache
def train(seed: int) -> Case:
    mechanism = gear_trains.train(seed)
    return Case(mechanism, acting(mechanism), {"crank": machines.sinusoidal(0.1, 0.5, 3.0, 0.4)})


@cache
def spindle_and_rack(spindle_first: bool) -> Case:
    mechanism = gear_trains.spindle_and_rack(0, spindle_first)
    return Case(mechanism, acting(mechanism), {"crank": machines.sinusoidal(0.1, 0.5, 3.0, 0.4)})


@cache
def of_gallery(name: str) -> Case:
    solver = ms.load(str(GALLERY / f"{name}.toml"))
    mechanism = ms.dynamics.dynamic_model(solver).mechanism
    wave = machines.sinusoidal(mechanism.start + 0.1, 0.2, 3.0, 0.4)
    return Case(mechanism, acting(mechanism), {mechanism.driver: wave})


def sinusoidally_driven(mechanism: ms.Mechanism, **waves: tuple[float, ...]) -> Case:
    """Return a mechanism with rods for its inertias, whose drivers move sinusoidally."""
    whole = ms.dynamics.dynamic_model(mechanism).mechanism
    laws = {name: machines.sinusoidal(*wave) for name, wave in waves.items()}
    return Case(whole, acting(whole), laws)


def locked_rack() -> ms.Mechanism:
    """Return a pinion that drives a rack, with a locked joint."""
    mesh = ms.Coupling("mesh", "rack", "crank", (0.001, 0.02))
    whole = machines.rack_and_cam()
    return replace(whole, driver=("crank",), couplings=(mesh,), locked={"cam": 0.01})


def acting(mechanism: ms.Mechanism) -> ms.Forces:
    """Return forces of every kind, dry friction only in moving joints: at rest it has no direction."""
    driven_joints = [joint.name for joint in mechanism.driven_joints if not KINDS[joint.kind].mixed]
    forces = every_force(mechanism, RUBBING, driven_joints, viscous=5.0)
    springs = tuple(item for item in forces.joint_springs if item.joint in driven_joints)
    return replace(forces, joint_springs=springs)


CASES = {
    **{f"linkage {seed}": lambda seed=seed: linkage(seed) for seed in LINKAGES},
    **{f"train {seed}": lambda seed=seed: train(seed) for seed in TRAINS},
    # a geared joint is split in MuJoCo's model, by a virtual body of the wheel or of its carrier
    "screw feed on its arm": lambda: spindle_and_rack(False),
    "screw feed, spindle first": lambda: spindle_and_rack(True),
    **{name: lambda name=name: of_gallery(name) for name in ("planetary_gear", "rack_steering")},
    "five-bar": lambda: sinusoidally_driven(machines.five_bar(), **TWO_ARMS),
    "boom": lambda: sinusoidally_driven(machines.boom(), stroke=(0.8, 0.1, 2.0)),
    "locked rack": lambda: sinusoidally_driven(locked_rack(), crank=(0.3, 1.0, 2.0)),
    "nonlinear rack": lambda: sinusoidally_driven(machines.nonlinear_rack(), crank=(0.3, 1.0, 2.0)),
    "nonlinear passive joint": lambda: sinusoidally_driven(machines.five_bar_with_cam(), **TWO_ARMS),
    # a plate of 9 g with nonlinear couplings to a tool of 2 mg and between its coordinates
    "nonlinear table": lambda: sinusoidally_driven(machines.table(backwards=False), tool=(0.3, 1.0, 2.0)),
}


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", CASES)
def test_every_link_is_in_equilibrium_under_its_reported_forces(case, method):
    case_data = CASES[case]()
    motion, record = solved(case_data, method)
    assert equilibrium.largest_imbalance(case_data.mechanism, case_data.forces, motion, record) <= BALANCED
    # a moment along a free axis would be an unreported drive
    assert equilibrium.largest_work(case_data.mechanism, motion, record) <= BALANCED
    assert equilibrium.largest_slip(case_data.mechanism, motion, record) <= BALANCED


@pytest.mark.long
def test_the_cases_cover_every_kind_of_joint_and_coupling():
    case_data = [CASES[case]().mechanism for case in CASES]
    kinds = {joint.kind for mechanism in case_data for joint in mechanism.joints}
    every = "revolute prismatic cylindrical screw universal spherical planar fixed"
    assert kinds == {*every.split()}
    nonlinear = [law for mechanism in case_data for law in mechanism.couplings if len(law.coefficients) > 2]
    assert len(nonlinear) > len(TRAINS)
    meshing = {"crank-wheel", "crank-planet", "planet-second", "crank-bevel", "planet-rack"}
    _, record = solved(train(TRAINS[0]), "analytic")
    assert {*record.meshes} == meshing
    # skew shafts, a thread and a cam groove have no pitch point
    assert {*record.gears} - meshing == {"crank-skew", "thread.turn-thread.way", "wheel-cam"}


@pytest.mark.long
@pytest.mark.parametrize(("case", "method"), [("linkage 38", "MuJoCo"), ("train 1", "analytic")])
def test_the_check_detects_every_omitted_force(case, method):
    case_data = CASES[case]()
    motion, record = solved(case_data, method)
    names = {item.name for item in equilibrium.actions(case_data.mechanism, case_data.forces, motion, record)}
    assert len(names) > 20
    for name in names:
        imbalance = equilibrium.largest_imbalance(
            case_data.mechanism, case_data.forces, motion, record, without=name
        )
        assert imbalance > 1e4 * BALANCED, name


def press() -> Case:
    """A spindle whose nut presses with 100 N."""
    mechanism = stated_mechanism("link_equilibrium_press.toml")
    forces = ms.Forces(loads=(ms.Load("P", ms.load_profile.constant((0.0, 0.0, -100.0))),))
    return Case(mechanism, forces, {"motor": lambda t: (2.0 * t, 2.0 + 0.0 * t, 0.0 * t)})


@pytest.mark.parametrize("method", METHODS)
def test_the_thread_of_a_press_carries_load_and_torque(method):
    case_data = press()
    _, record = solved(case_data, method)
    thread = record.reactions["thread"]
    force, moment = (vectors[:, 2] for vectors in (thread.force, thread.moment))
    np.testing.assert_allclose(force, 100.0, rtol=1e-12)
    np.testing.assert_allclose(moment, -100.0 * 0.005 / (2.0 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(record.drives["motor"], moment, rtol=1e-12)
    if method == "analytic":
        assert {"fz", "mz"}.isdisjoint(thread.undetermined)


@pytest.mark.parametrize("method", METHODS)
def test_the_force_of_a_joint_that_is_locked_under_a_crank_balances_its_links(method):
    whole = train(1)
    mechanism = replace(whole.mechanism, couplings=whole.mechanism.couplings[:1], locked={"cam": 0.01})
    if method == "MuJoCo":
        run = driven(mechanism, whole.forces, speed=3.0, turns=0.1, method="pose", samples=4)
        motion, record = run.motion, run.forces
    else:
        model = ms.dynamics.dynamic_model(mechanism, whole.forces)
        angles = np.linspace(0.0, 0.6, 5)
        motion, record = model.solver.solve(angles, 3.0), ms.dynamics.prescribed(model, angles, 3.0).forces
    assert {*record.locked} == {"cam"}
    assert equilibrium.largest_imbalance(mechanism, whole.forces, motion, record) <= BALANCED


def test_bearing_forces_of_redundant_planets_are_undetermined():
    """With a second planet the distribution of the load is undetermined."""
    mechanism = stated_mechanism("link_equilibrium_planets.toml")
    study = ms.dynamics.prescribed(ms.dynamics.dynamic_model(mechanism), [0.3, 0.4], 5.0)
    for i in range(2):
        assert {"fx", "fy"} <= {*study.forces.reactions[f"planet{i}"].undetermined}
    assert study.forces.undetermined == {*study.forces.gears}
    single = replace(mechanism, gears=mechanism.gears[:3])
    study = ms.dynamics.prescribed(ms.dynamics.dynamic_model(single), [0.3, 0.4], 5.0)
    assert {"fx", "fy"}.isdisjoint(study.forces.reactions["planet0"].undetermined)
    assert not study.forces.undetermined


@pytest.mark.long
@pytest.mark.parametrize("case", ["train 2", "linkage 22", "nonlinear rack", "five-bar"])
def test_links_are_in_equilibrium_in_stepped_runs(case):
    case_data = CASES[case]()
    run = driven(case_data.mechanism, case_data.forces, motion_laws=case_data.moves, method="step", samples=5)
    imbalance = equilibrium.largest_imbalance(case_data.mechanism, case_data.forces, run.motion, run.forces)
    # measured 1e-9, from the time step
    assert imbalance <= 1e-7
