"""Graphs against networkx, on random ones."""

import networkx as nx
import numpy as np
import pytest

from mechsim.numerics.graphs import components, distances, matching, ordered_blocks, reachable, spanning_edges


def random_successors(seed: int, count: int = 12, edges: int = 16) -> dict[int, list[int]]:
    pairs = np.random.default_rng(seed).integers(count, size=(edges, 2)).tolist()
    return {node: [b for a, b in pairs if a == node] for node in range(count)}


@pytest.mark.parametrize("seed", range(5))
def test_reachable_nodes_and_components_agree_with_networkx(seed):
    successors = random_successors(seed)
    graph = nx.DiGraph(successors)
    assert reachable(successors, [0]) == nx.descendants(graph, 0) | {0}
    undirected = {frozenset(component) for component in nx.connected_components(graph.to_undirected())}
    assert {frozenset(component) for component in components(graph, graph.edges)} == undirected


@pytest.mark.parametrize("seed", range(5))
def test_a_spanning_tree_and_distances_agree_with_networkx(seed):
    successors = random_successors(seed)
    pairs = [(a, b) for a, others in successors.items() for b in others]
    edges = [(a, b, k) for k, (a, b) in enumerate(pairs)]
    weighed = nx.MultiGraph()
    for a, b, k in edges:
        weighed.add_edge(a, b, key=k, weight=-k)
    expected = {key for _, _, key in nx.maximum_spanning_edges(weighed, keys=True, data=False)}
    assert {*spanning_edges(edges)} == expected
    assert distances(successors, 0) == nx.single_source_shortest_path_length(nx.DiGraph(successors), 0)


@pytest.mark.parametrize("seed", range(5))
def test_a_matching_has_the_maximum_size(seed):
    units = {node: [f"u{i}" for i in others] for node, others in random_successors(seed).items()}
    result = matching(units)
    assert all(unit in units[node] for node, unit in result.items())
    assert len(set(result.values())) == len(result)
    largest = nx.bipartite.hopcroft_karp_matching(nx.Graph(units), units)
    assert len(result) == len(largest) // 2


@pytest.mark.parametrize("seed", range(5))
def test_blocks_are_strongly_connected_and_ordered(seed):
    successors = random_successors(seed)
    graph = nx.DiGraph(successors)
    blocks = ordered_blocks(successors, min)
    assert {frozenset(b) for b in blocks} == {frozenset(b) for b in nx.strongly_connected_components(graph)}
    position = {node: i for i, block in enumerate(blocks) for node in block}
    assert all(position[a] <= position[b] for a, b in graph.edges)
    condensed = nx.condensation(graph)
    order = nx.lexicographical_topological_sort(condensed, key=lambda i: min(condensed.nodes[i]["members"]))
    assert blocks == [condensed.nodes[i]["members"] for i in order]
