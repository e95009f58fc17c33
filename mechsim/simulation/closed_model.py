"""A compiled model with closed loops, the start of every run in MuJoCo."""

import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recording import Track

# bits of a contact mask without the sign bit
BITS = 31


def exclude_contacts(model: mujoco.MjModel, determined: NDArray[np.bool_]) -> None:
    """Exclude the contacts between some bodies of a compiled model; none if no free mask bit remains.

    Contacts with other bodies remain: each mask pair of these geoms gets its own bit, which the masks of the
    other geoms contain.

    Args:
        model: model, changed in place.
        determined: mask of the bodies without motion, (nbody,).
    """
    if determined.all():
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        return
    excluded = determined[model.geom_bodyid]
    kind, affinity = model.geom_contype.copy(), model.geom_conaffinity.copy()
    used = int(np.bitwise_or.reduce(kind | affinity, initial=0))
    free_bits = [1 << bit for bit in range(BITS) if not used >> bit & 1]
    masks = {(int(a), int(b)) for a, b in zip(kind[excluded], affinity[excluded], strict=True) if a or b}
    if len(masks) > len(free_bits):
        return
    for bit, (mine, finds) in zip(free_bits, sorted(masks), strict=False):
        same = excluded & (kind == mine) & (affinity == finds)
        meets = ~excluded & (((kind & finds) | (affinity & mine)) != 0)
        model.geom_contype[same], model.geom_conaffinity[same] = 0, bit
        model.geom_contype[meets] |= bit
    # MuJoCo first checks the masks of bodies
    for mask in ("contype", "conaffinity"):
        whole = getattr(model, f"body_{mask}")
        whole[:] = 0
        np.bitwise_or.at(whole, model.geom_bodyid, getattr(model, f"geom_{mask}"))


# displacement, in [rad] or characteristic lengths, by which an undetermined DOF is probed
NUDGE = 1e-4


@dataclass(frozen=True)
class ClosedModel:
    """A compiled model, its loops, its recorded quantities, and a state in which its loops are closed.

    Attributes:
        loops: loops of the model.
        track: recorded points, links and coordinates.
        qpos: state with closed loops, (nq,); the drivers are in the model's reference configuration or at the
            start of their motion laws.
        custom: whether it is a user's model with its own settings.
        note: changes of the model as a sentence; empty without changes.
    """

    loops: ModelLoops
    track: Track
    qpos: Array
    custom: bool = field(default=False, kw_only=True)
    note: str = field(default="", kw_only=True)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model; runs step a copy."""
        return self.loops.model

    @property
    def angle(self) -> float:
        """Angle of the crank, or the path parameter, in the closed state, in [rad]."""
        return float(self.qpos[self.loops.crank_address])

    def without_contacts(self, determined: NDArray[np.bool_]) -> "ClosedModel":
        """Return the model without contacts between the bodies of a mask, (nbody,)."""
        loops = replace(self.loops, model=copy.copy(self.model))
        exclude_contacts(loops.model, determined)
        return replace(self, loops=loops)

    def point_positions(self, states: Array) -> Array:
        """Return the positions of the tracked points at n states, (n, k, 3) in [m]."""
        sites = [self.model.site(name).id for name in self.track.points]
        return self.loops.posed.site_positions(states)[:, sites]

    @property
    def driven_points(self) -> NDArray[np.bool_]:
        """Mask of the tracked points that the drivers determine, (k,); all points if none is determined."""
        undetermined = self.undetermined_points
        return undetermined if undetermined.all() else ~undetermined

    @cached_property
    def undetermined_points(self) -> NDArray[np.bool_]:
        """Mask of tracked points that can move with the drivers locked, (k,); poses do not determine them."""
        loops = self.loops
        moves = NUDGE * loop_jacobian.null_space(loops, loops.linearise(self.qpos[None])[1])
        nudged = loops.displaced(np.repeat(self.qpos[None], len(moves), 0), moves)
        positions = self.point_positions(np.concatenate([self.qpos[None], nudged]))
        # a closed loop allows motion of a point in second order of the displacement
        least = NUDGE**1.5 * loops.characteristic_length
        return np.abs(positions[1:] - positions[0]).max((0, 2), initial=0.0) > least
