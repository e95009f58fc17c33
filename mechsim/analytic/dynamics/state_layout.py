"""Packing of the state of a mechanism into one vector, with quaternions for balls."""

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import Dynamics, EquationsOfMotion, Kinematics
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.vector_method.rotations import cross
from mechsim.numerics.arrays import Array


class StateLayout:
    """Packing of coordinates, quaternions of balls, rates, work and loss into one vector.

    Args:
        equations: whose states.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.tree = equations.loops.tree
        self.units = equations.loops.units
        self.count, self.balls = self.tree.count, len(self.tree.balls)
        self.positions = self.count + 4 * self.balls

    def pack(self, q: Coordinates, rates: Array, work: float, lost: float) -> Array:
        """Return the vector of one state."""
        quaternions = [quaternion(rotation[..., 0]) for rotation in q.turns]
        return np.concatenate([q.values[:, 0] / self.units, *quaternions, rates[:, 0], [work, lost]])

    def unpack(self, state: Array) -> tuple[Coordinates, Array, float, float]:
        """Return coordinates, rates (count, 1), work done and energy lost of a vector."""
        q, rates = self.unpack_states(state[None])
        return q, rates, float(state[-2]), float(state[-1])

    def unpack_states(self, states: Array) -> tuple[Coordinates, Array]:
        """Return coordinates and rates (count, n) of n vectors."""
        n, positions = self.count, self.positions
        rotations = np.zeros((self.balls, 3, 3, len(states)))
        for i, rotation in enumerate(rotations):
            for k, state in enumerate(states):
                rotation[..., k] = rotation_matrix(state[n + 4 * i : n + 4 * i + 4])
        q = Coordinates(states[:, :n].T * self.units[:, None], rotations)
        return q, states[:, positions : positions + n].T.copy()

    def derivatives(self, states: Array, kinematics: Kinematics, dynamics: Dynamics) -> Array:
        """Return the derivatives of n vectors by time, (n, size)."""
        values = kinematics.rates.copy()
        values[self.tree.ball_indices] = 0.0
        turning: list[Array] = []
        for i, ball in enumerate(self.tree.balls):
            rate = kinematics.rates[ball.first_angle : ball.first_angle + 3]
            first = self.count + 4 * i
            quaternions = states[:, first : first + 4]
            turning.append(
                np.array([quaternion_rate(*pair) for pair in zip(quaternions, rate.T, strict=True)]).T
            )
        powers = dynamics.power_in[None], dynamics.power_lost[None]
        return np.concatenate([values, *turning, dynamics.acceleration, *powers]).T

    def scale(self, rate: float) -> Array:
        """Return characteristic magnitudes of the vector's components at a characteristic rate."""
        return np.concatenate([np.ones(self.positions), np.full(self.count, rate), np.full(2, 1e300)])


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)


def rotation_matrix(quaternion: Array) -> Array:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length."""
    w, x, y, z = quaternion / np.sqrt((quaternion**2).sum())
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def quaternion_rate(quaternion: Array, angular_velocity: Array) -> Array:
    """Return the rate of a quaternion at an angular velocity (3,) in the fixed frame."""
    w, vector = quaternion[0], quaternion[1:]
    return 0.5 * np.concatenate(
        [[-angular_velocity @ vector], w * angular_velocity + cross(angular_velocity, vector)]
    )
