"""The serial twin of a closed-loop model: the tree without its loops, passive joints coupled by polynomials.

Simulators without loop constraints can run the twin. The format is MJCF, with couplings of fourth degree, or
URDF, with linear mimic joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, ClassVar
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_configurations import scalar_dof, straight_path
from mechsim.simulation.joint_map import JointMap, map_over_grid
from mechsim.simulation.mjcf.compiling import plainly_compiled, to_xml
from mechsim.simulation.mjcf_reader.parsed_file import name_elements
from mechsim.simulation.model_loops import HINGE
from mechsim.simulation.state import SLIDE, rotation_matrix
from mechsim.studies.robots.mujoco_models import mujoco_spec, ranges_in_si

LOOPS = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
# types of joints in URDF
TYPES = {HINGE: "revolute", SLIDE: "prismatic"}
# degree of MuJoCo's couplings, and of URDF's mimic joints
MJCF_DEGREE, URDF_DEGREE = 4, 1
# position error in [rad] or [m] above which a smaller range is recommended: half a degree
COARSE = 0.01
# number of grid points along each independent joint
POINTS = 21


@dataclass(frozen=True)
class Coupled:
    """A passive joint as a function of the independent joints: a polynomial in one, linear in the others.

    Attributes:
        joint: the passive joint.
        leading: index of the independent joint of the polynomial.
        coefficients: coefficients of the passive joint's displacement in powers of the leading joint's
            displacement from the reference, from the constant up.
        linear: coefficients of the displacements of the independent joints, (k,); 0 for the leading joint.
        position_error: largest error over the grid, in [rad] or [m].
        torque_error: largest error of the derivatives by the independent joints.
    """

    JSON: ClassVar[tuple[str, ...]] = ("joint", "position_error", "torque_error")

    joint: str
    leading: int
    coefficients: Array
    linear: Array
    position_error: float
    torque_error: float


@dataclass(frozen=True)
class SerialTwin:
    """The text of a serial twin, its independent joints and its couplings."""

    name: str
    text: str
    independent: tuple[str, ...]
    coupled: tuple[Coupled, ...]
    left_out: tuple[str, ...]

    def summary(self) -> str:
        """Return the errors of the couplings relative to the loops, one line for each passive joint."""
        lines = [f"left out: {', '.join(self.left_out)}"] * bool(self.left_out)
        lines += [
            f"{joint.joint}: position off by {joint.position_error:.2g}, "
            f"torque ratio by {joint.torque_error:.2g}"
            for joint in self.coupled
        ]
        if any(joint.position_error > COARSE for joint in self.coupled):
            lines.append(
                f"A coupling is off by more than {COARSE:g} rad or m; give a smaller range, as in "
                f"--independent {self.independent[0]}=-0.1:0.1"
            )
        return "\n".join(lines)


def serial_twin(
    model: Any,
    format: str,
    *,
    independent: Sequence[str] | Mapping[str, tuple[float | str, float | str] | None] = (),
    set: Mapping[str, str | float] | None = None,
    loops: str | PathLike[str] | None = None,
) -> SerialTwin:
    """Return the serial twin of a model over a range of its independent joints.

    Args:
        model: as `load` takes it.
        format: "mjcf-tree" or "urdf".
        independent: joints of the twin that move freely, with their ranges as text or in SI. The default
            ranges are the joint limits; the default joints are those with actuators.
        set: parameter -> value.
        loops: path of a sidecar file with the loop closures of a URDF file.

    Raises:
        InputError: if the model has no loops or has passive ball joints, or a joint is unknown.
        AssemblyError: if no configuration in the range closes.
    """
    spec = mujoco_spec(model, set, loops)
    name_elements(spec)
    compiled = plainly_compiled(spec)
    names = tuple(independent) or _actuated(compiled)
    ranges = ranges_in_si(compiled, independent if isinstance(independent, Mapping) else dict.fromkeys(names))
    passive = _passive_joints(compiled, names)
    table = map_over_grid(compiled, ranges, passive, points=POINTS if len(names) < 3 else 7)
    degree = MJCF_DEGREE if format == "mjcf-tree" else URDF_DEGREE
    start = np.array([compiled.qpos0[compiled.joint(name).qposadr[0]] for name in (*names, *passive)])
    coupled = tuple(_coupled(table, i, degree, start) for i in range(len(passive)))
    left_out = tuple(
        equality.name or f"loop {i + 1}"
        for i, equality in enumerate(spec.equalities)
        if equality.type in LOOPS
    )
    is_urdf = format == "urdf"
    lacking = {"springs": compiled.jnt_stiffness, "rotors": compiled.dof_armature}
    lacking |= {"tendons": compiled.ntendon, "actuators": compiled.nu}
    left_out += tuple(name for name, values in lacking.items() if is_urdf and np.any(values))
    text = _urdf(spec, compiled, names, coupled) if is_urdf else _tree_mjcf(spec, names, coupled)
    return SerialTwin(spec.modelname, text, names, coupled, left_out)


def _actuated(model: mujoco.MjModel) -> tuple[str, ...]:
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    names = tuple(dict.fromkeys(model.joint(int(j)).name for j in model.actuator_trnid[on_joint, 0]))
    if not names:
        raise InputError("no actuator acts on a joint; name the independent joints by --independent")
    return names


def _passive_joints(model: mujoco.MjModel, names: Sequence[str]) -> list[str]:
    """Return the joints that the loops determine from the independent joints."""
    path = straight_path(model, [scalar_dof(model, name) for name in names])
    joints = sorted({int(model.dof_jntid[dof]) for dof in path.passive})
    for joint in joints:
        if model.jnt_type[joint] not in (HINGE, SLIDE):
            raise InputError(
                f"joint {model.joint(joint).name} is a ball, which no polynomial couples; replace it by "
                "hinges, or cut the loop at it"
            )
    return [model.joint(joint).name for joint in joints]


def _coupled(table: JointMap, output: int, degree: int, start: Array) -> Coupled:
    """Return the coupling of one output: a polynomial in the independent joint with the smallest error.

    Displacements are relative to the reference `start`, of the independent joints, then the passive joints.
    """
    count = len(table.inputs)
    inputs, jacobian = table.input - start[:count], table.jacobian[:, output]
    values = table.output[:, output] - start[count + output]
    fits: list[Coupled] = []
    for leading in range(count):
        others = [i for i in range(count) if i != leading]
        powers = inputs[:, [leading]] ** np.arange(degree + 1)
        fit = np.linalg.lstsq(np.hstack([powers, inputs[:, others]]), values)[0]
        coefficients, linear = fit[: degree + 1], np.zeros(count)
        linear[others] = fit[degree + 1 :]
        error = np.abs(powers @ coefficients + inputs @ linear - values).max()
        derivative = np.broadcast_to(linear, jacobian.shape).copy()
        derivative[:, leading] = powers[:, :-1] @ (coefficients[1:] * np.arange(1, degree + 1))
        torque = np.abs(derivative - jacobian).max()
        name = table.outputs[output]
        fits.append(Coupled(name, leading, coefficients, linear, float(error), float(torque)))
    return min(fits, key=lambda fit: fit.position_error)


def _tree_mjcf(spec: mujoco.MjSpec, names: Sequence[str], coupled: Sequence[Coupled]) -> str:
    """Return the model without its loops, each passive joint coupled by an equality of joints or tendons."""
    tree = spec.copy()
    for element in [*(equality for equality in tree.equalities if equality.type in LOOPS), *tree.keys]:
        tree.delete(element)
    for joint in coupled:
        equality = tree.add_equality(name=f"{joint.joint} coupling")
        equality.data[: len(joint.coefficients)] = joint.coefficients
        if not joint.linear.any():
            equality.type, equality.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
            equality.name1, equality.name2 = joint.joint, names[joint.leading]
            continue
        # tendons are sums of joints: passive joint - linear terms = polynomial in the leading joint
        combined = tree.add_tendon(name=f"{joint.joint} rest")
        right = tree.add_tendon(name=f"{joint.joint} leading")
        combined.wrap_joint(joint.joint, 1.0)
        for name, coefficient in zip(names, joint.linear.tolist(), strict=True):
            if coefficient:
                combined.wrap_joint(name, -coefficient)
        right.wrap_joint(names[joint.leading], 1.0)
        equality.type, equality.objtype = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtObj.mjOBJ_TENDON
        equality.name1, equality.name2 = combined.name, right.name
    return to_xml(tree)


def _urdf(
    spec: mujoco.MjSpec, model: mujoco.MjModel, names: Sequence[str], coupled: Sequence[Coupled]
) -> str:
    """Return the tree as URDF, in which each passive joint mimics its leading independent joint."""
    data = mujoco.MjData(model)
    data.qpos[np.isin(np.arange(model.nq), model.jnt_qposadr)] = 0.0
    mujoco.mj_kinematics(model, data)
    robot = ET.Element("robot", name=spec.modelname or "model")
    ET.SubElement(robot, "link", name="world")
    mimics = {joint.joint: joint for joint in coupled}
    frames = {0: ("world", np.zeros(3), np.eye(3))}
    for body in range(1, model.nbody):
        parent, position, rotation = frames[int(model.body_parentid[body])]
        rotated, label = data.xmat[body].reshape(3, 3).copy(), model.body(body).name or f"body{body}"
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + max(count, 1)):
            last = joint >= first + count - 1
            child = label if last else f"{label}_{joint - first + 1}"
            anchor = data.xanchor[joint].copy() if count else data.xpos[body].copy()
            kind = TYPES.get(int(model.jnt_type[joint])) if count else "fixed"
            name = model.joint(joint).name or f"joint{joint}" if count else f"{label}_fixed"
            if kind is None:
                raise InputError(
                    f"joint {name} is a ball or free joint, which URDF lacks; use --format mjcf-tree"
                )
            element = ET.SubElement(robot, "joint", name=name, type=kind)
            _origin(element, rotation.T @ (anchor - position), rotation.T @ rotated)
            ET.SubElement(element, "parent", link=parent)
            ET.SubElement(element, "child", link=child)
            if count:
                ET.SubElement(element, "axis", xyz=_text(rotated.T @ data.xaxis[joint]))
                _limits(element, model, joint)
                if name in mimics:
                    _mimic(element, mimics[name], names, model)
            link = ET.SubElement(robot, "link", name=child)
            if last:
                _inertial(link, model, body, rotated.T @ (data.xpos[body] - anchor))
            parent, position, rotation = child, anchor, rotated
        # the frame of a body's link is at its last joint
        frames[body] = parent, position, rotation
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _limits(element: ET.Element, model: mujoco.MjModel, joint: int) -> None:
    low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-1e3, 1e3)
    ET.SubElement(
        element, "limit", lower=repr(float(low)), upper=repr(float(high)), effort="1e3", velocity="1e3"
    )
    dof = int(model.jnt_dofadr[joint])
    resistance = {"damping": np.ravel(model.dof_damping[dof])[0], "friction": model.dof_frictionloss[dof]}
    if any(resistance.values()):
        ET.SubElement(element, "dynamics", {name: repr(float(value)) for name, value in resistance.items()})


def _mimic(element: ET.Element, coupling: Coupled, names: Sequence[str], model: mujoco.MjModel) -> None:
    """Add a mimic element, whose offset is relative to zero, not to the reference."""
    constant, multiplier = coupling.coefficients.tolist()
    passive, leading = (
        float(model.qpos0[model.joint(name).qposadr[0]]) for name in (coupling.joint, names[coupling.leading])
    )
    offset = passive + constant - multiplier * leading
    attributes = {"joint": names[coupling.leading], "multiplier": repr(multiplier), "offset": repr(offset)}
    ET.SubElement(element, "mimic", attributes)


def _inertial(link: ET.Element, model: mujoco.MjModel, body: int, origin: Array) -> None:
    """Add mass, centre and moments of a body; `origin` is the position of its frame in the link's frame."""
    if not model.body_mass[body] > 0.0:
        return
    inertial, axes = ET.SubElement(link, "inertial"), rotation_matrix(model.body_iquat[body])
    moments = axes @ np.diag(model.body_inertia[body]) @ axes.T
    _origin(inertial, origin + model.body_ipos[body], np.eye(3))
    ET.SubElement(inertial, "mass", value=repr(float(model.body_mass[body])))
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(moments[i, j])) for i in range(3) for j in range(i, 3)}
    ET.SubElement(inertial, "inertia", entries)


def _origin(element: ET.Element, position: Array, rotation: Array) -> None:
    """Add an origin; URDF's angles are about the fixed axes x, y and z."""
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_matrix(rotation).as_euler("xyz")
    ET.SubElement(element, "origin", xyz=_text(position), rpy=_text(angles))


def _text(values: Array) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
