"""Loops that are open at the start of a scene, and redundant loop constraints."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import MechsimError, first_names
from mechsim.mechanism.finding import Finding
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import rank
from mechsim.simulation.custom_model import from_file
from mechsim.simulation.equality_rows import coincident_frames
from mechsim.simulation.findings.inspected import RANK_TOLERANCE, Inspected, Loop, loop_rank, null_space
from mechsim.simulation.mjcf_reader.equality_constraints import CONNECT, WELD
from mechsim.simulation.mjcf_reader.fixed_bodies import free_joints
from mechsim.simulation.mobility import residual_mobility
from mechsim.simulation.state import BALL, scalar_joints

# largest number of joints in a message
NAMED = 8
# largest gap that is not reported, as a fraction of the characteristic length or in [rad]; rounding in CAD
# exports leaves 2e-6
MAX_GAP = 1e-5


def gaps(scene: Inspected) -> Iterator[Finding]:
    """Yield the loops that are open at the start of the scene."""
    gap, _, loop_of = scene.loop_residuals(scene.read.qpos)
    for loop in scene.loops:
        rows, metres = gap[loop_of == loop.number], scene.in_metres(loop)
        apart = [(rows[:3] if loop.closes else rows, "m" if metres else "rad", "its two sides")]
        if loop.kind == WELD:
            # the rotation rows of a weld are half the angle times its torque scale
            apart.append((rows[3:], "rad", "the orientations of its two frames"))
        for distances, unit, what in apart:
            by = float(np.linalg.norm(distances))
            if by > MAX_GAP * (scene.length if unit == "m" else 1.0):
                message = f"{loop.name} is open at the start: {what} are {by:.3g} {unit} apart"
                anchor = "move an anchor, or " if loop.closes else ""
                remedy = f"MuJoCo closes it in the first steps with large forces: {anchor}{_closed_at(scene)}"
                yield scene.finding("gap", loop.element, by, message, remedy)


def _closed_at(scene: Inspected) -> str:
    """Return where the loops close, as the end of a sentence: the joints that move most come first."""
    closed, model = scene.closed, scene.model
    if closed is None:
        return "start where the loops close; none was computed"
    moved = {name: int(model.jnt_qposadr[j]) for name, j in scalar_joints(model).items()}
    ordered = sorted(moved.items(), key=lambda each: -abs(closed[each[1]] - scene.read.qpos[each[1]]))
    listed = ", ".join(f"{name} = {closed[address]:.4g}" for name, address in ordered[:NAMED])
    return f"start where the loops close, at {listed} (SI)"


def duplicate_loops(scene: Inspected) -> Iterator[Finding]:
    """Yield the loops that repeat another loop."""
    jacobian, loop_of = scene.generic
    rows = {loop.number: jacobian[loop_of == loop.number] for loop in scene.loops}
    # MuJoCo omits the rows of bodies that cannot move
    loops = [loop for loop in scene.loops if len(rows[loop.number])]
    anchors = np.array([_anchor(scene, loop) for loop in loops]).reshape(-1, 3)
    reported: set[int] = set()
    for i, loop in enumerate(loops):
        close = np.linalg.norm(anchors[:i] - anchors[i], axis=1) <= MAX_GAP * scene.length
        for other in (loops[k] for k in np.flatnonzero(close)):
            alone, both = loop_rank(rows[other.number]), np.vstack([rows[other.number], rows[loop.number]])
            coincident = loop.closes == other.closes and other.number not in reported
            if not (alone and coincident) or loop_rank(both) != alone:
                continue
            reported.add(loop.number)
            count, repeats = len(rows[loop.number]), f"{loop.name} repeats {other.name}"
            message = f"{repeats}: the loop is closed twice, and its {count} rows add no rank"
            yield scene.finding("redundant", loop.element, count, message, f"leave out {loop.name}")
            break


def _anchor(scene: Inspected, loop: Loop) -> Array:
    """Return the world position of a loop's anchor at the start, (3,) in [m]; zero for couplings."""
    if not loop.closes:
        return np.zeros(3)
    (body, _), (local, _), _ = coincident_frames(scene.model, loop.number)
    return scene.started.xpos[body] + scene.started.xmat[body].reshape(3, 3) @ local


def redundant_constraints(scene: Inspected) -> Iterator[Finding]:
    """Yield the number of redundant constraint rows of the loops; duplicate loops do not count."""
    jacobian, loop_of = scene.generic
    duplicates = {finding.object for finding in duplicate_loops(scene)}
    kept = [loop for loop in scene.loops if loop.name not in duplicates]
    constraining = np.isin(loop_of, [loop.number for loop in kept]) & _constrains(scene, loop_of)
    jacobian, loop_of = jacobian[constraining], loop_of[constraining]
    extra = len(jacobian) - loop_rank(jacobian)
    if not extra:
        return
    # constraint rows of a planar loop depend on each other
    loop_rows = [jacobian[loop_of == loop.number] for loop in kept]
    across = sum(len(rows) - loop_rank(rows) for rows in loop_rows)
    # a loop adds no rank if all combinations of its rows are those of other rows: then as many of them are
    # independent in the combinations of rows that vanish
    vanishing = null_space(jacobian.T)
    redundant = [
        loop
        for loop, rows in zip(kept, loop_rows, strict=True)
        if rank(vanishing[:, loop_of == loop.number], RANK_TOLERANCE, RANK_TOLERANCE) == len(rows)
    ]
    names = ", ".join(loop.name for loop in redundant)
    flat = all(loop.kind == CONNECT or _joins_points(scene, loop) for loop in kept if loop.closes)
    ranks = f"{len(jacobian)} constraint equations of the loops have rank {len(jacobian) - extra}:"
    if not jacobian.any():
        message = f"the {ranks} no joint changes them"
    elif across == extra:
        message = f"{ranks} the others act normal to the planes of their loops"
    else:
        ending = f"; any one of {names} could go" if len(redundant) > 1 else f"; {names} could go"
        message = f"{ranks} {extra} of them repeat others{ending if names else ''}"
    remedy = "harmless if the linkage is planar or spherical: repeated equations only share forces unevenly"
    yield Finding(
        kind="redundant",
        object=names or "loops",
        value=extra,
        message=message,
        remedy="harmless" if across == extra and flat else remedy,
    )


def _constrains(scene: Inspected, loop_of: Array) -> NDArray[np.bool_]:
    """Return a mask of rows that constrain, (m,): with torquescale 0 the last three of a weld do not."""
    result = np.ones(len(loop_of), dtype=np.bool_)
    for loop in scene.loops:
        if _joins_points(scene, loop):
            result[np.flatnonzero(loop_of == loop.number)[3:]] = False
    return result


def _joins_points(scene: Inspected, loop: Loop) -> bool:
    """Return whether a loop is a weld that, with torquescale 0, joins points as a connect does."""
    return loop.kind == WELD and scene.model.eq_data[loop.number, 10] == 0.0


# component of a unit free direction above which a joint moves
SIGNIFICANT = 1e-6
# maximum number of names in a message
MAX_LISTED = 6


def undetermined(scene: Inspected) -> Iterator[Finding]:
    """Yield the degrees of freedom that the drivers leave undetermined, if there are any."""
    # a model without drivers is passive, and its free DOFs are not an error
    if not (scene.drivers and _has_undetermined(scene)):
        return
    model, (jacobian, _) = scene.model, scene.generic
    count, names = _representative_joints(scene)
    if not count:
        # a tracked point moves by balls alone
        count, names = _representative_joints(scene, balls=True)
    listed = first_names(names, MAX_LISTED)
    floats = " or --fix-base" if free_joints(model) else ""
    yield Finding(
        kind="open",
        object=listed,
        value=count,
        message=f"{model.nv - loop_rank(jacobian)} degrees of freedom, {count} of them undetermined with "
        f"{', '.join(_locked(scene))} locked: {listed} can still move; springs, weight, friction and "
        "contacts decide how",
        remedy=f"drive, lock or couple them (--drive, --lock{floats})",
    )


def _locked(scene: Inspected) -> list[str]:
    return [*scene.drivers, *scene.read.mechanism.locked]


def _representative_joints(scene: Inspected, balls: bool = False) -> tuple[int, list[str]]:
    """Return the number of undetermined DOFs with locked drivers, and a moving joint for each.

    Without `balls`, ball joints are omitted: mostly their motion is the spin of a rod about its axis.
    """
    model, chosen = scene.model, list[int]()
    locked = np.eye(model.nv)[[int(model.joint(name).dofadr[0]) for name in _locked(scene)]]
    free = null_space(np.vstack([scene.generic[0], locked]))
    for dof in range(model.nv):
        if not balls and model.jnt_type[model.dof_jntid[dof]] == BALL:
            continue
        if np.linalg.matrix_rank(free[:, [*chosen, dof]], tol=SIGNIFICANT) > len(chosen):
            chosen.append(dof)
    names = [str(model.joint(int(joint)).name) for joint in model.dof_jntid[chosen]]
    return len(chosen), list(dict.fromkeys(names))


def _has_undetermined(scene: Inspected) -> bool:
    """Return whether DOFs are undetermined with the drivers locked; False if the loops do not close.

    Loops that close only as well as their rounded dimensions allow are judged by their rank.
    """
    start = scene.read if scene.closed is None else replace(scene.read, qpos=scene.closed)
    try:
        return residual_mobility(from_file(start, scene.drivers)).undetermined != ()
    except (MechsimError, np.linalg.LinAlgError):
        return scene.closed is not None and _representative_joints(scene)[0] > 0
