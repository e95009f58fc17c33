"""Every assembly of a mechanism at a crank angle, complete where Assur groups decide."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mechsim.errors import AssemblyError, InputError
from mechsim.io.readers import load
from mechsim.kinematics.group_assemblies import group_assemblies
from mechsim.kinematics.loops.assemblies import located, other_assemblies
from mechsim.kinematics.loops.motion import driven_path
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array

if TYPE_CHECKING:
    from mechsim.io.readers import Model
    from mechsim.kinematics.formulas.closed_form import AssemblyPoints


@dataclass(frozen=True, slots=True)
class Assemblies:
    """The assemblies of a mechanism at a crank angle, or at an instant of its motion laws.

    Attributes:
        angle: crank angle in [rad], or path parameter.
        selectors: parameters that select each assembly, such as branch; empty without any.
        points: tracked point -> position, (3,) in [m], of each assembly; the mechanism's own is the first.
            Where tracked points do not distinguish the assemblies, joints between moving links do.
        complete: whether there are no others, by the formula or by Assur groups; otherwise random starts
            found them.
        reason: why the list is complete, or why it need not be.
        families: why further assemblies are continuous families, one sentence each.
    """

    angle: float
    selectors: tuple[Mapping[str, int | None], ...]
    points: tuple[Mapping[str, Array], ...]
    complete: bool
    reason: str
    families: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.points)


def assemblies(model: "Model", angle: float, *, searched: bool = True) -> Assemblies:
    """Return every assembly of a mechanism at a crank angle.

    The formulas of the catalogue have all of theirs. Another planar mechanism is solved by its Assur groups
    (dyads, and triads with six pins), which gives all assemblies. Otherwise loops are closed from random
    starts.

    Args:
        model: as in `load`.
        angle: crank angle in [rad], or path parameter of the motion laws.
        searched: whether to search from random starts where nothing else lists them; else none are listed.

    Example:
        >>> ms.assemblies("jansen", 0.1).complete, len(ms.assemblies("jansen", 0.1))
        (True, 8)
    """
    solver = load(model)
    if solver.assemblies(angle) is not None:
        listed, reason = solver.assembly_points(angle), "its formula has every assembly"
        return _assemblies_of(angle, listed, True, reason)
    try:
        # every assembly at the driver positions of the solver's own
        poses = _first_poses(solver.solve_along([angle]))
        groups = group_assemblies(solver.mechanism, {GROUND: IDENTITY, **poses})
    except (InputError, AssemblyError) as error:
        listed, families = all_assembly_points(solver, angle) if searched else ([], ())
        return _assemblies_of(angle, listed, False, f"found from random starts: {error}", families)
    listed, moving = all_assembly_points(solver, angle, groups.poses)
    families = (*groups.families, *moving)
    reason = "every pose" if groups.complete else f"the first {len(groups.poses)} of more poses"
    limited = " within the joint limits" if solver.ranges else ""
    return _assemblies_of(angle, listed, groups.complete, f"{reason} of its Assur groups{limited}", families)


def all_assembly_points(
    solver: KinematicSolver, angle: float, candidates: Sequence[Mapping[str, Pose]] | None = None
) -> "tuple[list[AssemblyPoints], tuple[str, ...]]":
    """Return every assembly of a mechanism without formulas at a crank angle, its own first, and families.

    Args:
        solver: of the mechanism.
        angle: in [rad].
        candidates: link -> pose of every assembly; None searches from random starts.
    """
    motions = [solver.whole_motion([angle])] if solver.assembly_points(angle) else []
    path = driven_path(solver.mechanism, solver.motion_laws, solver.change_point)
    links = [motion.links for motion in motions]
    others, families = other_assemblies(path, angle, solver.ranges, links, candidates)
    return [({}, points) for points in located(path, [*map(_first_poses, motions), *others])], families


def _first_poses(motion: Motion) -> dict[str, Pose]:
    """Return link -> its pose at the first instant of a motion."""
    return {name: Pose(link.position[0], link.rotation[0]) for name, link in motion.links.items()}


def _assemblies_of(
    angle: float,
    listed: list[tuple[dict[str, int | None], dict[str, Array]]],
    complete: bool,
    reason: str,
    families: tuple[str, ...] = (),
) -> Assemblies:
    selectors, points = (tuple(column) for column in zip(*listed, strict=True)) if listed else ((), ())
    return Assemblies(angle, selectors, points, complete, reason, families)
