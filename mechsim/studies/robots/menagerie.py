"""Models in the style of MuJoCo Menagerie: position actuators, a closed home keyframe, a verification."""

from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.analytic.dynamics import dynamic_model
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import InputError, MechsimError
from mechsim.model.forces import Forces, JointSpring
from mechsim.model.limits import NO_RANGES, Ranges
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_configurations import StraightPath, scalar_dof, straight_path
from mechsim.simulation.joint_map import inertia_and_holding
from mechsim.simulation.mjcf.force_elements import limit_joints
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.subjects.driver_positions import driver_path

HOME = "home"
# time step in [s] of a model with servos
SERVO_TIMESTEP = 1e-3
# natural frequency in [Hz] of a critically damped position actuator with the inertia of the mechanism
SERVO_FREQUENCY = 10.0
# largest deflection of an actuator under gravity at home, in [rad] or characteristic lengths
DEFLECTION = 0.01
# number of random configurations, largest distance of a driver from home in [rad] or characteristic lengths,
# and the seed
DRAWN, RADIUS, SEED = 100, 0.25, 0


@dataclass(frozen=True)
class Verification:
    """Differences between a written model and the loop equations of its mechanism.

    Attributes:
        configurations: number of random closed configurations that were compared.
        position: largest difference of the tracked points, in [m].
        gravity_torque: largest difference of the torque or force of the drivers that holds the mechanism at
            rest, in [N m] or [N]; None if the loop equations do not determine it.
        no_torque: the reason for None; otherwise empty.
    """

    configurations: int
    position: float
    gravity_torque: float | None
    no_torque: str = ""

    def markdown(self) -> str:
        """Return the numbers as a section of a README."""
        torque = (
            f"not compared: {self.no_torque}"
            if self.gravity_torque is None
            else f"{self.gravity_torque:.1e} N m"
        )
        return (
            "## Verification\n\n"
            f"- Tracked points match the loop-closure equations over {self.configurations} seeded random "
            f"configurations within {RADIUS} rad of home: largest difference {self.position:.1e} m.\n"
            f"- Largest difference of the torques that hold the mechanism against gravity: {torque}.\n"
            f"- The keyframe `{HOME}` closes all loops.\n"
        )


def with_servos(
    spec: mujoco.MjSpec, mechanism: Mechanism, forces: Forces, ranges: Ranges = NO_RANGES
) -> mujoco.MjSpec:
    """Return a model with a position actuator on each driver and a closed keyframe at its start.

    Args:
        spec: specification of the mechanism, with masses and forces.
        mechanism: mechanism with drivers.
        forces: forces on the mechanism.
        ranges: joint limits in [rad] or [m]; limits of cut joints are omitted.

    Raises:
        InputError: if the mechanism has no drivers.
    """
    spec = spec.copy()
    for key in list(spec.keys):
        spec.delete(key)
    names = _driver_joints(mechanism)
    if mechanism.has_crank:
        # a servo needs no virtual drive inertia
        spec.joint(CRANK).armature = forces.flywheel
        # rename a joint, also in the couplings that refer to it
        new = names[0]
        spec.joint(CRANK).name = new
        for equality in spec.equalities:
            if equality.type == mujoco.mjtEq.mjEQ_JOINT:
                equality.name1, equality.name2 = (
                    new if reference == CRANK else reference for reference in (equality.name1, equality.name2)
                )
    limit_joints(spec, ranges)
    for spring in forces.joint_springs:
        _use_joint_spring(spec, spring)
    path = _path(spec.compile(), names)
    matrices, weights = inertia_and_holding(path, path.reference[None])
    inertias = np.diagonal(matrices[0])
    stiffness = np.maximum(
        inertias * (2.0 * np.pi * SERVO_FREQUENCY) ** 2,
        np.abs(weights[0]) / (DEFLECTION * path.loops.units[path.drivers]),
    )
    damping = 2.0 * np.sqrt(stiffness * inertias)
    for name, dof, kp, kv in zip(names, path.drivers, stiffness.tolist(), damping.tolist(), strict=True):
        servo = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        servo.set_to_position(kp=kp, kv=kv)
        joint = int(path.loops.model.dof_jntid[dof])
        if path.loops.model.jnt_limited[joint]:
            servo.ctrllimited, servo.ctrlrange = 1, path.loops.model.jnt_range[joint]
    spec.add_key(name=HOME, qpos=path.reference, ctrl=path.reference[path.addresses])
    return spec


def _driver_joints(mechanism: Mechanism) -> list[str]:
    if not mechanism.drivers:
        raise InputError(f"{mechanism.name} has no driver for an actuator; name one by --drive")
    return list(mechanism.drivers)


def _use_joint_spring(spec: mujoco.MjSpec, spring: JointSpring) -> None:
    """Replace the actuator of a spring, which would add a control, by the spring of its joint."""
    joint, actuator = spec.joint(spring.joint), spec.actuator(f"spring in {spring.joint}")
    if joint is not None and actuator is not None:
        spec.delete(actuator)
        joint.stiffness[0], joint.springref = spring.stiffness, spring.rest


def _path(model: mujoco.MjModel, names: list[str]) -> StraightPath:
    return straight_path(model, [scalar_dof(model, name) for name in names])


def verification(text: str, solver: KinematicSolver) -> Verification:
    """Compare a written model with the loop equations at random closed configurations.

    Args:
        text: text of the file.
        solver: solver of the modelled mechanism.

    Raises:
        AssemblyError: if the solution of the loop equations does not reach a configuration.
    """
    mechanism = solver.mechanism
    path = _path(mujoco.MjModel.from_xml_string(text), _driver_joints(mechanism))
    drawn = _drawn(path)
    qpos = drawn[_nearest_first(drawn[:, path.addresses], path.reference[path.addresses])]
    values = np.vstack([path.reference[path.addresses], qpos[:, path.addresses]])
    laws = driver_path(solver, dict(zip(mechanism.drivers, values.T, strict=True)), "the configurations")
    loops = KinematicSolver(
        mechanism, motion_laws=laws.motion_laws, ranges=solver.ranges, forces=solver.forces
    )
    rest = np.zeros(len(values))
    points = loops.whole_motion(laws.times, rest, rest).points
    # the positions of the sites, name -> (n, 3) in [m]
    model = path.loops.model
    position, rotation, _ = path.loops.posed.poses(qpos)
    sites = {
        model.site(i).name: position[:, body] + rotation[:, body] @ model.site_pos[i]
        for i, body in enumerate(model.site_bodyid.tolist())
    }
    gaps = [
        np.linalg.norm(points[name].position[1:] - sites[name], axis=1).max()
        for name in points
        if name in sites
    ]
    gap = float(max(gaps, default=0.0))
    try:
        study = prescribed_along(
            dynamic_model(loops, solver.forces or Forces(gravity=tuple(path.loops.model.opt.gravity))),
            laws.times,
            rest,
            time=laws.times,
        )
    except MechsimError as error:
        return Verification(len(qpos), gap, None, str(error))
    torques = np.stack([study.forces.drives[name][1:] for name in mechanism.drivers], 1)
    holding = inertia_and_holding(path, qpos)[1]
    return Verification(len(qpos), gap, float(np.abs(holding - torques).max()))


def _drawn(path: StraightPath) -> Array:
    """Return random closed configurations near home, (n, nq)."""
    model, home = path.loops.model, path.reference[path.addresses]
    reach, joints = RADIUS * path.loops.units[path.drivers], model.dof_jntid[path.drivers]
    limited = model.jnt_limited[joints] != 0
    low, high = model.jnt_range[joints].T
    low = np.where(limited, np.maximum(low, home - reach), home - reach)
    high = np.where(limited, np.minimum(high, home + reach), home + reach)
    qpos, valid = path.reach(np.random.default_rng(SEED).uniform(low, high, (DRAWN, len(low))))
    return qpos[valid]


def _nearest_first(values: Array, start: Array) -> list[int]:
    """Return an order of rows, (n, k): each is the nearest remaining row to its predecessor."""
    order, remaining, current = list[int](), np.ones(len(values), dtype=np.bool_), start
    for _ in range(len(values)):
        distance = np.where(remaining, np.abs(values - current).max(1), np.inf)
        nearest = int(np.argmin(distance))
        order.append(nearest)
        remaining[nearest], current = False, values[nearest]
    return order
