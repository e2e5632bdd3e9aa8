"""The line of a robot in its fleet: what it says of its last stop, and where it is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from txt1.control.hand import DEFAULT_HAND
from txt1.control.standstill import Stop
from txt1.fleet.members import Member, member_of

if TYPE_CHECKING:
    from txt1.robot import Robot


def robot(
    stands: bool = False,
    blind: bool = False,
    seen: Stop | None = None,
    pose: tuple[float, float, float] | None = None,
) -> Robot:
    """A robot of which only this is known."""
    made = SimpleNamespace(
        config=SimpleNamespace(name="net01", hand=lambda: DEFAULT_HAND),
        told="",
        armed=True,
        reason="",
        pose=pose,
        odometry=SimpleNamespace(x=1.0, y=2.0, theta=0.5, v=0.3, omega=0.1),
        driver=SimpleNamespace(name="web"),
        battery=SimpleNamespace(battery1=12.5),
        now=7.0,
        runtime=SimpleNamespace(stands=lambda now: stands and now == 7.0),
        hal=SimpleNamespace(capabilities=SimpleNamespace(blind=blind)),
        stop_state=seen,
    )
    return cast("Robot", made)


@pytest.mark.parametrize(
    ("stands", "blind", "seen", "said"),
    [
        (True, False, Stop.STANDING, Stop.STANDING),
        (True, False, None, Stop.STANDING),
        (False, False, Stop.STANDING, Stop.SLOWING),  # it stood, and moves again
        (False, False, None, Stop.SLOWING),
        (False, False, Stop.NONE, Stop.SLOWING),
        (False, False, Stop.UNSEEN, Stop.UNSEEN),
        (True, True, Stop.SLOWING, Stop.UNSEEN),
        (False, True, None, Stop.UNSEEN),
    ],
)
def test_a_robot_says_that_it_stands_only_if_it_was_seen_to_and_still_does(
    stands: bool, blind: bool, seen: Stop | None, said: Stop
) -> None:
    assert member_of(robot(stands, blind, seen)).stop == said


@pytest.mark.parametrize("pose", [None, (4.0, 5.0, 0.1)])
def test_a_robot_s_place_is_its_pose_in_the_room_and_without_one_its_odometry(
    pose: tuple[float, float, float] | None,
) -> None:
    place = pose or (1.0, 2.0, 0.5)
    assert member_of(robot(pose=pose), "net02", "a wall") == Member(
        "net01", True, "", place, 0.3, 0.1, "web", 12.5, None, None, True, "net02", Stop.SLOWING, "a wall", DEFAULT_HAND
    )
