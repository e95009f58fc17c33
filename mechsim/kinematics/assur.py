"""Assur groups: decomposition of a planar chain into the smallest groups of zero mobility."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

from mechsim.errors import InputError, first_names
from mechsim.kinematics.mobility_count import Pairs, pinned, planar_pairs, plane_normal, rigid
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.graphs import components, matching, ordered_blocks, reachable


class Unit(NamedTuple):
    """An unknown: a coordinate of a link (three) or of a pin position (two)."""

    name: str | int
    coordinate: int


class Equation(NamedTuple):
    """One of the two equations that constrain a link to pin or slide number `pair`."""

    pair: int
    links: tuple[str, ...]
    row: int


def _system(pairs: Sequence[Pairs], unknown: Collection[str]) -> dict[Equation, list[Unit]]:
    """Return the unknowns of each equation."""
    units_of: dict[Equation, list[Unit]] = {}
    for number, pair in enumerate(pairs):
        loose = tuple(link for link in pair.links if link in unknown)
        # a pin on a placed link has a known position, so that every free link is constrained separately
        pin = [Unit(number, i) for i in range(2)] if pair.hinge and loose == pair.links else []
        for links in [(link,) for link in loose] if pair.hinge else [loose] * bool(loose):
            for row in range(2):
                units = [Unit(link, i) for link in links for i in range(3)] + pin
                units_of[Equation(number, links, row)] = units
    return units_of


def blocks(
    mechanism: Mechanism, pairs: Sequence[Pairs], unknown: Sequence[str]
) -> list[tuple[set[Equation], set[Unit]]]:
    """Return the smallest sets of equations that can be solved one after another, with their unknowns."""
    units_of = _system(pairs, dict.fromkeys(unknown))
    match = matching(units_of)
    users: dict[Unit, list[Equation]] = {unit: [] for unit in match.values()}
    for equation in filter(match.__contains__, units_of):
        for unit in filter(users.__contains__, units_of[equation]):
            users[unit].append(equation)
    later = {equation: users[unit] for equation, unit in match.items()}
    # raise InputError if equations and unknowns do not match; names the links concerned
    every = {unit for units in units_of.values() for unit in units}
    every |= {Unit(link, i) for link in unknown for i in range(3)}
    free = every - set(match.values())
    excess = [equation for equation in units_of if equation not in match]
    if free:
        loose = [equation for equation in match if free.intersection(units_of[equation])]
        open_equations = reachable(later, loose)
        links = {unit.name for unit in [*free, *(match[e] for e in open_equations)]}
        raise InputError(
            f"{mechanism.name}: the drivers leave {len(free)} degree{'s' * (len(free) > 1)} of freedom to "
            f"{_listed(mechanism, links)}; drive one more link for each"
        )
    if excess:
        solved_by = {unit: equation for equation, unit in match.items()}
        earlier = {e: [solved_by[unit] for unit in units_of[e] if unit in solved_by] for e in match}
        matched = reachable(earlier, [solved_by[unit] for e in excess for unit in units_of[e]])
        raise InputError(
            f"{mechanism.name}: {_listed(mechanism, {match[e].name for e in matched})} cannot move freely: "
            f"with the given drivers, {len(excess)} more condition{'s' * (len(excess) > 1)} than degrees of "
            "freedom; leave out a redundant link, or drive fewer"
        )

    index: dict[str | int, int] = {link: i for i, link in enumerate(unknown)}

    def first_link(equations: set[Equation]) -> int:
        names = (match[equation].name for equation in equations)
        return min((index[name] for name in names if isinstance(name, str)), default=-1)

    return [
        (equations, {match[equation] for equation in equations})
        for equations in ordered_blocks(later, first_link)
    ]


def _listed(mechanism: Mechanism, names: set[str | int]) -> str:
    return first_names([link.name for link in mechanism.links if link.name in names])


ROMAN = ("", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X")


@dataclass(frozen=True, slots=True)
class AssurGroup:
    """A group with zero mobility.

    Attributes:
        class_: Artobolevskii's class, the highest of its contours: 2 for a dyad, 3 with a link of
            three or more pairs, k with a closed changeable contour of k >= 4 sides.
        order: number of outer pairs, which connect it to links placed before.
        links: in the order of the mechanism.
        pairs: number of its lower pairs, inner and outer; 3 * links = 2 * pairs.
    """

    JSON: ClassVar[tuple[str, ...]] = ("class=class_", "order", "links")

    class_: int
    order: int
    links: tuple[str, ...]
    pairs: int

    def __str__(self) -> str:
        number = ROMAN[self.class_] if self.class_ < len(ROMAN) else str(self.class_)
        return f"Assur group of class {number}, order {self.order}: {', '.join(self.links)}"


@dataclass(frozen=True, slots=True)
class Decomposition:
    """A planar chain as its drivers and its groups.

    Attributes:
        drivers: driving links.
        groups: groups in the order of assembly.
        inner: driven joints between moving links, which count as one in the groups.
    """

    drivers: tuple[str, ...]
    groups: tuple[AssurGroup, ...]
    inner: tuple[str, ...] = ()

    @property
    def class_(self) -> int:
        """Class of the mechanism: the highest of its groups; 1 if it has none."""
        return max((group.class_ for group in self.groups), default=1)

    def lines(self) -> list[str]:
        """Return the drivers and each group in words."""
        return [f"driven by {', '.join((*self.drivers, *self.inner))}", *map(str, self.groups)]

    def __str__(self) -> str:
        return "; ".join(self.lines())


def assur_groups(mechanism: Mechanism) -> Decomposition:
    """Decompose a planar chain into Assur groups.

    Driving links are those of the driven joints, and the links geared to them. Links of locked joints count
    as one: with one crank locked and a joint of it driven instead, its rod drives, as in Koshel and Koshel.
    Both links of a driven joint between moving links, such as a cylinder, count as one, too.

    Args:
        mechanism: a planar mechanism.

    Returns:
        Drivers and groups in the order of assembly.

    Raises:
        InputError: for a spatial mechanism, or a chain that its drivers leave underdetermined or
            overdetermined; names the links.

    Source: Assur 1914; classes after Artobolevskii, Theory of Mechanisms; the exchange of drivers in
    Koshel and Koshel.
    """
    mechanism = pinned(mechanism)
    if plane_normal(mechanism) is None:
        raise InputError(
            f"{mechanism.name} is not planar, and Assur groups are those of planar chains; "
            "look at its mobility instead"
        )
    _, inner = driven_links(mechanism)
    mechanism = inner_drivers_locked(mechanism)
    pairs, (drivers, _) = planar_pairs(mechanism), driven_links(mechanism)
    order = [name for name, first in rigid(mechanism).items() if name == first != GROUND]
    unknown = [link for link in order if link not in drivers]
    groups: list[AssurGroup] = []
    index: dict[str | int, int] = {link: i for i, link in enumerate(unknown)}
    for equations, units in blocks(mechanism, pairs, unknown):
        own = sorted({index[unit.name] for unit in units if unit.name in index})
        links = tuple(unknown[i] for i in own)
        if links:  # otherwise only the position of a pin on a placed link
            groups.append(_group(links, equations, units))
    return Decomposition(drivers, tuple(groups), inner)


def _group(links: tuple[str, ...], equations: set[Equation], units: set[Unit]) -> AssurGroup:
    """Return the class and order of a group from its equations."""
    contours: list[tuple[str, int]] = []
    elements = dict.fromkeys(links, 0)
    outer = 0
    for pair, equation_links, row in equations:
        if row:
            continue
        own = [link for link in equation_links if link in elements]
        for link in own:
            elements[link] += 1
        if Unit(pair, 0) in units or len(own) == 2:
            contours += [(link, pair) for link in own]
        else:
            outer += 1
    pairs = {pair for _, pair in contours}
    widest = 3 if max(elements.values()) >= 3 else 2
    nodes: set[str | int] = {node for edge in contours for node in edge}
    if len(contours) > len(nodes) - len(components(nodes, contours)):  # there is a cycle
        import networkx as nx

        cycles = nx.minimum_cycle_basis(nx.Graph(contours))
        widest = max(widest, *(len(cycle) // 2 for cycle in cycles))
    return AssurGroup(widest, outer, links, outer + len(contours) - len(pairs))


def inner_drivers_locked(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism in which driven joints between moving links are locked, as those of a cylinder.

    At a position of the driver both links are one.
    """
    inner = driven_links(mechanism)[1]
    if not inner:
        return mechanism
    coordinates = {name for joint in inner for name in mechanism.joint(joint).coordinates}
    driver = tuple(name for name in mechanism.drivers if name not in coordinates)
    # no pose is computed from these values
    locked = {**mechanism.locked, **dict.fromkeys(coordinates, 0.0)}
    return replace(mechanism, driver=driver, locked=locked)


def driven_links(mechanism: Mechanism) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the links whose pose the drivers determine alone, and the driven joints that place none.

    The former are the crank, then links geared to it; the latter connect moving links.
    """
    names, body = [joint.name for joint in mechanism.driven_joints], rigid(mechanism)
    while more := [
        name
        for gear in mechanism.gears
        for source, name in ((gear.driver, gear.driven), (gear.driven, gear.driver))
        if source in names and name not in names
    ]:
        names.append(more[0])
    waiting = [mechanism.joint(name) for name in names]
    placed = [GROUND]
    while joint := next(
        (j for j in waiting if not {body[link] for link in j.links}.isdisjoint(placed)), None
    ):
        waiting.remove(joint)
        placed += [body[link] for link in joint.links if body[link] not in placed]
    return tuple(placed[1:]), tuple(joint.name for joint in waiting)
