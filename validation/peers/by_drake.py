"""Drake: discrete steps under its SAP solver, and poses by inverse kinematics.

Loops are `AddBallConstraint`, which only the discrete plant with SAP takes; what the continuous plant has
for loops is a bushing, a spring, and is left out. Poses are an `InverseKinematics` program each, solved by
SNOPT, which Drake chooses itself, started from the pose before, as the tutorials do.

Inside the time: `Simulator.AdvanceTo` from sample to sample, or the programs' `Solve`. Outside: plant,
context, programs, points out of angles.
"""

import time
from dataclasses import dataclass

import numpy as np
from problem import SAMPLES, Array, Places, Problem
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

# on the crank as its rotor's inertia: no reaction of links of grams slows it
FLYWHEEL = 1e6
STEPS = (20, 100, 200, 500, 1000, 3000)
POSES = (20, 100)
AXIS = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Programmed(Setting):
    """Poses by optimisation: SNOPT's feasibility tolerance; its own is 1e-6."""

    feasibility: float = 1e-6


def settings(problem: Problem) -> list[Setting]:
    stepped = [Setting("Drake, discrete SAP", n) for n in STEPS]
    bounds = {"Drake, inverse kinematics": 1e-6, "Drake, inverse kinematics, tight": 1e-9}
    poses = [Programmed(name, n, poses=True, feasibility=to) for name, to in bounds.items() for n in POSES]
    return [*stepped, *poses]


def build(problem: Problem, setting: Setting) -> "Poses | Steps":
    return Poses(problem, setting) if isinstance(setting, Programmed) else Steps(problem, setting)


class Linkage:
    """A tree of crank, coupler and rocker in a plant, with the ends that close the loop."""

    def __init__(self, problem: Problem, timestep: float):
        self.problem = problem
        self.plant = plant = MultibodyPlant(timestep)
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        if timestep:
            plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        (at_crank, near), (self.far, self.at_rocker) = problem.tips
        self.crank, self.rocker = self._body("crank"), self._body("rocker")
        self.coupler = self._body("coupler")
        self.joints = self._hinge("crank", self.crank), self._hinge("rocker", self.rocker)
        arm = self._frame(self.crank, np.eye(3), at_crank)
        end = self._frame(self.coupler, np.eye(3), near)
        if problem.planar:
            self.middle = plant.AddJoint(RevoluteJoint("middle", arm, end, AXIS))
        else:
            self.middle = plant.AddJoint(BallRpyJoint("middle", arm, end))
        if timestep:
            plant.AddBallConstraint(self.coupler, self.far, self.rocker, self.at_rocker)
            motor = plant.AddJointActuator("motor", self.joints[0])
            motor.set_default_rotor_inertia(FLYWHEEL)
            motor.set_default_gear_ratio(1.0)
        plant.Finalize()

    def _body(self, link: str) -> RigidBody:
        body = self.problem.inertia(link)
        about = body.about((0.0, 0.0, 0.0)) / body.mass
        unit = UnitInertia(about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2])
        return self.plant.AddRigidBody(link, SpatialInertia(body.mass, np.array(body.centre), unit))

    def _hinge(self, link: str, body: RigidBody) -> Joint:
        hinge = self.problem.hinge(link)
        ground = self._frame(self.plant.world_body(), hinge.frame, hinge.place)
        own = self._frame(body, hinge.link_frame, hinge.link_place)
        return self.plant.AddJoint(RevoluteJoint(f"{link} hinge", ground, own, AXIS))

    def _frame(self, body: RigidBody, rotation: Array, place: Array) -> FixedOffsetFrame:
        at = RigidTransform(RotationMatrix(rotation), place)
        name = f"frame {self.plant.num_frames()}"
        return self.plant.AddFrame(FixedOffsetFrame(name, body.body_frame(), at))

    def begin(self, context: object) -> None:
        """Set places and rates of the start."""
        problem = self.problem
        for joint, link in zip(self.joints, ("crank", "rocker"), strict=True):
            joint.set_angle(context, problem.hinge(link).angle)
            joint.set_angular_rate(context, problem.hinge(link).rate)
        crank, coupler = problem.link("crank"), problem.link("coupler")
        turn = crank.rotation[0].T @ coupler.rotation[0]
        spin = crank.rotation[0].T @ (coupler.angular_velocity[0] - crank.angular_velocity[0])
        if problem.planar:
            self.middle.set_angle(context, float(np.arctan2(turn[1, 0], turn[0, 0])))
            self.middle.set_angular_rate(context, float(spin[2]))
        else:
            self.middle.set_angles(context, RotationMatrix(turn).ToRollPitchYaw().vector())
            self.middle.set_angular_velocity(context, spin)

    def angles(self, context: object) -> list[float]:
        """Return the angles of crank and rocker."""
        return [joint.get_angle(context) for joint in self.joints]


class Steps:
    """A turn in discrete steps."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem = problem
        self.linkage = Linkage(problem, problem.duration / setting.steps)
        self.simulator = Simulator(self.linkage.plant)
        # just before the step that begins at a sample, whose outcome belongs to the next instant
        self.times = np.linspace(0.0, problem.duration, SAMPLES + 1) * (1.0 - 1e-9)

    def run(self) -> tuple[float, Places]:
        context, simulator = self.simulator.get_mutable_context(), self.simulator
        context.SetTime(0.0)
        self.linkage.begin(context)
        simulator.Initialize()
        direction, seconds = [self.linkage.angles(context)], 0.0
        for until in self.times[1:]:
            begin = time.process_time()
            simulator.AdvanceTo(until)
            seconds += time.process_time() - begin
            direction.append(self.linkage.angles(context))
        crank, rocker = np.array(direction).T
        return seconds, self.problem.places(crank, rocker)

    def torque(self) -> None:
        """The drive is an inertia, and a discrete step has no accelerations to report."""


class Poses:
    """The poses of a turn, a program each."""

    def __init__(self, problem: Problem, setting: Programmed):
        self.solver, self.options = SnoptSolver(), SolverOptions()
        self.options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", setting.feasibility)
        self.problem, self.linkage = problem, Linkage(problem, 0.0)
        plant = self.linkage.plant
        self.context = plant.CreateDefaultContext()
        self.linkage.begin(self.context)
        self.start = plant.GetPositions(self.context)
        self.crank_place = self.linkage.joints[0].position_start()
        self.rocker_place = self.linkage.joints[1].position_start()
        self.angles = problem.angles(setting.steps)
        self.motion_laws = [self._program(angle) for angle in self.angles[1:]]

    def _program(self, angle: float) -> InverseKinematics:
        linkage, closed = self.linkage, np.zeros(3)
        program = InverseKinematics(linkage.plant)
        at = RigidTransform(linkage.at_rocker)
        program.AddPositionConstraint(
            linkage.coupler.body_frame(), linkage.far, linkage.rocker.body_frame(), at, closed, closed
        )
        crank = program.q()[self.crank_place]
        program.prog().AddBoundingBoxConstraint(angle, angle, crank)
        return program

    def run(self) -> tuple[float, Places]:
        here, direction, seconds = self.start, [self.start], 0.0
        for program in self.motion_laws:
            begin = time.process_time()
            result = self.solver.Solve(program.prog(), here, self.options)
            here = result.GetSolution(program.q())
            seconds += time.process_time() - begin
            direction.append(here)
        states = np.array(direction)
        return seconds, self.problem.places(states[:, self.crank_place], states[:, self.rocker_place])

    def torque(self) -> None:
        """Inverse kinematics knows no forces."""
