"""What SDF and USD share: files of links, poses and joints with one axis or a ball, without formulas."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import networkx as nx
import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.actuators import Actuator, no_control
from mechsim.mechanism.forces import Forces, JointSpring, forces_of
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joint_kinds import KINDS, KindName, coordinates, crossed_at_zero, displaced
from mechsim.mechanism.joints import Coupling, End, Joint
from mechsim.mechanism.links import EX, EZ, GROUND, ORIGIN, Inertia, Link, Pose, Vector, vector
from mechsim.mechanism.mechanism import Mechanism, against
from mechsim.numerics.arrays import Array

# inertia of a link that only connects the two joints into which one is split, in [kg] and [kg m2]
BETWEEN = Inertia(1e-6, ORIGIN, ((1e-9, 0.0, 0.0), (0.0, 1e-9, 0.0), (0.0, 0.0, 1e-9)))
# format -> what it can contain, of the names in `left_out`
WRITTEN = {
    "USD": {"gravity", "springs in joints", "viscous friction"},
    "SDF": {"gravity", "springs in joints", "viscous friction", "constant friction"},
}
WRITTEN["MJCF"] = WRITTEN["SDF"] | {
    *("springs between points", "motors", "rotors", "friction about several axes", "locked coordinates"),
}


@dataclass
class FileContents:
    """What a file contains, as its elements are read.

    Attributes:
        poses: link -> its pose in the world.
        positions: joint with one axis -> its coordinate at these poses, in [m] or [rad].
        points: point -> its link, and position in the frame of the link in [m].
    """

    name: str
    gravity: Array
    links: list[Link] = field(default_factory=list[Link])
    poses: dict[str, Pose] = field(default_factory=dict[str, Pose])
    joints: list[Joint] = field(default_factory=list[Joint])
    positions: dict[str, float] = field(default_factory=dict[str, float])
    laws: list[Coupling] = field(default_factory=list[Coupling])
    drivers: tuple[str, ...] = ()
    points: dict[str, tuple[str, Vector]] = field(default_factory=dict[str, tuple[str, Vector]])
    friction: list[Friction] = field(default_factory=list[Friction])
    springs: list[JointSpring] = field(default_factory=list[JointSpring])
    actuators: list[Actuator] = field(default_factory=list[Actuator])
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])

    @property
    def hinges(self) -> set[str]:
        """The joints that only rotate about one axis."""
        return {joint.name for joint in self.joints if KINDS[joint.kind].hinge}

    def solver(self, unread: Iterable[str]) -> KinematicSolver:
        """Return the mechanism; links that no joint connects to the ground float.

        Args:
            unread: what the file contains and is not read; it becomes a sentence.
        """
        graph = nx.Graph([joint.links for joint in self.joints])
        graph.add_nodes_from((GROUND, *self.poses))
        for group in nx.connected_components(graph):
            if GROUND not in group:
                link = next(link for link in self.poses if link in group)
                self.joints.append(Joint(f"{link}_floating", "floating", End(GROUND), End(link)))
        mechanism = Mechanism(
            *(self.name, tuple(self.links), tuple(self.joints), self.drivers, self.points),
            guess=self.poses,
            couplings=tuple(self.laws),
            guess_coordinates=self.positions,
            up=against(vector(self.gravity)) or "z",
        )
        if self.drivers and mechanism.has_crank:
            mechanism = replace(mechanism, start=self.positions[self.drivers[0]])
        forces = Forces(
            gravity=vector(self.gravity),
            friction=tuple(self.friction),
            joint_springs=tuple(self.springs),
            actuators=tuple(self.actuators),
        )
        names = ", ".join(sorted({*unread}))
        return KinematicSolver(
            mechanism, forces=forces, ranges=self.ranges, facts=(f"not read: {names}",) if names else ()
        )

    def follow(self, name: str, leader: str, ratio: float, zeros: tuple[float, float]) -> None:
        """Add the coupling p - zeros[0] = ratio (p' - zeros[1]) of a joint that follows another.

        Raises:
            InputError: if the leader is no joint with one axis.
        """
        for joint in (leader, name):
            if joint not in self.positions:
                raise InputError(f"joint {name} mimics {leader!r}; {joint!r} is no joint with one axis")
        turns = {name, leader} <= self.hinges
        self.laws.append(Coupling(f"{name} mimic", name, leader, (0.0, ratio), zeros, turns))


def split_joints(
    mechanism: Mechanism, poses: Mapping[str, Pose], kinds: Sequence[KindName]
) -> tuple[list[Link], list[Joint], dict[str, Pose]]:
    """Return links, joints and poses in which joints of given kinds are two with a light link between.

    A cylindrical joint becomes a slide and a hinge, a universal joint two hinges. Floating joints go.

    Args:
        mechanism: its links and joints.
        poses: link -> pose in the world, the ground among them.
        kinds: "cylindrical", "universal" or both.
    """
    links, joints, placed = [*mechanism.links], list[Joint](), {**poses}
    for joint in mechanism.joints:
        if joint.kind not in kinds:
            joints += [joint] if joint.kind != "floating" else []
            continue
        between = Link(f"{joint.name} between", inertia=BETWEEN)
        links.append(between)
        # the link between has the joint frame of side a, moved by the first coordinate
        (start_a, frame_a), (start_b, frame_b) = (_frame(poses, end) for end in (joint.a, joint.b))
        middle = second = End(between.name, ORIGIN, EZ, EX)
        if joint.kind == "cylindrical":
            placed[between.name] = Pose(start_b, frame_a)
            names, first = (".way", ".turn"), "prismatic"
        else:
            angle = coordinates(KINDS[joint.kind], start_b - start_a, frame_a, frame_b, joint.cross_angle)[:1]
            placed[between.name] = Pose(start_a, frame_a @ displaced(KINDS["revolute"], [*angle], 0.0)[1])
            x, _, z = crossed_at_zero(joint.cross_angle).T
            second = End(between.name, ORIGIN, vector(z), vector(x))
            names, first = (".1", ".2"), "revolute"
        joints.append(Joint(joint.name + names[0], first, joint.a, middle))
        joints.append(Joint(joint.name + names[1], "revolute", second, joint.b))
    return links, joints, placed


def _frame(poses: Mapping[str, Pose], end: End) -> tuple[Array, Array]:
    """Return the position and the joint frame of a side in the world."""
    pose = poses[end.link]
    return pose.position + pose.rotation @ np.array(end.point), pose.rotation @ end.frame


def leaders(mechanism: Mechanism, format: str) -> dict[str, tuple[str, float]]:
    """Return joint -> the joint that it follows, and the ratio.

    Raises:
        InputError: for a curve or cam, or a coupling that is not linear between two joints with one axis.
    """
    for name, contact in mechanism.contacts.items():
        raise InputError(f"joint {name} is on a {contact.kind}, which {format} does not have; keep its file")
    single = {joint.name for joint in mechanism.joints if KINDS[joint.kind].single}
    by_follower: dict[str, tuple[str, float]] = {}
    for law in mechanism.laws:
        plain = len(law.coefficients) == 2 and not law.function and not law.rope
        if not plain or not all(isinstance(side, str) and side in single for side in (law.left, law.right)):
            raise InputError(
                f"coupling {law.name} is not linear between two joints, as in {format}; export it to TOML"
            )
        by_follower[str(law.left)] = str(law.right), law.ratio
    return by_follower


def left_out(
    solver: KinematicSolver, format: str, limits: Collection[str] | None = None, dry: Sequence[str] = ()
) -> str:
    """Return a sentence on what a format cannot contain; empty if there is nothing.

    Args:
        solver: the mechanism.
        format: a key of `WRITTEN`, or another that has no masses and forces.
        limits: coordinates whose limits it cannot contain; None for those of joints with several.
        dry: joints whose constant friction it cannot contain although it can that of others.
    """
    forces, joints = forces_of(solver), solver.mechanism.joints
    several = {joint.name: joint.coordinates for joint in joints if not KINDS[joint.kind].single}
    limited = limits if limits is not None else [*solver.ranges.keys() & {*chain(*several.values())}]
    varying = [friction.joint for friction in forces.friction if friction.varies]
    controlled = [actuator for actuator in forces.actuators if actuator.control is not no_control]
    present: dict[str, object] = {
        "gravity": any(forces.gravity),
        "springs between points": forces.springs,
        "springs with a law or stops": forces.nonlinear_springs,
        "springs in joints": forces.joint_springs,
        "bushings": forces.bushings,
        "loads": forces.load_profiles,
        "motors": forces.motor or forces.actuators,
        "controls": forces.motor or controlled or forces.controllers,
        "rotors": forces.armature or forces.flywheel,
        "clearances": forces.clearances,
        "viscous friction": [friction for friction in forces.friction if friction.viscous],
        "constant friction": [friction for friction in forces.friction if friction.coulomb],
        "friction about several axes": [
            friction for friction in forces.friction if friction.joint in several
        ],
        f"constant friction in {', '.join(dry)}": dry,
        f"friction by load and rate in {', '.join(varying)}": varying,
        f"limits of {', '.join(sorted(limited))}": limited,
        "restitution": solver.restitution,
        "initial states": solver.initial,
        "locked coordinates": solver.mechanism.locked,
        "motion laws": not solver.motion_laws.crank,
    }
    written = WRITTEN.get(format, {"gravity", "locked coordinates"})
    names = ", ".join(name for name, exists in present.items() if exists and name not in written)
    return f"left out, because {format} has no place for it: {names}" if names else ""


def unique_name(name: str, kind: str, unique: dict[str, str]) -> str:
    """Return a name that no other element has, and add it to those in use."""
    while name in unique:
        name = f"{name}_{kind}"
    return unique.setdefault(name, name)
