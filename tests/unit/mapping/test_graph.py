"""The pose graph: a square whose loop closes, and an edge that is wrong."""

from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from txt1.mapping.graph import Graph
from txt1.mapping.poses import composed, difference

INFORMATION = np.diag([1e4, 1e4, 1e5])


def square(bend: float):
    """Forty nodes round a square, whose steps turn by too much, and the true poses."""
    true = [np.zeros(3)]
    for k in range(40):
        true.append(composed(true[-1], (0.5, 0.0, np.pi / 2 if k % 10 == 9 else 0.0)))
    graph = Graph()
    pose = true[0]
    graph.add(pose)
    for one, other in pairwise(true):
        step = difference(one, other) + np.array([0.0, 0.0, bend])
        pose = composed(pose, step)
        graph.add(pose)
        graph.link(len(graph.poses) - 2, len(graph.poses) - 1, step, INFORMATION, False)
    return graph, np.array(true)


def test_a_loop_puts_the_square_right():
    graph, true = square(0.01)
    before = np.abs(graph.poses - true)[:, :2].max()
    assert before > 0.5
    for k in range(10):
        graph.link(k, k + 31, difference(true[k], true[k + 31]), INFORMATION, True)
    assert graph.link(0, 40, difference(true[0], true[40]), INFORMATION, True) > 100.0
    graph.optimise()
    assert np.abs(graph.poses - true)[:, :2].max() < 0.25 * before
    assert np.allclose(graph.poses[0], true[0], atol=1e-6)


def test_a_wrong_loop_says_little_against_all_others():
    graph, true = square(0.002)
    for k in range(6):
        graph.link(k, k + 31, difference(true[k], true[k + 31]), INFORMATION, True)
    graph.optimise()
    good = graph.poses.copy()
    graph.link(12, 30, np.array([0.1, 0.0, 0.0]), INFORMATION, True)
    graph.optimise()
    assert np.abs(graph.poses - good)[:, :2].max() < 0.05


def test_a_graph_without_a_loop_stays():
    graph, _ = square(0.01)
    before = graph.poses.copy()
    graph.optimise()
    assert np.array_equal(graph.poses, before)


def test_ways_through_the_graph_are_the_shortest():
    rng, graph = np.random.default_rng(1), Graph()
    size, lengths = 60, {}
    for k in range(size):
        graph.add((0.0, 0.0, 0.0))
        if k:
            step = rng.uniform(-1.0, 1.0, 3)
            graph.link(k - 1, k, step, np.eye(3), False)
            lengths[k - 1, k] = np.hypot(*step[:2]) + 0.3 * abs(step[2])
        if k > 10 and k % 7 == 0:
            other = int(rng.integers(k - 5))
            graph.link(other, k, np.zeros(3), np.eye(3), True)
            lengths[other, k] = 0.5
    matrix = csr_matrix((list(lengths.values()), tuple(zip(*lengths, strict=True))), shape=(size, size))
    for new in (0, 30, size - 1):
        assert np.abs(graph.ways(new) - dijkstra(matrix, directed=False, indices=new)).max() < 1e-6
