"""Inertias of the bodies of a MuJoCo model: those of links, negligible ones, and placeholders."""

from dataclasses import replace

import mujoco
import numpy as np

from mechsim.mechanism.links import Inertia, vector
from mechsim.mechanism.masses import with_inertia
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.simulation.state import quaternion

# mass of a massless link, as a fraction of the heaviest link's mass. Under a prescribed motion both methods
# are compared with it, and of a smaller one MuJoCo's accelerations lose digits: 1e-5 rad/s2 at 1e-12 in a
# four-bar. In a run from an initial state it changes the motion itself, and MuJoCo keeps the digits
MASSLESS, MASSLESS_FREE = 1e-6, 1e-12
# least mass in [kg] and moment in [kg m2] of a massless link: twice MuJoCo's mjMINVAL
LEAST_ACCEPTED = 2e-15
# principal moment relative to the largest up to which it is zero: rounding of the eigenvalues
ZERO_MOMENT = 1e-14
# placeholder mass of a link times size of its mechanism, in [kg m], in models without real inertias
PLACEHOLDER = 0.1


def with_accepted_inertia(mechanism: Mechanism, massless: float = MASSLESS) -> Mechanism:
    """Return the mechanism with an inertia on every link that MuJoCo accepts: negligible instead of zero.

    Args:
        mechanism: links without an inertia are rods, as in `masses.with_inertia`.
        massless: mass that replaces zero, as a fraction of the heaviest link's.
    """
    described = with_inertia(mechanism)
    length = described.characteristic_length
    inertias = [link.inertia for link in described.links if link.inertia is not None]
    heaviest = max((max(item.mass, np.trace(item.matrix) / length**2) for item in inertias), default=0.0)
    least = max(massless * (heaviest or 1.0), LEAST_ACCEPTED)
    moment = max(least * length**2, LEAST_ACCEPTED)
    links = [
        replace(link, inertia=_without_zeros(inertia, least, moment))
        for link, inertia in zip(described.links, inertias, strict=True)
    ]
    return replace(described, links=tuple(links))


def _without_zeros(inertia: Inertia, mass: float, moment: float) -> Inertia:
    """Return an inertia with `mass` in place of a mass of zero, and `moment` added where one is zero."""
    values = np.linalg.eigvalsh(inertia.matrix)
    flat = not values[0] > ZERO_MOMENT * values[-1]
    if inertia.mass and not flat:
        return inertia
    a, b, c = (vector(row) for row in inertia.matrix + moment * flat * np.eye(3))
    massless = inertia.negligible or not inertia.mass
    return replace(inertia, mass=inertia.mass or mass, moments=(a, b, c), negligible=massless)


def set_inertia(body: mujoco.MjsBody, inertia: Inertia) -> None:
    """Set mass, centre and principal moments of a body."""
    body.explicitinertial = True
    body.mass, body.ipos = inertia.mass, inertia.centre
    body.iquat, body.inertia = principal(inertia)


def principal(inertia: Inertia) -> tuple[Array, Array]:
    """Return the quaternion of the principal axes and the moments about them, (4,) and (3,)."""
    moments = inertia.matrix
    rotation = np.eye(3)
    values = np.diag(moments).copy()
    if np.count_nonzero(moments - np.diag(values)):
        values, rotation = np.linalg.eigh(moments)
        rotation[:, 2] *= np.sign(np.linalg.det(rotation))
    # the largest moment of a flat body may exceed the sum of the others by rounding, which MuJoCo rejects
    largest = int(np.argmax(values))
    values[largest] = min(values[largest], values.sum() - values[largest])
    return quaternion(rotation), values


def set_placeholder(body: mujoco.MjsBody, mechanism: Mechanism, link: str) -> None:
    """Set the placeholder inertia of a link: a ball about the centre of its joints, 1 kg for a size of 0.1 m.

    Under a prescribed crank no motion depends on it. A ball of the link's own size keeps the mass matrix well
    conditioned at any scale. MuJoCo takes a moment of inertia below 1e-15 (mjMINVAL) for zero: with a mass
    inverse to the size it stays far above that for linkages down to 1e-8 m.
    """
    points, length = np.array([end.point for end in mechanism.ends(link)]), mechanism.characteristic_length
    centre = (points.min(0) + points.max(0)) / 2.0
    radius = max(float(np.linalg.norm(points - centre, axis=1).max()), 0.1 * length)
    body.explicitinertial = True
    body.mass, body.ipos = PLACEHOLDER / length, centre
    body.inertia = np.full(3, 0.4 * body.mass * radius**2)
