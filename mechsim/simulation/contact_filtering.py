"""Contacts among bodies that the drivers settle: they move nothing, and brake the drivers.

Links as CAD exports them overlap where they are joined; as loops are held hard, so are contacts.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

# bits of a contact mask, the sign's left out
BITS = 31


def exclude_contacts(model: mujoco.MjModel, settled: NDArray[np.bool_]) -> None:
    """Take the contacts among some bodies out of a compiled model; where its masks have no bit left, none.

    What they meet with of other bodies stays: each kind of their geoms takes a bit of its own, by which the
    others find it and it finds nothing.

    Args:
        model: changed in place.
        settled: which bodies, (nbody,).
    """
    if settled.all():
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        return
    of = settled[model.geom_bodyid]
    kind, affinity = model.geom_contype.copy(), model.geom_conaffinity.copy()
    used = int(np.bitwise_or.reduce(kind | affinity, initial=0))
    left = [1 << bit for bit in range(BITS) if not used >> bit & 1]
    masks = {(int(a), int(b)) for a, b in zip(kind[of], affinity[of], strict=True) if a or b}
    if len(masks) > len(left):
        return
    for bit, (mine, finds) in zip(left, sorted(masks), strict=False):
        same = of & (kind == mine) & (affinity == finds)
        meets = ~of & (((kind & finds) | (affinity & mine)) != 0)
        model.geom_contype[same], model.geom_conaffinity[same] = 0, bit
        model.geom_contype[meets] |= bit
    # what MuJoCo looks at first: the masks of whole bodies
    for whole, each in (
        (model.body_contype, model.geom_contype),
        (model.body_conaffinity, model.geom_conaffinity),
    ):
        whole[:] = 0
        np.bitwise_or.at(whole, model.geom_bodyid, each)
