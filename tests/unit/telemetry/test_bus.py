"""The bus: who has something to tell, who listens, and when it is told."""

from dataclasses import replace
from typing import Any

from txt1.telemetry.bus import Bus
from txt1.telemetry.topics import Rule, Topic

SPEED = Topic("/speed", float, "m/s", "std_msgs/Float64", Rule.CYCLE, "a number of every cycle")
WAY = Topic("/way", float, "m", "std_msgs/Float64", Rule.CYCLE, "another one")
MOOD = Topic("/mood", str, "", "std_msgs/String", Rule.CHANGE, "a text that seldom changes")

Told = list[tuple[str, Any, float]]


def listening(bus: Bus, *topics: Topic[Any]) -> Told:
    """What is told from now on, of these topics or of all."""
    told: Told = []
    bus.subscribe(lambda topic, value, time: told.append((topic.name, value, time)), topics or None)
    return told


def offering(bus: Bus, *values: Any) -> None:
    """Offer speed, way and mood with these values."""
    for topic, value in zip((SPEED, WAY, MOOD), values, strict=True):
        bus.offer(topic, lambda value=value: value)


def test_each_topic_is_told_by_its_rule_in_the_order_of_the_offers() -> None:
    bus, mood = Bus(), "calm"
    bus.offer(SPEED, lambda: 1.0)
    bus.offer(MOOD, lambda: mood)
    bus.offer(WAY, lambda: 2.0)
    told = listening(bus)
    bus.sample(0.02)
    bus.sample(0.04)
    mood = "upset"
    bus.sample(0.06)
    cycles = [[("/speed", 1.0, time), ("/way", 2.0, time)] for time in (0.02, 0.04, 0.06)]
    assert told == [*cycles[0], ("/mood", "calm", 0.02), *cycles[1], *cycles[2], ("/mood", "upset", 0.06)]
    assert (bus.read(WAY), bus.read(MOOD), bus.offered) == (2.0, "upset", (SPEED, MOOD, WAY))


def test_what_is_the_same_in_another_object_has_not_changed() -> None:
    bus = Bus()
    bus.offer(MOOD, lambda: "".join(("ca", "lm")))
    told = listening(bus)
    bus.sample(0.02)
    bus.sample(0.04)
    assert told == [("/mood", "calm", 0.02)]


def test_unknown_values_are_not_published() -> None:
    bus = Bus()
    offering(bus, None, 2.0, None)
    told = listening(bus)
    bus.sample(0.02)
    assert told == [("/way", 2.0, 0.02)]


def test_a_topic_without_a_subscriber_is_not_read() -> None:
    bus, looks = Bus(), 0

    def read() -> float:
        nonlocal looks
        looks += 1
        return 1.0

    bus.offer(SPEED, read)
    bus.offer(MOOD, lambda: "calm")
    told = listening(bus, MOOD)
    bus.sample(0.02)
    assert (looks, told) == (0, [("/mood", "calm", 0.02)])
    leave = bus.subscribe(lambda topic, value, time: None, [SPEED])
    bus.sample(0.04)
    leave()
    bus.sample(0.06)
    assert looks == 1


def test_sampling_begins_with_the_first_subscriber_of_a_sampled_topic() -> None:
    begun = []
    bus = Bus(begin=lambda: begun.append(True))
    bus.offer(SPEED, lambda: 1.0)
    listening(bus, MOOD)
    assert not begun
    for _ in range(2):
        listening(bus, SPEED)
    assert begun == [True]


def test_a_late_subscriber_gets_earlier_changes_and_so_do_all_subscribers() -> None:
    bus = Bus()
    offering(bus, 1.0, 2.0, "calm")
    first = listening(bus, MOOD)
    bus.sample(0.02)
    late = listening(bus, MOOD)
    bus.sample(0.04)
    assert first == [("/mood", "calm", 0.02), ("/mood", "calm", 0.04)]
    assert late == [("/mood", "calm", 0.04)]


def test_what_changed_last_is_told_before_nothing_comes_any_more() -> None:
    bus, mood = Bus(), "calm"
    bus.offer(MOOD, lambda: mood)
    told = listening(bus, MOOD)
    bus.sample(0.02)
    mood = "upset"
    bus.flush(0.03)
    assert told[-1] == ("/mood", "upset", 0.03)


def test_two_who_listen_to_different_topics_each_hear_their_own() -> None:
    bus = Bus()
    offering(bus, 1.0, 2.0, "calm")
    speed, way = listening(bus, SPEED), listening(bus, WAY)
    bus.sample(0.02)
    assert (speed, way) == ([("/speed", 1.0, 0.02)], [("/way", 2.0, 0.02)])


def test_who_takes_whole_cycles_is_told_their_numbers_in_one_call() -> None:
    number = replace(SPEED, paths=("data",), make=lambda value: (value,))
    other = replace(WAY, paths=("data",), make=lambda value: (value,))
    bus, told, beside = Bus(), Told(), Told()
    bus.subscribe(
        lambda topic, value, time: told.append((topic.name, value, time)),
        cycle=lambda topics, values, time: told.append((",".join(each.name for each in topics), values, time)),
    )
    bus.offer(number, lambda: 1.0)
    bus.offer(MOOD, lambda: "calm")
    bus.offer(other, lambda: None)
    bus.subscribe(lambda topic, value, time: beside.append((topic.name, value, time)))
    bus.sample(0.02)
    assert told == [("/speed,/way", [1.0, None], 0.02), ("/mood", "calm", 0.02)]
    assert beside == [("/speed", 1.0, 0.02), ("/mood", "calm", 0.02)]


def test_who_takes_whole_cycles_is_told_numbers_that_are_published_one_by_one() -> None:
    number = replace(SPEED, paths=("data",), make=lambda value: (value,))
    bus, told = Bus(), Told()
    bus.subscribe(
        lambda topic, value, time: told.append((topic.name, value, time)), cycle=lambda topics, values, time: None
    )
    assert bus.wanted(number)
    bus.publish(number, 1.0, 0.02)
    assert told == [("/speed", 1.0, 0.02)]
