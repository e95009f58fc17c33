"""How a slide turns its links against each other where no mark says it: by the least, or as guessed."""

from collections.abc import Sequence

import numpy as np

from mechsim.numerics.arrays import Array

# axes whose sum has a smaller square are opposed, to rounding
OPPOSED = 1e-14
# a guess is rough, but which of several turns is meant it tells
MEANT = np.pi / 4


def least_turned(own: Array, axis: Array, mark: Array) -> Array:
    """Return the mark beside an axis of one's own whose least turn onto another axis lays mark on mark, (3,).

    Axes that are opposed are laid on each other about z, or about the other mark where that is not across.
    """
    across, between = np.cross(own, axis), own + axis
    if (nearness := float(between @ between)) > OPPOSED:
        back = np.cross(across, mark)
        return mark - back + 2.0 * np.cross(across, back) / nearness
    about = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < OPPOSED else mark
    return 2.0 * about * (about @ mark) - mark


def guessed(side: Array, frames: Sequence[Array], turned: Array) -> tuple[int, float]:
    """Return which of several joint frames of side b is meant by a guess, and how far off in [rad] that is.

    Args:
        side: the joint's frame on side a, (3, 3), with the axis as its last column.
        frames: those of side b.
        turned: rotation of link b seen from link a, as guessed.

    Where the guess lays the axes more against than along each other it says nothing: the first is taken.
    """
    own = turned @ frames[0][:, 2]
    if not own @ side[:, 2] > 0.0:
        return 0, 0.0
    meant = least_turned(own, side[:, 2], side[:, 0])
    near = [float((turned @ frame[:, 0]) @ meant) for frame in frames]
    best = int(np.argmax(near))
    return best, float(np.arccos(np.clip(near[best], -1.0, 1.0)))
