"""The pose graph: nodes are poses, edges are measured differences of poses; finds the poses that fit all edges best.

How it works
------------

An edge from i to j holds the pose of j as seen from i, and its information matrix. Its error is the difference of the
present poses from that. Gauss-Newton minimises the sum of squares; the normal equations are sparse, and SciPy's SuperLU
solves them. An edge that closes a loop may be wrong, because corridors look alike. So its square has Geman and
McClure's weight (c / (c + chi^2))^2: the more the edge contradicts all others, the less it counts. Before a long loop
is closed, a correct edge contradicts the others, too. So c begins large and shrinks round by round (graduated
non-convexity, Yang 2020). Edges between consecutive scans have no such weight.

How well a node's pose is known from another's is told along the shortest way between them: the covariances of its edges
add up (Bosse 2004). All ways taken together would tell it a little better, at the cost of a factorisation each time.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.mapping.poses import difference, wrapped

Array = NDArray[np.float64]

BENT: Final = 20.0
"""Chi-square of three numbers from which an edge that closes a loop counts less; 16.3 is the 99.9 % quantile."""


SHRINKS: Final = 3.0
"""Factor by which c shrinks in a round, down to `BENT`."""
ENDLESS_WAY: Final = 1e6
"""m."""
UNMEASURED_INFORMATION: Final = 1e-5
"""Trace of an edge's information below which it joins its nodes without a measurement."""
SAME_WAY: Final = 1e-5
"""m by which sums of the same lengths may differ."""
SETTLED_SHARE: Final = 1e-3
"""Share of the sum of squares: iteration ends when a round takes away less."""

EDGE: Final = np.dtype(
    [
        ("first", np.int64),
        ("second", np.int64),
        ("step", np.float64, 3),
        ("information", np.float64, (3, 3)),
        ("loop", bool),
    ]
)
"""A measured difference of two nodes' poses.

`step` is the second node as seen from the first: x, y, theta (m, rad). Its information is in 1 / m^2 and 1 / rad^2.
`loop`: the edge closes a loop.
"""


class Ways(NamedTuple):
    """The shortest ways from a node to all through a graph."""

    node: int
    lengths: Array
    """m; a radian counts 0.3 m, a loop 0.5 m."""
    along: Array
    """m from the first node to each without loops."""
    rounds: int
    """More than the largest number of loops that one of them leads over."""


class Graph:
    """Nodes and edges."""

    def __init__(self) -> None:
        self._poses = np.empty((64, 3))
        self._edges = np.empty(64, EDGE)
        # of each edge: how it moves a node behind it that lies at the origin; and these, added up to each node
        self._moves, self._sums = np.zeros((64, 3, 3)), np.zeros((64, 3, 3))
        self._nodes = self._links = 0

    @property
    def poses(self) -> Array:
        """Poses of the nodes, a row each (m, rad)."""
        return self._poses[: self._nodes]

    @property
    def edges(self) -> NDArray[Any]:
        """The edges, a row each."""
        return self._edges[: self._links]

    def add(self, pose: Any) -> int:
        """Add a node, and return its number."""
        if self._nodes == len(self._poses):
            self._poses = np.concatenate((self._poses, np.empty_like(self._poses)))
            self._sums = np.concatenate((self._sums, np.zeros_like(self._sums)))
        self._poses[self._nodes] = pose
        self._nodes += 1
        return self._nodes - 1

    def link(self, first: int, second: int, step: Array, information: Array, loop: bool) -> float:
        """Add an edge, and return its chi-square at the present poses."""
        if self._links == len(self._edges):
            self._edges = np.concatenate((self._edges, np.empty_like(self._edges)))
            self._moves = np.concatenate((self._moves, np.zeros_like(self._moves)))
        self._edges[self._links] = first, second, step, information, loop
        self._moves[self._links] = moved = self._moved(self._edges[self._links : self._links + 1])[0]
        if not loop:
            self._sums[second] = self._sums[first] + moved
        self._links += 1
        _, error = self._errors(self._edges[self._links - 1 : self._links])
        return float(error[0] @ information @ error[0])

    def restore(self, edges: NDArray[Any]) -> None:
        """Take these edges in place of all that there are."""
        self._edges, self._links = edges.copy(), len(edges)
        self._moves = np.zeros((len(edges), 3, 3))
        self.refresh()

    def refresh(self) -> None:
        """Take note that poses have moved."""
        moves = self._moves[: self._links]
        moves[:] = self._moved(self.edges)
        between = moves[~self.edges["loop"]]
        self._sums[1 : 1 + len(between)] = np.cumsum(between, axis=0)

    def ways(self, node: int, begun: int = 0) -> Ways:
        """Return the shortest ways from a node to all through the graph.

        Edges that close no loop join each node with the next, in turn. The one to the node `begun` counts as endless.
        """
        edges, loops = self.edges, self.edges["loop"]
        steps, loop = edges["step"][~loops], edges[loops]
        each = np.hypot(steps[:, 0], steps[:, 1]) + 0.3 * np.abs(steps[:, 2])
        if begun:
            each[begun - 1] = ENDLESS_WAY
        along = np.concatenate(([0.0], np.cumsum(each)))
        # between the ends of loops nothing is to be decided
        ends, places = np.unique(np.concatenate((loop["first"], loop["second"], [node])), return_inverse=True)
        first, second = places[:-1].reshape(2, -1)
        lengths: Array = np.abs(along[ends] - along[node])
        rounds = 0
        while True:
            before, rounds = lengths.copy(), rounds + 1
            np.minimum.at(lengths, first, before[second] + 0.5)
            np.minimum.at(lengths, second, before[first] + 0.5)
            if (lengths > before - 1e-6).all():
                break
            lengths = _spread(lengths, along[ends])
        every = np.full(len(along), np.inf)
        every[ends] = lengths
        return Ways(node, _spread(every, along), along, rounds)

    def covariances(self, ways: Ways, wanted: Any) -> Array:
        """Return the covariances along ways, (n, 3, 3) in m^2 and rad^2: those of x, y and theta of their node where
        each of the nodes `wanted` is held, in the frame of the map.
        """
        lengths, loops = ways.lengths, self.edges["loop"]
        loop, over = self.edges[loops], self._moves[: self._links][loops]
        here, there = (np.concatenate((loop[a], loop[b])) for a, b in (("first", "second"), ("second", "first")))
        taken = lengths[here] > lengths[there] + 0.5 - SAME_WAY
        here, there, over = here[taken], there[taken], np.concatenate((over, over))[taken]
        # the nodes that matter, and which of them is which
        nodes, places = np.unique(np.concatenate((here, there, [ways.node], wanted)), return_inverse=True)
        here, there, node, asked = np.split(places, np.cumsum((len(here), len(there), 1)))
        ends = _ends(lengths[nodes], ways.along[nodes], np.append(here, node))
        sums = self._sums[nodes]
        # of each end of a loop that a way leads over
        known = np.zeros((len(nodes), 3, 3))
        # from that end along the nodes
        sign = np.sign(np.arange(len(nodes)) - ends)[:, None, None]
        behind = sign * (sums - sums[ends])
        before, more = ends[there], behind[there] + over
        for _ in range(ways.rounds):
            known[here] = known[before] + more
        x, y, _ = self.poses[ways.node]
        moves = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
        return np.asarray(moves @ (known[ends[asked]] + behind[asked]) @ moves.T)

    def _moved(self, edges: NDArray[Any]) -> Array:
        """Return how each edge's covariance moves a node behind it that lies at the origin, (n, 3, 3)."""
        first, second = self.poses[edges["first"]], self.poses[edges["second"]]
        cosine, sine = np.cos(first[:, 2]), np.sin(first[:, 2])
        moves = np.zeros((len(edges), 3, 3))
        moves[:, 0, 0], moves[:, 0, 1], moves[:, 1, 0], moves[:, 1, 1] = cosine, -sine, sine, cosine
        moves[:, 0, 2], moves[:, 1, 2], moves[:, 2, 2] = second[:, 1], -second[:, 0], 1.0
        measured = edges["information"].trace(axis1=1, axis2=2) > UNMEASURED_INFORMATION
        covariances = np.linalg.inv(edges["information"]) * measured[:, None, None]
        return np.asarray(moves @ covariances @ moves.transpose(0, 2, 1))

    def _errors(self, edges: NDArray[Any]) -> tuple[Array, Array]:
        """Return the second nodes as seen from the first nodes, and their differences from the edges."""
        seen = difference(self.poses[edges["first"]], self.poses[edges["second"]])
        error = seen - edges["step"]
        error[:, 2] = wrapped(error[:, 2])
        return seen, error

    def optimise(self, held: int = 0, rounds: int = 20) -> None:
        """Move the poses so that they fit all edges best; those up to the node `held` stay."""
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        edges = self.edges[np.maximum(self.edges["first"], self.edges["second"]) > held]
        if not edges["loop"].any():
            return
        poses, bent = self.poses[held:], edges["loop"]
        # all that stay are one
        first, second = (np.maximum(edges[end] - held, 0) for end in ("first", "second"))
        size = 3 * len(poses)
        damping, bend, before = 1e-9, np.inf, np.inf
        for _ in range(rounds):
            seen, error = self._errors(edges)
            information = edges["information"]
            chi = np.einsum("ni,nij,nj->n", error, information, error)
            bend = max(BENT, min(bend / SHRINKS, 2.0 * float(chi[bent].max())))
            total = float(np.where(bent, bend * chi / (bend + chi), chi).sum())
            if bend == BENT and total >= (1.0 - SETTLED_SHARE) * before:
                break
            before = total if bend == BENT else np.inf
            weight = np.where(bent, (bend / (bend + chi)) ** 2, 1.0)
            information = information * weight[:, None, None]
            angles = self.poses[edges["first"], 2]
            cosine, sine = np.cos(angles), np.sin(angles)
            count = len(first)
            back = np.zeros((count, 3, 3))
            back[:, 0, 0], back[:, 0, 1], back[:, 1, 0], back[:, 1, 1], back[:, 2, 2] = cosine, sine, -sine, cosine, 1.0
            a = -back
            a[:, 0, 2], a[:, 1, 2] = seen[:, 1], -seen[:, 0]
            jacobians = np.concatenate((a, back), axis=2)
            weighted = np.einsum("nij,nik->njk", jacobians, information)
            blocks = np.einsum("nij,njk->nik", weighted, jacobians)
            gradient = np.zeros(size)
            places = np.concatenate((3 * first[:, None] + np.arange(3), 3 * second[:, None] + np.arange(3)), axis=1)
            np.add.at(gradient, places, np.einsum("nij,nj->ni", weighted, error))
            rows = np.repeat(places, 6, axis=1).ravel()
            columns = np.tile(places, (1, 6)).ravel()
            fixed = np.arange(3)
            matrix = csc_matrix(
                (
                    np.concatenate((blocks.reshape(-1), np.full(3, 1e9), np.full(size, damping))),
                    (np.concatenate((rows, fixed, np.arange(size))), np.concatenate((columns, fixed, np.arange(size)))),
                ),
                shape=(size, size),
            )
            # it is positive definite: without pivots the order that keeps the factors sparse stays
            factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            step = factors.solve(-gradient).reshape(-1, 3)
            poses[1:] += step[1:]
            poses[:, 2] = wrapped(poses[:, 2])
        self.refresh()


def _spread(lengths: Array, along: Array) -> Array:
    """Return the lengths of ways after going along the nodes, forward and backward."""
    lengths = np.minimum.accumulate(lengths - along) + along
    return np.asarray(np.minimum.accumulate((lengths + along)[::-1])[::-1] - along)


def _ends(ways: Array, along: Array, ends: Any) -> NDArray[np.int64]:
    """Return of each node that one of the `ends` from which its way leads along the nodes."""
    found, count = np.full(len(ways), ends[-1]), np.arange(len(ways))
    begun = np.full(len(ways), np.inf)
    begun[ends] = ways[ends]
    for turn in (1, -1):
        ahead = (begun - turn * along)[::turn]
        least = np.minimum.accumulate(ahead)
        source = np.maximum.accumulate(np.where(ahead <= least, count, 0))
        fits = ahead[source] + turn * along[::turn] < ways[::turn] + SAME_WAY
        found[::turn][fits] = count[::turn][source[fits]]
    return found
