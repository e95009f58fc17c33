"""Modelica's MultiBody examples against the reference results of the library, which Dymola computed.

Gravity is 9.80665 m/s2 along -y, and the density of boxes and cylinders 7700 kg/m3. Links have the ground's
axes in the first configuration.
"""

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

import mechsim as ms
from mechsim.model.links import GROUND, Pose
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite, kept

ROOT = "Modelica/Mechanics/MultiBody/Examples"
WEIGHT, DENSITY = ms.Forces(gravity=(0.0, -9.80665, 0.0)), 7700.0
X, Y, Z, ORIGIN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
# of the range of a signal: the tube in which the library's own comparison (CSV Compare) accepts results
TUBE = 2e-3
# of instants in [s]
ROUNDING = 1e-9
FAULTS = {
    "Elementary/DoublePendulumInitTip": "its integration error grows with this chaotic motion;"
    " DOP853 at 1e-12 agrees with mechsim to 2e-9 rad"
}
REASON = "of the range of a signal: the tube of the library's own comparison"


@dataclass(frozen=True)
class Model:
    """A mechanism, its forces and initial values, and the signals: column -> coordinate."""

    mechanism: ms.Mechanism
    forces: ms.Forces
    signals: dict[str, str]
    initial: dict[str, float] = field(default_factory=dict)


def bar(vector, side: float, round_bar: bool = False) -> ms.Inertia:
    """Return a square bar, or a round one, along a vector from the origin of its link."""
    v = np.array(vector)
    length = float(np.linalg.norm(v))
    area = np.pi * side**2 / 4.0 if round_bar else side**2
    mass, u = DENSITY * area * length, v / length
    axial = mass * side**2 / (8.0 if round_bar else 6.0)
    across = 0.5 * axial + mass * length**2 / 12.0
    moments = across * np.eye(3) + (axial - across) * np.outer(u, u)
    return ms.Inertia(mass, tuple(0.5 * v), tuple(map(tuple, moments)))


def linkage(joints, driver=(), points=None, **links) -> ms.Mechanism:
    """Return a mechanism of joints (kind, links, points in them, axes) and links (origin, inertia)."""
    built = []
    for name, (kind, a, b, in_a, in_b, *axes) in joints.items():
        first, second = axes[0] if axes else Z, axes[-1] if axes else Z
        built.append(ms.Joint(name, kind, ms.End(a, in_a, first), ms.End(b, in_b, second)))
    own = tuple(ms.Link(name, inertia=inertia) for name, (_, inertia) in links.items())
    guess = {name: Pose(np.array(origin, float), np.eye(3)) for name, (origin, _) in links.items()}
    return ms.Mechanism("example", own, tuple(built), driver, points or {}, guess=guess)


def damped(coefficient: float) -> ms.Forces:
    return ms.Forces(gravity=WEIGHT.gravity, friction=(ms.Friction("first", viscous=coefficient),))


def pendulum() -> Model:
    body = ms.Inertia(1.0, (0.5, 0.0, 0.0), tuple(map(tuple, 0.001 * np.eye(3))))
    plain = linkage({"first": ("revolute", GROUND, "body", ORIGIN, ORIGIN)}, body=(ORIGIN, body))
    return Model(plain, damped(0.1), {"rev.phi": "first.q", "rev.w": "first.v"})


def double_pendulum(**initial: float) -> Model:
    half = (0.5, 0.0, 0.0)
    joints = {
        "first": ("revolute", GROUND, "one", ORIGIN, ORIGIN),
        "second": ("revolute", "one", "two", half, ORIGIN),
    }
    plain = linkage(joints, one=(ORIGIN, bar(half, 0.06)), two=(half, bar(half, 0.06)))
    signals = {"revolute1.phi": "first.q", "revolute1.w": "first.v"}
    signals |= {"revolute2.phi": "second.q", "revolute2.w": "second.v"}
    return Model(plain, damped(0.1), signals, {f"{name}.q": value for name, value in initial.items()})


def tip_pendulum() -> Model:
    # both bars of 0.5 m, their tip at (0.7, 0.3)
    second = np.arccos((0.7**2 + 0.3**2) / 0.5 - 1.0)
    return double_pendulum(first=float(np.arctan2(0.3, 0.7) - 0.5 * second), second=float(second))


def on_spring() -> Model:
    joints = {
        "first": ("revolute", GROUND, "guide", (0.3, 0.0, 0.0), ORIGIN),
        "slide": ("prismatic", "guide", "body", ORIGIN, ORIGIN, X),
    }
    nothing = ms.Inertia(0.0, ORIGIN, ((0.0,) * 3,) * 3)
    body = ms.Inertia(1.0, ORIGIN, tuple(map(tuple, np.eye(3))))
    points = {"P": ("body", ORIGIN)}
    plain = linkage(joints, points=points, guide=((0.3, 0, 0), nothing), body=((0.8, 0, 0), body))
    spring = ms.Spring((GROUND, (0.3, 0.0, 0.0)), "P", 20.0, 0.2, 1.0)
    forces = ms.Forces(gravity=WEIGHT.gravity, springs=(spring,))
    signals = {"prismatic.s": "slide.q", "prismatic.v": "slide.v"}
    signals |= {"revolute.phi": "first.q", "revolute.w": "first.v"}
    return Model(plain, forces, signals, {"slide.q": 0.5})


def mass_on_spring() -> Model:
    body = ms.Inertia(1.0, ORIGIN, tuple(map(tuple, 0.001 * np.eye(3))))
    down = (0.0, -1.0, 0.0)
    plain = linkage({"first": ("prismatic", GROUND, "body", ORIGIN, ORIGIN, down)}, body=((0, -0.1, 0), body))
    forces = ms.Forces(gravity=WEIGHT.gravity, joint_springs=(ms.JointSpring("first", 30.0, 0.1),))
    return Model(plain, forces, {"p1.s": "first.q", "p2.v": "first.v"}, {"first.q": 0.1})


def planar_four_bar() -> Model:
    crank, coupler, post, rocker = (0.4, 0.0, 0.0), (0.1, 1.1, 0.0), (-0.15, 1.0, 0.0), (0.65, 0.1, 0.0)
    joints = {
        "first": ("revolute", GROUND, "crank", ORIGIN, ORIGIN),
        "A": ("revolute", "crank", "coupler", crank, ORIGIN),
        "B": ("revolute", "coupler", "rocker", coupler, rocker),
        "D": ("revolute", GROUND, "rocker", post, ORIGIN),
    }
    bars = {"crank": (ORIGIN, bar(crank, 0.05)), "coupler": (crank, bar(coupler, 0.05))}
    plain = linkage(joints, "first", rocker=(post, bar(rocker, 0.05)), **bars)
    return Model(plain, damped(0.1), {"revolute1.phi": "first.q", "revolute1.w": "first.v"})


def spatial_four_bar(rod: bool) -> Model:
    """Return crank, slider and a rod between a ball and a universal joint, with or without its mass."""
    crank, arm, length = (0.0, 0.5, 0.1), (0.0, 0.2, 0.0), (-1.0, 0.3, 0.1)
    nothing = ms.Inertia(0.0, ORIGIN, ((0.0,) * 3,) * 3)
    joints = {
        "first": ("revolute", GROUND, "crank", ORIGIN, ORIGIN, X),
        "slide": ("prismatic", GROUND, "slider", (1.2, 0.0, 0.0), ORIGIN, X),
        "cross": ("universal", "slider", "rod", arm, ORIGIN, Y, Z),
        "ball": ("spherical", "rod", "crank", length, crank),
    }
    links = {
        "crank": (ORIGIN, bar(crank, 0.05, True)),
        "slider": ((1.0, 0.0, 0.0), bar(arm, 0.05, True)),
        "rod": ((1.0, 0.2, 0.0), bar(length, 0.05, True) if rod else nothing),
    }
    plain = linkage(joints, "first", **links)
    speed = {"first.v": 5.235987755982989}
    return Model(plain, WEIGHT, {"j1.phi": "first.q", "j1.w": "first.v"}, speed)


CASES: dict[str, Callable[[], Model]] = {
    "Elementary/Pendulum": pendulum,
    "Elementary/DoublePendulum": double_pendulum,
    "Elementary/DoublePendulumInitTip": tip_pendulum,
    "Elementary/PendulumWithSpringDamper": on_spring,
    "Elementary/SpringMassSystem": mass_on_spring,
    "Loops/PlanarFourbar": planar_four_bar,
    "Loops/Fourbar1": lambda: spatial_four_bar(True),
    "Loops/Fourbar2": lambda: spatial_four_bar(False),
    "Loops/Fourbar_analytic": lambda: spatial_four_bar(False),
}


def table(clone: Clone | None, name: str) -> dict[str, np.ndarray]:
    """Return the columns of a result."""
    if clone is None:
        rows = [row[1:] for row in kept("modelica") if row[0] == name]
    else:
        rows = list(csv.reader(clone.read(f"{ROOT}/{name}/{name.split('/')[1]}.csv").splitlines()))
    return dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))


def compared(name: str, clone: Clone | None) -> Case:
    model, reference = CASES[name](), table(clone, name)
    end = float(reference["time"][-1])
    run = ms.dynamics.run(model.mechanism, model.forces, initial=model.initial, duration=end, samples=500)
    # all rows of ours that the table has
    rows = []
    which = np.searchsorted(reference["time"], run.time - ROUNDING)
    shared = np.abs(reference["time"][which] - run.time) < ROUNDING
    for signal, coordinate in model.signals.items():
        joint, kind = coordinate.split(".")
        own = getattr(run.motion.joints[joint], "value" if kind == "q" else "rate")
        theirs = reference[signal]
        error = np.abs(own - theirs[which])[shared].max() / np.ptp(theirs)
        rows.append(Row(signal, float(error), TUBE, "", REASON))
    return Case(name, tuple(rows), source_fault=FAULTS.get(name, ""))


def cases(clone: Clone | None) -> Iterator[Case]:
    for name in CASES:
        yield compared(name, clone)


SUITE = Suite(
    "Modelica: MultiBody examples",
    "modelica/MAP-LIB_ReferenceResults",
    "Results of Dymola at an integration tolerance of 1e-6, 501 instants. No licence is stated.",
    cases,
)
