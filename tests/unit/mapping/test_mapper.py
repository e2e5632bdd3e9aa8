"""Maps of a simulated room: the trajectory, the loops and the certainty."""

from math import radians

import numpy as np
import pytest

from rigs.laser_logs import drifted
from tests.unit.mapping.rooms import drive, room, scan
from txt1.mapping import grid_files
from txt1.mapping.graph import Graph
from txt1.mapping.mapper import Mapper, Matching
from txt1.mapping.matcher import LocalMap, cloud_of, compiled_kernels, joined
from txt1.mapping.poses import difference, trajectory_error
from txt1.maps.grid import FREE, OCCUPIED


def mapped(poses, odometry):
    rng, there, mapper = np.random.default_rng(1), room(), Mapper()
    matches = [
        mapper.add(0.1 * k, scan(there, pose, rng), told)
        for k, (pose, told) in enumerate(zip(poses, odometry, strict=True))
    ]
    mapper.finish()
    return mapper, matches


@pytest.mark.long
def test_a_room_is_mapped_in_spite_of_wrong_wheels():
    poses = drive(1.3)
    odometry = drifted(poses, 3)
    assert trajectory_error(odometry, poses) > 0.5
    mapper, matches = mapped(poses, odometry)
    assert trajectory_error(mapper.poses, poses) < 0.03
    assert sum(match.closed for match in matches) > 0
    assert all(match.score > 0.5 for match in matches[1:])


def test_optimising_is_linear_in_the_way_however_many_loops_contradict(monkeypatch):
    optimise, optimised = Graph.optimise, []

    def counted(graph, held):
        optimised.append(len(graph.poses) - 1 - held)
        optimise(graph, held)

    aside = np.array((0.2, 0.0, 0.0))

    def contradicting(mapper, chunk, query, window):
        nodes = mapper.graph.poses[8 * chunk + 4], mapper.graph.poses[-1]
        return difference(*nodes) + aside, 1e4 * np.eye(3), 1.0

    monkeypatch.setattr(Graph, "optimise", counted)
    monkeypatch.setattr(Mapper, "_closed", contradicting)
    mapper, rng, there = Mapper(Matching(often=1)), np.random.default_rng(1), room()
    for k, pose in enumerate(drive(2.5)):
        mapper.add(0.1 * k, scan(there, pose, rng), pose)
    count = len(mapper.keys)
    assert 0.5 * count < sum(optimised) < 2 * count


def test_a_map_has_its_walls_where_the_room_has_them():
    poses = drive(0.6)
    mapper, _ = mapped(poses, poses)
    grid = grid_files.grid_of([key.cloud for key in mapper.keys], mapper.graph.poses, mapper.loops)
    there = room()
    rows, columns = np.nonzero(grid.cells == OCCUPIED)
    x, y = grid.to_room(columns + 1.5, rows + 1.5)
    column, row = (np.floor(each).astype(int) for each in there.to_cells(x, y))
    assert np.mean(there.clear[row, column] <= 4) > 0.98
    assert len(rows) > 200
    assert (grid.cells == FREE).sum() * grid.resolution**2 > 20.0


def test_a_scan_is_found_again():
    there, loops = room(), compiled_kernels()
    true = np.array([0.6, -1.7, 0.9])
    cloud = cloud_of(scan(there, true, np.random.default_rng(3)), loops)
    other = np.array([0.5, -1.8, 0.7])
    around = joined([cloud_of(scan(there, other, np.random.default_rng(4)), loops)], other[None])
    local = LocalMap(around, loops)
    guess = true + np.array([0.3, -0.35, radians(18.0)])
    score, start = local.search(cloud, guess, 0.5, radians(25.0), (2.0, 2.0), 0.3)
    assert score > 0.5
    pose, information, fit, _ = local.align(cloud, start, start, 1e-9 * np.eye(3))
    assert fit > 0.8 and np.linalg.eigvalsh(information).min() > 0.0
    assert np.abs(difference(true, pose)).max() < 0.03


def test_a_corridor_says_that_it_does_not_know_how_far_along():
    there, loops = room(corridor=True), compiled_kernels()
    clouds = [cloud_of(scan(there, (0.1 * k, 0.0, 0.0), np.random.default_rng(k)), loops) for k in range(2)]
    local = LocalMap(clouds[0], loops)
    _, information, _, _ = local.align(clouds[1], np.zeros(3), np.zeros(3), 1e-9 * np.eye(3))
    assert information[0, 0] < 0.05 * information[1, 1]


@pytest.mark.parametrize("points", [np.empty((0, 2)), np.ones((3, 2))])
def test_scans_that_see_nothing_leave_the_pose_to_odometry(points):
    mapper = Mapper()
    for k in range(5):
        match = mapper.add(0.1 * k, points, (0.4 * k, 0.0, 0.0))
        assert match.score == 0.0
    # what odometry may err by grows with each of the four steps
    assert mapper.covariance[0, 0] > 4 * 0.06**2 and mapper.covariance[1, 1] > mapper.covariance[0, 0]
    mapper.finish()
    assert np.allclose(mapper.poses[:, 0], 0.4 * np.arange(5))


def test_the_covariance_told_grows_with_the_way_and_a_loop_lessens_it():
    poses, rng, there, mapper = drive(1.3), np.random.default_rng(1), room(), Mapper()
    sigmas, errors, loops = [], [], []
    for k, (pose, told) in enumerate(zip(poses, drifted(poses, 3), strict=True)):
        match = mapper.add(0.1 * k, scan(there, pose, rng), told)
        sigmas.append(np.sqrt(np.trace(mapper.covariance[:2, :2])))
        errors.append(np.hypot(*(difference(mapper.poses[0], match.pose) - difference(poses[0], pose))[:2]))
        loops.append(match.closed)
    first = int(np.flatnonzero(loops)[0])
    assert np.all(np.array(errors) < 3.0 * np.array(sigmas))
    assert max(sigmas[:first]) > 3.0 * sigmas[10] and sigmas[first] < 0.5 * max(sigmas[:first])
    assert np.sqrt(np.trace(mapper.local_covariance[:2, :2])) < 0.03


def test_glass_costs_a_third_of_the_beams_and_no_map():
    poses, rng, there, mapper = drive(0.5), np.random.default_rng(5), room(), Mapper()
    for k, (pose, told) in enumerate(zip(poses, drifted(poses, 1), strict=True)):
        points = scan(there, pose, rng)
        mapper.add(0.1 * k, points[rng.random(len(points)) > 0.3], told)
    mapper.finish()
    assert trajectory_error(mapper.poses, poses) < 0.05


def test_a_loop_that_was_closed_a_little_wrong_is_put_right_in_the_end(monkeypatch):
    monkeypatch.setattr(Mapper, "_look", lambda mapper: 0)
    poses, rng, there, mapper = drive(1.3), np.random.default_rng(1), room(), Mapper()
    for k, pose in enumerate(poses):
        mapper.add(0.1 * k, scan(there, pose, rng), pose)
    first, last = 2, len(mapper.keys) - 6
    wrong = np.array([0.2, 0.1, 0.0]) + difference(poses[mapper.keys[first].number], poses[mapper.keys[last].number])
    mapper.graph.link(first, last, wrong, 1e4 * np.eye(3), True)
    mapper.graph.optimise()
    assert trajectory_error(mapper.poses, poses) > 0.05
    mapper.finish()
    assert trajectory_error(mapper.poses, poses) < 0.01
