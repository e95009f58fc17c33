"""Inertias of links, from those of all their bodies."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mechsim.mechanism.links import Inertia, Link, combine, rows, vector
from mechsim.numerics.arrays import ROUNDING
from mechsim.simulation.mjcf_reader.kinematic_tree import Carrier
from mechsim.simulation.state import rotation_matrix


def with_inertias(
    model: mujoco.MjModel,
    links: Sequence[Link],
    carriers: Sequence[Carrier],
    raised: float = 0.0,
) -> tuple[Link, ...]:
    """Return links with the inertias of all their bodies.

    Args:
        model: the compiled model.
        links: the moving links.
        carriers: carrier of each body, the world first.
        raised: mass in [kg] assigned to massless bodies; 0 if there are none.
    """
    bodies = {link.name: list[int]() for link in links}
    for i, carrier in enumerate(carriers):
        if carrier.link in bodies:
            bodies[carrier.link].append(i)
    if not any(model.body_mass[i] > 0.0 for own in bodies.values() for i in own):
        return tuple(links)

    def inertia(own: Sequence[int]) -> Inertia:
        """Return the inertia of the bodies on one link, in its frame."""
        inertias: list[Inertia] = []
        for i in own if any(model.body_mass[i] > 0.0 for i in own) else ():
            axes = carriers[i].pose.rotation @ rotation_matrix(model.body_iquat[i])
            moments = rows(axes @ np.diag(model.body_inertia[i]) @ axes.T)
            inertias.append(
                Inertia(float(model.body_mass[i]), vector(carriers[i].point(model.body_ipos[i])), moments)
            )
        whole = combine(inertias)
        return replace(whole, negligible=not whole.mass > raised * len(own) * (1.0 + ROUNDING))

    return tuple(replace(link, inertia=inertia(bodies[link.name])) for link in links)
