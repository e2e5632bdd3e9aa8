"""Whoever reads bytes of strangers refuses them in his own words, and holds back no more than he must."""

import pytest

from torture.fuzz import HOSTILE, TARGETS, attack, feed_random, hostile_stream


def test_random_bytes_raise_no_error_and_hold_back_no_more_than_a_frame() -> None:
    assert int(feed_random(50_000).split()[0]) >= 50_000


def test_every_hostile_stream_is_bounded_whatever_its_length() -> None:
    assert len(HOSTILE) == 20
    for name in HOSTILE:
        hostile_stream(name, (2_000, 8_000))


@pytest.mark.parametrize(
    "target, count",
    [
        *(
            ("decoder", 300),
            ("setting", 150),
            ("file", 60),
            ("recording", 8),
            ("view", 300),
            ("policy", 60),
            ("map", 60),
        ),
        *(pytest.param(target, 40, marks=pytest.mark.long) for target in ("table", "replay")),
    ],
)
def test_changed_inputs_are_refused_and_nothing_else(target: str, count: int) -> None:
    assert attack(target, count, seed=1) is None


def test_an_input_that_somebody_cannot_take_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    def clumsy(data: bytes) -> None:
        raise KeyError("clumsy")

    monkeypatch.chdir(str(tmp_path))
    monkeypatch.setitem(TARGETS, "view", clumsy)
    assert "--target view --input out/torture/view-0.bin" in (attack("view", 5) or "")
