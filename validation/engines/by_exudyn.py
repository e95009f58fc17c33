"""Exudyn: bodies with redundant coordinates, joints as constraints, implicit integration of index 3.

The settings follow its manual. Planar loops have more constraints than they need; `ignoreSingularJacobian`
with the dense solver lets them be. Its Newton method does not converge with the flywheel, so the crank's
joint follows its angle by an `offsetUserFunction`, in Python, and the torque is that of this joint.
"""

import time
from itertools import product
from typing import Any

import exudyn
import exudyn.itemInterface as items  # noqa: N813
import mujoco
import numpy as np
from exudyn import utilities
from reference_problem import Array, Poses, Problem, Setting, Unsupported
from scipy.spatial.transform import Rotation

NAME, PACKAGE = "Exudyn", "exudyn"
HINGE, SLIDE, BALL = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_BALL)


# spectral radius of the generalised-alpha method; 0.9 is its default, with modified Newton
SETTINGS = [
    Setting("default", 0.001, 0.9),
    *[Setting(f"full Newton, radius {r}", -float(n), r) for r, n in product((0.5, 0.9), (2, 10))],
]


class Bodies:
    """The bodies of a problem in an Exudyn system."""

    def __init__(self, problem: Problem):
        if problem.couplings:
            raise Unsupported("couplings between joints")
        self.problem, source = problem, problem.model
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        data = mujoco.MjData(source)
        data.qpos[:], data.qvel[:] = problem.qpos, problem.qvel
        mujoco.mj_forward(source, data)
        self.numbers = [self.system.AddObject(items.ObjectGround())]
        for body in range(1, source.nbody):
            self.numbers.append(self._add_body(data, body))
        for body in range(1, source.nbody):
            self._add_joint(data, body)
        for loop in problem.loops:
            axes = [1] * 6 if loop.weld else [1, 1, 1, 0, 0, 0]
            frames = Rotation.from_quat(loop.quaternion, scalar_first=True)
            self._constrain(loop.bodies, loop.position, frames, axes)

    def _add_body(self, data: mujoco.MjData, body: int) -> int:
        source, velocity = self.problem.model, np.zeros(6)
        mujoco.mj_objectVelocity(source, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
        frame = Rotation.from_quat(source.body_iquat[body], scalar_first=True).as_matrix()
        centre = np.array(source.body_ipos[body])
        mass = float(source.body_mass[body])
        about_centre = frame @ np.diag(self.problem.moments[body]) @ frame.T
        about_origin = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        inertia = utilities.RigidBodyInertia(mass=mass, inertiaTensor=about_origin, com=centre)
        number = self.system.CreateRigidBody(
            inertia=inertia,
            nodeType=exudyn.NodeType.RotationEulerParameters,
            referencePosition=data.xpos[body],
            referenceRotationMatrix=data.xmat[body].reshape(3, 3),
            initialVelocity=velocity[3:],
            initialAngularVelocity=velocity[:3],
            gravity=list(source.opt.gravity),
        )
        return int(number)

    def _add_joint(self, data: mujoco.MjData, body: int) -> None:
        """Constrain a body against its parent so that its joints are what remains."""
        source, parent = self.problem.model, int(self.problem.model.body_parentid[body])
        joints = np.arange(source.body_jntnum[body]) + source.body_jntadr[body]
        kinds = list(source.jnt_type[joints])
        if not (len(kinds) == 1 or (sorted(kinds) == [SLIDE, HINGE] and _parallel(source.jnt_axis[joints]))):
            raise Unsupported("a body with several joints that are no cylindrical joint")
        axes = [1, 1, int(SLIDE not in kinds)]
        axes += [0, 0, 0] if BALL in kinds else [1, 1, int(HINGE not in kinds)]
        # z of the joint's frame is its axis in the body and, at the start, in the parent
        to_axis = Rotation.align_vectors([source.jnt_axis[joints[0]]], [[0.0, 0.0, 1.0]])[0]
        own, other = (Rotation.from_matrix(data.xmat[k].reshape(3, 3)) for k in (body, parent))
        local = np.array(source.jnt_pos[joints[0]])
        in_parent = other.inv().apply(own.apply(local) + data.xpos[body] - data.xpos[parent])
        frames = Rotation.concatenate([other.inv() * own * to_axis, to_axis])
        turns = None
        if joints[0] == self.problem.crank:
            axes, speed = [1] * 6, float(self.problem.qvel[self.problem.model.jnt_dofadr[joints[0]]])
            turns = lambda _system, time, _item, _parameters: [0.0] * 5 + [speed * time]  # noqa: E731
        number = self._constrain((parent, body), np.array([in_parent, local]), frames, axes, turns)
        if turns is not None:
            self.joint_torque = number

    def _constrain(
        self, bodies: tuple[int, int], points: Array, frames: Rotation, axes: list[int], turns: Any = None
    ) -> int:
        markers = [
            self.system.AddMarker(items.MarkerBodyRigid(bodyNumber=self.numbers[body], localPosition=point))
            for body, point in zip(bodies, points, strict=True)
        ]
        first, second = frames.as_matrix()
        joint = items.GenericJoint(
            markerNumbers=markers, constrainedAxes=axes, rotationMarker0=first, rotationMarker1=second
        )
        if turns is not None:
            joint.offsetUserFunction = turns
        return int(self.system.AddObject(joint))


def _parallel(axes: Array) -> bool:
    return bool(np.abs(np.cross(*axes)).max() < 1e-12)  # of unit vectors: rounding


def _settings(problem: Problem, setting: Setting) -> Any:
    result = exudyn.SimulationSettings()
    integration, duration = result.timeIntegration, problem.interval * problem.instants
    result.solution.file.write = False
    result.solution.sensors.writePeriod = problem.interval
    result.parallel.numberOfThreads = 1
    result.linearSolver.solverType = exudyn.LinearSolverType.EigenDense
    result.linearSolver.ignoreSingularJacobian = True
    result.linearSolver.pivotThreshold = 0.0
    integration.endTime = duration
    integration.numberOfSteps = problem.instants * setting.steps(problem.interval)
    integration.adaptiveStep, integration.verboseMode = False, 0
    integration.generalizedAlpha.spectralRadius = setting.options
    integration.newton.useModifiedNewton = setting.name == "default"
    return result


def run(problem: Problem, setting: Setting) -> Poses:
    bodies = Bodies(problem)
    system, kinds = bodies.system, exudyn.OutputVariableType

    def recorded(number: int, kind: Any) -> Any:
        sensor = items.SensorBody(bodyNumber=number, outputVariableType=kind, storeInternal=True)
        return system.AddSensor(sensor)

    outputs = (kinds.Position, kinds.RotationMatrix)
    sensors = [[recorded(number, kind) for kind in outputs] for number in bodies.numbers[1:]]
    joint_torque = {"objectNumber": bodies.joint_torque, "outputVariableType": kinds.TorqueLocal}
    torque = system.AddSensor(items.SensorObject(**joint_torque, storeInternal=True))
    system.Assemble()
    before = time.process_time()
    solved = system.SolveDynamic(_settings(problem, setting))
    seconds = time.process_time() - before
    n = problem.instants
    if not solved or len(system.GetSensorStoredData(torque)) < n + 1:
        raise RuntimeError("its Newton method did not converge")
    data = [[system.GetSensorStoredData(sensor)[-n:, 1:] for sensor in pair] for pair in sensors]
    position = np.stack([np.zeros((n, 3)), *[pair[0] for pair in data]], 1)
    rotation = np.stack([np.tile(np.eye(3), (n, 1, 1)), *[pair[1].reshape(n, 3, 3) for pair in data]], 1)
    return Poses(position, rotation, system.GetSensorStoredData(torque)[-n:, 3], seconds)
