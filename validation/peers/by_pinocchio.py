"""Pinocchio from Python: constrained forward dynamics under RK4, and poses by Newton's method.

A tree of crank, coupler and rocker; the loop is a `RigidConstraintModel` of contact type 3D, solved by
`constraintDynamics` to rounding, with and without Baumgarte's correction. Pinocchio has no integrators: the
steps, like Newton's method, are written here in Python, and most of the time is Python's. Pinocchio's C++
would do the same with the same errors in a fraction of it.

Inside the time: all of the loop over steps or poses. Outside: model, data and points out of angles.
"""

import time
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from problem import SAMPLES, TURN, Array, Places, Problem
from protocol import Setting

# on the crank as its armature: no reaction of links of grams slows it
FLYWHEEL = 1e9
# of the Baumgarte correction, in a turn: what mechsim's loops have, too
CONSTANTS = 10.0
STEPS = (20, 40, 100, 200, 500, 1000)
POSES = (20, 100, 1000)
# coordinates and rates
State = tuple[Array, Array]
# Newton's method stops at this opening of the loop, in units of the crank
CLOSED, MOST = 1e-13, 10


@dataclass(frozen=True)
class Corrected(Setting):
    """Steps whose loop is drawn closed with so many time constants a turn; 0 leaves it to drift."""

    constants: float = 0.0


def settings(problem: Problem) -> list[Setting]:
    drifting = [Corrected("Pinocchio (Python), RK4", n) for n in STEPS]
    drawn = [Corrected("Pinocchio (Python), RK4, Baumgarte", n, constants=CONSTANTS) for n in STEPS]
    return [*drifting, *drawn, *[Setting("Pinocchio (Python), Newton", n, poses=True) for n in POSES]]


class Solver:
    """The linkage as a tree with one constraint; coordinates crank, coupler, rocker."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem, self.setting = problem, setting
        self.model = model = pin.Model()
        model.gravity.linear = np.zeros(3)
        (at_crank, near), (far, at_rocker) = problem.tips
        crank, rocker = problem.hinge("crank"), problem.hinge("rocker")
        first = model.addJoint(0, pin.JointModelRZ(), pin.SE3(crank.frame, crank.place), "crank")
        middle = pin.JointModelRZ() if problem.planar else pin.JointModelSpherical()
        second = model.addJoint(first, middle, pin.SE3(np.eye(3), crank.in_frame(at_crank)), "coupler")
        third = model.addJoint(0, pin.JointModelRZ(), pin.SE3(rocker.frame, rocker.place), "rocker")
        frames = crank.link_frame, np.eye(3), rocker.link_frame
        zeros = crank.link_place, near, rocker.link_place
        for joint, frame, place in zip((first, second, third), frames, zeros, strict=True):
            body = problem.inertia(model.names[joint])
            at = pin.SE3(frame.T, -frame.T @ place)
            model.appendBodyToJoint(joint, pin.Inertia(body.mass, np.array(body.centre), body.matrix), at)
        model.armature[0] = FLYWHEEL
        self.joints = second, third
        self.ends = far - near, rocker.in_frame(at_rocker)
        self.rows = 2 if problem.planar else 3  # a planar loop says nothing across its plane
        self.frames = [
            model.addFrame(pin.Frame(f"end {i}", joint, 0, pin.SE3(np.eye(3), end), pin.FrameType.OP_FRAME))
            for i, (joint, end) in enumerate(zip(self.joints, self.ends, strict=True))
        ]
        self.data = model.createData()
        self.q, self.v = self._start(crank.frame)
        self.constants = setting.constants if isinstance(setting, Corrected) else 0.0
        self._close()
        self.nothing = np.zeros(model.nv)

    def _close(self) -> None:
        """Add the loop as a constraint."""
        self.constraints = pin.StdVec_RigidConstraintModel()
        first, second = self.joints
        ends = [pin.SE3(np.eye(3), end) for end in self.ends]
        loop = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D, self.model, first, ends[0], second, ends[1], pin.ReferenceFrame.LOCAL
        )
        rate = self.constants / self.problem.duration
        loop.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(rate**2, 2.0 * rate))
        self.constraints.append(loop)
        self.workspace = pin.StdVec_RigidConstraintData()
        self.workspace.append(loop.createData())
        pin.initConstraintDynamics(self.model, self.data, self.constraints, self.workspace)
        self.proximal = pin.ProximalSettings(1e-12, 1e-12, 10)

    def _start(self, crank_frame: Array) -> tuple[Array, Array]:
        """Return coordinates and rates at the start."""
        problem = self.problem
        crank, rocker, coupler = problem.hinge("crank"), problem.hinge("rocker"), problem.link("coupler")
        cos, sin = np.cos(crank.angle), np.sin(crank.angle)
        before = crank_frame @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        rotation = before.T @ coupler.rotation[0]
        spin = rotation.T @ before.T @ (coupler.angular_velocity[0] - crank.rate * crank_frame[:, 2])
        if problem.planar:
            turn = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
            return np.array([crank.angle, turn, rocker.angle]), np.array([crank.rate, spin[2], rocker.rate])
        quaternion = pin.Quaternion(rotation).coeffs()
        return np.array([crank.angle, *quaternion, rocker.angle]), np.array([crank.rate, *spin, rocker.rate])

    def run(self) -> tuple[float, Places]:
        begin = time.process_time()
        direction = self.solved() if self.setting.poses else self.stepped()
        seconds = time.process_time() - begin
        self.way, angles = direction, np.array([q for q, _ in direction])
        return seconds, self.problem.places(angles[:, 0], angles[:, -1])

    def torque(self) -> Array | None:
        """Return what the wheel on the crank feels, at the rates reached; none at poses."""
        if self.setting.poses:
            return None
        return np.array([-FLYWHEEL * self.acceleration(q, v)[0] for q, v in self.way])

    def stepped(self) -> list[State]:
        """Return the states at the samples, by the classical Runge-Kutta method in the tangent space."""
        model, dt = self.model, self.problem.duration / self.setting.steps
        stride = self.setting.steps // SAMPLES
        q, v, direction = self.q, self.v, [(self.q, self.v)]
        for i in range(1, self.setting.steps + 1):
            a1 = self.acceleration(q, v)
            w1 = v
            v2 = v + 0.5 * dt * a1
            w2 = self.tangent_rate(0.5 * dt * w1, v2)
            a2 = self.acceleration(pin.integrate(model, q, 0.5 * dt * w1), v2)
            v3 = v + 0.5 * dt * a2
            u2 = 0.5 * dt * w2
            w3 = self.tangent_rate(u2, v3)
            a3 = self.acceleration(pin.integrate(model, q, u2), v3)
            v4 = v + dt * a3
            u3 = dt * w3
            w4 = self.tangent_rate(u3, v4)
            a4 = self.acceleration(pin.integrate(model, q, u3), v4)
            q = pin.integrate(model, q, dt / 6.0 * (w1 + 2.0 * (w2 + w3) + w4))
            v = v + dt / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
            if i % stride == 0:
                direction.append((q, v))
        return direction

    def acceleration(self, q: Array, v: Array) -> Array:
        """Return the accelerations of all coordinates under the constraint."""
        made = pin.constraintDynamics(
            self.model, self.data, q, v, self.nothing, self.constraints, self.workspace, self.proximal
        )
        return np.array(made)

    def tangent_rate(self, direction: Array, rate: Array) -> Array:
        """Return the rate of the tangent vector `direction` for velocities `rate`: dexp^-1, right side."""
        if self.problem.planar:
            return rate
        out, u, w = rate.copy(), direction[1:4], rate[1:4]
        turned = np.array([u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]])
        (x, y, z), (a, b, c) = u, turned
        out[1:4] += 0.5 * turned + np.array([y * c - z * b, z * a - x * c, x * b - y * a]) / 12.0
        return out

    def solved(self) -> list[State]:
        """Return the coordinates and derivatives at the poses, each started along the tangent."""
        model, stride = self.model, TURN / self.setting.steps
        q = self.q
        tangent = self.tangent(self.linearised(q)[1])
        direction = [(q, tangent)]
        start = self.q[0]
        for i in range(1, self.setting.steps + 1):
            q = pin.integrate(model, q, stride * tangent)
            q[0] = start + i * stride
            for _ in range(MOST):
                gap, jacobian = self.linearised(q)
                if np.abs(gap).max() < CLOSED * self.problem.crank:
                    break
                q = pin.integrate(model, q, self.least(jacobian, -gap))
            tangent = self.tangent(jacobian)
            direction.append((q, tangent))
        return direction

    def linearised(self, q: Array) -> tuple[Array, Array]:
        """Return how far the loop stands open and the derivative of that."""
        model, data, rows = self.model, self.data, self.rows
        pin.computeJointJacobians(model, data, q)
        places, jacobians = [], []
        for frame in self.frames:
            places.append(pin.updateFramePlacement(model, data, frame).translation)
            jacobians.append(pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED))
        return (places[0] - places[1])[:rows], (jacobians[0] - jacobians[1])[:rows]

    def least(self, jacobian: Array, right: Array) -> Array:
        """Return the smallest change of all coordinates but the crank's that makes J x = right."""
        held, step = jacobian[:, 1:], np.zeros(self.model.nv)
        step[1:] = held.T @ np.linalg.solve(held @ held.T, right)
        return step

    def tangent(self, jacobian: Array) -> Array:
        """Return the rates of all coordinates at unit rate of the crank."""
        step = self.least(jacobian, -jacobian[:, 0])
        step[0] = 1.0
        return step


build = Solver
