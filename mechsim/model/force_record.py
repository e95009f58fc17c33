"""Records of forces and energies: inverse dynamics, free runs and speed fluctuation, by both methods."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mechsim.model.finding import Outcome
from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
# of a component that is determined only together with others
PARTLY = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Reaction:
    """What the geometry of a joint transmits to its link b from its link a; of a screw, its thread's too.

    Friction, springs and the drive in the joint act along its freedom and are not in it; a link's own
    balance is: reactions + those + weight + loads + efforts of couplings = inertia.

    Attributes:
        link: the link b on which it acts.
        by: the link a by which it acts.
        force: in ground axes, (n, 3) in [N].
        moment: about the joint's point on link b, in ground axes, (n, 3) in [N m].
        point: that point in the ground frame, (n, 3) in [m].
        determined: of fx, fy, fz, mx, my, mz, whether Newton's and Euler's laws of rigid links say
            what it is, (6,); of those they do not, the smallest that fit are given. None where the
            method does not determine it.
        projector: projects force and moment, each for itself, on what those laws determine of them at
            each instant, (n, 2, 3, 3): of two that are not, a part in between may well be. None where
            all is determined.
    """

    link: str
    by: str
    force: Array
    moment: Array
    point: Array
    determined: NDArray[np.bool_] | None = None
    projector: Array | None = None

    __repr__ = short_repr

    @property
    def is_determined(self) -> NDArray[np.bool_]:
        """Whether each component is determined, (6,); all where a method does not say."""
        return np.ones(len(COMPONENTS), dtype=np.bool_) if self.determined is None else self.determined

    def project(self, force: Array, moment: Array) -> tuple[Array, Array]:
        """Return what is determined of forces and moments in this joint, (n, 3) each."""
        if self.projector is None:
            return np.where(self.is_determined[:3], force, 0.0), np.where(self.is_determined[3:], moment, 0.0)
        projector = self.projector
        return (projector[:, 0] @ force[..., None])[..., 0], (projector[:, 1] @ moment[..., None])[..., 0]

    @property
    def partly_undetermined(self) -> tuple[str, ...]:
        """Names of the components that are not determined, but for a part across or along others."""
        if self.projector is None:
            return ()
        rows = np.abs(self.projector).max((0, 3)).reshape(len(COMPONENTS))
        open_ = zip(COMPONENTS, self.is_determined, rows > PARTLY, strict=True)
        return tuple(name for name, determined, partly in open_ if partly and not determined)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the components that are not determined."""
        return tuple(
            name for name, determined in zip(COMPONENTS, self.is_determined, strict=True) if not determined
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshForce:
    """The force of the teeth of a gear, bevel or rack pair, which acts at the pitch point.

    Attributes:
        link: the driven wheel or rack, on which it acts.
        by: the driver, on which its reverse acts.
        force: in ground axes, (n, 3) in [N].
        point: the pitch point in the ground frame, (n, 3) in [m].
    """

    link: str
    by: str
    force: Array
    point: Array

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceRecord:
    """Forces and energies of a machine under a moving crank at n instants, in SI; ground frame.

    Attributes:
        characteristic_length: of the mechanism in [m], which relates moments to forces.
        time: (n,) in [s]; None where it is not known.
        angle: crank angle, (n,) in [rad].
        speed: of the crank, (n,) in [rad/s].
        acceleration: of the crank, (n,) in [rad/s2].
        torque: of the drive on the driven joint's link b about its axis, (n,) in [N m]. It includes what
            a flywheel takes; the drive's own inertia is not in it.
        reactions: joint -> what it transmits.
        gears: "driver-driven" of gears and other couplings -> torque on the driven joint's link b about its
            axis, or force along it, (n,) in [N m] or [N]; on the driver's is -slope times it. Each acts in
            reverse on the joint's link a, except in screws, whose reaction contains them, and where `meshes`
            has a tooth force in their place.
        meshes: those couplings that have a pitch point -> the tooth force there.
        undetermined: couplings whose effort rigid links leave open, as of planets that share a load; the
            smallest that fit are given. Empty where the method does not report it.
        drives: driven or held coordinate -> torque on the joint's link b about its axis, or force along it,
            (n,) in [N m] or [N]. Empty where a crank is driven. Otherwise angle, speed and acceleration are
            those of the path parameter of the motion laws, and the torque is the drives' power by its rate.
        locked: coordinate locked while a crank is driven -> likewise; under motion laws they are in `drives`.
        drive_accelerations: driven coordinate -> its acceleration, (n,) in [rad/s2] or [m/s2].
        straight: names among gears and drives that are forces in [N].
        kinetic: energy of motion, flywheel included, (n,) in [J].
        potential: of gravity (zero at the ground's origin) and springs, (n,) in [J].
        power_in: of drive and motor, (n,) in [W].
        power_loads: of loads on points, links and crank, (n,) in [W].
        power_lost: in friction and dampers, (n,) in [W].
        residual: what the method's own check of these forces leaves over, as a part of the largest, (n,).
            Of formulas: of any link's balance; of MuJoCo: of the accelerations it gets from them.
        sliding: direction in which each joint with dry friction goes, (n, k) of -1, 0, 1; 0 where it
            turns round or the crank stands.
        at_branch_point: where assemblies meet, so that forces between links are unbounded and have no
            limit, (n,); None for nowhere. Torque, energies and powers have one.
    """

    characteristic_length: float
    time: Array | None
    angle: Array
    speed: Array
    acceleration: Array
    torque: Array
    reactions: Mapping[str, Reaction]
    gears: Mapping[str, Array]
    kinetic: Array = field(metadata={"unit": "J"})
    potential: Array = field(metadata={"unit": "J"})
    power_in: Array = field(metadata={"unit": "W"})
    power_loads: Array = field(metadata={"unit": "W"})
    power_lost: Array = field(metadata={"unit": "W"})
    residual: Array
    sliding: Array
    drives: Mapping[str, Array] = field(default_factory=dict[str, Array])
    locked: Mapping[str, Array] = field(default_factory=dict[str, Array])
    drive_accelerations: Mapping[str, Array] = field(default_factory=dict[str, Array])
    straight: frozenset[str] = frozenset()
    meshes: Mapping[str, MeshForce] = field(default_factory=dict[str, MeshForce])
    undetermined: frozenset[str] = frozenset()
    at_branch_point: NDArray[np.bool_] | None = None

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def reversing(self) -> NDArray[np.bool_]:
        """Where a dry friction has no direction, so that reactions jump from one value to another, (n,)."""
        return (self.sliding == 0.0).any(1)

    @property
    def unbounded(self) -> NDArray[np.bool_]:
        """Where assemblies meet, so that forces between links have no limit, (n,)."""
        return np.zeros(len(self), dtype=np.bool_) if self.at_branch_point is None else self.at_branch_point

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield time, angle, rates, torque or drives, energies and reactions as columns of a table in SI."""
        if self.time is not None:
            yield "time", self.time
        moved = () if self.drives else ("angle", "speed", "acceleration", "torque")
        for name in (*moved, "kinetic", "potential"):
            yield name, getattr(self, name)
        for name, effort in {**self.drives, **self.locked}.items():
            yield f"drive {name}", effort
        for name in ("power_in", "power_loads", "power_lost"):
            yield name, getattr(self, name)
        for name, reaction in self.reactions.items():
            yield from wrench_columns(name, reaction.force, reaction.moment)
        for name, torque in self.gears.items():
            yield f"gear {name}", torque
        for name, mesh in self.meshes.items():
            for component, column in zip(COMPONENTS, mesh.force.T, strict=False):
                yield f"mesh {name}.{component}", column


def wrench_columns(name: str, force: Array, moment: Array) -> Iterator[tuple[str, Array]]:
    """Yield a force and a moment, (n, 3) each, as six columns."""
    values = np.concatenate([force, moment], 1)
    for component, column in zip(COMPONENTS, values.T, strict=True):
        yield f"{name}.{component}", column


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeRun:
    """A free run at n instants, in SI, and how it ended.

    Attributes:
        time: (n,) in [s].
        angle: crank angle, not wrapped, (n,) in [rad].
        speed: (n,) in [rad/s].
        acceleration: (n,) in [rad/s2].
        kinetic: energy of motion, (n,) in [J].
        potential: of gravity and springs, (n,) in [J].
        work: done by motor and loads since the start, (n,) in [J].
        lost: in friction and dampers since the start, (n,) in [J].
        motor: torque of the motor on the crank, (n,) in [N m].
        outcome: "done" (the turns or time asked for), "time over" (fewer turns in the time), "cannot
            start" (never left its place, or swung back without a turn), "turned back" (ran, but did not
            make the turns), "stopped" (friction holds it), "dead centre", "diverged", "failed" (done,
            but not within the tolerance asked for).
        reason: one sentence where the outcome is not "done".
    """

    time: Array
    angle: Array
    speed: Array
    acceleration: Array
    kinetic: Array
    potential: Array
    work: Array
    lost: Array
    motor: Array
    outcome: Outcome
    reason: str = ""

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.time)

    @property
    def imbalance(self) -> Array:
        """Energy there is less energy there should be, (n,) in [J]; zero by the law of energy."""
        total = self.kinetic + self.potential
        return total - total[0] - self.work + self.lost

    @property
    def turned_over(self) -> float:
        """Energy turned over: the largest of motion, of the change at rest, of work and loss, in [J]."""
        energies = (
            np.abs(self.kinetic).max(),
            np.ptp(self.potential),
            np.abs(self.work).max(),
            self.lost.max(),
        )
        return max(float(energy) for energy in energies)

    @property
    def energy_error(self) -> float:
        """Largest imbalance relative to the energy turned over."""
        energy = self.turned_over
        return float(np.abs(self.imbalance).max()) / energy if energy > 0.0 else 0.0

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the run as columns of a table in SI."""
        for name in ("time", "angle", "speed", "acceleration", "kinetic", "potential", "work", "lost"):
            yield name, getattr(self, name)
        yield "motor", self.motor


@dataclass(frozen=True, slots=True)
class Fluctuation:
    """A turn of a machine in its steady state under a constant drive torque.

    Attributes:
        angle: crank angles over one turn, (n,) in [rad].
        speed: of the crank, (n,) in [rad/s].
        mean: mean speed over time, in [rad/s].
        torque: the constant drive torque, in [N m].
        excess: largest less smallest energy that the drive has put in beyond what the turn took so far,
            in [J].
        coefficient: (largest - smallest speed) / mean.
        flywheel: moment of inertia of the flywheel, in [kg m2].
    """

    angle: Array
    speed: Array
    mean: float
    torque: float
    excess: float
    coefficient: float
    flywheel: float

    __repr__ = short_repr
