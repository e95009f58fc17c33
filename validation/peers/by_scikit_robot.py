"""scikit-robot: configurations by its inverse kinematics of an open chain, rocker and coupler.

Its models have no loops: inverse kinematics moves the end of the coupler to that of the crank, from the
previous configuration. Three hinges replace a ball joint between the links. The default tolerance is 1 mm;
here it is 0.1 mm. Smaller tolerances fail, because its angles have 32 bits.

Inside the time: `inverse_kinematics` of all configurations. Outside: model, targets and points from angles.
"""

import time

import numpy as np
from problem import Positions, Problem
from protocol import Setting
from scipy.spatial.transform import Rotation
from skrobot.coordinates import CascadedCoords, Coordinates
from skrobot.model import Link, RobotModel, RotationalJoint

POSES = (20, 100)
# of the position in [m]; of the solver
TOLERANCE, MAX_ITERATIONS = 1e-4, 200
# half-range of all joints, in [rad]
RANGE = 4.0 * np.pi


def settings(problem: Problem) -> list[Setting]:
    return [Setting("scikit-robot, inverse kinematics", n, poses=True) for n in POSES]


class Solver:
    """Rocker and coupler as a chain of hinges."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem, self.angles = problem, problem.angles(setting.samples)
        (at_crank, coupler_start), (coupler_end, at_rocker) = problem.coupler_ends
        rocker, crank = problem.hinge("rocker"), problem.hinge("crank")
        frame = rocker.frame @ Rotation.from_rotvec([0.0, 0.0, rocker.angle]).as_matrix()
        relative = frame.T @ problem.link("coupler").rotation[0]
        axes = "z" if problem.planar else "xyz"
        angles = Rotation.from_matrix(relative).as_euler("XYZ")
        self.start = [rocker.angle, *([angles[2]] if problem.planar else angles)]
        base = Link(name="base")
        links, joints = [base], []
        for name, axis in (("rocker", "z"), *((f"coupler_{axis}", axis) for axis in axes)):
            link = Link(name=name)
            links[-1].assoc(link)
            if name == "rocker":
                link.newcoords(Coordinates(pos=rocker.position, rot=rocker.frame))
            else:
                first = len(links) == 2
                link.newcoords(Coordinates(pos=rocker.in_frame(at_rocker) if first else np.zeros(3)))
            joint = RotationalJoint(
                name=name,
                axis=axis,
                parent_link=links[-1],
                child_link=link,
                min_angle=-RANGE,
                max_angle=RANGE,
            )
            link.joint = joint
            link.add_parent_link(links[-1])
            links[-1].add_child_link(link)
            links.append(link)
            joints.append(joint)
        self.end = CascadedCoords(parent=links[-1], pos=coupler_start - coupler_end)
        self.robot = RobotModel(link_list=links, joint_list=joints)
        self.links, self.targets = links[1:], crank.path(at_crank, self.angles)

    def run(self) -> tuple[float, Positions]:
        robot, rocker = self.robot, [self.start[0]]
        robot.angle_vector(np.array(self.start))
        begin = time.process_time()
        for target in self.targets[1:]:
            solved = robot.inverse_kinematics(
                Coordinates(pos=target),
                link_list=self.links,
                move_target=self.end,
                rotation_axis=False,
                thre=TOLERANCE,
                stop=MAX_ITERATIONS,
            )
            if solved is False:
                return time.process_time() - begin, {}
            rocker.append(float(robot.joint_list[0].joint_angle()))
        return time.process_time() - begin, self.problem.positions(self.angles, np.array(rocker))

    def torque(self) -> None:
        """Kinematics alone."""


build = Solver
