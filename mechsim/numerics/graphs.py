"""Small directed and bipartite graphs, as mappings of each node to its neighbours.

Every `mechsim show` needs these functions; importing networkx takes 0.15 s of processor time.
"""

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping
from typing import TypeVar

Node = TypeVar("Node", bound=Hashable)
Other = TypeVar("Other", bound=Hashable)


def reachable(neighbours: Mapping[Node, Iterable[Node]], start: Iterable[Node]) -> set[Node]:
    """Return the nodes reachable from start nodes, these included."""
    reached, waiting = set(start), list(start)
    while waiting:
        added = set(neighbours[waiting.pop()]) - reached
        reached |= added
        waiting += added
    return reached


def components(nodes: Iterable[Node], edges: Iterable[tuple[Node, Node]]) -> list[set[Node]]:
    """Return the connected components of an undirected graph, in the order of their first nodes."""
    neighbours: dict[Node, set[Node]] = {node: set() for node in nodes}
    for a, b in edges:
        neighbours[a].add(b)
        neighbours[b].add(a)
    connected: list[set[Node]] = []
    for node in neighbours:
        if not any(node in component for component in connected):
            connected.append(reachable(neighbours, [node]))
    return connected


def spanning_edges(edges: Iterable[tuple[Node, Node, Other]]) -> list[Other]:
    """Return the names of those edges (node, node, name) that join two trees of the edges before them.

    Source: J. B. Kruskal, Proceedings of the American Mathematical Society 7 (1956) 48-50.
    """
    tree: dict[Node, set[Node]] = {}
    kept: list[Other] = []
    for a, b, name in edges:
        first, second = tree.setdefault(a, {a}), tree.setdefault(b, {b})
        if first is not second:
            first |= second
            tree |= dict.fromkeys(second, first)
            kept.append(name)
    return kept


def distances(neighbours: Mapping[Node, Iterable[Node]], start: Node) -> dict[Node, int]:
    """Return the least number of edges from a node to each node reachable from it."""
    steps, waiting = {start: 0}, [start]
    for node in waiting:
        for other in neighbours.get(node, ()):
            if other not in steps:
                steps[other] = steps[node] + 1
                waiting.append(other)
    return steps


def matching(neighbours: Mapping[Node, Collection[Other]]) -> dict[Node, Other]:
    """Return a maximum matching of a bipartite graph; neighbours are nodes of the other kind.

    Source: augmenting paths, H. W. Kuhn, Naval Research Logistics Quarterly 2 (1955) 83-97.
    """
    partner: dict[Other, Node] = {}

    def matched(node: Node, tried: set[Other]) -> bool:
        for other in neighbours[node]:
            if other not in tried:
                tried.add(other)
                if other not in partner or matched(partner[other], tried):
                    partner[other] = node
                    return True
        return False

    for node in neighbours:
        matched(node, set())
    return {node: other for other, node in partner.items()}


def ordered_blocks(
    successors: Mapping[Node, Iterable[Node]], key: Callable[[set[Node]], int]
) -> list[set[Node]]:
    """Return the strongly connected components, each after its predecessors.

    Of several possible next components, the one with the smallest key comes first.
    """
    after = {node: reachable(successors, [node]) for node in successors}
    blocks: list[set[Node]] = []
    for node in successors:
        if not any(node in block for block in blocks):
            blocks.append({other for other in after[node] if node in after[other]})
    ordered: list[set[Node]] = []
    while blocks:
        # the nodes of the remaining blocks that follow another block
        later = {follower for block in blocks for follower in after[next(iter(block))] - block}
        ordered.append(min((block for block in blocks if not block & later), key=key))
        blocks.remove(ordered[-1])
    return ordered
