"""Assur groups: a planar chain taken apart into the smallest groups of no mobility.

Each link has three coordinates and each pair gives two equations. Matching equations to unknowns
and taking the strongly connected parts (Dulmage and Mendelsohn, 1958) finds the same groups as
peeling off smallest subsets with 3n = 2p, without trying every subset.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from mechsim.errors import InputError
from mechsim.mechanism import Mechanism
from mechsim.structure.inputs import inputs
from mechsim.structure.planar import Pairs, planar_pairs, plane_normal

if TYPE_CHECKING:
    import networkx as nx

ROMAN = ("", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X")


@dataclass(frozen=True, slots=True)
class AssurGroup:
    """A group that neither adds nor takes a freedom.

    Attributes:
        class_: Artobolevskii's class, the highest of its contours: 2 for a dyad, 3 with a link of
            three or more pairs, k with a closed changeable contour of k >= 4 sides.
        order: number of outer pairs, by which it hangs on what is already there.
        links: in the order of the mechanism.
        pairs: number of its lower pairs, inner and outer; 3 * links = 2 * pairs.
    """

    class_: int
    order: int
    links: tuple[str, ...]
    pairs: int

    def as_dict(self) -> dict[str, Any]:
        """Return what `mechsim show --json` prints."""
        return {"class": self.class_, "order": self.order, "links": list(self.links)}

    def __str__(self) -> str:
        number = ROMAN[self.class_] if self.class_ < len(ROMAN) else str(self.class_)
        return f"Assur group of class {number}, order {self.order}: {', '.join(self.links)}"


@dataclass(frozen=True, slots=True)
class Decomposition:
    """A planar chain as its drivers and its groups.

    Attributes:
        drivers: links that drive.
        stopped: links stopped in thought, counted as frame.
        groups: in the order of assembly.
    """

    drivers: tuple[str, ...]
    stopped: tuple[str, ...]
    groups: tuple[AssurGroup, ...]

    @property
    def class_(self) -> int:
        """Class of the mechanism: the highest of its groups; 1 if it has none."""
        return max((group.class_ for group in self.groups), default=1)

    def as_dicts(self) -> list[dict[str, Any]]:
        """Return the groups as `mechsim show --json` prints them."""
        return [group.as_dict() for group in self.groups]

    def lines(self) -> list[str]:
        """Return the drivers and each group in words."""
        still = f", with {', '.join(self.stopped)} stopped" if self.stopped else ""
        return [f"driven by {', '.join(self.drivers)}{still}", *(str(group) for group in self.groups)]

    def __str__(self) -> str:
        return "; ".join(self.lines())


class _Unit(NamedTuple):
    """Something unknown: a link (three coordinates) or the place of a pin (two)."""

    name: str | int
    coordinate: int


class _Equation(NamedTuple):
    """One of the two equations by which a link sits on pin or slide number `pair`."""

    pair: int
    links: tuple[str, ...]
    row: int


def assur_groups(
    mechanism: Mechanism, driver: str | Sequence[str] | None = None, stopped: Sequence[str] = ()
) -> Decomposition:
    """Take a planar chain apart into Assur groups.

    Args:
        mechanism: a planar mechanism.
        driver: link or links that drive. None: the crank and what is geared to it. A link on the
            frame takes the crank's place; the crank becomes an ordinary link. A link that meets no
            frame but a driven link drives with that one stopped, as in paper 003; gears are released
            by such an exchange, and other driven links go on driving as far as there are freedoms.
        stopped: links stopped in thought: they count as frame.

    Returns:
        Drivers, stopped links and groups in the order of assembly.

    Raises:
        InputError: for a spatial mechanism, a link that cannot drive, or a chain whose drivers leave
            a freedom or hold it more than once; names the links.

    Source: Assur 1914; classes after Artobolevskii, Theory of Mechanisms; the exchange of drivers
    in paper 003.
    """
    if plane_normal(mechanism) is None:
        raise InputError(
            f"{mechanism.name} is not planar, and Assur groups are those of planar chains; "
            "look at its mobility instead"
        )
    pairs = planar_pairs(mechanism)
    drivers, stopped = inputs(mechanism, pairs, driver, stopped)
    order = [link.name for link in mechanism.links]
    unknown = [link for link in order if link not in (*drivers, *stopped)]
    groups: list[AssurGroup] = []
    for equations, units in _blocks(mechanism, pairs, unknown):
        links = tuple(link for link in unknown if _Unit(link, 0) in units)
        if links:  # else only a pin's place, on a link already there
            groups.append(_group(links, equations, units))
    return Decomposition(drivers, stopped, tuple(groups))


def _system(pairs: Sequence[Pairs], unknown: Sequence[str]) -> "nx.Graph[_Unit | _Equation]":
    """Return which equation holds which unknowns."""
    import networkx as nx

    graph: nx.Graph[_Unit | _Equation] = nx.Graph()
    graph.add_nodes_from(_Unit(link, i) for link in unknown for i in range(3))
    for number, pair in enumerate(pairs):
        loose = tuple(link for link in pair.links if link in unknown)
        # a pin on a link that is there has a known place; so each loose link sits on it by itself
        pin = [_Unit(number, i) for i in range(2)] if pair.hinge and loose == pair.links else []
        for links in [(link,) for link in loose] if pair.hinge else [loose] * bool(loose):
            for row in range(2):
                held = [_Unit(link, i) for link in links for i in range(3)] + pin
                graph.add_edges_from((_Equation(number, links, row), unit) for unit in held)
    return graph


def _blocks(
    mechanism: Mechanism, pairs: Sequence[Pairs], unknown: Sequence[str]
) -> list[tuple[set[_Equation], set[_Unit]]]:
    """Return the smallest sets of equations that can be solved one after the other, with their unknowns."""
    import networkx as nx

    graph = _system(pairs, unknown)
    equations = [node for node in graph if isinstance(node, _Equation)]
    match = nx.bipartite.hopcroft_karp_matching(graph, equations)
    needs: nx.DiGraph[_Equation] = nx.DiGraph()
    needs.add_nodes_from(equation for equation in equations if equation in match)
    for equation in needs:
        needs.add_edges_from((match[unit], equation) for unit in graph[equation] if unit in match)
    _require_matched(mechanism, graph, match, needs)
    parts = nx.condensation(needs)
    members: list[set[_Equation]] = [parts.nodes[part]["members"] for part in parts]
    blocks = [(held, {match[equation] for equation in held}) for held in members]

    def first_link(block: int) -> int:
        return min((unknown.index(u.name) for u in blocks[block][1] if isinstance(u.name, str)), default=-1)

    return [blocks[i] for i in nx.lexicographical_topological_sort(parts, key=first_link)]


def _require_matched(mechanism: Mechanism, graph: Any, match: Any, needs: Any) -> None:
    """Raise InputError where equations and unknowns do not pair off; names the links concerned."""
    import networkx as nx

    free = [node for node in graph if isinstance(node, _Unit) and node not in match]
    excess = [node for node in graph if isinstance(node, _Equation) and node not in match]
    if free:
        later = {e for unit in free for e in graph[unit]}
        later |= {f for e in later for f in nx.descendants(needs, e)}
        links = {unit.name for unit in [*free, *(match[e] for e in later)]}
        raise InputError(
            f"{mechanism.name}: the drivers leave {len(free)} freedom{'s' * (len(free) > 1)} to "
            f"{_listed(mechanism, links)}; drive one link more for each"
        )
    if excess:
        held = {match[unit] for e in excess for unit in graph[e]}
        held |= {f for e in held for f in nx.ancestors(needs, e)}
        raise InputError(
            f"{mechanism.name}: {_listed(mechanism, {match[e].name for e in held})} cannot move freely: "
            f"with the drivers given, {len(excess)} more condition{'s' * (len(excess) > 1)} than freedoms; "
            "leave out a link that repeats another, or drive fewer"
        )


def _listed(mechanism: Mechanism, names: set[str | int]) -> str:
    return ", ".join(link.name for link in mechanism.links if link.name in names)


def _group(links: tuple[str, ...], equations: set[_Equation], units: set[_Unit]) -> AssurGroup:
    """Return the class and order of a group from its equations."""
    import networkx as nx

    contours: nx.Graph[str | int] = nx.Graph()
    elements = dict.fromkeys(links, 0)
    outer = 0
    for pair, held, row in equations:
        if row:
            continue
        own = [link for link in held if link in elements]
        for link in own:
            elements[link] += 1
        if _Unit(pair, 0) in units or len(own) == 2:
            contours.add_edges_from((link, pair) for link in own)
        else:
            outer += 1
    inner = contours.number_of_edges() - sum(isinstance(node, int) for node in contours)
    sides = [len(cycle) // 2 for cycle in nx.minimum_cycle_basis(contours)]
    widest = 3 if max(elements.values()) >= 3 else 2
    return AssurGroup(max([widest, *sides]), outer, links, outer + inner)
