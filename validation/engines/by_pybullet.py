"""PyBullet: its multibody with joint coordinates, loops as constraints of its iterative solver.

Its velocity motor loses 4e-4 of the speed, so the flywheel drives; the torque comes from a difference of
velocities. The bodies are read from a URDF file written here.
"""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient
from reference_problem import Array, Loop, Poses, Problem, Setting, Unsupported
from scipy.spatial.transform import Rotation

NAME, PACKAGE = "PyBullet", "pybullet"
KINDS = {
    mujoco.mjtJoint.mjJNT_HINGE: "continuous",
    mujoco.mjtJoint.mjJNT_SLIDE: "prismatic",
    mujoco.mjtJoint.mjJNT_BALL: "spherical",
}
UNLIMITED = 1e9  # force of a constraint, in [N]


# iterations of the solver, 50 by default; by default all links lose 4 % of their speed a second, which would
# brake the flywheel and is off in all settings
SETTINGS = [
    Setting("default", 1.0 / 240.0, 50),
    *[Setting(f"{n} iterations", -float(steps), n) for n in (50, 500) for steps in (5, 50)],
]


def _origin(position: Array, rotation: Rotation) -> str:
    numbers = (" ".join(f"{x:.17g}" for x in row) for row in (position, rotation.as_euler("xyz")))
    return '<origin xyz="{}" rpy="{}"/>'.format(*numbers)


def _inertia(moments: Sequence[float]) -> str:
    named = " ".join(f'i{axis}{axis}="{x:.17g}"' for axis, x in zip("xyz", moments, strict=True))
    return f'<inertia {named} ixy="0" ixz="0" iyz="0"/>'


def _urdf(problem: Problem) -> str:
    """Return the tree in URDF, whose links have their origin at the joint that moves them."""
    model = problem.model
    links = [f'<link name="base"><inertial><mass value="0"/>{_inertia((0.0, 0.0, 0.0))}</inertial></link>']
    for body in range(1, model.nbody):
        j, parent = model.body_jntadr[body], int(model.body_parentid[body])
        anchor = model.jnt_pos[j]
        centre = model.body_ipos[body] - anchor
        own = Rotation.from_quat(model.body_iquat[body], scalar_first=True)
        links.append(
            f'<link name="l{body}"><inertial>{_origin(centre, own)}'
            f'<mass value="{model.body_mass[body]:.17g}"/>'
            f"{_inertia(model.body_inertia[body])}</inertial></link>"
        )
        rotation = Rotation.from_quat(model.body_quat[body], scalar_first=True)
        position = model.body_pos[body] + rotation.apply(anchor)
        if parent:
            position = position - model.jnt_pos[model.body_jntadr[parent]]
        axis = " ".join(f"{x:.17g}" for x in model.jnt_axis[j])
        above = f"l{parent}" if parent else "base"
        links.append(
            f'<joint name="j{j}" type="{KINDS[mujoco.mjtJoint(model.jnt_type[j])]}">'
            f'{_origin(position, rotation)}<axis xyz="{axis}"/>'
            f'<parent link="{above}"/><child link="l{body}"/>'
            '<limit effort="1e9" velocity="1e9" lower="-1e9" upper="1e9"/></joint>'
        )
    return f'<robot name="{problem.name}">{"".join(links)}</robot>'


class World:
    """The bodies of a problem in a PyBullet world; the link of MuJoCo's body b is number b - 1."""

    def __init__(self, problem: Problem):
        model = problem.model
        if (model.body_jntnum[1:] != 1).any():
            raise Unsupported("a body with several joints")
        self.problem, self.client = problem, BulletClient(pybullet.DIRECT)
        self.client.setGravity(*model.opt.gravity)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "tree.urdf"
            file.write_text(_urdf(problem))
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_MAINTAIN_LINK_ORDER
            self.tree = self.client.loadURDF(str(file), useFixedBase=True, flags=flags)
        for link in range(-1, model.nbody - 1):
            kinds = ("linearDamping", "angularDamping", "jointDamping")
            self.client.changeDynamics(self.tree, link, **dict.fromkeys(kinds, 0.0))
        self.start()
        for loop in problem.loops:
            self._close(loop)
        for coupling in problem.couplings:
            first, second = (int(model.jnt_bodyid[j]) - 1 for j in coupling.joints)
            made = self.client.createConstraint(
                self.tree, first, self.tree, second, pybullet.JOINT_GEAR, [0, 0, 1], [0, 0, 0], [0, 0, 0]
            )
            self.client.changeConstraint(made, gearRatio=-coupling.ratio, maxForce=UNLIMITED)

    def start(self) -> None:
        """Set the coordinates at the start, and switch off the motors that every joint has."""
        model, problem = self.problem.model, self.problem
        for j in range(model.njnt):
            link, address, dof = int(model.jnt_bodyid[j]) - 1, model.jnt_qposadr[j], model.jnt_dofadr[j]
            if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
                w, x, y, z = problem.qpos[address : address + 4]
                rate = list(problem.qvel[dof : dof + 3])
                self.client.resetJointStateMultiDof(self.tree, link, [x, y, z, w], rate)
                off = {
                    "targetPosition": [0, 0, 0, 1],
                    "positionGain": 0,
                    "velocityGain": 0,
                    "force": [0, 0, 0],
                }
                self.client.setJointMotorControlMultiDof(self.tree, link, pybullet.POSITION_CONTROL, **off)
            else:
                q, v = float(problem.qpos[address] - model.qpos0[address]), float(problem.qvel[dof])
                self.client.resetJointState(self.tree, link, q, v)
                self.client.setJointMotorControl2(self.tree, link, pybullet.VELOCITY_CONTROL, force=0.0)

    def _close(self, loop: Loop) -> None:
        model, ends = self.problem.model, []
        for body, position, quaternion in zip(loop.bodies, loop.position, loop.quaternion, strict=True):
            frame = Rotation.from_quat(model.body_iquat[body], scalar_first=True).inv()
            rotation = frame * Rotation.from_quat(quaternion, scalar_first=True)
            ends.append((body - 1, frame.apply(position - model.body_ipos[body]), rotation.as_quat()))
        (first, at_first, turned_first), (second, at_second, turned_second) = ends
        kind = pybullet.JOINT_FIXED if loop.weld else pybullet.JOINT_POINT2POINT
        frames = at_first, at_second, turned_first, turned_second
        made = self.client.createConstraint(self.tree, first, self.tree, second, kind, [0, 0, 0], *frames)
        self.client.changeConstraint(made, maxForce=UNLIMITED)

    def poses(self) -> tuple[Array, Array]:
        """Return the frames of all bodies as they are."""
        model = self.problem.model
        position, rotation = np.zeros((model.nbody, 3)), np.tile(np.eye(3), (model.nbody, 1, 1))
        states = self.client.getLinkStates(
            self.tree, list(range(model.nbody - 1)), computeForwardKinematics=1
        )
        for body, state in enumerate(states, 1):
            frame = Rotation.from_quat(state[5])
            position[body] = np.array(state[4]) - frame.apply(model.jnt_pos[model.body_jntadr[body]])
            rotation[body] = frame.as_matrix()
        return position, rotation


def run(problem: Problem, setting: Setting) -> Poses:
    world, steps = World(problem), setting.steps(problem.interval)
    client, crank = world.client, int(problem.model.jnt_bodyid[problem.crank]) - 1
    client.setPhysicsEngineParameter(
        fixedTimeStep=problem.interval / steps, numSolverIterations=setting.options, numSubSteps=0
    )
    recorded, torque, seconds = [], np.empty(problem.instants), 0.0
    for k in range(problem.instants):
        before = time.process_time()
        for _ in range(steps):
            slower = client.getJointState(world.tree, crank)[1]
            client.stepSimulation()
        seconds += time.process_time() - before
        recorded.append(world.poses())
        change = client.getJointState(world.tree, crank)[1] - slower
        torque[k] = -problem.flywheel * change * steps / problem.interval
    client.disconnect()
    position, rotation = (np.array(item) for item in zip(*recorded, strict=True))
    return Poses(position, rotation, torque, seconds)
