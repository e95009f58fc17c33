"""Contact filtering: excludes contacts between bodies whose motion the drivers determine.

Such contacts move nothing, but they brake the drivers. Links exported by CAD overlap at their joints, and the
stiff loop constraints make these contacts stiff, too.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

# bits of a contact mask without the sign bit
BITS = 31


def exclude_contacts(model: mujoco.MjModel, settled: NDArray[np.bool_]) -> None:
    """Exclude the contacts between some bodies of a compiled model; none if no free mask bit remains.

    Contacts with other bodies remain: every mask pair of the geoms gets a bit of its own, which the other
    geoms' masks contain.

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
    # MuJoCo checks the masks of whole bodies first
    for whole, each in (
        (model.body_contype, model.geom_contype),
        (model.body_conaffinity, model.geom_conaffinity),
    ):
        whole[:] = 0
        np.bitwise_or.at(whole, model.geom_bodyid, each)
