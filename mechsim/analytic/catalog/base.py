"""What every catalogue mechanism has in common: checked parameters, crank range, assemblies, solving."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.catalog.parameter_checks import checked, checked_rate, choice
from mechsim.analytic.loops.oracle import conditioning
from mechsim.analytic.path_instants import path_instants
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.link_frames import GROUND_FRAME, LinkFrame
from mechsim.analytic.vector_method.trig_polynomial import (
    Arcs,
    SignedRoot,
    reachable_arcs,
    sampled,
    signed_root,
)
from mechsim.analytic.vector_method.vectors import Sign
from mechsim.errors import AssemblyError, InputError
from mechsim.model.joints import Joint
from mechsim.model.limits import Ranges
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import ChangePointPolicy, JointMotion, Motion, join
from mechsim.model.motion_laws import CRANK, MotionLaws, interval_around, no_crank_range_error
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet, Values, values
from mechsim.units import WrittenUnits

# crank angles within this of a change point, in [rad], are that change point
AT_POINT = 1e-9
# distance in [rad] from a change point to the configuration that counts as right after it
AFTER = 1e-6


def first_sign_angle(angles: Array, change_points: Sequence[float], direction: float) -> float:
    """Return the crank angle at which a sign applies: the first, or right after it at a change point.

    Args:
        angles: crank angles in the order of the motion, (n,) in [rad].
        change_points: in [rad], of any revolution.
        direction: sign of the crank's motion, where the angles are all one.
    """
    first = float(angles[0])
    distance = first - np.asarray(change_points)
    if np.abs(distance - REVOLUTION * np.round(distance / REVOLUTION)).min() > AT_POINT:
        return first
    displacement = angles - first
    moved = displacement[np.abs(displacement) > AT_POINT]
    ahead = float(moved[0]) if len(moved) else direction
    return first + (-AFTER if ahead < 0.0 else AFTER)


def segment(
    angle: float, change_points: Sequence[float], arc: tuple[float, float] | None
) -> tuple[float, float]:
    """Return the interval of crank angles around one angle that is free of change points, in [rad].

    Args:
        angle: in [rad], not a change point.
        change_points: in [rad], of any revolution.
        arc: reachable interval that bounds it; None for a crank that turns fully.
    """
    points = np.asarray(change_points)
    below = points + REVOLUTION * np.floor((angle - points) / REVOLUTION)
    low, high = float(below.max()), float((below + REVOLUTION).min())
    return (low, high) if arc is None else (max(low, arc[0]), min(high, arc[1]))


# parameters that say which assembly is meant
SELECTORS = ("branch", "side", "assembly")

# smallest discriminant of a start, relative to the largest: closer to a dead centre assemblies coincide
MIN_START_DISCRIMINANT = 1e-3

# angles a closed form takes in one go: its arrays of this length stay in a core's own cache
CHUNK = 8192


@dataclass(frozen=True, kw_only=True)
class ClosedForm(ABC):
    """A catalogue mechanism with a driven crank and a closed form.

    A subclass is a frozen dataclass of parameters, checked at construction. It gives the abstract
    members below, among them the pose of every link as a formula of the crank angle; `positions`,
    `solve` and the checks follow from them.
    """

    name: ClassVar[str]
    # what theory has to say of this mechanism alone: "coupler line", "velocity plan"
    theories: ClassVar[frozenset[str]] = frozenset()
    # the parameter that is a gear ratio
    gear: ClassVar[str] = ""
    # parameters that may be arrays, one number a design, for `many_designs`
    broadcast: ClassVar[frozenset[str]] = frozenset()
    # what a `LoopForm` may have: drivers under programs, the forces and the formula of its file
    motion_laws: ClassVar[MotionLaws] = CRANK
    forces: ClassVar[None] = None
    formula: ClassVar[str] = ""
    ranges: ClassVar[Ranges] = {}
    written: ClassVar[WrittenUnits] = WrittenUnits()

    def __post_init__(self) -> None:
        for parameter in fields(self):
            value, rule = getattr(self, parameter.name), parameter.metadata
            kept = checked(self.name, parameter.name, value, parameter.default, rule)
            object.__setattr__(self, parameter.name, kept)

    @property
    @abstractmethod
    def description(self) -> Mechanism:
        """Links, joints, crank and tracked points, without a guess."""

    @abstractmethod
    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """Yield links and their frames at crank angles, those that carry tracked points first.

        Args:
            angle: (n,) in [rad], as an array, which gives places, or as a jet, which gives the motion.

        Frames are NaN where the loop does not close.
        """

    @property
    def has_own_start(self) -> bool:
        """Whether `start_frames` determines the assembly."""
        return bool(self.broadcast)

    def start_frames(self, count: int) -> Iterator[tuple[str, LinkFrame]]:
        """Yield links and their frames in so many designs, cranks at 0; NaN where the loop does not close."""
        return self.frames(np.zeros(count))

    def local_points(self) -> Mapping[str, Sequence[Any]]:
        """Return the tracked points in their links' frames, in [m]; parts may be (n,) of many designs."""
        return {name: local for name, (_, local) in self._described.points.items()}

    def joint_points(self) -> Mapping[str, tuple[Any, Any]]:
        """Return joint -> its points on links a and b, in [m]; parts may be (n,) of many designs.

        Joints that are left out have theirs at both links' origins.
        """
        return {joint.name: (joint.a.point, joint.b.point) for joint in self._described.joints}

    def side_a(self, joint: Joint) -> Array:
        """Return the frame of a joint's side a in its link, (3, 3), or (3, 3, n) of many designs."""
        return joint.a.frame

    @abstractmethod
    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that distinguishes the assemblies, (n,); positive for this one.

        Args:
            points: tracked point -> (n, 3) in [m], by any method.
        """

    @abstractmethod
    def transmission_angle(self, angles: ArrayLike) -> Array:
        """Return the angle between coupler force and the output's motion, (n,) in [rad], 0 to pi/2.

        90 degrees is best; zero is a pose in which the output locks.
        """

    @abstractmethod
    def crank_range(self) -> Arcs:
        """Return the arcs of crank angle over which the loops close in this assembly."""

    @abstractmethod
    def assemblies(self, angle: float) -> Sequence[Self]:
        """Return the mechanism in each real assembly it has at a crank angle; empty if it has none."""

    def assembly_points(self, angle: float) -> list[tuple[dict[str, int | None], dict[str, Array]]]:
        """Return every real assembly at a crank angle: the parameters that select it, and its tracked points.

        Points are (3,) in [m]. A selector is None where no value of it leads to the assembly.
        """
        listed: list[tuple[dict[str, int | None], dict[str, Array]]] = []
        for assembly in self.assemblies(angle):
            chosen: dict[str, int | None] = {
                name: getattr(assembly, name) for name in SELECTORS if hasattr(assembly, name)
            }
            listed.append((chosen, {name: point[0] for name, point in assembly.positions([angle]).items()}))
        return listed

    @cached_property
    def mechanism(self) -> Mechanism:
        """The description, with a guess that names the assembly."""
        return self._described.with_guess(*self.guess())

    @property
    def idle(self) -> frozenset[str]:
        """Parameters on which nothing depends as the others are."""
        return frozenset()

    @property
    def spinning(self) -> frozenset[str]:
        """Links whose spin about their own line nothing determines."""
        return frozenset()

    def variants(self) -> Mapping[str, Self]:
        """Return what is validated besides this mechanism itself: name -> the same with something changed."""
        return {}

    def positions(
        self,
        angles: ArrayLike | None = None,
        change_point: ChangePointPolicy | None = None,
        *,
        t: ArrayLike | None = None,
        speed: float | None = None,
    ) -> dict[str, Array]:
        """Return the tracked points at crank angles, or at times: name -> (n, 3) in [m].

        `change_point`, `t` and `speed` are as in `solve`; so is the assembly.

        Raises:
            AssemblyError: where the loop cannot close; says over which part of the turn it can.
        """
        if t is not None or angles is None:
            angles = path_instants(self.mechanism, CRANK, angles, speed, 0.0, t).parameter
        angles = self._angles(angles)
        solver = self.with_change_point(change_point).starting_at(angles)
        pieces = [solver._positions_at(angles[piece]) for piece in _chunks(len(angles))]
        points = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
        self._require_closed(angles, points)
        return points

    def solve(
        self,
        angles: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        acceleration: ArrayLike = 0.0,
        *,
        t: ArrayLike | None = None,
        links: bool = True,
        change_point: ChangePointPolicy | None = None,
    ) -> Motion:
        """Return the motion at crank angles, or at times, in closed form.

        The sign of the assembly applies at the first crank angle, as `starting_at` has it.

        Args:
            angles: crank angles, (n,) in [rad], in any order, or text, as "0:360:5deg".
            speed: crank speed, scalar or (n,) in [rad/s], or text, as "600rpm"; None is 1 at crank angles.
            acceleration: crank acceleration, scalar or (n,) in [rad/s2].
            t: times, (n,) in [s], in place of crank angles: the crank turns at a constant `speed` and stands
                at the mechanism's `start` at time zero.
            links: False leaves out links and joints, for speed where only points are wanted.
            change_point: "smooth" or "branch" at change points; None takes the mechanism's own. Rates
                there are limits, of a fold those beyond it.

        Returns:
            Poses, velocities and accelerations of tracked points, links and joints, ground frame, SI.

        Raises:
            AssemblyError: where the loop cannot close; says over which part of the turn it can.

        Accuracy: loops close to 8 ulp of the longest link; rates are carried through the formula of
            the pose, relative error a few ulp divided by the sine of the transmission angle.
        """
        time = None
        if t is not None or angles is None:
            instants = path_instants(self.mechanism, CRANK, angles, speed, acceleration, t)
            angles, speed, time = instants.parameter, instants.rate, instants.time
        angles = self._angles(angles)
        speed = checked_rate(self.name, "speed", 1.0 if speed is None else speed, angles.shape)
        acceleration = checked_rate(self.name, "acceleration", acceleration, angles.shape)
        solver = self.with_change_point(change_point).starting_at(angles, float(speed[0]))
        pieces = [
            solver._motion(Jet(angles[piece], speed[piece], acceleration[piece]), links)
            for piece in _chunks(len(angles))
        ]
        motion = join(pieces)
        self._require_finite(motion)
        return replace(motion, time=time, origin=solver)

    def solve_along(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion at values of the path parameter, which is the crank angle; as `solve`."""
        return self.solve(parameter, rate, second)

    def solve_as(self, driven: Motion) -> Motion:
        """Return the motion where the crank of another motion was."""
        return self.solve(driven.angle, driven.speed, driven.acceleration)

    def within_ranges(self, motion: Motion) -> Motion:
        """Return a motion; no joint of the catalogue has a range."""
        return motion

    def conditioning(self, motion: Motion) -> Array:
        """Return how far each pose of a motion is from a singular one, (n,), by the loop equations."""
        poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
        return conditioning(self.mechanism, poses)

    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles at which the assemblies meet, in [rad]; empty if the crank turns fully."""
        arcs = self.crank_range()
        return () if arcs.full else tuple(end for arc in arcs.arcs for end in arc)

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles at which assemblies meet though the crank turns on, in [-pi, pi) rad.

        There bars lie on each other, as in a parallelogram laid flat, and the linkage could go on in either
        assembly.
        """
        return ()

    @property
    def period(self) -> float:
        """Crank angle in [rad] after which the mechanism stands as before, if the crank gets so far.

        It is two turns where the linkage passes one change point a turn, or any other odd number.
        """
        return REVOLUTION

    @property
    def change_point(self) -> ChangePointPolicy:
        """How the motion continues at change points."""
        return "smooth"

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        """Return the mechanism that goes on so where assemblies meet; None, or none meet: as it is."""
        return self

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        """Return the mechanism whose assembly is the one that its parameters select at the first crank angle.

        Only change points make a difference: past one the sign of an assembly is another. At a change point
        the configurations right after it count. What this returns keeps its assembly at all crank angles.

        Args:
            angles: crank angles in the order of the motion, (n,) in [rad].
            direction: sign of the crank's motion, where the angles are all one.
        """
        self._angles(angles)
        return self

    def guess(self) -> tuple[dict[str, Pose], float]:
        """Return link poses at a crank angle well inside the range, and that angle in [rad]."""
        start = self._start_angle
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            frames = self._frames(np.array([start]), links=True)
        guess = {
            link.name: Pose(
                link_frames.place(frames[link.name].origin, 1)[0], frames[link.name].rotation(1)[0]
            )
            for link in self._described.links
        }
        for name, pose in guess.items():
            if not np.isfinite(pose.rotation).all():
                raise AssemblyError(
                    f"{self.name}: nothing can hold link {name!r} at crank angle {start:.6g} rad"
                )
        return guess, start

    def _start(self) -> float:
        """Return the crank angle of the guess in [rad]."""
        arcs = self.crank_range()
        if not arcs.arcs:
            raise no_crank_range_error(self.name)
        return arcs.start()

    @cached_property
    def _start_angle(self) -> float:
        """The crank angle of the guess in [rad], at which the sign of the assembly applies."""
        return self._start()

    @cached_property
    def _described(self) -> Mechanism:
        return self.description

    def _angles(self, angles: ArrayLike) -> Array:
        """Return crank angles as an array, from text too; raise InputError for what are none."""
        angles = units.si_angles(angles, f"the crank angles of {self.name}")
        try:
            listed = np.atleast_1d(np.asarray(angles, dtype=np.float64))
        except (TypeError, ValueError):
            listed = np.array([np.nan])
        if listed.ndim != 1 or listed.size == 0 or not np.isfinite(listed).all():
            raise InputError(
                f"{self.name}: crank angles must be a list of finite numbers, not of shape {listed.shape} "
                "or with NaN; give angles in [rad]"
            )
        return listed

    def _frames(self, angle: Values, *, links: bool) -> dict[str, LinkFrame]:
        """Return frames of links, or of those only that carry tracked points; NaN where the loop is open."""
        carriers = {link for link, _ in self._described.points.values()}
        frames_by_link: dict[str, LinkFrame] = {}
        for name, frame in self.frames(angle):
            frames_by_link[name] = frame
            if not links and carriers <= frames_by_link.keys():
                break
        return frames_by_link

    def _positions_at(self, angles: Array) -> dict[str, Array]:
        """Return the tracked points at one chunk of crank angles, NaN where the loop does not close."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            frames = self._frames(angles, links=False)
            return {
                name: link_frames.place(frames[link].point(local), len(angles))
                for name, (link, local) in self._described.points.items()
            }

    def _motion(self, angle: Jet, links: bool) -> Motion:
        """Return the motion at one chunk of crank angles, NaN where the loop does not close."""
        whole, n = self._described, len(angle.value)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            frames = self._frames(angle, links=links)
            points = {
                name: link_frames.point_motion(frames[link].point(local), n)
                for name, (link, local) in whole.points.items()
            }
            motion = Motion("closed form", angle.value, angle.rate, angle.second, points)
            if not links:
                return motion
            moved = {link.name: link_frames.link_motion(frames[link.name], n) for link in whole.links}
            joints = self._joints(angle, frames, n)
        return replace(motion, links=moved, joints=joints, spinning=self.spinning)

    def _joints(self, angle: Jet, frames: Mapping[str, LinkFrame], n: int) -> dict[str, JointMotion]:
        """Return the motion of the coordinates of joints; geared ones count the turns of the crank."""
        whole = self._described
        frame_of = {**frames, GROUND: GROUND_FRAME}
        geared = {gear.driven: gear.ratio * angle + gear.phase for gear in whole.gears}
        counted = {whole.crank.name: angle, **geared}
        motions: dict[str, JointMotion] = {}
        for joint in whole.joints:
            if joint.name in counted:
                coordinates = [counted[joint.name]]
            else:
                coordinates = link_frames.joint_coordinates(
                    joint, frame_of[joint.a.link], frame_of[joint.b.link]
                )
            motions |= link_frames.joint_motions(joint, coordinates, n)
        return motions

    def _require_closed(self, angles: Array, points: Mapping[str, Array]) -> None:
        """Raise AssemblyError where a closed form gave no place."""
        for position in points.values():
            closed = np.isfinite(position).all(1)
            if not closed.all():
                arcs = self.crank_range()
                where = f"it can stand {arcs}" if arcs.arcs else "it can close nowhere in the turn"
                raise AssemblyError(
                    f"{self.name}: the loop does not close at crank angle "
                    f"{angles[np.argmin(closed)]:.6g} rad; {where}; "
                    "change the dimensions or stay inside the range"
                )

    def _require_finite(self, motion: Motion) -> None:
        """Raise AssemblyError where a closed form gave no number."""
        self._require_closed(motion.angle, {name: point.position for name, point in motion.points.items()})
        for point in motion.points.values():
            bounded = np.isfinite(point.acceleration).all(1)
            if not bounded.all():
                raise AssemblyError(
                    f"{self.name}: crank angle {motion.angle[np.argmin(bounded)]:.6g} rad is a dead centre, "
                    "where rates have no bound; keep away from it"
                )
        for name, link in motion.links.items():
            finite = np.isfinite(link.rotation[:, 0]).all(1) & np.isfinite(link.angular_acceleration[:, 0])
            if not finite.all():
                raise AssemblyError(
                    f"{self.name}: nothing can hold link {name!r} at crank angle "
                    f"{motion.angle[np.argmin(finite)]:.6g} rad; change the angles of its guide"
                )


@dataclass(frozen=True, kw_only=True)
class TwoBranchForm(ClosedForm):
    """A mechanism whose loop closes in two ways, selected by the parameter `branch`.

    A subclass gives `discriminant`, whose sign changes are the dead centres.
    """

    discriminant_degree: ClassVar[int] = 2
    if TYPE_CHECKING:
        # every subclass declares it where its own parameters say
        branch: Sign

    change_point: ChangePointPolicy = choice(  # pyright: ignore[reportIncompatibleMethodOverride]
        "smooth", ("smooth", "branch"), "how it goes on where both assemblies meet"
    )

    @abstractmethod
    def discriminant(self, angles: ArrayLike) -> Array:
        """Return how far each crank angle is from a dead centre, (n,); negative where the loop cannot close.

        A trigonometric polynomial of the crank angle of degree `discriminant_degree`, so that its roots,
        the dead centres, are found exactly.
        """

    def crank_range(self) -> Arcs:
        return self._arcs

    def change_points(self) -> tuple[float, ...]:
        return self._root.touching

    @property
    def period(self) -> float:
        return (
            2.0 * REVOLUTION
            if len(self.change_points()) % 2 and self.change_point == "smooth"
            else REVOLUTION
        )

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        if change_point in (None, self.change_point):
            return self
        made = replace(self, change_point=change_point)
        if self._keeps_assembly:
            vars(made).update(_keeps_assembly=True, _start_angle=self._start_angle)
        return made

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        angles = self._angles(angles)
        if self._keeps_assembly or not self._root.touching:
            return self
        sign_angle = first_sign_angle(self.counted(angles), self._root.touching, direction)
        made = copy.copy(self)
        vars(made)["_keeps_assembly"] = True
        vars(made).pop("_all_assemblies", None)
        if self._root.sign(sign_angle) != self._root.sign(self._start_angle):
            vars(made).pop("mechanism", None)
            vars(made)["_start_angle"] = self._clear_angle(sign_angle)
        return made

    def across(self, angle: Values) -> Any:
        """Return the square root of the discriminant that passes change points as `change_point` says, (n,).

        At the first configuration, see `starting_at`, it has the sign of `branch`. None where there are
        no change points, and the sign never changes.
        """
        if not self._root.touching:
            return None
        angle = self.counted(angle)
        if self.change_point == "branch":
            return self.branch * self._root.folded(angle)
        return self.branch * self._root.sign(self._start_angle) * self._root.over(angle)

    def counted(self, angle: Values) -> Any:
        """Return crank angles on the lap of the range, (n,): one that only swings does the same on each."""
        if self._arcs.full or not self._arcs.arcs:
            return angle
        return angle - REVOLUTION * np.floor((values(angle) - self._arcs.arcs[0][0]) / REVOLUTION)

    @cached_property
    def _arcs(self) -> Arcs:
        return reachable_arcs(self.discriminant, self.discriminant_degree)

    @cached_property
    def _root(self) -> SignedRoot:
        return signed_root(sampled(self.discriminant, self.discriminant_degree))

    @cached_property
    def _keeps_assembly(self) -> bool:
        """Whether the first crank angle is known, so that others do not select another assembly."""
        return False

    def _start(self) -> float:
        start, arcs = super()._start(), self.crank_range()
        if self._root.touching:
            return self._clear_angle(first_sign_angle(np.array([start]), self._root.touching, 1.0))
        spread = np.concatenate([np.linspace(low, high, 25) for low, high in arcs.arcs])
        discriminants = self.discriminant(spread)
        # near a dead centre no guess distinguishes the assemblies
        if self.discriminant(np.array([start]))[0] > MIN_START_DISCRIMINANT * discriminants.max():
            return start
        return float(spread[np.argmax(discriminants)])

    def _clear_angle(self, angle: float) -> float:
        """Return a crank angle, in [rad], with well separated assemblies and no change point between."""
        full, turns = self._arcs.full, round(self.period / REVOLUTION)
        angle -= turns * REVOLUTION * np.round(angle / (turns * REVOLUTION)) if full else 0.0
        low, high = segment(angle, self._root.touching, None if full else interval_around(self._arcs, angle))
        spread = np.concatenate([[angle], np.linspace(low, high, 25)])
        discriminants = self.discriminant(spread)
        return (
            angle
            if discriminants[0] > MIN_START_DISCRIMINANT * discriminants.max()
            else float(spread[np.argmax(discriminants)])
        )

    def assemblies(self, angle: float) -> Sequence[Self]:
        discriminant = (
            self._root.rest.value(angle) if self._root.touching else self.discriminant(np.array([angle]))[0]
        )
        if not discriminant >= 0.0:
            return []
        return self._all_assemblies

    @cached_property
    def _all_assemblies(self) -> list[Self]:
        """This mechanism in both assemblies; kept, for each finds its own dead centres."""
        own = None if self._keeps_assembly else self.branch
        return [self if branch == own else replace(self, branch=branch) for branch in (1, -1)]


def _chunks(count: int) -> list[slice]:
    return [slice(start, start + CHUNK) for start in range(0, count, CHUNK)]
