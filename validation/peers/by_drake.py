"""Drake: discrete steps with its SAP solver, and configurations by inverse kinematics.

Loops are `AddBallConstraint`, which only the discrete plant with SAP supports. The continuous plant has only
bushings, which are springs and are not compared. Each configuration is an `InverseKinematics` program, solved
by Drake's default SNOPT from the configuration before, as in the tutorials.

Inside the time: `Simulator.AdvanceTo` from sample to sample, or the programs' `Solve`. Outside: plant,
context, programs, points from angles.
"""

import time
from dataclasses import dataclass

import numpy as np
from problem import SAMPLES, Array, Positions, Problem
from protocol import Setting
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    FixedOffsetFrame,
    Joint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.solvers import SnoptSolver, SolverOptions
from pydrake.systems.analysis import Simulator

# of the motor on the crank in [kg m2]: large against the links of a few grams
ROTOR_INERTIA = 1e6
STEPS = (20, 100, 200, 500, 1000, 3000)
POSES = (20, 100)
AXIS = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class OptimisedPoses(Setting):
    """Configurations by optimisation, with SNOPT's feasibility tolerance; its default is 1e-6."""

    feasibility: float = 1e-6


def settings(problem: Problem) -> list[Setting]:
    stepped = [Setting("Drake, discrete SAP", n) for n in STEPS]
    tolerances = {"Drake, inverse kinematics": 1e-6, "Drake, inverse kinematics, tight": 1e-9}
    names = [(name, n) for name in tolerances for n in POSES]
    poses = [OptimisedPoses(name, n, poses=True, feasibility=tolerances[name]) for name, n in names]
    return [*stepped, *poses]


def build(problem: Problem, setting: Setting) -> "Poses | Steps":
    return Poses(problem, setting) if isinstance(setting, OptimisedPoses) else Steps(problem, setting)


class Linkage:
    """A tree of crank, coupler and rocker in a plant, with the points that close the loop."""

    def __init__(self, problem: Problem, timestep: float):
        self.problem = problem
        self.plant = plant = MultibodyPlant(timestep)
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        if timestep:
            plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        (at_crank, coupler_start), (self.coupler_end, self.at_rocker) = problem.coupler_ends
        self.crank, self.rocker = self._body("crank"), self._body("rocker")
        self.coupler = self._body("coupler")
        self.joints = self._hinge("crank", self.crank), self._hinge("rocker", self.rocker)
        arm = self._frame(self.crank, np.eye(3), at_crank)
        end = self._frame(self.coupler, np.eye(3), coupler_start)
        if problem.planar:
            self.middle = plant.AddJoint(RevoluteJoint("middle", arm, end, AXIS))
        else:
            self.middle = plant.AddJoint(BallRpyJoint("middle", arm, end))
        if timestep:
            plant.AddBallConstraint(self.coupler, self.coupler_end, self.rocker, self.at_rocker)
            motor = plant.AddJointActuator("motor", self.joints[0])
            motor.set_default_rotor_inertia(ROTOR_INERTIA)
            motor.set_default_gear_ratio(1.0)
        plant.Finalize()

    def _body(self, link: str) -> RigidBody:
        body = self.problem.inertia(link)
        m = body.about((0.0, 0.0, 0.0)) / body.mass
        unit = UnitInertia(m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2])
        return self.plant.AddRigidBody(link, SpatialInertia(body.mass, np.array(body.centre), unit))

    def _hinge(self, link: str, body: RigidBody) -> Joint:
        hinge = self.problem.hinge(link)
        ground = self._frame(self.plant.world_body(), hinge.frame, hinge.position)
        own = self._frame(body, hinge.link_frame, hinge.link_position)
        return self.plant.AddJoint(RevoluteJoint(f"{link} hinge", ground, own, AXIS))

    def _frame(self, body: RigidBody, rotation: Array, position: Array) -> FixedOffsetFrame:
        placement = RigidTransform(RotationMatrix(rotation), position)
        name = f"frame {self.plant.num_frames()}"
        return self.plant.AddFrame(FixedOffsetFrame(name, body.body_frame(), placement))

    def set_initial_state(self, context: object) -> None:
        """Set the initial positions and rates."""
        problem = self.problem
        for joint, link in zip(self.joints, ("crank", "rocker"), strict=True):
            joint.set_angle(context, problem.hinge(link).angle)
            joint.set_angular_rate(context, problem.hinge(link).rate)
        crank, coupler = problem.link("crank"), problem.link("coupler")
        rotation_matrix = crank.rotation[0].T @ coupler.rotation[0]
        spin = crank.rotation[0].T @ (coupler.angular_velocity[0] - crank.angular_velocity[0])
        if problem.planar:
            self.middle.set_angle(context, float(np.arctan2(rotation_matrix[1, 0], rotation_matrix[0, 0])))
            self.middle.set_angular_rate(context, float(spin[2]))
        else:
            self.middle.set_angles(context, RotationMatrix(rotation_matrix).ToRollPitchYaw().vector())
            self.middle.set_angular_velocity(context, spin)

    def angles(self, context: object) -> list[float]:
        """Return the angles of crank and rocker."""
        return [joint.get_angle(context) for joint in self.joints]


class Steps:
    """A revolution in discrete steps."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem = problem
        self.linkage = Linkage(problem, problem.duration / setting.steps)
        self.simulator = Simulator(self.linkage.plant)
        # just before each sample: the step that starts there belongs to the next instant
        self.times = np.linspace(0.0, problem.duration, SAMPLES + 1) * (1.0 - 1e-9)

    def run(self) -> tuple[float, Positions]:
        context, simulator = self.simulator.get_mutable_context(), self.simulator
        context.SetTime(0.0)
        self.linkage.set_initial_state(context)
        simulator.Initialize()
        states, seconds = [self.linkage.angles(context)], 0.0
        for time_of_sample in self.times[1:]:
            begin = time.process_time()
            simulator.AdvanceTo(time_of_sample)
            seconds += time.process_time() - begin
            states.append(self.linkage.angles(context))
        crank, rocker = np.array(states).T
        return seconds, self.problem.positions(crank, rocker)

    def torque(self) -> None:
        """None: an inertia drives the crank, and a discrete step has no accelerations."""


class Poses:
    """The configurations of a revolution, one program each."""

    def __init__(self, problem: Problem, setting: OptimisedPoses):
        self.solver, self.options = SnoptSolver(), SolverOptions()
        self.options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", setting.feasibility)
        self.problem, self.linkage = problem, Linkage(problem, 0.0)
        plant = self.linkage.plant
        self.context = plant.CreateDefaultContext()
        self.linkage.set_initial_state(self.context)
        self.start = plant.GetPositions(self.context)
        self.crank_address = self.linkage.joints[0].position_start()
        self.rocker_address = self.linkage.joints[1].position_start()
        self.angles = problem.angles(setting.steps)
        self.problems = [self._kinematics(angle) for angle in self.angles[1:]]

    def _kinematics(self, angle: float) -> InverseKinematics:
        linkage, zero = self.linkage, np.zeros(3)
        kinematics = InverseKinematics(linkage.plant)
        placement = RigidTransform(linkage.at_rocker)
        kinematics.AddPositionConstraint(
            linkage.coupler.body_frame(),
            linkage.coupler_end,
            linkage.rocker.body_frame(),
            placement,
            zero,
            zero,
        )
        crank = kinematics.q()[self.crank_address]
        kinematics.prog().AddBoundingBoxConstraint(angle, angle, crank)
        return kinematics

    def run(self) -> tuple[float, Positions]:
        q, states, seconds = self.start, [self.start], 0.0
        for kinematics in self.problems:
            begin = time.process_time()
            result = self.solver.Solve(kinematics.prog(), q, self.options)
            q = result.GetSolution(kinematics.q())
            seconds += time.process_time() - begin
            states.append(q)
        states = np.array(states)
        return seconds, self.problem.positions(states[:, self.crank_address], states[:, self.rocker_address])

    def torque(self) -> None:
        """None: inverse kinematics has no forces."""
