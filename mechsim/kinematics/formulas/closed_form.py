"""Formulas of a mechanism: link frames in closed form at crank angles, and the motion that follows."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError
from mechsim.kinematics.formulas.parameters import FormulaParameter, assembled_values, components
from mechsim.kinematics.path_instants import crank_angles, crank_motion
from mechsim.kinematics.vector_method import link_frames
from mechsim.kinematics.vector_method.link_frames import GROUND_FRAME, LinkFrame
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import ChangePointPolicy, JointMotion, Motion, join
from mechsim.mechanism.motion_laws import Arcs, no_crank_range_error
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.jets import Jet, Values, constant_jet, values

# parameters that select the assembly mode
SELECTORS = ("branch", "side", "assembly")
# selectors of an assembly mode, None for one that no parameter selects, and its tracked points, (3,) in [m]
AssemblyPoints = tuple[dict[str, int | None], dict[str, Array]]


@dataclass(frozen=True, slots=True)
class Geometry:
    """Points and frames fixed in links; components may be (n,) of many designs.

    Attributes:
        points: tracked point -> its position in its link, in [m].
        joints: joint -> its points on links a and b, in [m]; other joints have them at the origins.
        frames: joint -> frame of its side a, (3, 3) or (3, 3, n), if it depends on parameters.
    """

    points: Mapping[str, Sequence[Any]]
    joints: Mapping[str, tuple[Any, Any]]
    frames: Mapping[str, Array] = field(default_factory=dict[str, Array])


class Description(Protocol):
    """The description that formulas share with other methods: parameters, links, joints and points."""

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        ...

    @property
    def about(self) -> str:
        """One sentence on the mechanism."""
        ...

    @property
    def rows(self) -> Mapping[str, FormulaParameter]:
        """Parameters by name."""
        ...

    def mechanism(self, values: Mapping[str, Any]) -> Mechanism:
        """Return links, joints, crank and tracked points for values of the parameters, without a guess."""
        ...

    def geometry(self, values: Mapping[str, Any]) -> Geometry:
        """Return points and frames fixed in links for values of which some are arrays."""
        ...


class ClosedForm(ABC):
    """Formulas of a mechanism with a driven crank, for values of its parameters.

    A subclass defines `frames` in terms of the parameters, which are its attributes; all else has a default.

    Attributes:
        declared: parameters, links, joints and points, which other methods use too.
        values: parameter -> value in SI.
        gear: name of the parameter that is a gear ratio; empty if there is none.
        array_parameters: parameters that may be arrays, one number per design.
    """

    gear: str = ""
    array_parameters: frozenset[str] = frozenset()
    change_point: ChangePointPolicy = "smooth"

    def __init__(self, declared: Description, values: Mapping[str, Any], *, checked: bool = True):
        self.declared = declared
        self.values = {name: values.get(name, row.default) for name, row in declared.rows.items()}
        if checked:
            self.values = {
                name: row.checked(declared.name, self.values[name]) for name, row in declared.rows.items()
            }
        vars(self).update(self.values)
        if checked:
            self.check()

    def check(self) -> None:  # noqa: B027
        """Raise InputError for parameters that do not fit together."""

    def with_parameters(self, *, checked: bool = True, **changes: Any) -> Self:
        """Return the formulas for other values of some parameters; unchecked ones may be arrays."""
        return type(self)(self.declared, self.values | changes, checked=checked)

    def with_dimensions(self, changes: Mapping[str, Any], *, checked: bool = True) -> Self:
        """Return the formulas for other numbers by name; a component of a point is named as in pivot.x."""
        return self.with_parameters(checked=checked, **assembled_values(self.values, changes))

    def __repr__(self) -> str:
        return f"<{type(self).__name__}>"

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.declared.name

    @cached_property
    def described(self) -> Mechanism:
        """Links, joints, crank and tracked points, without a guess."""
        return self.declared.mechanism(self.values)

    @cached_property
    def mechanism(self) -> Mechanism:
        """The description, with a guess that selects the assembly mode."""
        return self.described.with_guess(*self.guess())

    @property
    def selectors(self) -> dict[str, int | None]:
        """Parameters that select the assembly mode, with their values."""
        return {name: self.values[name] for name in SELECTORS if name in self.values}

    @property
    def dimensions(self) -> dict[str, tuple[float, str]]:
        """Parameters that are numbers, a component of a point as in pivot.x: value in SI, and unit."""
        rows = self.declared.rows
        numbers = {name: value for name, value in self.values.items() if not rows[name].is_choice}
        return {
            name: (float(number), rows[name.partition(".")[0]].unit)
            for name, number in components(numbers).items()
        }

    @abstractmethod
    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """Yield links and their frames at crank angles, those that carry tracked points first.

        Args:
            angle: (n,) in [rad]; an array gives poses, a jet gives the motion.

        Frames are NaN where the loop does not close.
        """

    def geometry(self) -> Geometry:
        """Return points and frames fixed in links; of many designs if parameters are arrays."""
        if any(getattr(value, "ndim", 0) for value in self.values.values()):
            return self.declared.geometry(self.values)
        points = {name: local for name, (_, local) in self.described.points.items()}
        return Geometry(
            points, {joint.name: (joint.a.point, joint.b.point) for joint in self.described.joints}
        )

    def start_frames(self, count: int) -> Iterator[tuple[str, LinkFrame]] | None:
        """Return links and frames of designs at crank angle 0; None if they do not determine the mode.

        Frames are NaN where the loop does not close.
        """
        return self.frames(np.zeros(count)) if self.array_parameters else None

    def crank_range(self) -> Arcs:
        """Return the intervals of crank angle in which the loops close in this assembly mode."""
        return Arcs(True, ((-np.pi, np.pi),))

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles at which the links are collinear, as in a flat parallelogram."""
        return ()

    @property
    def period(self) -> float:
        """Crank angle in [rad] after which the configuration repeats."""
        return REVOLUTION

    def assemblies(self, angle: float) -> Sequence[Self]:
        """Return the formulas of each real assembly mode at a crank angle; empty if it has none."""
        return [self]

    def assembly_points(self, angle: float) -> list[AssemblyPoints]:
        """Return every real assembly mode at a crank angle."""
        return [
            (assembly.selectors, {name: point[0] for name, point in assembly.positions([angle]).items()})
            for assembly in self.assemblies(angle)
        ]

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that distinguishes the assembly modes, (n,); positive for this one.

        Args:
            points: tracked point -> (n, 3) in [m], by any method.
        """
        return np.ones(len(next(iter(points.values()))))

    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array | None:
        """Return the angle between the coupler force and the output's motion, (n,) in [rad], 0 to pi/2.

        90 degrees is best; at zero the output locks. None if it is not defined.

        Args:
            angles: crank angles, (n,) in [rad].
            points: tracked point -> (n, 3) in [m], at these angles.
        """
        return None

    def transmission_angle(self, angles: ArrayLike) -> Array | None:
        """Return the transmission angle at crank angles, (n,) in [rad]; None if it is not defined."""
        return self.transmission_at(crank_angles(self.name, angles), self.positions(angles))

    def variants(self) -> Mapping[str, Self]:
        """Return formulas that are validated in addition, with another parameter, by name."""
        return {}

    @property
    def spinning(self) -> frozenset[str]:
        """Links whose rotation about their own line is undetermined."""
        return frozenset()

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        """Return the formulas with another policy at change points, if they have any."""
        return self

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        """Return the formulas of the assembly mode that the parameters select at the first crank angle.

        This matters only with change points, beyond which the sign of the mode differs. At a change point the
        sign applies right after it. The result keeps its assembly mode at all crank angles.

        Args:
            angles: crank angles in the order of the motion, (n,) in [rad].
            direction: sign of the crank's motion if all angles are equal.
        """
        crank_angles(self.name, angles)
        return self

    def guess(self) -> tuple[dict[str, Pose], float]:
        """Return link poses at a crank angle well inside the range, and that angle in [rad]."""
        start = self._start_angle
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            frames = dict(self.frames(np.array([start])))
        guess = {
            link.name: Pose(
                link_frames.rows(frames[link.name].origin, 1)[0], frames[link.name].rotation(1)[0]
            )
            for link in self.described.links
        }
        for name, pose in guess.items():
            if not np.isfinite(pose.rotation).all():
                raise AssemblyError(
                    f"{self.name}: the orientation of link {name!r} is undetermined at crank "
                    f"angle {start:.6g} rad"
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
        """The crank angle of the guess in [rad], at which the sign of the assembly mode applies."""
        return self._start()

    def positions(self, angles: ArrayLike) -> dict[str, Array]:
        """Return the tracked points at crank angles: name -> (n, 3) in [m].

        Raises:
            AssemblyError: where the loop cannot close; states the interval in which it can.
        """
        angles = crank_angles(self.name, angles)
        motion = self.starting_at(angles)._in_chunks(angles, links=False)
        points = {name: point.position for name, point in motion.points.items()}
        self.require_closed(angles, points)
        return points

    def motion(
        self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0, *, links: bool = True
    ) -> Motion:
        """Return the motion at crank angles, (n,) in [rad] in any order, in closed form.

        Args:
            parameter: crank angles.
            rate: crank speed, scalar or (n,) in [rad/s].
            second: crank acceleration, scalar or (n,) in [rad/s2].
            links: False leaves out links and joints, which is faster.

        Raises:
            AssemblyError: where the loop cannot close; states the interval in which it can.

        Accuracy: loops close to 8 ulp of the longest link. Rates are exact derivatives of the formula of
            the pose; their relative error is a few ulp divided by the sine of the transmission angle.
        """
        motion = self._in_chunks(Jet(*crank_motion(self.name, parameter, rate, second)), links=links)
        self.check_finite(motion)
        return motion

    def _in_chunks(self, angle: Values, *, links: bool) -> Motion:
        starts = range(0, len(values(angle)), CHUNK)
        pieces = (angle[start : start + CHUNK] for start in starts)
        return join([self.motion_at(piece, links=links, joints=links) for piece in pieces])

    def motion_at(self, angle: Values, *, links: bool, joints: bool) -> Motion:
        """Return the motion at crank angles, NaN where the loop does not close; of arrays without rates.

        Parameters may be arrays of many designs.
        """
        mechanism, n = self.described, len(values(angle))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # frames of links; unless of every link, only of those with tracked points
            carriers = {link for link, _ in self.described.points.values()}
            frames_by_link: dict[str, LinkFrame] = {GROUND: GROUND_FRAME}
            for name, frame in self.frames(angle):
                frames_by_link[name] = frame
                if not (links or joints) and carriers <= frames_by_link.keys():
                    break
            frames, geometry = frames_by_link, self.geometry()
            points = {
                name: link_frames.point_motion(frames[mechanism.points[name][0]].point(local), n)
                for name, local in geometry.points.items()
            }
            moved = {
                link.name: link_frames.motion_of_frame(frames[link.name], n)
                for link in mechanism.links
                if links
            }
            geared = {gear.driven: gear.ratio * angle + gear.phase for gear in mechanism.gears}
            # those of gears include the revolutions of the crank
            crank_angle = {mechanism.crank.name: angle, **geared}
            motions: dict[str, JointMotion] = {}
            for joint in mechanism.joints if joints else ():
                side_a = geometry.frames.get(joint.name)
                sides = None if side_a is None else (side_a, joint.b.frame)
                coordinates: Sequence[Values] = (
                    [crank_angle[joint.name]]
                    if joint.name in crank_angle
                    else link_frames.joint_coordinates(
                        joint, frames[joint.a.link], frames[joint.b.link], sides
                    )
                )
                motions |= link_frames.motions_of_joint(joint, coordinates, n)
        crank = angle if isinstance(angle, Jet) else constant_jet(angle)
        return Motion(
            "closed form",
            crank.value,
            crank.rate,
            crank.second,
            points,
            moved,
            motions,
            spinning=self.spinning if links else frozenset(),
        )

    def require_closed(self, angles: Array, points: Mapping[str, Array]) -> None:
        """Raise AssemblyError where there is no real position."""
        for position in points.values():
            if not np.isfinite(position).all():
                closed = np.isfinite(position).all(1)
                arcs = self.crank_range()
                where = f"its range is {arcs}" if arcs.arcs else "it cannot close at any crank angle"
                raise AssemblyError(
                    f"{self.name}: the loop does not close at crank angle "
                    f"{angles[np.argmin(closed)]:.6g} rad; {where}; "
                    "change the dimensions or stay inside the range"
                )

    def check_finite(self, motion: Motion) -> None:
        """Raise AssemblyError where there are no finite rates."""
        rates = [point.acceleration for point in motion.points.values()]
        rates += [link.angular_acceleration for link in motion.links.values()]
        # they follow from the poses, and are finite only where these are
        if all(np.isfinite(rate).all() for rate in rates):
            return
        self.require_closed(motion.angle, {name: point.position for name, point in motion.points.items()})
        for point in motion.points.values():
            if not np.isfinite(point.acceleration).all():
                bounded = np.isfinite(point.acceleration).all(1)
                raise AssemblyError(
                    f"{self.name}: crank angle {motion.angle[np.argmin(bounded)]:.6g} rad is a dead centre, "
                    "where rates are unbounded; keep away from it"
                )
        for name, link in motion.links.items():
            finite = np.isfinite(link.rotation[:, 0]).all(1) & np.isfinite(link.angular_acceleration[:, 0])
            if not finite.all():
                raise AssemblyError(
                    f"{self.name}: the orientation of link {name!r} is undetermined at crank angle "
                    f"{motion.angle[np.argmin(finite)]:.6g} rad; change the angles of its guide"
                )


# crank angles solved together: arrays of this length fit in the cache of a core
CHUNK = 8192
