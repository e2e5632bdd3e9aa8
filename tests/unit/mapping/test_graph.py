"""The pose graph: a square whose loop closes, and an edge that is wrong."""

from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix, linalg
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

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


def test_nodes_up_to_the_held_one_stay_and_the_others_fit_their_loops():
    graph, true = square(0.01)
    # the first side and the corner are where they should be
    graph.poses[:] = composed(true[11], difference(graph.poses[11].copy(), graph.poses))
    before = graph.poses.copy()
    for k in range(11, 16):
        graph.link(k, k + 25, difference(true[k], true[k + 25]), INFORMATION, True)
    graph.optimise(11)
    assert np.array_equal(graph.poses[:12], before[:12])
    off, was = (np.abs(poses - true)[12:, :2].max() for poses in (graph.poses, before))
    assert off < 0.5 * was


def test_loops_far_from_the_beginning_take_the_time_of_their_own_way(monkeypatch):
    sizes = []

    def factorised(matrix, **options):
        sizes.append(matrix.shape[0] // 3)
        return splu(matrix, **options)

    monkeypatch.setattr(linalg, "splu", factorised)
    graph, true = square(0.01)
    graph.link(30, 40, difference(true[30], true[40]), INFORMATION, True)
    graph.optimise(30)
    assert set(sizes) == {11}


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
        assert np.abs(graph.ways(new).lengths - dijkstra(matrix, directed=False, indices=new)).max() < 1e-6


def through(graph: Graph, edges: list[int], node: int, held: int):
    """The covariance of a node where another is held, by these edges alone: the inverse of their information."""
    size = 3 * len(graph.poses)
    information = np.zeros((size, size))
    for each in graph.edges[edges]:
        ends = each["first"], each["second"]
        jacobian = np.zeros((3, size))
        for end in ends:
            for k in range(3):
                moved = []
                for by in (1e-6, -1e-6):
                    poses = graph.poses.copy()
                    poses[end, k] += by
                    moved.append(difference(poses[ends[0]], poses[ends[1]]))
                jacobian[:, 3 * end + k] = (moved[0] - moved[1]) / 2e-6
        information += jacobian.T @ each["information"] @ jacobian
    kept = np.delete(np.arange(size), range(3 * held, 3 * held + 3))
    covariance = np.zeros((size, size))
    covariance[np.ix_(kept, kept)] = np.linalg.pinv(information[np.ix_(kept, kept)])
    return covariance[3 * node : 3 * node + 3, 3 * node : 3 * node + 3]


def test_a_poses_covariance_is_that_of_the_edges_of_its_shortest_way():
    graph, _ = square(0.01)
    chain = list(range(40))
    for held, node in ((0, 40), (3, 17), (40, 5)):
        told, exact = graph.covariances(graph.ways(node), [held])[0], through(graph, chain, node, held)
        assert np.allclose(told, exact, rtol=1e-4, atol=1e-9)
    # from node 1 to node 38 the way leads over the loop now
    graph.link(2, 40, difference(graph.poses[2], graph.poses[40]), 0.3 * INFORMATION, True)
    near, far = graph.covariances(graph.ways(38), [1, 30])
    assert np.allclose(near, through(graph, [1, 38, 39, 40], 38, 1), rtol=1e-4, atol=1e-9)
    assert np.allclose(far, through(graph, chain, 38, 30), rtol=1e-4, atol=1e-9)
    # every edge that there is can only make it smaller
    assert np.linalg.eigvalsh(near - through(graph, [*chain, 40], 38, 1)).min() > -1e-9
