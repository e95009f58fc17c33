"""Input of the code generator: the loops of one assembly, the solved rows, and its range.

A universal joint replaces a ball joint of a link with an undetermined spin, such as a rod between two balls.
Positions, rates of all other links and drive torques do not change if the link is axisymmetric about its
line.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mechsim.codegen.expressions import ROUNDING
from mechsim.errors import InputError
from mechsim.kinematics.loops.constraints import TreeLoops, TreeSolver
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses, link_poses, twists
from mechsim.kinematics.loops.mobility import checked_start
from mechsim.kinematics.loops.motion import driven_path, instants_of_laws, with_locked_values
from mechsim.kinematics.loops.path import closed_chunks
from mechsim.kinematics.loops.start import with_closed_guess
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.state_quantities import joined_configurations
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Vector, vector
from mechsim.mechanism.mechanism import Mechanism, require_polynomials
from mechsim.mechanism.motion_laws import interval_around
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.loop_solver import loop_solver
from mechsim.numerics.rank import significant

# number of configurations over the range at which the conditioning of rows is compared
SAMPLES = 49
# distance of samples from a singular end of the range, as a fraction of the range
INSET = 1e-3
# angular velocity along a null-space vector, relative to the largest one, below which a link does not spin
STILL = 1e-6
# candidate directions of the first axis of a universal joint
DIRECTIONS = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (0, 1) if x or y or z], float
)


@dataclass(frozen=True)
class SolvedAssembly:
    """One assembly of a mechanism, in the form that generated code solves.

    Attributes:
        source: the original mechanism.
        mechanism: the mechanism with rounded directions and lengths, and without undetermined spins.
        solver: loop solver about the start, with the solved rows.
        interval: range of the crank angle in [rad] in which the loops close and no two assemblies coincide;
            None if the crank rotates fully or there is no crank.
        spinning: link with an undetermined spin -> spin axis in the link's frame, (3,).
        samples: configurations over the range.
    """

    source: KinematicSolver
    mechanism: Mechanism
    solver: TreeSolver
    interval: tuple[float, float] | None
    spinning: dict[str, Array]
    samples: Coordinates

    @property
    def loops(self) -> TreeLoops:
        """The loop equations."""
        return self.solver.loops

    @property
    def start(self) -> Coordinates:
        """The configuration from which the code traces the motion."""
        return self.solver.reference

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the driven coordinates."""
        return self.mechanism.drivers

    @property
    def driven(self) -> list[int]:
        """Indices of the driven coordinates."""
        return [*self.loops.driven][: len(self.drivers)]

    @cached_property
    def determinant_sign(self) -> float:
        """Sign of the determinant of the solved rows in this assembly."""
        return float(self.solver.at_reference.determinant[0][0]) if len(self.loops.unknown) else 1.0


def assembly(source: KinematicSolver) -> SolvedAssembly:
    """Return the assembly of a mechanism, selected by its guess.

    Args:
        source: the mechanism.

    Raises:
        AssemblyError: if the loops do not close at the start.
        MobilityError: if the drivers leave joints or tracked points undetermined, or are redundant.
        InputError: if a link can spin in joints for which no code is generated.
    """
    require_polynomials(source.mechanism, "compiled")
    mechanism = _rounded(with_closed_guess(source.mechanism))
    solver = KinematicSolver(mechanism, motion_laws=source.motion_laws, ranges=source.ranges)
    interval, parameters = _range(solver)
    q = _sampled(solver, parameters)
    first = checked_start(mechanism)
    spinning: dict[str, Array] = {}
    if first.nullity:
        mechanism, spinning = without_passive_spin(first, link_poses(first.loops.tree, q))
        q = _sampled(solver.with_mechanism(mechanism), parameters)
        first = checked_start(mechanism)
    return SolvedAssembly(source, mechanism, _with_best_rows(first, q), interval, spinning, q)


def _rounded(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with rounding errors in components of directions and points replaced by zero."""
    length = ROUNDING * mechanism.characteristic_length

    def rounded(values: Array, tolerance: float) -> Vector:
        return vector(np.where(np.abs(values) < tolerance, 0.0, values))

    def end(side: End) -> End:
        axis, reference = (rounded(side.frame[:, column], ROUNDING) for column in (2, 0))
        return End(side.link, rounded(np.array(side.point), length), axis, reference)

    joints = [replace(joint, a=end(joint.a), b=end(joint.b)) for joint in mechanism.joints]
    return replace(mechanism, joints=tuple(joints))


def _range(solver: KinematicSolver) -> tuple[tuple[float, float] | None, Array]:
    """Return the interval of the crank angle in one assembly, and path parameters over the range."""
    start = solver.mechanism.start
    if not solver.motion_laws.crank:
        return None, np.linspace(0.0, solver.motion_laws.length, SAMPLES)
    if not solver.mechanism.has_crank:
        return None, np.zeros(0)
    arcs, change_points = solver.crank_range(), solver.change_points()
    if arcs.full and not change_points:
        return None, np.linspace(start - np.pi, start + np.pi, SAMPLES)
    low, high = (
        (start - np.pi, start + np.pi) if arcs.full else interval_around(arcs, start) or (start, start)
    )
    low, high = float(low), float(high)
    for point in change_points:
        for angle in (point - REVOLUTION, point, point + REVOLUTION):
            low, high = (max(low, angle), high) if angle < start else (low, min(high, angle))
    inset = INSET * (high - low)
    return (low, high), np.linspace(low + inset, high - inset, SAMPLES)


def _sampled(solver: KinematicSolver, parameters: Array) -> Coordinates:
    """Return the coordinates of the tree at path parameters, in the order of the solved chunks."""
    if not len(parameters):
        return checked_start(solver.mechanism).reference
    path = driven_path(solver.mechanism, solver.motion_laws)
    rates = np.ones_like(parameters)
    instants = instants_of_laws(solver.motion_laws, parameters, rates, 0.0 * rates)
    return joined_configurations(
        [chunk.q for chunk in closed_chunks(path, with_locked_values(path.loops, instants))]
    )


def _with_best_rows(first: TreeSolver, q: Coordinates) -> TreeSolver:
    """Return the solver with the independent rows of best conditioning over the range."""
    loops = first.loops
    if not len(loops.unknown) or first.uses_all_rows:
        return first
    jacobian = loops.linearise(q)[1][:, loops.unknown]
    candidates = {tuple(first.rows.tolist())}
    for i in range(len(q)):
        rows = loop_solver(loops, q, jacobian=loops.linearise(q.select(np.array([i])))[1]).rows
        candidates.add(tuple(rows.tolist()))

    def smallest(rows: tuple[int, ...]) -> float:
        if len(rows) != len(first.rows):
            return 0.0
        values = np.linalg.svd(jacobian[list(rows)].transpose(2, 0, 1), compute_uv=False)
        return float(values[:, -1].min()) if significant(values.max(0)).all() else 0.0

    return replace(first, rows=np.array(max(sorted(candidates), key=smallest), dtype=np.intp))


def without_passive_spin(solver: TreeSolver, poses: LinkPoses) -> tuple[Mechanism, dict[str, Array]]:
    """Return a mechanism with universal joints in place of ball joints that allow links to spin.

    Args:
        solver: solver of the loops at the start, with a null space.
        poses: poses of the links over the range of the motion.

    Returns:
        The mechanism, and spinning link -> spin axis in its frame, (3,).

    Raises:
        InputError: if no ball joint connects a spinning link with a link that does not spin.
    """
    mechanism, spinning = solver.loops.tree.mechanism, dict[str, Array]()
    index = solver.loops.tree.index
    while solver.nullity:
        axes = _spin_axes(solver)
        rotation = solver.at_reference.poses.rotation
        spinning |= {name: rotation[index[name], :, :, 0].T @ axis for name, axis in axes.items()}
        balls = (joint for joint in mechanism.joints if KINDS[joint.kind].ball and KINDS[joint.kind].pivot)
        joint = next((ball for ball in balls if len({*ball.links} & axes.keys()) == 1), None)
        if joint is None:
            raise InputError(
                f"{mechanism.name}: nothing determines the spin of link {next(iter(axes))!r}, which no "
                "spherical joint joins to a link that does not spin; lock it, or give it a universal joint"
            )
        replaced = _as_universal(joint, axes, solver, poses, spinning)
        mechanism = replace(
            mechanism, joints=tuple(replaced if other is joint else other for other in mechanism.joints)
        )
        solver = checked_start(mechanism)
    return mechanism, spinning


def _spin_axes(solver: TreeSolver) -> dict[str, Array]:
    """Return link that moves along the null space -> direction of its angular velocity, (3,)."""
    loops, count = solver.loops, solver.nullity
    rates = np.zeros((loops.tree.count, count, 1))
    rates[loops.unknown, :, 0] = solver.null_space.T
    poses, units = solver.at_reference.poses, loops.units[:, None]
    angular = np.stack([twists(loops.tree, poses, rates[:, k] * units)[:, 3:, 0] for k in range(count)])
    fastest = np.abs(angular).max()
    axes: dict[str, Array] = {}
    for name, i in loops.tree.index.items():
        if np.abs(angular[:, i]).max() > STILL * fastest:
            axes[name] = np.linalg.svd(angular[:, i])[2][0]
    return axes


def _as_universal(
    joint: Joint, axes: dict[str, Array], solver: TreeSolver, poses: LinkPoses, spinning: dict[str, Array]
) -> Joint:
    """Return a universal joint in place of a ball joint; its first axis is far from the link's spin axis."""
    index = solver.loops.tree.index
    other, spinner = (joint.a, joint.b) if joint.b.link in axes else (joint.b, joint.a)
    line = np.einsum("ijn,j->in", poses.rotation[index[spinner.link]], spinning[spinner.link])
    if other.link != GROUND:
        line = np.einsum("jin,jn->in", poses.rotation[index[other.link]], line)
    directions = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]
    fixed = directions[np.argmin(np.abs(directions @ line).max(1))]
    at_start = solver.at_reference.poses.rotation[..., 0]
    in_ground = fixed if other.link == GROUND else at_start[index[other.link]] @ fixed
    across = at_start[index[spinner.link]].T @ np.cross(in_ground, axes[spinner.link])
    first = replace(other, axis=vector(fixed / np.linalg.norm(fixed)), reference=None)
    second = replace(spinner, axis=vector(across / np.linalg.norm(across)), reference=None)
    a, b = (first, second) if spinner is joint.b else (second, first)
    return Joint(joint.name, "universal", a, b)
