"""Forces of bushings in MuJoCo, from the poses and velocities of the frames of both sides."""

import numpy as np

from mechsim.mechanism.nonlinear_springs import Bushing
from mechsim.numerics.arrays import Array
from mechsim.simulation.state import rotation_vector_rates


def bushing_forces(bushing: Bushing, pose: Array, velocity: Array) -> tuple[Array, Array, Array]:
    """Return the wrenches of a bushing on sides a and b, at their origins, (n, 12), energy and power lost.

    Args:
        bushing: the bushing, whose docstring states the formula.
        pose: position and rotation vector of side a, then of side b, in the ground frame, (n, 12).
        velocity: velocity and angular velocity of both, (n, 12).
    """
    from scipy.spatial.transform import Rotation

    a, b = Rotation.from_rotvec(pose[:, 3:6]), Rotation.from_rotvec(pose[:, 9:])
    gap, spin_a = pose[:, 6:9] - pose[:, :3], velocity[:, 3:6]
    rate = velocity[:, 6:9] - velocity[:, :3] - np.cross(spin_a, gap)
    rotated = (a.inv() * b).as_rotvec()
    deflection = np.hstack([a.apply(gap, inverse=True), rotated])
    rates = np.hstack([a.apply(rate, inverse=True), a.apply(velocity[:, 9:] - spin_a, inverse=True)])
    stiffness, damping = bushing.matrices
    elastic, damped = -deflection @ stiffness, -rates @ damping
    energy, lost = -0.5 * (elastic * deflection).sum(1), -(damped * rates).sum(1)
    moment = (elastic[:, None, 3:] @ rotation_vector_rates(rotated))[:, 0] + damped[:, 3:]
    force, moment = a.apply(elastic[:, :3] + damped[:, :3]), a.apply(moment)
    return np.hstack([-force, -moment - np.cross(gap, force), force, moment]), energy, lost
