"""Drake: discrete steps with its SAP solver, the only first of its plants that holds loops."""

import time

import mujoco
import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    FixedOffsetFrame,
    Joint,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import Simulator
from reference_problem import Array, Poses, Problem, Setting

NAME, PACKAGE = "Drake", "drake"
# 1 ms is the step of Drake's examples; its plants have no default
SETTINGS = [Setting("default", 0.001), *[Setting("smaller steps", -float(n)) for n in (20, 100)]]


def _transform(position: Array, quaternion: Array) -> RigidTransform:
    return RigidTransform(Quaternion(wxyz=quaternion / np.linalg.norm(quaternion)), np.array(position))


class Plant:
    """The bodies of a problem as a plant."""

    def __init__(self, problem: Problem, step: float):
        self.problem, source = problem, problem.model
        self.plant = plant = MultibodyPlant(step)
        plant.mutable_gravity_field().set_gravity_vector(source.opt.gravity.copy())
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        self.bodies: list[RigidBody] = [plant.world_body()]
        self.joints: list[Joint] = []
        for body in range(1, source.nbody):
            self._add_body(body)
        # a ball constraint to the world is a segmentation fault in Drake 1.51.1; one to a welded body is not
        post = plant.AddRigidBody("post", SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(1.0)))
        plant.WeldFrames(plant.world_frame(), post.body_frame())
        for loop in problem.loops:
            first, second = (self.bodies[body] if body else post for body in loop.bodies)
            if loop.weld:
                frames = [_transform(*end) for end in zip(loop.position, loop.quaternion, strict=True)]
                plant.AddWeldConstraint(first, frames[0], second, frames[1])
            else:
                plant.AddBallConstraint(first, loop.position[0], second, loop.position[1])
        for coupling in problem.couplings:
            first, second = (self.joints[j] for j in coupling.joints)
            plant.AddCouplerConstraint(first, second, coupling.ratio)
        plant.Finalize()

    def _add_body(self, body: int) -> None:
        source, plant = self.problem.model, self.plant
        parent = self.bodies[source.body_parentid[body]]
        offset = _transform(source.body_pos[body], source.body_quat[body])
        first = int(source.body_jntadr[body])
        joints = range(first, first + int(source.body_jntnum[body]))
        for j in joints:
            if j < joints[-1]:
                child = plant.AddRigidBody(f"part {j}", SpatialInertia.Zero())
            else:
                child = plant.AddRigidBody(f"body {body}", self._inertia(body))
            anchor = RigidTransform(np.array(source.jnt_pos[j]))
            on_parent = plant.AddFrame(
                FixedOffsetFrame(f"on parent {j}", parent.body_frame(), offset @ anchor)
            )
            on_child = plant.AddFrame(FixedOffsetFrame(f"on child {j}", child.body_frame(), anchor))
            self.joints.append(plant.AddJoint(_joint(source, j, on_parent, on_child)))
            parent, offset = child, RigidTransform()
        self.bodies.append(parent)

    def _inertia(self, body: int) -> SpatialInertia:
        source = self.problem.model
        mass, centre = float(source.body_mass[body]), np.array(source.body_ipos[body])
        frame = RotationMatrix(Quaternion(wxyz=source.body_iquat[body])).matrix()
        about = frame @ np.diag(source.body_inertia[body]) @ frame.T
        about = (about + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))) / mass
        unit = UnitInertia(about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2])
        return SpatialInertia(mass, centre, unit)

    def start(self) -> tuple[Array, Array]:
        """Return positions and velocities of the plant at the start."""
        source, problem = self.problem.model, self.problem
        q, v = np.zeros(self.plant.num_positions()), np.zeros(self.plant.num_velocities())
        for j, joint in enumerate(self.joints):
            address, dof = source.jnt_qposadr[j], source.jnt_dofadr[j]
            q_at, v_at = joint.position_start(), joint.velocity_start()
            if source.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
                rotation = RotationMatrix(Quaternion(wxyz=problem.qpos[address : address + 4]))
                q[q_at : q_at + 3] = RollPitchYaw(rotation).vector()
                v[v_at : v_at + 3] = rotation @ problem.qvel[dof : dof + 3]
            else:
                q[q_at], v[v_at] = problem.qpos[address] - source.qpos0[address], problem.qvel[dof]
        return q, v


def _joint(source: mujoco.MjModel, j: int, on_parent: object, on_child: object) -> Joint:
    kind, axis, name = source.jnt_type[j], np.array(source.jnt_axis[j]), f"joint {j}"
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        return RevoluteJoint(name, on_parent, on_child, axis)
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return PrismaticJoint(name, on_parent, on_child, axis)
    return BallRpyJoint(name, on_parent, on_child)


def run(problem: Problem, setting: Setting) -> Poses:
    step = problem.interval / setting.steps(problem.interval)
    built = Plant(problem, step)
    plant, simulator = built.plant, Simulator(built.plant)
    context = simulator.get_mutable_context()
    q, v = built.start()
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    simulator.Initialize()
    bodies, seconds = len(built.bodies), 0.0
    position, rotation = np.empty((problem.instants, bodies, 3)), np.empty((problem.instants, bodies, 3, 3))
    torque, crank = np.empty(problem.instants), built.joints[problem.crank].velocity_start()
    for k in range(problem.instants):
        # just before the instant: the step that starts there belongs to the next first
        end = (k + 1) * problem.interval
        before = time.process_time()
        simulator.AdvanceTo(end - 1.5 * step)
        slower = plant.GetVelocities(context)[crank]
        simulator.AdvanceTo(end - 0.5 * step)
        seconds += time.process_time() - before
        torque[k] = -problem.flywheel * (plant.GetVelocities(context)[crank] - slower) / step
        for body, made in enumerate(built.bodies):
            placed = plant.EvalBodyPoseInWorld(context, made)
            position[k, body], rotation[k, body] = placed.translation(), placed.rotation().matrix()
    return Poses(position, rotation, torque, seconds)
