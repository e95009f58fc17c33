"""Small directed and bipartite graphs, as mappings of each node to its neighbours.

Every `mechsim show` needs these functions; importing networkx takes 0.15 s of processor time.
"""

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping
from graphlib import TopologicalSorter
from heapq import heappop, heappush
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
    visited: set[Node] = set()
    for node in neighbours:
        if node not in visited:
            connected.append(reachable(neighbours, [node]))
            visited |= connected[-1]
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
        free = next((other for other in neighbours[node] if other not in partner), None)
        if free is not None:
            partner[free] = node
            return True
        for other in neighbours[node]:
            if other not in tried:
                tried.add(other)
                if matched(partner[other], tried):
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

    Source: S. R. Kosaraju, in M. Sharir, Computers and Mathematics with Applications 7 (1981) 67-72.
    """
    predecessors: dict[Node, list[Node]] = {node: [] for node in successors}
    for node, followers in successors.items():
        for follower in followers:
            predecessors[follower].append(node)
    root: dict[Node, Node] = {}
    for node in reversed(_finished(successors)):
        waiting = [node]
        while waiting:
            if (member := waiting.pop()) not in root:
                root[member] = node
                waiting += predecessors[member]
    blocks: dict[Node, set[Node]] = {}
    for node in successors:
        blocks.setdefault(root[node], set()).add(node)
    sorter = TopologicalSorter(
        {
            name: {root[p] for node in block for p in predecessors[node]} - {name}
            for name, block in blocks.items()
        }
    )
    sorter.prepare()
    by_key = sorted(blocks, key=lambda name: key(blocks[name]))
    rank = {name: i for i, name in enumerate(by_key)}
    ready, ordered = list[int](), list[set[Node]]()
    while sorter.is_active():
        for name in sorter.get_ready():
            heappush(ready, rank[name])
        name = by_key[heappop(ready)]
        ordered.append(blocks[name])
        sorter.done(name)
    return ordered


def _finished(successors: Mapping[Node, Iterable[Node]]) -> list[Node]:
    """Return the nodes in the order in which a depth-first search has visited all that follow them."""
    finished, visited = dict[Node, None](), set[Node]()
    waiting = [*reversed([*successors])]
    while waiting:
        node = waiting[-1]
        if node in visited:
            finished.setdefault(waiting.pop())
        else:
            visited.add(node)
            waiting += [other for other in successors[node] if other not in visited]
    return [*finished]
