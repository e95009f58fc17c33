"""Pinocchio from Python: constrained forward dynamics by RK4.

A tree of crank, coupler and rocker; the loop is a `RigidConstraintModel` of contact type 3D, solved by
`constraintDynamics` to rounding, with and without Baumgarte's correction. Pinocchio has no integrators: this
file implements the steps in Python, which takes most of the time.

Inside the time: the loop over steps. Outside: model, data and points from angles.
"""

import time
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from problem import SAMPLES, Array, Positions, Problem
from protocol import Setting

# armature of the crank in [kg m2]: large against the links of a few grams
ARMATURE = 1e9
# of the Baumgarte correction, per revolution: the same as mechsim's loops
TIME_CONSTANTS = 10.0
STEPS = (20, 40, 100, 200, 500, 1000)
# coordinates and rates
State = tuple[Array, Array]


@dataclass(frozen=True)
class Baumgarte(Setting):
    """Steps with Baumgarte's correction: time constants per revolution; 0 leaves constraint drift."""

    constants: float = 0.0


def settings(problem: Problem) -> list[Setting]:
    drifting = [Baumgarte("Pinocchio (Python), RK4", n) for n in STEPS]
    corrected = [Baumgarte("Pinocchio (Python), RK4, Baumgarte", n, constants=TIME_CONSTANTS) for n in STEPS]
    return [*drifting, *corrected]


class Solver:
    """The linkage as a tree with one constraint; coordinates crank, coupler, rocker."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem, self.setting = problem, setting
        self.model = model = pin.Model()
        model.gravity.linear = np.zeros(3)
        (at_crank, coupler_start), (coupler_end, at_rocker) = problem.coupler_ends
        crank, rocker = problem.hinge("crank"), problem.hinge("rocker")
        first = model.addJoint(0, pin.JointModelRZ(), pin.SE3(crank.frame, crank.position), "crank")
        middle = pin.JointModelRZ() if problem.planar else pin.JointModelSpherical()
        second = model.addJoint(first, middle, pin.SE3(np.eye(3), crank.in_frame(at_crank)), "coupler")
        third = model.addJoint(0, pin.JointModelRZ(), pin.SE3(rocker.frame, rocker.position), "rocker")
        frames = crank.link_frame, np.eye(3), rocker.link_frame
        origins = crank.link_position, coupler_start, rocker.link_position
        for joint, frame, position in zip((first, second, third), frames, origins, strict=True):
            body = problem.inertia(model.names[joint])
            placement = pin.SE3(frame.T, -frame.T @ position)
            inertia = pin.Inertia(body.mass, np.array(body.centre), body.matrix)
            model.appendBodyToJoint(joint, inertia, placement)
        model.armature[0] = ARMATURE
        self.joints = second, third
        self.ends = coupler_end - coupler_start, rocker.in_frame(at_rocker)
        self.data = model.createData()
        self.q, self.v = self._start(crank.frame)
        self.constants = setting.constants if isinstance(setting, Baumgarte) else 0.0
        self._add_loop()
        self.no_torque = np.zeros(model.nv)

    def _add_loop(self) -> None:
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
        crank_rotation = crank_frame @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        rotation = crank_rotation.T @ coupler.rotation[0]
        spin = rotation.T @ crank_rotation.T @ (coupler.angular_velocity[0] - crank.rate * crank_frame[:, 2])
        if problem.planar:
            angle = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
            return np.array([crank.angle, angle, rocker.angle]), np.array([crank.rate, spin[2], rocker.rate])
        quaternion = pin.Quaternion(rotation).coeffs()
        return np.array([crank.angle, *quaternion, rocker.angle]), np.array([crank.rate, *spin, rocker.rate])

    def run(self) -> tuple[float, Positions]:
        begin = time.process_time()
        self.states = self.stepped()
        seconds = time.process_time() - begin
        angles = np.array([q for q, _ in self.states])
        return seconds, self.problem.positions(angles[:, 0], angles[:, -1])

    def torque(self) -> Array:
        """Return the torque on the armature of the crank at the computed states."""
        return np.array([-ARMATURE * self.acceleration(q, v)[0] for q, v in self.states])

    def stepped(self) -> list[State]:
        """Return the states at the samples, by the classical Runge-Kutta method in the tangent space."""
        model, dt = self.model, self.problem.duration / self.setting.steps
        interval = self.setting.steps // SAMPLES
        q, v, states = self.q, self.v, [(self.q, self.v)]
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
            if i % interval == 0:
                states.append((q, v))
        return states

    def acceleration(self, q: Array, v: Array) -> Array:
        """Return the accelerations of all coordinates under the constraint."""
        accelerations = pin.constraintDynamics(
            self.model, self.data, q, v, self.no_torque, self.constraints, self.workspace, self.proximal
        )
        return np.array(accelerations)

    def tangent_rate(self, vector: Array, rate: Array) -> Array:
        """Return the rate of a tangent vector for velocities `rate`: inverse of dexp, to second order."""
        if self.problem.planar:
            return rate
        out, u, w = rate.copy(), vector[1:4], rate[1:4]
        rotated = np.array([u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]])
        (x, y, z), (a, b, c) = u, rotated
        out[1:4] += 0.5 * rotated + np.array([y * c - z * b, z * a - x * c, x * b - y * a]) / 12.0
        return out


build = Solver
