"""Forces of a MuJoCo model: springs, dampers, friction, loads, drive inertia, motor.

Springs between points are tendons. Forces in a tree joint along its own coordinate belong to the joint; no
loop is cut at a joint with a spring. Friction in a cut joint is an actuator between two sites without a
control: its value is an affine function of the speed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import mujoco
import numpy as np

from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.forces import Forces, Friction, JointSpring, Location, Spring, located
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import ORIGIN
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import plane_normals
from mechsim.mechanism.motors import ConstantTorque, DCMotor, Geared, Motor
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring
from mechsim.simulation.mjcf.joints import finite_limits, model_names, part_names
from mechsim.simulation.mjcf.loop_cuts import Tree, turning_with
from mechsim.simulation.state import quaternion

Bodies = Mapping[str, mujoco.MjsBody]
AXES = "xyz"
# first part of the name of an actuator that is a spring
SPRING = "spring in "
BUSHING_AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, slots=True)
class Builder:
    """A model under construction, with its mechanism and its tree."""

    spec: mujoco.MjSpec
    mechanism: Mechanism
    tree: Tree
    bodies: Bodies

    def model_joints(self, joint: Joint) -> list[mujoco.MjsJoint]:
        """Return the model's joints of a tree joint; empty for a cut joint."""
        if joint in self.tree.cuts:
            return []
        return [self.spec.joint(name) for name in part_names(self.mechanism, joint)]

    def site(self, name: str, end: End) -> str:
        """Add a site with a joint end's frame: x along the reference, z along the axis."""
        self.bodies[end.link].add_site(name=name, pos=end.point, quat=quaternion(end.frame))
        return name

    def point(self, name: str, location: Location) -> str:
        """Add a site at a location with the axes of its link's frame, except at a tracked point."""
        if isinstance(location, str):
            return location
        link, local = located(self.mechanism, location)
        self.bodies[link].add_site(name=name, pos=local)
        return name


def add_forces(spec: mujoco.MjSpec, mechanism: Mechanism, tree: Tree, bodies: Bodies, forces: Forces) -> None:
    """Add all forces on a mechanism to its model.

    Actuators, in this order: "motor" (control 1 switches it on; for a DC motor it is the voltage),
    "crank torque" (control in [N m]), "load 1.x", "load 1.y" ... (controls in [N], ground axes), "couple
    1.x" ... (controls in [N m], ground axes); "nonlinear spring 1" ... (the control is the tension);
    "bushing NAME.a.x" ... (three forces and three moments on each side, ground axes); "spring in JOINT" for
    revolute joints; "friction in JOINT.z" or ".x", ".y" and ".z" of a cut joint; and, if MuJoCo has no
    Coulomb friction for the joint, "friction in JOINT dry.z" and so on, whose controls [N m] must oppose the
    actuators' velocities. The last are "actuator NAME".
    """
    forces.check(mechanism)
    builder = Builder(spec, mechanism, tree, bodies)
    _add_crank_forces(spec, forces)
    acting = [(f"load {i}", load.location, 0) for i, load in enumerate(forces.loads, 1)]
    acting += [(f"couple {i}", (couple.link, ORIGIN), 3) for i, couple in enumerate(forces.couples, 1)]
    if acting or forces.bushings:
        spec.worldbody.add_site(name="ground axes")
    for name, location, first in acting:
        site = builder.point(name, location)
        for axis, gear in zip(AXES, np.eye(6)[first : first + 3], strict=True):
            _between(spec, f"{name}.{axis}", site, "ground axes", gear)
    for number, spring in enumerate(forces.nonlinear_springs, 1):
        _add_nonlinear_spring(builder, f"nonlinear spring {number}", spring)
    _add_bushings(builder, forces.bushings)
    for number, spring in enumerate(forces.springs, 1):
        _add_spring(builder, f"spring {number}", spring)
    for spring in forces.joint_springs:
        _add_joint_spring(builder, spring)
    for friction in forces.friction:
        _add_friction(builder, friction)
    for name, inertia in forces.armature.items():
        _add_armature(builder, name, inertia)
    for actuator in forces.actuators:
        _add_actuator(builder, actuator)


@dataclass(frozen=True, slots=True)
class Actuators:
    """Indices of the actuators that `add_forces` adds, in their order."""

    motor: slice
    crank_torque: slice
    loads: slice
    couples: slice
    nonlinear: slice
    bushings: slice
    springs: slice
    friction: slice
    actuators: slice


def actuator_slices(forces: Forces, model: mujoco.MjModel) -> Actuators:
    """Return the indices of actuators by purpose; a load or a couple has three."""
    counts = (
        int(forces.motor is not None),
        int(forces.crank_torque is not None),
        len(AXES) * len(forces.loads),
        len(AXES) * len(forces.couples),
        len(forces.nonlinear_springs),
        2 * len(BUSHING_AXES) * len(forces.bushings),
        sum(model.actuator(i).name.startswith(SPRING) for i in range(model.nu)),
    )
    ends = [0, *accumulate(counts), model.nu - len(forces.actuators), model.nu]
    return Actuators(*(slice(first, last) for first, last in pairwise(ends)))


def native(actuator: Actuator) -> bool:
    """Return whether MuJoCo has this actuator; otherwise a callback computes force and state rate."""
    if any(actuator.direct):
        return False
    if actuator.inflow is None:
        return True
    by_control, by_state, by_length, by_speed = actuator.inflow
    return not (by_length or by_speed) and (by_control, by_state) in ((1.0, 0.0), (by_control, -by_control))


def _add_actuator(builder: Builder, actuator: Actuator) -> None:
    """Add an actuator on a joint, or on a tendon; one that is not `native` only has its state.

    Its control and its force then come from `AppliedControls`.
    """
    names = model_names(builder.mechanism)
    called = f"actuator {actuator.name}"
    if len(actuator.gear) == 1:
        ((target, ratio),) = actuator.gear.items()
        made = builder.spec.add_actuator(name=called, target=names[target], trntype=mujoco.mjtTrn.mjTRN_JOINT)
        made.gear[0] = ratio
        _add_armature(builder, target, actuator.inertia * ratio**2)
    else:
        tendon = _add_line(builder, called, actuator.ends or ())
        tendon.armature = actuator.inertia
        for name, ratio in actuator.gear.items():
            tendon.wrap_joint(names[name], ratio)
        made = builder.spec.add_actuator(name=called, target=called, trntype=mujoco.mjtTrn.mjTRN_TENDON)
        made.gear[0] = actuator.pull
    if actuator.inflow is not None:
        by_control = actuator.inflow[0]
        filters = native(actuator) and actuator.inflow[1] != 0.0
        made.dyntype = mujoco.mjtDyn.mjDYN_FILTER if filters else mujoco.mjtDyn.mjDYN_INTEGRATOR
        made.dynprm[0] = 1.0 / by_control if filters else 1.0
        made.actlimited, made.actrange = finite_limits(actuator.state_range)
    if not native(actuator):
        made.gainprm[0] = 0.0
        return
    made.gaintype, made.biastype = mujoco.mjtGain.mjGAIN_AFFINE, mujoco.mjtBias.mjBIAS_AFFINE
    made.gainprm[:3], made.biasprm[:3] = actuator.gain, actuator.bias
    made.ctrllimited, made.ctrlrange = finite_limits(actuator.control_range)
    made.forcelimited, made.forcerange = finite_limits(actuator.force_range)


def _add_armature(builder: Builder, coordinate: str, inertia: float) -> None:
    made = builder.spec.joint(model_names(builder.mechanism)[coordinate])
    made.armature = float(made.armature) + inertia


def _add_crank_forces(spec: mujoco.MjSpec, forces: Forces) -> None:
    """Add flywheel, motor and load of the crank; the control of the load is its torque."""
    if forces.flywheel:
        spec.joint("crank").armature = forces.flywheel
    if forces.motor is not None:
        _add_motor(spec, forces.motor)
    if forces.crank_torque is not None:
        _on_crank(spec, "crank torque")


def _add_motor(spec: mujoco.MjSpec, motor: Motor) -> None:
    """Add a motor: gain times control minus the decrease of torque with speed; the gear is the motor's."""
    ratio = 1.0
    if isinstance(motor, Geared):
        motor, ratio = motor.motor, motor.ratio
    gain = motor.constant / motor.resistance if isinstance(motor, DCMotor) else float(motor.torque(0.0))
    made = _on_crank(spec, "motor")
    made.gear[0] = ratio
    made.gainprm[0] = gain
    if not isinstance(motor, ConstantTorque):
        made.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        made.biasprm[:3] = 0.0, 0.0, motor.derivative


def motor_control(motor: Motor) -> float:
    """Return the control at which the model's motor gives the motor's torque."""
    plain = motor.motor if isinstance(motor, Geared) else motor
    return plain.voltage if isinstance(plain, DCMotor) else 1.0


def _on_crank(spec: mujoco.MjSpec, name: str) -> mujoco.MjsActuator:
    made = spec.add_actuator(name=name, target="crank", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    made.gainprm[0] = 1.0
    return made


def _between(
    spec: mujoco.MjSpec, name: str, site: str, reference: str, gear: Sequence[float] | np.ndarray
) -> mujoco.MjsActuator:
    """Add an actuator on one site against another, along `gear` in the other's frame."""
    made = spec.add_actuator(
        name=name, target=site, refsite=reference, trntype=mujoco.mjtTrn.mjTRN_SITE, gear=gear
    )
    made.gainprm[0] = 1.0
    return made


def _couples(builder: Builder, name: str, joint: Joint, axes: Sequence[int]) -> list[mujoco.MjsActuator]:
    """Add couples on link b by link a about axes of a's joint frame."""
    a, b = (builder.site(f"{name}.{side}", end) for side, end in (("a", joint.a), ("b", joint.b)))
    return [_between(builder.spec, f"{name}.{AXES[axis]}", b, a, np.eye(6)[3 + axis]) for axis in axes]


def _depend_on_state(made: mujoco.MjsActuator, by_angle: float, by_rate: float) -> None:
    """Make the effort of an actuator linear in its angle and rate, without a control."""
    made.gainprm[0] = 0.0
    made.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    made.biasprm[:3] = 0.0, by_angle, by_rate


def _add_joint_spring(builder: Builder, spring: JointSpring) -> None:
    joint, name = builder.mechanism.joint(spring.joint), SPRING + spring.joint
    if builder.spec.actuator(name) is not None:
        name += f" {len(builder.spec.actuators)}"
    (model_joint,) = builder.model_joints(joint)
    if model_joint.stiffness[0]:
        # one more spring in the joint
        made = builder.spec.add_actuator(
            name=name, target=model_joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        _depend_on_state(made, -spring.stiffness, 0.0)
        made.biasprm[0] = spring.stiffness * spring.rest
    else:
        model_joint.stiffness, model_joint.springref = _linear(spring.stiffness), spring.rest


def _add_spring(builder: Builder, name: str, spring: Spring) -> None:
    tendon = _add_line(builder, name, (spring.a, spring.b))
    tendon.stiffness, tendon.damping = _linear(spring.stiffness), _linear(spring.damping)
    tendon.springlength = spring.rest, spring.rest


def _add_line(builder: Builder, name: str, ends: Sequence[Location]) -> mujoco.MjsTendon:
    """Add a tendon between two points, or an empty one."""
    tendon = builder.spec.add_tendon(name=name)
    for side, point in zip("ab", ends, strict=False):
        tendon.wrap_site(builder.point(f"{name}.{side}", point))
    return tendon


def _add_nonlinear_spring(builder: Builder, name: str, spring: NonlinearSpring) -> None:
    """Add an actuator along the length of a spring, whose control is the tension."""
    if not isinstance(spring.ends, str):
        _add_line(builder, name, spring.ends)
        made = builder.spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    else:
        target = model_names(builder.mechanism)[spring.ends]
        made = builder.spec.add_actuator(name=name, target=target, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    made.gainprm[0] = -1.0


def _add_bushings(builder: Builder, bushings: Sequence[Bushing]) -> None:
    """Add actuators with the force and the moment of each side of a bushing, which are their controls."""
    for bushing in bushings:
        for side, end in (("a", bushing.a), ("b", bushing.b)):
            site = builder.site(f"bushing {bushing.name}.{side}", end)
            for axis, gear in zip(BUSHING_AXES, np.eye(6), strict=True):
                _between(builder.spec, f"{site}.{axis}", site, "ground axes", gear)


def _add_friction(builder: Builder, friction: Friction) -> None:
    joint = builder.mechanism.joint(friction.joint)
    model_joints, kind = builder.model_joints(joint), KINDS[joint.kind]
    native = not kind.ball
    for model_joint, (viscous, coulomb) in zip(model_joints, friction.sizes(kind), strict=False):
        model_joint.damping = _linear(viscous + float(model_joint.damping[0]))
        model_joint.frictionloss = model_joint.frictionloss + (coulomb if native else 0.0)
    axes = (2,) if kind.hinge else (0, 1, 2)
    if friction.viscous and not model_joints:
        for made in _couples(builder, f"friction in {joint.name}", joint, axes):
            _depend_on_state(made, 0.0, -friction.viscous)
    if not friction.coulomb or (model_joints and native):
        return
    if native and plane_normals(builder.mechanism) is not None:
        _add_coulomb_cut(builder, joint, friction.coulomb)
        return
    # MuJoCo's Coulomb friction of a ball joint acts about three separate axes, not against the rotation
    _couples(builder, coulomb_name(joint.name), joint, axes)


def coulomb_name(joint: str) -> str:
    """Return the name, without the axis, of the actuators of a joint's Coulomb friction."""
    return f"friction in {joint} dry"


def _add_coulomb_cut(builder: Builder, joint: Joint, torque: float) -> None:
    """Add Coulomb friction to a cut joint of a planar mechanism: its angle is a sum of the tree's angles."""
    tendon = builder.spec.add_tendon(name=f"friction in {joint.name}", frictionloss=torque)
    for name, share in turning_with(builder.mechanism, builder.tree, joint).items():
        (model_joint,) = builder.model_joints(builder.mechanism.joint(name))
        tendon.wrap_joint(model_joint.name, share)


def _linear(value: float) -> tuple[float, float, float]:
    """Return the coefficients of a linear spring or damper; the others belong to higher powers."""
    return value, 0.0, 0.0
