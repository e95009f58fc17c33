"""Records of forces and energies: inverse dynamics and speed fluctuation, by both methods."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import Array

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
# largest entry of the projector of an undetermined component that counts as zero: rounding of a projector
PROJECTOR_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Reaction:
    """The force and moment that the geometry of a joint exerts on its link b, for a screw with its thread.

    Friction, springs and drives act along the degree of freedom of the joint and are not included. The
    balance of a link is: reactions + friction, springs and drives + weight + loads + coupling forces =
    inertia.

    Attributes:
        link: link b, on which it acts.
        by: link a, which exerts it.
        force: in ground axes, (n, 3) in [N].
        moment: about the joint's point on link b, in ground axes, (n, 3) in [N m].
        point: that point in the ground frame, (n, 3) in [m].
        determined: whether the Newton-Euler equations of rigid links determine each of fx, fy, fz, mx, my,
            mz, (6,). Undetermined components have the minimum-norm solution. None if the method does not
            report it.
        projector: projects force and moment separately on their determined subspaces at each instant,
            (n, 2, 3, 3): a combination of undetermined components can be determined. None if all are
            determined.
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
        """Whether each component is determined, (6,); all if the method does not report it."""
        return np.ones(len(COMPONENTS), dtype=np.bool_) if self.determined is None else self.determined

    def project(self, force: Array, moment: Array) -> tuple[Array, Array]:
        """Return the determined components of forces and moments in this joint, (n, 3) each."""
        if self.projector is None:
            return np.where(self.is_determined[:3], force, 0.0), np.where(self.is_determined[3:], moment, 0.0)
        projector = self.projector
        return (projector[:, 0] @ force[..., None])[..., 0], (projector[:, 1] @ moment[..., None])[..., 0]

    @property
    def partly_undetermined(self) -> tuple[str, ...]:
        """Names of undetermined components that a determined combination of components contains."""
        if self.projector is None:
            return ()
        rows = np.abs(self.projector).max(0).max(-1).reshape(len(COMPONENTS))
        components = zip(COMPONENTS, self.is_determined, rows > PROJECTOR_ROUNDING, strict=True)
        return tuple(name for name, determined, partly in components if partly and not determined)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the undetermined components."""
        return tuple(
            name for name, determined in zip(COMPONENTS, self.is_determined, strict=True) if not determined
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshForce:
    """The tooth force of a gear, bevel or rack pair at its pitch point.

    Attributes:
        link: the driven wheel or rack, on which it acts.
        by: the driver, on which the opposite force acts.
    """

    link: str
    by: str
    force: Array
    point: Array

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceRecord:
    """Forces and energies of a mechanism in motion at n instants, in SI and the ground frame.

    Attributes:
        characteristic_length: of the mechanism in [m]; moment tolerances are force tolerances times it.
        time: (n,) in [s]; None if unknown.
        angle: crank angle, (n,) in [rad].
        speed: crank speed, (n,) in [rad/s].
        acceleration: crank acceleration, (n,) in [rad/s2].
        torque: drive torque on the driven joint's link b about its axis, (n,) in [N m]. It includes the
            torque on a flywheel, but not on the inertia of the drive itself.
        reactions: joint -> its reaction.
        sums: names of several joints between the same two links, joined by " + " -> the sum of their
            reactions, about the point of the first; empty if the method does not report it.
        gears: "driver-driven" of gears and other couplings -> torque on the driven joint's link b about its
            axis, or force along it, (n,) in [N m] or [N]; on the driver it is -slope times as large. The
            opposite acts on the joint's link a, except in screws, whose reaction contains it, and for
            couplings in `meshes`, whose tooth force replaces it.
        meshes: coupling with a pitch point -> its tooth force.
        undetermined: couplings whose force rigid links do not determine, such as planets that share a load;
            they have the minimum-norm solution. Empty if the method does not report it.
        drives: driven or locked coordinate -> torque on the joint's link b about its axis, or force along it,
            (n,) in [N m] or [N]. Empty if a crank is driven. Otherwise angle, speed and acceleration are
            those of the path parameter, and `torque` is the power of the drives divided by its rate.
        actuators: coordinate -> torque or force of actuators in place of the drives, (n,) in [N m] or [N];
            then reactions are those under these forces.
        locked: coordinate that is locked while a crank is driven -> torque or force, as in `drives`.
        drive_accelerations: driven coordinate -> its acceleration, (n,) in [rad/s2] or [m/s2].
        straight: names in `gears` and `drives` that are forces in [N].
        kinetic: kinetic energy with the flywheel, (n,) in [J].
        potential: potential energy of gravity (zero at the ground's origin) and springs, (n,) in [J].
        power_in: power of drive and motor, (n,) in [W].
        power_loads: power of loads on points, links and crank, (n,) in [W].
        power_lost: power lost in friction and dampers, (n,) in [W].
        residual: residual of the method's own check of these forces relative to the largest force, (n,):
            analytic: of the balance of any link; MuJoCo: of the accelerations that the forces produce.
        sliding: direction of motion of each joint with Coulomb friction, (n, k) of -1, 0, 1; 0 where it
            reverses or the crank stands still.
        at_branch_point: whether the configuration is a branch point, where forces between links are
            unbounded, (n,); None if none is. Torque, energies and powers have limits there.
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
    actuators: Mapping[str, Array] = field(default_factory=dict[str, Array])
    locked: Mapping[str, Array] = field(default_factory=dict[str, Array])
    drive_accelerations: Mapping[str, Array] = field(default_factory=dict[str, Array])
    straight: frozenset[str] = frozenset()
    meshes: Mapping[str, MeshForce] = field(default_factory=dict[str, MeshForce])
    sums: Mapping[str, Reaction] = field(default_factory=dict[str, Reaction])
    undetermined: frozenset[str] = frozenset()
    at_branch_point: NDArray[np.bool_] | None = None

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def reversing(self) -> NDArray[np.bool_]:
        """Whether a Coulomb friction has no direction, so that reactions are discontinuous, (n,)."""
        return (self.sliding == 0.0).any(1)

    @property
    def unbounded(self) -> NDArray[np.bool_]:
        """Whether forces between links are unbounded, at a branch point, (n,)."""
        return np.zeros(len(self), dtype=np.bool_) if self.at_branch_point is None else self.at_branch_point

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield time, angle, rates, torque or drives, energies and reactions as columns of a table in SI."""
        if self.time is not None:
            yield "t", self.time
        rates = () if self.drives else ("angle", "speed", "acceleration", "torque")
        for name in (*rates, *(f.name for f in fields(self) if "unit" in f.metadata)):
            yield name, getattr(self, name)
        for name, effort in {**self.drives, **self.locked}.items():
            yield f"drive {name}", effort
        for name, effort in self.actuators.items():
            yield f"actuator {name}", effort
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


@dataclass(frozen=True, slots=True)
class Fluctuation:
    """A period in the steady state under a constant drive torque.

    Attributes:
        angle: crank angles over a period, (n,) in [rad].
        speed: crank speed, (n,) in [rad/s].
        mean: mean speed over time, in [rad/s].
        torque: the constant drive torque, in [N m].
        excess: largest less smallest difference between the work of the drive and the work required since
            the start of the period, in [J].
        coefficient: (largest - smallest speed) / mean.
        flywheel: moment of inertia of the flywheel, in [kg m2].
    """

    JSON: ClassVar[tuple[str, ...]] = ("mean", "coefficient", "torque", "excess", "flywheel")

    angle: Array
    speed: Array
    mean: float
    torque: float
    excess: float
    coefficient: float
    flywheel: float

    __repr__ = short_repr
