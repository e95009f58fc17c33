"""Unknowns and equations of a planar chain, paired off: the smallest parts that can be solved one by one.

Each link has three coordinates and each pair gives two equations. Matching equations to unknowns
and taking the strongly connected parts (Dulmage and Mendelsohn, 1958) finds the same groups as
peeling off smallest subsets with 3n = 2p, without trying every subset.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.theory.structure.planar import Pairs

if TYPE_CHECKING:
    import networkx as nx


class Unit(NamedTuple):
    """Something unknown: a link (three coordinates) or the place of a pin (two)."""

    name: str | int
    coordinate: int


class Equation(NamedTuple):
    """One of the two equations by which a link sits on pin or slide number `pair`."""

    pair: int
    links: tuple[str, ...]
    row: int


def _system(pairs: Sequence[Pairs], unknown: Sequence[str]) -> "nx.Graph[Unit | Equation]":
    """Return which equation holds which unknowns."""
    import networkx as nx

    graph: nx.Graph[Unit | Equation] = nx.Graph()
    graph.add_nodes_from(Unit(link, i) for link in unknown for i in range(3))
    for number, pair in enumerate(pairs):
        loose = tuple(link for link in pair.links if link in unknown)
        # a pin on a link that is there has a known place; so each loose link sits on it by itself
        pin = [Unit(number, i) for i in range(2)] if pair.hinge and loose == pair.links else []
        for links in [(link,) for link in loose] if pair.hinge else [loose] * bool(loose):
            for row in range(2):
                units = [Unit(link, i) for link in links for i in range(3)] + pin
                graph.add_edges_from((Equation(number, links, row), unit) for unit in units)
    return graph


def blocks(
    mechanism: Mechanism, pairs: Sequence[Pairs], unknown: Sequence[str]
) -> list[tuple[set[Equation], set[Unit]]]:
    """Return the smallest sets of equations that can be solved one after the other, with their unknowns."""
    import networkx as nx

    graph = _system(pairs, unknown)
    equations = [node for node in graph if isinstance(node, Equation)]
    match = nx.bipartite.hopcroft_karp_matching(graph, equations)
    needs: nx.DiGraph[Equation] = nx.DiGraph()
    needs.add_nodes_from(equation for equation in equations if equation in match)
    for equation in needs:
        needs.add_edges_from((match[unit], equation) for unit in graph[equation] if unit in match)
    _require_matched(mechanism, graph, match, needs)
    components = nx.condensation(needs)
    members: list[set[Equation]] = [components.nodes[component]["members"] for component in components]
    blocks = [(equation_set, {match[equation] for equation in equation_set}) for equation_set in members]

    def first_link(block: int) -> int:
        return min((unknown.index(u.name) for u in blocks[block][1] if isinstance(u.name, str)), default=-1)

    return [blocks[i] for i in nx.lexicographical_topological_sort(components, key=first_link)]


def _require_matched(mechanism: Mechanism, graph: Any, match: Any, needs: Any) -> None:
    """Raise InputError where equations and unknowns do not pair off; names the links concerned."""
    import networkx as nx

    free = [node for node in graph if isinstance(node, Unit) and node not in match]
    excess = [node for node in graph if isinstance(node, Equation) and node not in match]
    if free:
        later = {e for unit in free for e in graph[unit]}
        later |= {f for e in later for f in nx.descendants(needs, e)}
        links = {unit.name for unit in [*free, *(match[e] for e in later)]}
        raise InputError(
            f"{mechanism.name}: the drivers leave {len(free)} freedom{'s' * (len(free) > 1)} to "
            f"{_listed(mechanism, links)}; drive one link more for each"
        )
    if excess:
        matched = {match[unit] for e in excess for unit in graph[e]}
        matched |= {f for e in matched for f in nx.ancestors(needs, e)}
        raise InputError(
            f"{mechanism.name}: {_listed(mechanism, {match[e].name for e in matched})} cannot move freely: "
            f"with the drivers given, {len(excess)} more condition{'s' * (len(excess) > 1)} than freedoms; "
            "leave out a link that repeats another, or drive fewer"
        )


def _listed(mechanism: Mechanism, names: set[str | int]) -> str:
    return ", ".join(link.name for link in mechanism.links if link.name in names)
