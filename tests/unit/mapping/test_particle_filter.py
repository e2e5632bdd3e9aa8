"""Where the robot is on a map: from a given pose, from anywhere, carried away, in a wrong map."""

from math import degrees, hypot

import numpy as np
import pytest

from benchmarks.locating import believed, flat_of, kidnapped
from rigs.laser_logs import drifted
from tests.unit.mapping.rooms import BEAMS, drive, room, scan
from txt1.mapping import whole_map
from txt1.mapping.matcher import Cloud
from txt1.mapping.particle_filter import Located, Locator
from txt1.mapping.poses import composed, difference
from txt1.maps.grid import FREE, OCCUPIED, Grid
from txt1.maps.rays import cast

COUNT = 300  # particles are few, as their rays are cast by NumPy


def coarse() -> Grid:
    """The room at 5 cm, as a map has it."""
    fine = room()
    cells = fine.cells.reshape(120, 2, 160, 2).max(axis=(1, 3))
    return Grid(np.ascontiguousarray(cells), 0.05, fine.origin)


def followed(locator: Locator, poses, odometry, people: float = 0.0) -> list[tuple[Located, float, float]]:
    """What the filter told, and its errors in m and degrees."""
    rng, there, told = np.random.default_rng(1), room(), []
    for k, (pose, wheels) in enumerate(zip(poses, odometry, strict=True)):
        points = scan(there, pose, rng)
        if people:
            # somebody stands before some of the beams
            points[rng.random(len(points)) < people] *= 0.5
        found = locator.update(0.25 * k, points, wheels)
        off = difference(pose, found.pose)
        told.append((found, hypot(off[0], off[1]), abs(degrees(off[2]))))
    return told


def test_it_follows_from_a_given_pose_with_slip_and_people():
    poses = drive(0.5)
    locator = Locator(coarse(), 1, COUNT)
    locator.place(poses[0])
    told = followed(locator, poses, drifted(poses, 2), people=0.1)
    position, angle = (np.sqrt(np.mean(np.square([each[k] for each in told[5:]]))) for k in (1, 2))
    assert position < 0.05 and angle < 2.0
    assert not any(each.lost for each, _, _ in told[4:])
    assert all(hypot(each.covariance[0, 0], each.covariance[1, 1]) < 0.02 for each, _, _ in told[5:])


def test_told_its_place_alone_it_finds_its_heading():
    poses = drive(0.3)
    locator = Locator(coarse(), 1, COUNT)
    locator.place((*poses[0][:2] + 0.1, poses[0][2] + 2.0), (0.3, 2.0 * np.pi))
    told = followed(locator, poses, drifted(poses, 2))
    assert not any(each.lost for each, _, _ in told[-5:])
    assert told[-1][1] < 0.15 and told[-1][2] < 4.0


def test_a_pose_of_which_it_is_not_sure_must_not_be_used():
    poses = drive(0.1)
    locator = Locator(coarse(), 1, COUNT)
    locator.place(poses[0], (3.0, 0.1))
    # three rays tell little
    few = scan(room(), poses[0], np.random.default_rng(1))[:3]
    found = locator.update(0.0, few, poses[0])
    assert found.covariance[0, 0] + found.covariance[1, 1] > 0.5**2
    assert found.lost


def test_it_finds_itself_from_anywhere():
    poses = drive(0.6)[10:]
    told = followed(Locator(coarse(), 1, COUNT), poses, drifted(poses, 2))
    assert told[0][0].lost and told[1][0].lost
    assert not told[-1][0].lost and told[-1][1] < 0.15 and told[-1][2] < 4.0


def test_on_a_map_that_is_black_beyond_its_walls_it_finds_itself_from_anywhere():
    cells = np.pad(coarse().cells, 200, constant_values=OCCUPIED)
    x, y, _ = coarse().origin
    locator = Locator(Grid(cells, 0.05, (x - 10.0, y - 10.0, 0.0)), 1, COUNT)
    poses = drive(0.6)[10:]
    told = followed(locator, poses, drifted(poses, 2))
    assert not told[-1][0].lost and told[-1][1] < 0.15 and told[-1][2] < 4.0


def test_scans_are_weighed_while_the_whole_map_is_searched(monkeypatch):
    monkeypatch.setattr(whole_map, "LOOKS", 300_000)
    poses = drive(1.0)[10:]
    locator = Locator(coarse(), 1, COUNT)
    # a wrong pose: the search begins when scans do not fit
    locator.place(poses[0] + (1.0, -0.5, 2.0))
    told = followed(locator, poses, drifted(poses, 2))
    lost = [k for k, (each, _, _) in enumerate(told) if each.lost]
    # the filter has a pose for each scan of the search, which takes several
    assert len(lost) > 6 and len({tuple(told[k][0].pose) for k in lost}) == len(lost)
    assert not told[-1][0].lost and told[-1][1] < 0.15 and told[-1][2] < 4.0


def test_carried_away_it_says_so_and_finds_itself_again():
    poses = drive(1.6)
    there = np.concatenate((poses[:20], poses[70:120]))
    steps = np.concatenate(
        (difference(poses[:19], poses[1:20]), np.zeros((1, 3)), difference(poses[70:119], poses[71:120]))
    )
    wheels = [poses[0]]
    for step in steps:
        wheels.append(composed(wheels[-1], step))
    locator = Locator(coarse(), 1, COUNT)
    locator.place(poses[0])
    told = followed(locator, there, np.array(wheels))
    assert not told[18][0].lost
    assert any(each.lost for each, _, _ in told[21:40])
    assert not told[-1][0].lost and told[-1][1] < 0.15


def hall() -> Grid:
    """20 m x 14 m round (0, 0), with a closet of 2 m in a corner."""
    cells = np.full((280, 400), OCCUPIED, np.int8)
    cells[2:-2, 2:-2] = FREE
    cells[40:44, 2:42] = cells[2:40, 40:44] = OCCUPIED
    return Grid(cells, 0.05, (-10.0, -7.0, 0.0))


CLOSET = (-9.0, -6.0, 0.5)


def in_the_hall(poses, odometry, person: bool = False, blank: int = 1000) -> list[Located]:
    """What the filter told, placed at the first pose; the laser sees 4 m, ten times a second, with a person beside.
    From the scan `blank` on it sees nothing.
    """
    rng, locator, told = np.random.default_rng(1), Locator(hall(), 1, COUNT), []
    locator.place(poses[0], (0.03, 0.02))
    for k, (pose, wheels) in enumerate(zip(poses, odometry, strict=True)):
        points, ranges = scan(hall(), pose, rng, far=4.0), cast(hall(), *pose[:2], pose[2] + BEAMS, 4.0)
        if k >= blank:
            points, ranges = points[:0], np.full(len(BEAMS), np.inf)
        angles = BEAMS[~np.isfinite(ranges)]
        if person:
            points = np.concatenate((points, 0.8 * np.column_stack((np.cos(angles[-10:]), np.sin(angles[-10:])))))
            angles = angles[:-10]
        free = 2.5 * np.column_stack((np.cos(angles), np.sin(angles)))
        told.append(locator.update(0.1 * k, points, wheels, free, 4.0))
    return told


@pytest.mark.parametrize("person", [False, True])
def test_where_no_wall_is_in_reach_it_keeps_its_pose(person):
    x = np.arange(-4.0, 4.0, 0.05)
    poses = np.column_stack((x, np.zeros_like(x), np.zeros_like(x)))
    told = in_the_hall(poses, drifted(poses, 2), person)
    assert not any(each.lost for each in told)
    # it says that it knows less there
    assert told[-1].covariance.trace() > 5.0 * told[20].covariance.trace()


MIDDLE = (0.0, 0.0, 0.0)
CORNER = (7.0, 4.0, 0.8)  # its walls are 2.9 m away, and so is that of WALL
WALL = (7.0, 0.0, 0.0)


@pytest.mark.parametrize("places", [(MIDDLE, CLOSET), (CLOSET, MIDDLE), (CORNER, MIDDLE), (WALL, MIDDLE)])
def test_carried_where_more_or_less_is_in_reach_than_on_the_map_it_is_lost(places):
    told = in_the_hall(np.repeat(places, (10, 30), axis=0), np.zeros((40, 3)))
    assert not told[9].lost and all(each.lost for each in told[22:])


@pytest.mark.parametrize("place", [CLOSET, CORNER, WALL])
def test_a_laser_that_sees_no_wall_where_there_are_some_loses_the_robot(place):
    told = in_the_hall(np.repeat([place], 40, axis=0), np.zeros((40, 3)), blank=10)
    assert not told[9].lost and all(each.lost for each in told[22:])


def test_a_place_from_which_nothing_is_in_reach_does_not_tell_where_it_is():
    told = in_the_hall(np.repeat((MIDDLE, CLOSET, MIDDLE), (10, 15, 40), axis=0), np.zeros((65, 3)))
    assert all(each.lost and not each.foreign for each in told[22:])


def test_a_laser_that_has_seen_nothing_yet_does_not_call_the_map_foreign():
    way = np.linspace(CLOSET, MIDDLE, 100)
    poses = np.concatenate((np.repeat(way[:1], 15, axis=0), way, np.repeat(way[-1:], 30, axis=0)))
    told = in_the_hall(poses, poses, blank=0)
    # in the end it fits, but nothing seen bears it out
    assert told[-1].fit > 0.9
    assert all(each.lost and not each.foreign for each in told[15:])


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_in_a_room_that_looks_the_same_from_two_places_it_does_not_say_that_it_knows(seed):
    cells = np.full((90, 130), OCCUPIED, np.int8)
    cells[2:-2, 2:-2] = FREE
    hall, rng = Grid(cells, 0.05, (-3.25, -2.25, 0.0)), np.random.default_rng(seed)
    # it stands for a while, then drives
    way = np.concatenate((np.zeros(20), np.linspace(0.0, 2.0 * np.pi, 80)))
    x, y = 1.8 * np.cos(way), 1.2 * np.sin(way)
    poses = np.column_stack((x, y, np.arctan2(1.2 * np.cos(way), -1.8 * np.sin(way))))
    # few particles would not come near the best pose of each place
    locator = Locator(hall, seed)
    for k, (pose, wheels) in enumerate(zip(poses, drifted(poses, seed), strict=True)):
        found = locator.update(0.1 * k, scan(hall, pose, rng), wheels)
        assert found.lost
    assert found.alike


def test_places_alike_are_told_apart_by_driving_on():
    cells = np.full((200, 320), OCCUPIED, np.int8)
    # a corridor of 2 m round a block, with two alcoves
    cells[2:-2, 2:-2] = FREE
    cells[42:-42, 42:-42] = OCCUPIED
    cells[42:60, 200:220] = cells[130:150, 260:278] = FREE
    # at first other places are as likely
    assert kidnapped(Grid(cells, 0.05), 11)


def test_along_a_straight_corridor_every_place_may_be_that_of_the_robot():
    cells = np.full((40, 400), OCCUPIED, np.int8)
    cells[2:-2, 2:-2] = FREE
    corridor = Grid(cells, 0.05)
    # the walls of 4 m to each side
    along = np.arange(-4.0, 4.0, 0.1)
    points = np.concatenate([np.column_stack((along, np.full_like(along, y))) for y in (-0.925, 0.925)])
    search = Locator(corridor)._whole.places(Cloud(points, np.zeros_like(points)), 0.4)  # noqa: SLF001
    with pytest.raises(StopIteration) as ended:
        while True:
            next(search)
    x, _, theta = ended.value.value.T
    there = np.sort(x[np.abs(np.sin(theta)) < 0.1])
    inside = there[(there > 4.0) & (there < 16.0)]
    assert np.diff(inside).max() < 2.0


def test_another_flat_in_which_all_that_fits_would_be_behind_people_is_not_believed():
    # without a count of all rays, this drive ended with a pose on the wrong map
    assert believed(flat_of(4), flat_of(1004), 4) == (False, False)
    assert believed(flat_of(4), flat_of(4), 4) == (True, True)


def test_another_flat_that_fits_by_chance_in_some_scans_is_not_believed():
    # without the level of significance, three quarters of the rays of four scans were enough
    assert believed(flat_of(60), flat_of(1060), 60) == (False, False)
    assert believed(flat_of(60), flat_of(60), 60) == (True, True)


@pytest.mark.long
def test_in_a_wrong_map_it_stays_lost():
    cells = np.full((80, 90), OCCUPIED, np.int8)
    cells[2:-2, 2:-2] = FREE
    locator = Locator(Grid(cells, 0.05, (0.0, 0.0, 0.0)), 1, COUNT)
    poses = drive(0.4)
    told = followed(locator, poses, poses)
    assert np.mean([each.lost for each, _, _ in told]) > 0.9


def test_the_same_seed_gives_the_same_poses():
    poses = drive(0.1)[:4]
    one, other = ([each[0].pose for each in followed(Locator(coarse(), 7, 100), poses, poses)] for _ in range(2))
    assert np.array_equal(one, other)


def test_the_pose_that_saw_a_scan_weighs_most():
    poses = drive(1.0)
    points = scan(room(), poses[3], np.random.default_rng(1))
    weights = Locator(coarse(), 1).weights(poses, np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0]))
    assert np.argmax(weights) == 3
