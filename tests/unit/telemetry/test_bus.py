"""The bus: who has something to tell, who listens, and when it is told."""

from typing import Any

from txt1.telemetry.bus import Bus
from txt1.telemetry.topics import Rule, Topic

SPEED = Topic("/speed", float, "m/s", "std_msgs/Float64", Rule.CYCLE, "a number of every cycle")
WAY = Topic("/way", float, "m", "std_msgs/Float64", Rule.CYCLE, "another one")
MOOD = Topic("/mood", str, "", "std_msgs/String", Rule.CHANGE, "a text that seldom changes")
ALONE = Topic("/alone", float, "", "std_msgs/Float64", Rule.CYCLE, "offered by somebody else")

Told = list[tuple[str, Any, float]]


def listening(bus: Bus, *topics: Topic[Any]) -> Told:
    """What is told from now on, of these topics or of all."""
    told: Told = []
    bus.subscribe(lambda topic, value, time: told.append((topic.name, value, time)), topics or None)
    return told


def test_a_row_is_read_once_a_cycle_and_told_by_the_topics_rules() -> None:
    bus, looks, now = Bus(), 0, [1.0, 2.0, "calm"]

    def read() -> tuple[Any, ...]:
        nonlocal looks
        looks += 1
        return tuple(now)

    bus.offer_row([SPEED, WAY, MOOD], read)
    bus.offer(ALONE, lambda: 7.0)
    told = listening(bus)
    bus.sample(0.02)
    bus.sample(0.04)
    now[2] = "upset"
    bus.sample(0.06)
    assert looks == 3
    assert [one for one in told if one[0] != "/mood"] == [
        (name, value, time)
        for time in (0.02, 0.04, 0.06)
        for name, value in (("/speed", 1.0), ("/way", 2.0), ("/alone", 7.0))
    ]
    assert [one for one in told if one[0] == "/mood"] == [("/mood", "calm", 0.02), ("/mood", "upset", 0.06)]
    assert (bus.read(WAY), bus.read(MOOD), bus.offered) == (2.0, "upset", (SPEED, WAY, MOOD, ALONE))


def test_what_a_row_does_not_know_is_not_told() -> None:
    bus = Bus()
    bus.offer_row([SPEED, WAY, MOOD], lambda: (None, 2.0, None))
    told = listening(bus)
    bus.sample(0.02)
    assert told == [("/way", 2.0, 0.02)]


def test_a_row_nobody_listens_to_is_not_read() -> None:
    bus, looks = Bus(), 0

    def read() -> tuple[Any, ...]:
        nonlocal looks
        looks += 1
        return 1.0, "calm"

    bus.offer_row([SPEED, MOOD], read)
    bus.sample(0.02)
    assert looks == 0
    told = listening(bus, MOOD)
    bus.sample(0.04)
    assert told == [("/mood", "calm", 0.04)]


def test_who_comes_late_is_told_what_changed_before_and_so_is_everybody() -> None:
    bus = Bus()
    bus.offer_row([SPEED, MOOD], lambda: (1.0, "calm"))
    first = listening(bus, MOOD)
    bus.sample(0.02)
    late = listening(bus, MOOD)
    bus.sample(0.04)
    assert first == [("/mood", "calm", 0.02), ("/mood", "calm", 0.04)]
    assert late == [("/mood", "calm", 0.04)]


def test_what_changed_last_is_told_before_nothing_comes_any_more() -> None:
    bus, mood = Bus(), "calm"
    bus.offer_row([SPEED, MOOD], lambda: (1.0, mood))
    told = listening(bus, MOOD)
    bus.sample(0.02)
    mood = "upset"
    bus.flush(0.03)
    assert told[-1] == ("/mood", "upset", 0.03)


def test_two_who_listen_to_different_topics_of_a_row_each_hear_their_own() -> None:
    bus = Bus()
    bus.offer_row([SPEED, WAY, MOOD], lambda: (1.0, 2.0, "calm"))
    speed, way = listening(bus, SPEED), listening(bus, WAY)
    bus.sample(0.02)
    assert (speed, way) == ([("/speed", 1.0, 0.02)], [("/way", 2.0, 0.02)])
