"""Packing of the state of a mechanism into one vector, with quaternions for balls."""

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import Dynamics, EquationsOfMotion, Kinematics
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.vector_method.rotations import cross, from_quaternion
from mechsim.numerics.arrays import Array


class StateLayout:
    """Packing of coordinates, quaternions of spherical joints, rates, work and loss into one vector.

    Args:
        equations: equations of motion.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.tree = equations.loops.tree
        self.units = equations.loops.units
        self.count, self.balls = self.tree.count, len(self.tree.balls)
        self.positions = self.count + 4 * self.balls

    def pack(self, q: Coordinates, rates: Array, work: float, lost: float) -> Array:
        """Return the vector of one state."""
        turns = [rotation_quaternions(rotation)[0] for rotation in q.turns]
        return np.concatenate([q.values[:, 0] / self.units, *turns, rates[:, 0], [work, lost]])

    def unpack(self, state: Array) -> tuple[Coordinates, Array, float, float]:
        """Return coordinates, rates (count, 1), work done and energy lost of a vector."""
        q, rates = self.unpack_states(state[None])
        return q, rates, float(state[-2]), float(state[-1])

    def unpack_states(self, states: Array) -> tuple[Coordinates, Array]:
        """Return coordinates and rates (count, n) of n vectors."""
        n, positions = self.count, self.positions
        rotations = np.zeros((self.balls, 3, 3, len(states)))
        for i, rotation in enumerate(rotations):
            rotation[:] = rotation_matrices(states[:, n + 4 * i : n + 4 * i + 4])
        q = Coordinates(states[:, :n].T * self.units[:, None], rotations)
        return q, states[:, positions : positions + n].T.copy()

    def replaced(self, states: Array, q: Coordinates, rates: Array) -> Array:
        """Return n vectors with other coordinates and rates (count, n), and unchanged work and loss."""
        n, positions, result = self.count, self.positions, states.copy()
        result[:, :n] = (q.values / self.units[:, None]).T
        result[:, positions : positions + n] = rates.T
        for i, rotation in enumerate(q.turns):
            columns = slice(n + 4 * i, n + 4 * i + 4)
            new = rotation_quaternions(rotation)
            # a quaternion and its negative are the same rotation
            result[:, columns] = np.where((new * states[:, columns]).sum(1)[:, None] < 0.0, -new, new)
        return result

    def derivatives(self, states: Array, kinematics: Kinematics, dynamics: Dynamics) -> Array:
        """Return the derivatives of n vectors by time, (n, size)."""
        values = kinematics.rates.copy()
        values[self.tree.ball_indices] = 0.0
        turning: list[Array] = []
        for i, ball in enumerate(self.tree.balls):
            rate = kinematics.rates[ball.first_angle : ball.first_angle + 3]
            first = self.count + 4 * i
            turning.append(quaternion_rates(states[:, first : first + 4], rate.T).T)
        powers = dynamics.power_in[None], dynamics.power_lost[None]
        return np.concatenate([values, *turning, dynamics.acceleration, *powers]).T

    def scale(self, rate: float) -> Array:
        """Return characteristic magnitudes of the vector's components at a characteristic rate."""
        return np.concatenate([np.ones(self.positions), np.full(self.count, rate), np.full(2, 1e300)])


def rotation_quaternions(rotations: Array) -> Array:
    """Return the unit quaternions (w, x, y, z), (n, 4), of rotation matrices (3, 3, n)."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotations.transpose(2, 0, 1)).as_quat(), 1, axis=1)


def rotation_matrices(quaternions: Array) -> Array:
    """Return the rotation matrices (3, 3, n) of quaternions (w, x, y, z), (n, 4), of any length."""
    w, x, y, z = (quaternions / np.sqrt((quaternions**2).sum(1))[:, None]).T
    return from_quaternion(w, x, y, z)


def quaternion_rates(quaternions: Array, angular_velocities: Array) -> Array:
    """Return the rates of quaternions (n, 4) at angular velocities (n, 3) in the fixed frame, (n, 4)."""
    w, vector = quaternions[:, :1], quaternions[:, 1:]
    scalar = -(angular_velocities * vector).sum(1)[:, None]
    return 0.5 * np.concatenate([scalar, w * angular_velocities + cross(angular_velocities, vector)], 1)
