"""What tells the poses of a mechanism apart, whatever spins idly in it, and which motion is not idle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.spanning_tree import SpanningTree
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import LinkPoses, cross, twists
from mechsim.errors import MobilityError
from mechsim.maths.arrays import Array
from mechsim.model.links import GROUND

# parts of a unit motion below which a coordinate or a point is at rest
REST = 1e-6


@dataclass(frozen=True, slots=True)
class Marks:
    """Points and directions of links that together say where each link is, but for idle spins.

    Of a link that cannot spin idly: its origin over the size, its axes over sqrt 2, so that the
    length of their motion is that of its twist. Of one that can: what lies still on the axis it spins about.

    Attributes:
        tree: of the mechanism.
        links: index of the link of each mark, (k,).
        local: place or direction in the link's frame, (3, k).
        places: which of them are places, (k,).
        weights: factor on each, (k,).
    """

    tree: SpanningTree
    links: NDArray[np.intp]
    local: Array
    places: NDArray[np.bool_]
    weights: Array

    def at(self, here: LinkPoses) -> Array:
        """Return the marks of n poses, (n, 3 k)."""
        turned = np.einsum("kijn,jk->ikn", here.rotation[self.links], self.local)
        where = turned + np.where(self.places[:, None], here.position[self.links].transpose(1, 0, 2), 0.0)
        return (where * self.weights[:, None]).reshape(-1, where.shape[2]).T

    def rates(self, here: LinkPoses, rates: Array) -> Array:
        """Return the rates of the marks, (n, 3 k), at coordinate rates (count, n) in SI."""
        moved = twists(self.tree, here, rates)[self.links].transpose(1, 0, 2)
        turned = np.einsum("kijn,jk->ikn", here.rotation[self.links], self.local)
        where = turned + np.where(self.places[:, None], here.position[self.links].transpose(1, 0, 2), 0.0)
        found = np.where(self.places[:, None], moved[:3], 0.0) + cross(moved[3:], where)
        return (found * self.weights[:, None]).reshape(-1, found.shape[2]).T


def marks_of(tree: SpanningTree, here: LinkPoses, idle: Array) -> Marks:
    """Return the marks of a mechanism whose idle freedoms at one pose are directions (count, idle) in SI."""
    mechanism, size = tree.mechanism, tree.mechanism.size
    spun = np.zeros(len(mechanism.links), dtype=np.bool_)
    if idle.shape[1]:
        twist = np.abs(twists(tree, here, idle)).max(2)
        spun = np.maximum(twist[:, :3].max(1) / size, twist[:, 3:].max(1)) > REST
    rows: list[tuple[int, tuple[float, ...], bool, float]] = []
    for i, link in enumerate(mechanism.links):
        if not spun[i]:
            rows.append((i, (0.0, 0.0, 0.0), True, 1.0 / size))
            rows += [(i, tuple(axis), False, np.sqrt(0.5)) for axis in np.eye(3).tolist()]
            continue
        known = [end.point for end in mechanism.ends(link.name)]
        known += [place for name, place in mechanism.points.values() if name == link.name]
        rows += [(i, place, True, 1.0 / size) for place in dict.fromkeys(known)]
    links, local, places, weights = zip(*rows, strict=True)
    every = Marks(tree, np.array(links), np.array(local).T, np.array(places), np.array(weights))
    if not idle.shape[1]:
        return every
    still = np.abs(every.rates(here, idle)).max(0).reshape(3, -1).max(0) <= REST
    return Marks(tree, every.links[still], every.local[:, still], every.places[still], every.weights[still])


def of_all(loops: TreeLoops, directions: Array) -> Array:
    """Return rates of all coordinates in SI, (count, n), from those of the unknowns in units, (n, u)."""
    rates = np.zeros((loops.tree.count, len(directions)))
    rates[loops.unknown] = directions.T * loops.units[loops.unknown, None]
    return rates


def split(loops: TreeLoops, here: LinkPoses, free: Array) -> tuple[Array, Array]:
    """Return which open direction moves coordinates of joints or tracked points, and which are idle.

    Args:
        loops: of the mechanism, its drivers free.
        here: one pose.
        free: orthonormal open directions of the unknowns in their units, (open, unknowns).

    Returns:
        The direction, (unknowns,), and the idle ones, (open - 1, unknowns).

    Raises:
        MobilityError: where more than one direction moves any of them, or none does.
    """
    tree, mechanism = loops.tree, loops.tree.mechanism
    rates = of_all(loops, free)
    told = list(tree.index_of.values())
    twist = twists(tree, here, rates)
    seen = [rates[told] / loops.units[told, None]]
    for link, local in mechanism.points.values():
        if link != GROUND:
            i = tree.links[link]
            arm = here.position[i] + np.einsum("ijn,j->in", here.rotation[i], np.array(local))
            seen.append((twist[i, :3] + cross(twist[i, 3:], arm)) / mechanism.size)
    _, values, turned = np.linalg.svd(np.concatenate(seen), full_matrices=True)
    count = int((values > REST).sum())
    if count == 1:
        return turned[0] @ free, turned[1:] @ free
    if count == 0:
        raise MobilityError(
            f"{mechanism.name}: the loops leave it no motion, so there is no curve to trace; add a freedom",
            "overdriven",
        )
    raise MobilityError(
        f"{mechanism.name}: {count} freedoms are open, and a curve has one; "
        f"hold or couple {count - 1} of them",
        "undetermined",
    )
