"""Maps from motors to joints of any model, and their comparison with the loop equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.io.driver_positions import driver_path
from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import steady
from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation.joint_map import STEP, JointMap, map_over_grid
from mechsim.simulation.mjcf_reader.pose_chains import POSITIONS
from mechsim.simulation.state import rotation_vector_rates
from mechsim.studies.robots.mujoco_models import ranges_in_si, started_model

if TYPE_CHECKING:
    from mechsim.mechanism.motion import Motion

# number of grid points at which a map is compared with the loop equations
COMPARED_POINTS = 9
# largest difference between the methods, in [rad] or [m] and in the Jacobian: both methods close to 1e-12,
# and the Jacobian multiplies this error by its inverse conditioning
TOLERANCE = 1e-9


@dataclass(frozen=True)
class MapComparison:
    """Largest differences between a map by MuJoCo and the loop equations at some of its points.

    Attributes:
        points: number of points compared.
        output: largest difference of the outputs, in [rad] or [m].
        jacobian: largest difference of the Jacobian.
        jacobian_derivative: largest difference of the diagonal of its derivative, relative to the largest
            entry or 1.
    """

    points: int
    output: float
    jacobian: float
    jacobian_derivative: float

    @property
    def passed(self) -> bool:
        """Whether every difference is within the tolerance; NaN is not."""
        differences = (self.output, self.jacobian, self.jacobian_derivative)
        return all(difference <= TOLERANCE for difference in differences)


def joint_map(
    model: Any,
    inputs: Sequence[str] | Mapping[str, tuple[float | str, float | str] | None],
    outputs: Sequence[str],
    *,
    points: int = 21,
    degree: int | None = None,
    set: Mapping[str, str | float] | None = None,
    loops: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
    key: str | None = None,
    start: Mapping[str, str | float] | None = None,
    fix_base: bool = False,
) -> JointMap:
    """Return the outputs of a closed-loop model over a grid of its inputs.

    Args:
        model: as in `load`. A mechanism that is no MuJoCo model is exported to one.
        inputs: joints, with their ranges as text or in SI; the default range is the joint limits.
        outputs: joints, and positions or rotations of links and points, such as plate.x or plate.rz.
        points: grid points along each input.
        degree: total degree of polynomials that approximate the outputs; None for none.
        set: parameter -> value.
        loops: path of a sidecar file with the loop closures of a URDF file.
        progress: called with a text and the finished fraction.
        key: name of the keyframe from which paths start; None is the reference.
        start: joint -> value as text or in SI; paths start in the nearest assembly.
        fix_base: whether free joints stay at the start, also in loops.

    Raises:
        InputError: if a name is unknown, an input has no range or limits, or the grid is too large.
        AssemblyError: if no grid point is reached, or too few for the polynomials.

    Example:
        >>> table = ms.joint_map("four_bar", {"crank": ("20deg", "80deg")}, ["rocker"], degree=4)
        >>> table.polynomials.position_error.max() < 1e-2
        True
    """
    started = started_model(model, set, loops, key, start)
    ranges = ranges_in_si(started.model, inputs if isinstance(inputs, Mapping) else dict.fromkeys(inputs))
    return map_over_grid(
        started.model,
        ranges,
        outputs,
        points=points,
        degree=degree,
        progress=progress,
        start=started.initial,
        fix_base=fix_base,
    )


def compare_with_loop_equations(
    table: JointMap,
    model: Any,
    set: Mapping[str, str | float] | None = None,
    key: str | None = None,
    start: Mapping[str, str | float] | None = None,
    fix_base: bool = False,
) -> MapComparison:
    """Compare a map with the loop equations of its model at points spread over the map.

    Raises:
        AssemblyError: if the solution of the loop equations does not reach a point of the map.
    """
    rows = np.unique(np.linspace(0, len(table.input) - 1, COMPARED_POINTS).astype(int))
    solver = load(
        model,
        set,
        # the laws define only the start of the drivers; the points of the map replace them
        drive={name: steady(value, 1e-3) for name, value in zip(table.inputs, table.reference, strict=True)},
        lock=dict(table.locked),
        # a floating base stays at the reference of the map
        lock_others=True,
        fix_base=fix_base,
        key=key,
        start=start,
        track=table.tracked,
        duration=1.0,
    )
    rows = rows[np.argsort(np.linalg.norm(table.input[rows] - table.reference, axis=1), kind="stable")]
    values = np.vstack([table.reference, table.input[rows]])
    columns = dict(zip(table.inputs, values.T, strict=True))
    path = driver_path(solver, columns, "the map")
    mechanism = solver.mechanism
    loops = KinematicSolver(mechanism, motion_laws=path.motion_laws)
    zero = np.zeros(len(values))
    still = loops.solve_along(path.times, zero, zero)
    output = _outputs(still, still, mechanism, table.outputs)[0, 1:]
    moving: list[Motion] = []
    for driver in table.inputs:
        # at unit rate, the others at rest
        joints = {name: replace(still.joints[name], rate=zero + (name == driver)) for name in table.inputs}
        moving.append(loops.solve_as(replace(still, joints={**still.joints, **joints})))
    rates = np.stack([_outputs(motion, still, mechanism, table.outputs)[1:, 1:] for motion in moving], -1)
    diagonal = np.diagonal(table.jacobian_derivative[rows], axis1=2, axis2=3)
    return MapComparison(
        len(rows),
        float(np.abs(output - table.output[rows]).max()),
        float(np.abs(rates[0] - table.jacobian[rows]).max()),
        float(np.abs(rates[1] - diagonal).max() / max(1.0, np.abs(diagonal).max())),
    )


def _outputs(motion: Motion, still: Motion, mechanism: Mechanism, names: Sequence[str]) -> Array:
    """Return the outputs of a motion with their first and second time derivatives, (3, n, m).

    Rotations are measured from the first instant of `still`.
    """
    columns = list[Array]()
    for name in names:
        subject, _, suffix = name.rpartition(".")
        if name in motion.joints:
            joint = motion.joints[name]
            columns.append(np.stack([joint.value, joint.rate, joint.acceleration]))
            continue
        if suffix in POSITIONS:
            point = motion.points[subject]
            vectors = np.stack([point.position, point.velocity, point.acceleration])
        else:
            vectors = _rotation_vectors(motion, still, mechanism.points[subject][0])
        columns.append(vectors[:, :, POSITIONS.index(suffix[-1])])
    return np.stack(columns, -1)


def _rotation_vectors(motion: Motion, still: Motion, link: str) -> Array:
    """Return the rotation vector of a link from the first instant, and two time derivatives, (3, n, 3).

    The rate of the vector v is J(v) w, with the angular velocity w, and its second derivative is
    J dw/dt + dJ/dt w. dJ/dt is a central difference of fourth order along the rate, exact to about 1e-12.
    """
    if link not in motion.links:
        # the ground does not rotate
        return np.zeros((3, len(motion.angle), 3))
    moved, start = motion.links[link], still.links[link].rotation[0]
    # a local import, since the help of a command needs no solver
    from scipy.spatial.transform import Rotation

    vector = Rotation.from_matrix(moved.rotation @ start.T).as_rotvec()
    angular, matrix = moved.angular_velocity[..., None], rotation_vector_rates
    rate = (matrix(vector) @ angular)[..., 0]
    step = STEP / max(1.0, float(np.abs(rate).max()))
    change = [matrix(vector + k * step * rate) - matrix(vector - k * step * rate) for k in (1, 2)]
    matrix_rate = (8.0 * change[0] - change[1]) / (12.0 * step)
    second = matrix(vector) @ moved.angular_acceleration[..., None] + matrix_rate @ angular
    return np.stack([vector, rate, second[..., 0]])
