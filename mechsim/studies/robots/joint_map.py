"""Maps from motors to joints of any model, and their comparison with the loop equations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.model.progress import Progress, no_progress
from mechsim.model.scene import Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation.joint_map import JointMap, map_over_grid
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.subjects.driver_positions import driver_path
from mechsim.subjects.mjcf_source import mujoco_input
from mechsim.subjects.readers import load
from mechsim.units import Unit, si

if TYPE_CHECKING:
    from mechsim.model.motion import Motion

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
        output: largest difference of the outputs that are joints, in [rad] or [m].
        jacobian: largest difference of their Jacobian.
        jacobian_derivative: largest difference of the diagonal of its derivative, relative to the largest
            entry or 1.
    """

    points: int
    output: float
    jacobian: float
    jacobian_derivative: float

    @property
    def passed(self) -> bool:
        """Whether every difference is within the tolerance."""
        return max(self.output, self.jacobian, self.jacobian_derivative) <= TOLERANCE


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

    Raises:
        InputError: if a name is unknown, an input has no range or limits, or the grid is too large.
        AssemblyError: if no grid point is reached, or too few for the polynomials.

    Example:
        >>> table = ms.joint_map("four_bar", {"crank": ("20deg", "80deg")}, ["rocker"], degree=4)
        >>> table.polynomials.position_error.max() < 1e-2
        True
    """
    own_model = mujoco_model(model, set, loops)
    ranges = ranges_in_si(own_model, inputs if isinstance(inputs, Mapping) else dict.fromkeys(inputs))
    return map_over_grid(own_model, ranges, outputs, points=points, degree=degree, progress=progress)


def mujoco_model(
    model: Any, set: Mapping[str, str | float] | None = None, loops: str | PathLike[str] | None = None
) -> mujoco.MjModel:
    """Return the compiled MuJoCo model; a mechanism is exported as by `mechsim export`."""
    is_compiled = isinstance(model, mujoco.MjModel) and loops is None
    return model if is_compiled else compiled(mujoco_spec(model, set, loops))


def mujoco_spec(
    model: Any, set: Mapping[str, str | float] | None = None, loops: str | PathLike[str] | None = None
) -> mujoco.MjSpec:
    """Return the specification of a model without missing meshes."""
    own = mujoco_input(model, loops)
    if own is not None:
        return parse_file(own)[0]
    solver = load(model, set, still=True)
    # a local import: only the export of a mechanism needs the renderer's scenery
    from mechsim.pictures.render.scenery import exported

    return exported(solver.mechanism, Scene(level="dynamics", forces=solver.forces))


def ranges_in_si(
    model: mujoco.MjModel, ranges: Mapping[str, tuple[float | str, float | str] | None]
) -> dict[str, tuple[float, float] | None]:
    """Return ranges of joints in [rad] or [m] from numbers in SI or text; None means the joint limits."""
    return {name: None if ends is None else _ends(model, name, ends) for name, ends in ranges.items()}


def _ends(model: mujoco.MjModel, name: str, ends: tuple[float | str, float | str]) -> tuple[float, float]:
    low, high = (quantity_of_joint(model, name, end) for end in ends)
    return low, high


def quantity_of_joint(model: mujoco.MjModel, name: str, value: float | str) -> float:
    """Return a coordinate of a joint in SI; text may have a unit."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    unit: Unit = "m" if joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"
    return float(si(value, unit, f"the value of {name}"))


def compare_with_loop_equations(
    table: JointMap, model: Any, set: Mapping[str, str | float] | None = None
) -> MapComparison:
    """Compare a map with the loop equations of its model at points spread over the map.

    Raises:
        AssemblyError: if the solution of the loop equations does not reach a point of the map.
    """
    joints = [i for i, name in enumerate(table.outputs) if "." not in name]
    rows = np.unique(np.linspace(0, len(table.input) - 1, COMPARED_POINTS).astype(int))
    solver = load(
        model,
        set,
        drive={name: _slow_motion(value) for name, value in zip(table.inputs, table.reference, strict=True)},
        lock=dict(table.locked),
        duration=1.0,
    )
    rows = rows[np.argsort(np.linalg.norm(table.input[rows] - table.reference, axis=1), kind="stable")]
    values = np.vstack([table.reference, table.input[rows]])
    columns = dict(zip(table.inputs, values.T, strict=True))
    path = driver_path(solver, columns, "the map")
    loops = LoopForm(solver.mechanism, motion_laws=path.motion_laws, ranges=solver.ranges)
    zero = np.zeros(len(rows))
    still = loops.solve_along(path.times[1:], zero, zero)
    names = [table.outputs[i] for i in joints]
    output = np.stack([still.joints[name].value for name in names], 1)
    moving = [loops.solve_as(_with_rate(still, table.inputs, i)) for i in range(len(table.inputs))]
    jacobian = np.stack([[m.joints[name].rate for name in names] for m in moving], -1)
    second = np.stack([[m.joints[name].acceleration for name in names] for m in moving], -1)
    mapped = table.jacobian_derivative[rows][:, joints]
    diagonal = np.swapaxes(np.diagonal(mapped, axis1=2, axis2=3), 0, 1)
    return MapComparison(
        len(rows),
        float(np.abs(output - table.output[rows][:, joints]).max(initial=0.0)),
        float(np.abs(jacobian - np.swapaxes(table.jacobian[rows][:, joints], 0, 1)).max(initial=0.0)),
        float(np.abs(second - diagonal).max(initial=0.0) / max(1.0, np.abs(diagonal).max(initial=0.0))),
    )


def _slow_motion(start: float) -> Callable[[Array], tuple[Array, Array, Array]]:
    """Return a motion law that defines only the start of a driver; the points of the map replace it."""
    return lambda time: (start + 1e-3 * time, np.full_like(time, 1e-3), np.zeros_like(time))


def _with_rate(still: "Motion", names: Sequence[str], moving: int) -> "Motion":
    """Return a motion with one driver at unit rate and the others at rest."""
    rates = {
        name: replace(still.joints[name], rate=np.full(len(still.angle), float(i == moving)))
        for i, name in enumerate(names)
    }
    return replace(still, joints={**still.joints, **rates})
