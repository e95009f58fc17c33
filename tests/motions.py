"""The difference of two motions, and mechanisms that start at a configuration."""

import numpy as np

import mechsim as ms


def largest_difference(result, exact, quantity="position", *, kind="points", rows=slice(None)) -> float:
    """Return the largest difference of a quantity, over the points, links or joints of the exact motion.

    `rows` are the instants of `result` that `exact` has.
    """
    differences = [
        np.abs(getattr(getattr(result, kind)[name], quantity)[rows] - getattr(item, quantity)).max()
        for name, item in getattr(exact, kind).items()
    ]
    return float(np.max(differences))


def started_at(mechanism: ms.Mechanism, motion: ms.Motion, index: int = 0) -> ms.Mechanism:
    """Return a mechanism whose guess is one configuration of a motion."""
    guess = {name: ms.Pose(link.position[index], link.rotation[index]) for name, link in motion.links.items()}
    return mechanism.with_guess(guess, float(motion.angle[index]))
