"""Pinocchio from Python: its constrained dynamics, with steps written here, for it has no integrator.

Loops are `RigidConstraintModel`, solved by `constraintDynamics` with Baumgarte's correction. Couplings
between joints are not among its constraints. The steps are in Python, which takes most of the time.
"""

import time
from dataclasses import dataclass
from itertools import product
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from reference_problem import Array, Poses, Problem, Setting, Unsupported

NAME, PACKAGE = "Pinocchio", "pin"


@dataclass(frozen=True)
class Options:
    """Order of the steps, 1 (semi-implicit) or 4, and time constants of Baumgarte's correction a turn."""

    order: int = 1
    constants: float = 0.0


SETTINGS = [
    Setting("default", 0.001, Options()),
    *[
        Setting(f"order {order}, {constants:g} time constants a turn", -float(n), Options(order, constants))
        for order, constants, n in product((1, 4), (10.0, 100.0), (2, 10))
    ],
]


def _se3(position: Array, quaternion: Array) -> pin.SE3:
    w, x, y, z = quaternion
    return pin.SE3(pin.Quaternion(float(w), float(x), float(y), float(z)), np.array(position))


class Tree:
    """The bodies of a problem as a Pinocchio model; a coordinate is zero at the start of MuJoCo's model."""

    def __init__(self, problem: Problem):
        if problem.couplings:
            raise Unsupported("couplings between joints")
        self.problem, source = problem, problem.model
        self.model = model = pin.Model()
        model.gravity.linear = source.opt.gravity.copy()
        # MuJoCo's body -> Pinocchio's joint that carries it, and the body's frame in the joint's
        self.carrier: dict[int, tuple[int, pin.SE3]] = {0: (0, pin.SE3.Identity())}
        for body in range(1, source.nbody):
            self._add_body(body)
        self.data = model.createData()

    def _add_body(self, body: int) -> None:
        source, model = self.problem.model, self.model
        parent, offset = self.carrier[int(source.body_parentid[body])]
        offset = offset * _se3(source.body_pos[body], source.body_quat[body])
        first = source.body_jntadr[body]
        for j in range(first, first + source.body_jntnum[body]):
            anchor = pin.SE3(np.eye(3), source.jnt_pos[j])
            parent = model.addJoint(parent, _joint(source, j), offset * anchor, f"joint {j}")
            offset = anchor.inverse()
        moments = np.diag(source.body_inertia[body])
        local = _se3(source.body_ipos[body], source.body_iquat[body])
        centre = local.rotation @ moments @ local.rotation.T
        model.appendBodyToJoint(
            parent, pin.Inertia(float(source.body_mass[body]), local.translation, centre), offset
        )
        self.carrier[body] = parent, offset

    def constraints(self, rate: float) -> tuple[Any, Any]:
        """Return the loops, corrected at a rate in [1/s], and their working memory."""
        models, data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for loop in self.problem.loops:
            ends = []
            for body, position, quaternion in zip(loop.bodies, loop.position, loop.quaternion, strict=True):
                joint, offset = self.carrier[body]
                ends += [joint, offset * _se3(position, quaternion)]
            kind = pin.ContactType.CONTACT_6D if loop.weld else pin.ContactType.CONTACT_3D
            made = pin.RigidConstraintModel(kind, self.model, *ends, pin.ReferenceFrame.LOCAL)
            made.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(rate**2, 2.0 * rate))
            models.append(made)
            data.append(made.createData())
        return models, data

    def start(self) -> tuple[Array, Array]:
        """Return coordinates and velocities at the start."""
        source, q = self.problem.model, pin.neutral(self.model)
        for j in range(source.njnt):
            to, address = self.model.joints[j + 1].idx_q, source.jnt_qposadr[j]
            if source.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
                w, x, y, z = self.problem.qpos[address : address + 4]
                q[to : to + 4] = x, y, z, w
            else:
                q[to] = self.problem.qpos[address] - source.qpos0[address]
        return q, self.problem.qvel.copy()

    def poses(self, states: list[Array], torque: Array, seconds: float) -> Poses:
        """Return the poses of all bodies."""
        bodies = len(self.carrier)
        position, rotation = np.empty((len(states), bodies, 3)), np.empty((len(states), bodies, 3, 3))
        for k, q in enumerate(states):
            pin.forwardKinematics(self.model, self.data, q)
            for body, (joint, offset) in self.carrier.items():
                placed = self.data.oMi[joint] * offset
                position[k, body], rotation[k, body] = placed.translation, placed.rotation
        return Poses(position, rotation, torque, seconds)


def _joint(source: mujoco.MjModel, j: int) -> pin.JointModel:
    kind, axis = source.jnt_type[j], np.array(source.jnt_axis[j])
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        return pin.JointModelRevoluteUnaligned(axis)
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return pin.JointModelPrismaticUnaligned(axis)
    return pin.JointModelSpherical()


def run(problem: Problem, setting: Setting) -> Poses:
    tree, options = Tree(problem), setting.options
    model, data = tree.model, tree.data
    models, workspace = tree.constraints(options.constants / (problem.interval * (problem.instants + 1)))
    pin.initConstraintDynamics(model, data, models, workspace)
    # redundant loops are singular at 1e-12; from 1e-8 to 1e-4 results are the same
    proximal, no_torque = pin.ProximalSettings(1e-12, 1e-6, 50), np.zeros(model.nv)
    balls = [
        slice(joint.idx_v, joint.idx_v + 3)
        for joint in model.joints
        if joint.shortname() == "JointModelSpherical"
    ]

    def acceleration(q: Array, v: Array) -> Array:
        return np.array(pin.constraintDynamics(model, data, q, v, no_torque, models, workspace, proximal))

    q, v = tree.start()
    steps = setting.steps(problem.interval)
    dt, crank = problem.interval / steps, model.joints[problem.crank + 1].idx_v
    states, torque, seconds = [], np.empty(problem.instants), 0.0
    for k in range(problem.instants):
        before = time.process_time()
        for _ in range(steps):
            if options.order == 1:
                v = v + dt * acceleration(q, v)
                q = pin.integrate(model, q, dt * v)
            else:
                q, v = _runge_kutta(model, acceleration, balls, q, v, dt)
        seconds += time.process_time() - before
        states.append(q)
        torque[k] = -problem.flywheel * acceleration(q, v)[crank]
    return tree.poses(states, torque, seconds)


def _runge_kutta(model, acceleration, balls, q: Array, v: Array, dt: float) -> tuple[Array, Array]:  # type: ignore[no-untyped-def]
    """Return the state after a classical step of order 4 in the tangent space of the coordinates."""

    def stage(displacement: Array, velocity: Array) -> tuple[Array, Array]:
        rate = velocity.copy()
        for ball in balls:  # inverse of dexp to second order
            u, w = displacement[ball], velocity[ball]
            across = pin.skew(u)
            rate[ball] += 0.5 * across @ w + across @ across @ w / 12.0
        return rate, acceleration(pin.integrate(model, q, displacement), velocity)

    w1, a1 = v, acceleration(q, v)
    w2, a2 = stage(0.5 * dt * w1, v + 0.5 * dt * a1)
    w3, a3 = stage(0.5 * dt * w2, v + 0.5 * dt * a2)
    w4, a4 = stage(dt * w3, v + dt * a3)
    moved = pin.integrate(model, q, dt / 6.0 * (w1 + 2.0 * (w2 + w3) + w4))
    return moved, v + dt / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
