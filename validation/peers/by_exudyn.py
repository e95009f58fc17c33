"""Exudyn: the same linkage with redundant coordinates and implicit integration.

Crank and rocker are bodies with one angle (`ObjectRotationalMass1D`). The coupler is a rigid body between two
joints, or in "rod as a length" a `DistanceConstraint` without a body. Settings follow the manual: index 3
with the generalised-alpha method and a spectral radius of 0.5 to 1; index 2 with the implicit trapezoidal
rule; a `CoordinateConstraint` prescribes the crank. "as it comes" uses the default options, among them
modified Newton and a radius of 0.9, except for the faster of the dense linear solvers. Exudyn's explicit
integrators do not support loop constraints.

Inside the time: `SolveSteps`, recording of two angles and the torque at the samples included. Outside:
model, assembly, `InitializeSolver` (initial accelerations).
"""

import os
import time
from dataclasses import dataclass
from typing import Any, Literal

# the module without range checks, which the manual of Exudyn advises for a tested model
os.environ.setdefault("EXUDYN_MODULE", "fast")

import exudyn
import exudyn.itemInterface as items  # noqa: N813
import numpy as np
from exudyn import utilities
from problem import SAMPLES, Array, Positions, Problem
from protocol import Setting

STEPS = (20, 40, 100, 200, 500, 1000)


@dataclass(frozen=True)
class Implicit(Setting):
    """Settings of the integration.

    Attributes:
        prescribed: "speed" of the crank, by a `CoordinateConstraint` of velocity, or its "angle", by one
            with an `offsetUserFunction` in Python.
        index: of the integrated constraints.
        coupler: rotation of the body by "Euler parameters" or "Lie group", or a "length" without mass.
        radius: spectral radius of the generalised-alpha method, below 1 for index 3.
        modified: whether Newton's method reuses its matrix while it converges.
    """

    prescribed: Literal["speed", "angle"] = "speed"
    index: Literal[2, 3] = 3
    coupler: Literal["Euler parameters", "Lie group", "length"] = "Euler parameters"
    radius: float = 0.5
    modified: bool = False


NODES = {
    "Euler parameters": exudyn.NodeType.RotationEulerParameters,
    "Lie group": exudyn.NodeType.RotationRotationVector,
}
FAMILIES: dict[str, dict[str, Any]] = {
    "Exudyn index 3, as it comes": {"modified": True, "prescribed": "angle", "radius": 0.9},
    "Exudyn index 3, full Newton": {},
    "Exudyn index 3, full Newton, Lie group": {"coupler": "Lie group"},
    "Exudyn index 3, full Newton, rod as a length": {"coupler": "length"},
    "Exudyn index 2": {"index": 2, "modified": True},
}


def settings(problem: Problem) -> list[Implicit]:
    # a planar body has one angle in either representation
    kinds = {name: options for name, options in FAMILIES.items() if not (problem.planar and "Lie" in name)}
    return [Implicit(series, n, **options) for series, options in kinds.items() for n in STEPS]


def build(problem: Problem, setting: Implicit) -> "Solver":
    return Solver(problem, setting)


class Solver:
    """An assembled Exudyn system that solves the revolution repeatedly."""

    def __init__(self, problem: Problem, setting: Implicit):
        self.problem, self.setting = problem, setting
        self._container = exudyn.SystemContainer()
        self.system = self._container.AddSystem()
        crank, at_crank = self._rotor("crank", 0)
        rocker, at_rocker = self._rotor("rocker", 1)
        if setting.coupler == "length":
            markers = [at_crank, at_rocker]
            self.system.AddObject(items.DistanceConstraint(markerNumbers=markers, distance=self._length))
        else:
            self._coupler(at_crank, at_rocker)
        self.force = self._prescribe_crank(crank)
        recorded = {"storeInternal": True, "outputVariableType": exudyn.OutputVariableType.Coordinates}
        self.sensors = [
            self.system.AddSensor(items.SensorNode(nodeNumber=node, **recorded)) for node in (crank, rocker)
        ]
        self.system.Assemble()
        self.options = self._options()
        self.solver = exudyn.MainSolverImplicitSecondOrder()
        self.system.sys["dynamicSolver"] = self.solver

    def run(self) -> tuple[float, Positions]:
        self.finished = False
        system, options, data = self.system, self.options, self.system.systemData
        kinds = exudyn.ConfigurationType
        data.SetSystemState(data.GetSystemState(configuration=kinds.Initial), configuration=kinds.Current)
        data.SetTime(0.0)
        if not self.solver.InitializeSolver(system, options):
            raise RuntimeError("Exudyn could not start")
        begin = time.process_time()
        solved = self.solver.SolveSteps(system, options)
        seconds = time.process_time() - begin
        self.solver.FinalizeSolver(system, options)
        angles = [system.GetSensorStoredData(sensor)[-SAMPLES - 1 :, 1] for sensor in self.sensors]
        if not solved or len(angles[0]) != SAMPLES + 1:
            return seconds, {}
        crank, rocker = angles
        self.finished = True
        return seconds, self.problem.positions(
            self.problem.hinge("crank").angle + crank, self.problem.hinge("rocker").angle + rocker
        )

    def torque(self) -> Array | None:
        """Return the multiplier of the driving constraint; None for a coupler without mass."""
        if self.setting.coupler == "length" or not self.finished:
            return None
        return -self.system.GetSensorStoredData(self.force)[-SAMPLES - 1 :, 1]

    def _rotor(self, link: str, tip: int) -> tuple[int, int]:
        """Add crank or rocker; return its node and a marker at the joint with the coupler."""
        problem, hinge = self.problem, self.problem.hinge(link)
        axis = hinge.link_frame[:, 2]
        inertia = float(axis @ problem.inertia(link).about(tuple(hinge.link_position)) @ axis)
        node = self.system.AddNode(
            items.Node1D(referenceCoordinates=[hinge.angle], initialVelocities=[hinge.rate])
        )
        body = self.system.AddObject(
            items.Rotor1D(
                nodeNumber=node,
                inertia=inertia,
                referencePosition=hinge.position,
                referenceRotation=hinge.frame,
            )
        )
        local = hinge.in_frame(problem.coupler_ends[tip][tip])
        return node, self.system.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=local))

    def _coupler(self, at_crank: int, at_rocker: int) -> None:
        """Add the coupler as a body between two joints."""
        planar = self.problem.planar
        body = self._planar_body() if planar else self._spatial_body()
        (_, coupler_start), (coupler_end, _) = self.problem.coupler_ends
        joint = items.RevoluteJoint2D if planar else items.SphericalJoint
        for marker, local in ((at_crank, coupler_start), (at_rocker, coupler_end)):
            own = self.system.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=local))
            self.system.AddObject(joint(markerNumbers=[marker, own]))

    def _planar_body(self) -> int:
        start, inertia = self.problem.link("coupler"), self.problem.inertia("coupler")
        angle = float(np.arctan2(start.rotation[0, 1, 0], start.rotation[0, 0, 0]))
        node = self.system.AddNode(
            items.NodeRigidBody2D(
                referenceCoordinates=[*start.position[0, :2], angle],
                initialVelocities=[*start.velocity[0, :2], start.angular_velocity[0, 2]],
            )
        )
        return self.system.AddObject(
            items.ObjectRigidBody2D(
                nodeNumber=node,
                mass=inertia.mass,
                inertia=float(inertia.about((0.0, 0.0, 0.0))[2, 2]),
                centerOfMass=list(inertia.centre[:2]),
            )
        )

    def _spatial_body(self) -> int:
        start, inertia = self.problem.link("coupler"), self.problem.inertia("coupler")
        rigid_body_inertia = utilities.RigidBodyInertia(
            mass=inertia.mass, inertiaTensor=inertia.about((0.0, 0.0, 0.0)), com=np.array(inertia.centre)
        )
        number = self.system.CreateRigidBody(
            inertia=rigid_body_inertia,
            nodeType=NODES[self.setting.coupler],
            referencePosition=start.position[0],
            referenceRotationMatrix=start.rotation[0],
            initialVelocity=start.velocity[0],
            initialAngularVelocity=start.angular_velocity[0],
        )
        return int(number)

    @property
    def _length(self) -> float:
        (_, coupler_start), (coupler_end, _) = self.problem.coupler_ends
        return float(np.linalg.norm(coupler_end - coupler_start))

    def _prescribe_crank(self, crank: int) -> int:
        """Prescribe the crank's speed or angle; return the sensor of the drive torque."""
        speed, prescribed = self.problem.speed, self.setting.prescribed
        ground = self.system.AddNode(items.NodePointGround())
        markers = [
            self.system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
            for node in (ground, crank)
        ]
        options: dict[str, Any] = {"offset": speed, "velocityLevel": True}
        if prescribed == "angle":
            options = {
                "offsetUserFunction": lambda _system, time, _item, _offset: speed * time,
                "offsetUserFunction_t": lambda _system, _time, _item, _offset: speed,
            }
        driver = self.system.AddObject(items.CoordinateConstraint(markerNumbers=markers, **options))
        kind = exudyn.OutputVariableType.Force
        return self.system.AddSensor(
            items.SensorObject(objectNumber=driver, storeInternal=True, outputVariableType=kind)
        )

    def _options(self) -> Any:
        setting, options = self.setting, exudyn.SimulationSettings()
        solution, integration = options.solution, options.timeIntegration
        solution.file.write = False
        solution.sensors.writePeriod = self.problem.duration / SAMPLES
        options.parallel.numberOfThreads = 1
        options.linearSolver.solverType = exudyn.LinearSolverType.EigenDense
        integration.endTime = self.problem.duration
        integration.numberOfSteps = setting.steps
        integration.adaptiveStep = False
        integration.verboseMode = 0
        integration.newton.useModifiedNewton = setting.modified
        integration.generalizedAlpha.spectralRadius = setting.radius
        if setting.index == 2:
            # as "TrapezoidalIndex2" of the manual
            integration.generalizedAlpha.useNewmark = True
            integration.generalizedAlpha.useIndex2Constraints = True
        return options
